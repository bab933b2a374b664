"""What the four shading languages share: the structure of statements and expressions."""

from __future__ import annotations

import ast
import textwrap
from abc import ABC, abstractmethod
from typing import ClassVar

from diffprt.exporters.shaders.program import Declaration, Function, Program

_BINARY = {ast.Add: ("+", 5), ast.Sub: ("-", 5), ast.Mult: ("*", 6), ast.Div: ("/", 6), ast.FloorDiv: ("/", 6)}
_BINARY[ast.Mod] = ("%", 6)
_COMPARE = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_LOGIC = {ast.And: ("&&", 2), ast.Or: ("||", 1)}
_UNARY_RANK, _COMPARE_RANK, _CHOICE_RANK, _ATOM = 7, 4, 0, 9


class Printer(ABC):
    """Prints one stage of a program; a language is a subclass.

    Args:
        program: the whole program; only what the stage reaches is printed.
        stage: one of `STAGES`.
    """

    types: ClassVar[dict[str, str]]

    def __init__(self, program: Program, stage: str) -> None:
        self.program = program.reached_from(stage)
        self.stage = stage
        self.reassigned: set[str] = set()
        self.outside: set[str] = set()

    def text(self) -> str:
        """The shader, ready to compile."""
        parts = [self.header(), self.interface()]
        for name, function in self.program.functions.items():
            parts.append(self.entry(function) if name == self.stage else self.function(function))
        return "\n\n".join(part for part in parts if part) + "\n"

    @abstractmethod
    def header(self) -> str:
        """What comes first: version, precision, the program's comment."""

    @abstractmethod
    def interface(self) -> str:
        """Declarations of attributes, varyings, targets, uniforms and tables."""

    @abstractmethod
    def entry(self, function: Function) -> str:
        """The entry point."""

    @abstractmethod
    def variable(self, name: str, type_name: str, value: str) -> str:
        """The statement in which a variable begins."""

    @abstractmethod
    def signature(self, function: Function) -> str:
        """The first line of a function, without its brace."""

    def of_kind(self, *kinds: str) -> list[Declaration]:
        """The declarations of these kinds, in order."""
        return [entry for entry in self.program.declarations.values() if entry.kind in kinds]

    def function(self, function: Function) -> str:
        """A function that is not an entry point."""
        return f"{self.comment(function.comment)}{self.signature(function)} {{\n{self.block(function)}\n}}"

    def comment(self, text: str) -> str:
        """Comment lines, each with its line break."""
        paragraphs = [textwrap.wrap(" ".join(part.split()), 112) for part in text.split("\n\n")]
        lines = [line for paragraph in paragraphs for line in ["", *paragraph]][1:]
        return "".join(f"// {line}".rstrip() + "\n" for line in lines)

    def block(self, function: Function) -> str:
        """The statements of a function."""
        self.outside = function.names()
        targets = [
            node.target if isinstance(node, ast.AugAssign) else node.targets[0]
            for statement in function.body
            for node in ast.walk(statement)
            if isinstance(node, (ast.AugAssign, ast.Assign))
        ]
        self.reassigned = {_root(target) for target in targets}
        return "\n".join(self.statements(function.body, 1))

    def statements(self, body: list[ast.stmt], depth: int) -> list[str]:
        """Lines of statements."""
        indent = "  " * depth
        lines = []
        for node in body:
            lines += [""] * (node.gap and node is not body[0])
            lines += [f"{indent}// {text}" for text in node.before]
            first, *rest = self.statement(node, depth)
            lines += [indent + first + (f" // {node.beside}" if node.beside else ""), *rest]
        return lines

    def statement(self, node: ast.stmt, depth: int) -> list[str]:
        """The lines of a statement; the first without indentation."""
        indent = "  " * depth
        match node:
            case ast.AnnAssign():
                return [self.variable(node.target.id, node.annotation.id, self.expression(node.value))]
            case ast.Assign():
                return [f"{self.expression(node.targets[0])} = {self.expression(node.value)};"]
            case ast.AugAssign():
                operator = _BINARY[type(node.op)][0]
                return [f"{self.expression(node.target)} {operator}= {self.expression(node.value)};"]
            case ast.Return():
                return [f"return {self.expression(node.value)};"]
            case ast.If():
                lines = [f"if ({self.expression(node.test)}) {{", *self.statements(node.body, depth + 1)]
                if node.orelse:
                    lines += [f"{indent}}} else {{", *self.statements(node.orelse, depth + 1)]
                return [*lines, f"{indent}}}"]
            case ast.For():
                bounds = [self.expression(argument) for argument in node.iter.args]
                start, stop = bounds if len(bounds) == 2 else ("0", bounds[0])
                head = self.loop(node.target.id, start, stop)
                return [f"for ({head}) {{", *self.statements(node.body, depth + 1), f"{indent}}}"]
        raise self.unprintable(node)

    def unprintable(self, node: ast.AST) -> NotImplementedError:
        """What is raised where the language admits a construct that no printer knows yet."""
        place = f"line {node.lineno} of {self.program.name}.shader"
        return NotImplementedError(f"{place}: no printer knows {ast.unparse(node)}; add a case for it")

    def loop(self, name: str, start: str, stop: str) -> str:
        """The head of a counting loop."""
        return f"int {name} = {start}; {name} < {stop}; {name}++"

    def expression(self, node: ast.expr, rank: int = -1) -> str:
        """An expression; in parentheses where it binds less than `rank`."""
        text, own = self.ranked(node)
        return f"({text})" if own < rank else text

    def ranked(self, node: ast.expr) -> tuple[str, int]:
        """An expression and how strongly it binds."""
        match node:
            case ast.Constant():
                return repr(node.value), _ATOM
            case ast.Name():
                return self.name(node.id), _ATOM
            case ast.Attribute():
                return f"{self.expression(node.value, _ATOM)}.{node.attr}", _ATOM
            case ast.Subscript():
                return f"{self.expression(node.value, _ATOM)}[{self.expression(node.slice)}]", _ATOM
            case ast.Call():
                return self.call(node.func.id, node.args)
            case ast.BinOp():
                symbol, rank = _BINARY[type(node.op)]
                return f"{self.expression(node.left, rank)} {symbol} {self.expression(node.right, rank + 1)}", rank
            case ast.UnaryOp():
                return f"-{self.expression(node.operand, _UNARY_RANK)}", _UNARY_RANK
            case ast.Compare():
                left, right = (self.expression(side, _COMPARE_RANK + 1) for side in (node.left, node.comparators[0]))
                return f"{left} {_COMPARE[type(node.ops[0])]} {right}", _COMPARE_RANK
            case ast.BoolOp():
                symbol, rank = _LOGIC[type(node.op)]
                return f" {symbol} ".join(self.expression(value, rank + 1) for value in node.values), rank
            case ast.IfExp():
                return self.choice(node)
        raise self.unprintable(node)

    def choice(self, node: ast.IfExp) -> tuple[str, int]:
        """a if b else c."""
        parts = [self.expression(part, _CHOICE_RANK + 1) for part in (node.test, node.body, node.orelse)]
        return "{} ? {} : {}".format(*parts), _CHOICE_RANK

    def name(self, name: str) -> str:
        """How a variable is called; `global_name` where it is not the function's own."""
        return self.global_name(name) if name in self.outside else name

    @abstractmethod
    def global_name(self, name: str) -> str:
        """How an input, an output or a uniform is called."""

    def call(self, name: str, arguments: list[ast.expr]) -> tuple[str, int]:
        """A call of an intrinsic, a constructor or a function of the program, and how strongly it binds."""
        texts = [self.expression(argument) for argument in arguments]
        return f"{self.types.get(name, name)}({', '.join(texts)})", _ATOM


def _root(target: ast.expr) -> str:
    while not isinstance(target, ast.Name):
        target = target.value
    return target.id
