"""WGSL: inputs and outputs are structures, uniforms one structure in binding 0, tables the bindings after it."""

from __future__ import annotations

import ast
from typing import ClassVar

from diffprt.exporters.shaders.printer import Printer
from diffprt.exporters.shaders.program import Declaration, Function


class WgslPrinter(Printer):
    """WGSL with the entry point `main`; every binding is in group 0."""

    types: ClassVar[dict[str, str]] = {
        **{"float": "f32", "int": "i32", "uint": "u32"},
        **{f"vec{n}": f"vec{n}f" for n in (2, 3, 4)},
        **{f"ivec{n}": f"vec{n}i" for n in (2, 3)},
        **{f"mat{n}": f"mat{n}x{n}f" for n in (3, 4)},
    }

    def header(self) -> str:
        return self.comment(self.program.comment).rstrip()

    def interface(self) -> str:
        parts = []
        if uniforms := self.of_kind("uniform"):
            lines = [f"  {entry.name}: {self.kind(entry)},{_beside(entry)}" for entry in uniforms]
            parts.append("\n".join(["struct Uniforms {", *lines, "}"]))
            parts.append("@group(0) @binding(0) var<uniform> uniforms: Uniforms;")
        for binding, entry in enumerate(self.of_kind("table"), 1):
            parts.append(f"@group(0) @binding({binding}) var {entry.name}: texture_2d<f32>;{_beside(entry)}")
        if self.stage == "vertex":
            lines = ["  @builtin(vertex_index) vertexIndex: u32,"]
            lines += self.located("attribute")
            parts.append("\n".join(["struct Attributes {", *lines, "}"]))
        invariant = "@invariant " if self.stage == "vertex" else ""
        lines = [f"  {invariant}@builtin(position) clipPosition: vec4f,", *self.located("varying", "flat")]
        parts.append("\n".join(["struct Varyings {", *lines, "}"]))
        return "\n\n".join(parts)

    def kind(self, entry: Declaration) -> str:
        """The type of a declaration."""
        name = self.types[entry.type]
        return f"array<{name}, {entry.length}>" if entry.length else name

    def located(self, *kinds: str) -> list[str]:
        """Members of a structure, each with its location."""
        flat = {"flat": " @interpolate(flat)"}
        return [
            f"  @location({place}){flat.get(entry.kind, '')} {entry.name}: {self.kind(entry)},{_beside(entry)}"
            for place, entry in enumerate(self.of_kind(*kinds))
        ]

    def entry(self, function: Function) -> str:
        comment, block = self.comment(function.comment), self.block(function)
        if self.stage == "vertex":
            return (
                f"{comment}@vertex\nfn main(attributes: Attributes) -> Varyings {{\n"
                f"  var varyings: Varyings;\n{block}\n  return varyings;\n}}"
            )
        (target,) = self.of_kind("target")
        kind = self.kind(target)
        return (
            f"{comment}@fragment\nfn main(varyings: Varyings) -> @location(0) {kind} {{\n  var {target.name}: {kind};\n"
            f"{block}\n  return {target.name};\n}}"
        )

    def signature(self, function: Function) -> str:
        arguments = ", ".join(f"{name}: {self.types[kind]}" for name, kind in function.arguments)
        return f"fn {function.name}({arguments}) -> {self.types[function.returns]}"

    def variable(self, name: str, type_name: str, value: str) -> str:
        return f"{'var' if name in self.reassigned else 'let'} {name}: {self.types[type_name]} = {value};"

    def loop(self, name: str, start: str, stop: str) -> str:
        return f"var {name} = {start}; {name} < {stop}; {name}++"

    def choice(self, node: ast.IfExp) -> tuple[str, int]:
        parts = [self.expression(part) for part in (node.orelse, node.body, node.test)]
        return f"select({', '.join(parts)})", 9

    def global_name(self, name: str) -> str:
        if name == "vertexIndex":
            return "i32(attributes.vertexIndex)"
        if name == "pixel":
            return "vec2i(varyings.clipPosition.xy)"
        if name == "clipPosition":
            return "varyings.clipPosition"
        kind = self.program.declarations[name].kind if name in self.program.declarations else ""
        places = {"attribute": "attributes.", "varying": "varyings.", "flat": "varyings.", "uniform": "uniforms."}
        return places.get(kind, "") + name

    def call(self, name: str, arguments: list[ast.expr]) -> tuple[str, int]:
        texts = [self.expression(argument) for argument in arguments]
        if name == "fetch":
            return f"textureLoad({texts[0]}, {texts[1]}, 0)", 9
        if name == "size":
            return f"vec2i(textureDimensions({texts[0]}))", 9
        if name == "transform":
            return f"{self.expression(arguments[0], 6)} * {self.expression(arguments[1], 7)}", 6
        return super().call(name, arguments)


def _beside(entry: Declaration) -> str:
    return f" // {entry.comment}" if entry.comment else ""
