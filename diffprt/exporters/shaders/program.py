"""Reads the shaders' one source: files of `programs/`, in the syntax of Python and the types of shading languages.

A file is a program: declarations, functions, and the entry points `vertex` and `fragment`, which take no arguments.

    position: attribute[vec3]           what each vertex has
    radiance: varying[vec3]             what the vertex stage hands to the fragment stage; `flat` is not interpolated
    color: target[vec4]                 what the fragment stage writes
    components: uniform[int]            what is the same for a whole draw; uniform[vec4, 256] is an array
    weights: table                      a texture of four floats a texel, read with `fetch(weights, ivec2(x, y))`

Types are float, int, uint, vec2 to vec4, ivec2, ivec3, mat3 and mat4. Statements are assignments (with the type where
a variable begins), `if`, `for i in range(...)` and `return`; expressions are arithmetic, comparisons, `a if b else c`,
swizzles, indices and calls. Entry points read `vertexIndex` (int) and `pixel` (ivec2, from the first row in memory)
and write `clipPosition`. `from other import name` brings in what another file has. Comments and docstrings are kept.
"""

from __future__ import annotations

import ast
import io
import tokenize
from dataclasses import dataclass, field, replace
from importlib.resources import files

from diffprt.errors import InputError

KINDS = ("attribute", "varying", "flat", "target", "uniform", "table")
STAGES = ("vertex", "fragment")


@dataclass(frozen=True)
class Declaration:
    """A name outside the functions: one of `KINDS`, its type, how many of them, and the comment beside it."""

    name: str
    kind: str
    type: str
    length: int = 0
    comment: str = ""


@dataclass(frozen=True)
class Function:
    """A function as it was parsed; statements carry comments as `before` and `beside`, and the `gap` above them."""

    name: str
    arguments: list[tuple[str, str]]
    returns: str
    body: list[ast.stmt]
    comment: str

    def names(self) -> set[str]:
        """Every name that the body mentions and that is not the function's own."""
        own = {name for name, _ in self.arguments}
        nodes = [node for statement in self.body for node in ast.walk(statement)]
        own |= {node.target.id for node in nodes if isinstance(node, (ast.AnnAssign, ast.For))}
        return {node.id for node in nodes if isinstance(node, ast.Name)} - own


@dataclass(frozen=True)
class Program:
    """What a file holds, with what it imports; in the order of the files."""

    name: str
    comment: str
    declarations: dict[str, Declaration] = field(default_factory=dict)
    functions: dict[str, Function] = field(default_factory=dict)

    @property
    def stages(self) -> list[str]:
        """The entry points of this program."""
        return [stage for stage in STAGES if stage in self.functions]

    def reached_from(self, entry: str) -> Program:
        """This program without what the function `entry` and those that it calls do not mention."""
        wanted, found = {entry}, set()
        while wanted:
            found |= wanted
            mentioned = set().union(*(self.functions[name].names() for name in wanted))
            wanted = {name for name in mentioned if name in self.functions} - found
        mentioned = set().union(*(self.functions[name].names() for name in found))
        return replace(
            self,
            # The stages must agree on all that is handed over.
            declarations={
                name: entry
                for name, entry in self.declarations.items()
                if name in mentioned or entry.kind in ("varying", "flat")
            },
            functions={name: function for name, function in self.functions.items() if name in found},
        )


def program_names() -> list[str]:
    """Programs with an entry point, sorted."""
    folder = files("diffprt.exporters.shaders") / "programs"
    names = sorted(entry.name.removesuffix(".shader") for entry in folder.iterdir() if entry.name.endswith(".shader"))
    return [name for name in names if read_program(name).stages]


def read_program(name: str, sizes: dict[str, int] | None = None) -> Program:
    """The program of a file of `programs/`.

    Args:
        name: of the file, without ".shader".
        sizes: lengths of arrays that the file names in capitals, in place of those it gives itself.

    Raises:
        InputError: there is no such file.
    """
    file = files("diffprt.exporters.shaders") / "programs" / f"{name}.shader"
    if not file.is_file():
        raise InputError(f"shader '{name}' is unknown: use one of {', '.join(program_names())}")
    text = file.read_text(encoding="utf-8")
    tree = ast.parse(text)
    _attach_comments(tree, text)
    lengths: dict[str, int] = {}
    declarations: dict[str, Declaration] = {}
    functions: dict[str, Function] = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            other = read_program(node.module, sizes)
            declarations.update(other.declarations)
            functions.update(other.functions)
        elif isinstance(node, ast.Assign):
            lengths[node.targets[0].id] = node.value.value
            lengths.update({key: value for key, value in (sizes or {}).items() if key in lengths})
        elif isinstance(node, ast.AnnAssign):
            declarations[node.target.id] = _declaration(node, lengths)
        elif isinstance(node, ast.FunctionDef):
            functions[node.name] = _function(node)
    return Program(name, ast.get_docstring(tree) or "", declarations, functions)


def _declaration(node: ast.AnnAssign, lengths: dict[str, int]) -> Declaration:
    annotation = node.annotation
    if isinstance(annotation, ast.Name):
        return Declaration(node.target.id, annotation.id, "vec4", comment=node.beside)
    kind, inner = annotation.value.id, annotation.slice
    if isinstance(inner, ast.Tuple):
        return Declaration(node.target.id, kind, inner.elts[0].id, lengths[inner.elts[1].id], node.beside)
    return Declaration(node.target.id, kind, inner.id, comment=node.beside)


def _function(node: ast.FunctionDef) -> Function:
    comment = ast.get_docstring(node) or ""
    return Function(
        node.name,
        [(argument.arg, argument.annotation.id) for argument in node.args.args],
        node.returns.id if node.returns else "void",
        node.body[1:] if comment else node.body,
        comment,
    )


def _attach_comments(tree: ast.Module, text: str) -> None:
    lines = text.splitlines()
    comments = {
        token.start[0]: token.string.lstrip("# ")
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT
    }
    alone = {line for line in comments if lines[line - 1].lstrip().startswith("#")}
    for node in ast.walk(tree):
        if isinstance(node, ast.stmt):
            first = node.lineno
            while first - 1 in alone:
                first -= 1
            node.before = [comments[line] for line in range(first, node.lineno)]
            node.gap = not lines[first - 2].strip()
            # A block's own comment stands beside its first line, a simple statement's beside its last.
            last = node.lineno if hasattr(node, "body") else node.end_lineno
            node.beside = comments.get(last, "") if last not in alone else ""
