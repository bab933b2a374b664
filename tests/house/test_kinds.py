"""What an asset is, is asked of the asset: code that branches on its kind is counted, and listed."""

import ast
from collections import Counter
from pathlib import Path

import diffprt
from diffprt.representation.registry import HOMES, kind_of

SOURCES = Path(diffprt.__file__).parent
REGISTRY = "representation/registry.py"
KINDS = [kind_of(name) for name in HOMES]
# Classes that tell kinds apart, the bases between them included, and names that a tensor of some kind has.
CLASSES = {base.__name__ for kind in KINDS for base in kind.__mro__ if base.__module__.startswith("diffprt.")}
TENSORS = {tensor for kind in KINDS for tensor in kind.spec}

# Files that branch, how often, and why they may. At most six in the tree.
ALLOWED = {
    "representation/files.py": 1,
}


def branches(tree: ast.AST) -> list[ast.AST]:
    """isinstance, issubclass, type(x), class patterns, hasattr and comparisons of names that tell kinds apart."""
    return [node for node in ast.walk(tree) if is_branch(node)]


def is_branch(node: ast.AST) -> bool:
    match node:
        case ast.Call(func=ast.Name("isinstance" | "issubclass"), args=[_, classes]):
            return bool(names(classes) & CLASSES)
        case ast.Call(func=ast.Name("hasattr"), args=[_, name]) | ast.Call(func=ast.Name("getattr"), args=[_, name, _]):
            return bool(strings(name) & TENSORS)
        case ast.Compare():
            of_type = any(isinstance(part, ast.Name) and part.id == "type" for part in ast.walk(node))
            return bool((of_type and names(node) & CLASSES) or strings(node) & set(HOMES))
        case ast.MatchClass(cls=kind):
            return bool(names(kind) & CLASSES)
        case ast.MatchValue(value=value):
            return bool(names(value) & CLASSES or strings(value) & set(HOMES))
    return False


def names(tree: ast.AST) -> set[str]:
    words = (getattr(part, "id", None) or getattr(part, "attr", None) for part in ast.walk(tree))
    return set(filter(None, words))


def strings(tree: ast.AST) -> set[str]:
    parts = (part.value for part in ast.walk(tree) if isinstance(part, ast.Constant))
    return {value for value in parts if isinstance(value, str)}


def test_every_way_to_branch_is_seen():
    for line in (
        "isinstance(a, Transfer)",
        "issubclass(a, (int, diffprt.GlossyTransfer))",
        "type(a) is ClusteredTransfer",
        "hasattr(a, 'glossy')",
        "getattr(a, 'diffuse', None)",
        "a.name == 'glossy_transfer'",
        "header['type'] in ('transfer', 'clustered_transfer')",
        "match a:\n    case Transfer():\n        pass",
        "match a.name:\n    case 'transfer':\n        pass",
    ):
        assert len(branches(ast.parse(line))) == 1, line
    for line in ("isinstance(a, str)", "a.name == 'sky'", "hasattr(os, 'getloadavg')", "getattr(a, 'diffuse')"):
        assert not branches(ast.parse(line)), line


def test_at_most_six_branches_on_a_kind():
    found = Counter()
    for path in sorted(SOURCES.rglob("*.py")):
        name = path.relative_to(SOURCES).as_posix()
        if name != REGISTRY:
            found[name] = len(branches(ast.parse(path.read_text("utf-8"))))
    assert len(found) > 200
    assert dict(+found) == ALLOWED
    assert sum(ALLOWED.values()) <= 6
