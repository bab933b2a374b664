"""GLSL: ES 3.00 for WebGL 2 and phones, 3.30 for desktops."""

from __future__ import annotations

import ast
from typing import ClassVar

from diffprt.exporters.shaders.printer import Printer
from diffprt.exporters.shaders.program import Declaration, Function

_NAMES = {"vertexIndex": "gl_VertexID", "clipPosition": "gl_Position", "pixel": "ivec2(gl_FragCoord.xy)"}


class DesktopGlslPrinter(Printer):
    """GLSL 3.30 core."""

    types: ClassVar[dict[str, str]] = {}
    version = "#version 330 core\n"
    precision = ""

    def header(self) -> str:
        return f"{self.version}{self.comment(self.program.comment)}{self.precision}".rstrip()

    def interface(self) -> str:
        lines = []
        for location, entry in enumerate(self.of_kind("attribute", "target")):
            direction = "in" if entry.kind == "attribute" else "out"
            lines.append(_declared(f"layout(location = {location}) {direction} ", entry))
        for entry in self.of_kind("varying", "flat"):
            direction = "out" if self.stage == "vertex" else "in"
            # Whole numbers cannot be interpolated.
            lines.append(_declared(f"{'flat ' if entry.kind == 'flat' else ''}{direction} ", entry))
        lines += [_declared("uniform ", entry) for entry in self.of_kind("uniform")]
        for entry in self.of_kind("table"):
            lines.append(f"uniform sampler2D {entry.name};" + _beside(entry))
        if self.stage == "vertex":
            lines.append("invariant gl_Position; // the same depth in every pass")
        return "\n".join(lines)

    def entry(self, function: Function) -> str:
        return f"{self.comment(function.comment)}void main() {{\n{self.block(function)}\n}}"

    def signature(self, function: Function) -> str:
        arguments = ", ".join(f"{type_name} {name}" for name, type_name in function.arguments)
        return f"{function.returns} {function.name}({arguments})"

    def variable(self, name: str, type_name: str, value: str) -> str:
        return f"{type_name} {name} = {value};"

    def global_name(self, name: str) -> str:
        return _NAMES.get(name, name)

    def call(self, name: str, arguments: list[ast.expr]) -> tuple[str, int]:
        texts = [self.expression(argument) for argument in arguments]
        if name == "fetch":
            return f"texelFetch({texts[0]}, {texts[1]}, 0)", 9
        if name == "size":
            return f"textureSize({texts[0]}, 0)", 9
        if name == "transform":
            return f"{self.expression(arguments[0], 6)} * {self.expression(arguments[1], 7)}", 6
        return super().call(name, arguments)


class GlslEsPrinter(DesktopGlslPrinter):
    """GLSL ES 3.00."""

    version = "#version 300 es\n"
    precision = "precision highp float;\nprecision highp int;\nprecision highp sampler2D;\n"


def _declared(before: str, entry: Declaration) -> str:
    length = f"[{entry.length}]" if entry.length else ""
    return f"{before}{entry.type} {entry.name}{length};{_beside(entry)}"


def _beside(entry: Declaration) -> str:
    return f" // {entry.comment}" if entry.comment else ""
