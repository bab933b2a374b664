"""HLSL, shader model 5: inputs and outputs are structures, uniforms a constant buffer, tables Texture2D."""

from __future__ import annotations

import ast
from typing import ClassVar

from diffprt.exporters.shaders.printer import Printer
from diffprt.exporters.shaders.program import Declaration, Function

_VECTORS = {f"vec{n}": f"float{n}" for n in (2, 3, 4)} | {f"ivec{n}": f"int{n}" for n in (2, 3)}
_TABLE_SIZE = """int2 tableSize(Texture2D<float4> table) {
  uint width, height;
  table.GetDimensions(width, height);
  return int2(width, height);
}"""


class HlslPrinter(Printer):
    """HLSL with the entry point `main`; matrices act on columns and lie in memory as in GLSL."""

    types: ClassVar[dict[str, str]] = {**_VECTORS, "mat3": "float3x3", "mat4": "float4x4"}

    def header(self) -> str:
        return self.comment(self.program.comment).rstrip()

    def interface(self) -> str:
        parts = []
        if uniforms := self.of_kind("uniform"):
            lines = [f"  {self.declared(entry)}" for entry in uniforms]
            parts.append("\n".join(["cbuffer Uniforms : register(b0) {", *lines, "};"]))
        tables = self.of_kind("table")
        parts += [
            f"Texture2D<float4> {entry.name} : register(t{slot});{_beside(entry)}" for slot, entry in enumerate(tables)
        ]
        if any(isinstance(node, ast.Call) and node.func.id == "size" for node in self.nodes()):
            parts.append(_TABLE_SIZE)
        if self.stage == "vertex":
            lines = ["  uint vertexIndex : SV_VertexID;"]
            lines += [f"  {self.declared(entry, entry.name.upper())}" for entry in self.of_kind("attribute")]
            parts.append("\n".join(["struct Attributes {", *lines, "};"]))
        precise = "precise " if self.stage == "vertex" else ""
        lines = [f"  {precise}float4 clipPosition : SV_Position; // the same depth in every pass"]
        for slot, entry in enumerate(self.of_kind("varying", "flat")):
            flat = "nointerpolation " if entry.kind == "flat" else ""
            lines.append(f"  {flat}{self.declared(entry, f'TEXCOORD{slot}')}")
        parts.append("\n".join(["struct Varyings {", *lines, "};"]))
        return "\n\n".join(parts)

    def nodes(self) -> list[ast.AST]:
        """All nodes of all functions."""
        return [n for function in self.program.functions.values() for s in function.body for n in ast.walk(s)]

    def declared(self, entry: Declaration, semantic: str = "") -> str:
        """A member of a structure or buffer."""
        length = f"[{entry.length}]" if entry.length else ""
        meaning = f" : {semantic}" if semantic else ""
        return f"{self.types.get(entry.type, entry.type)} {entry.name}{length}{meaning};{_beside(entry)}"

    def entry(self, function: Function) -> str:
        comment, block = self.comment(function.comment), self.block(function)
        if self.stage == "vertex":
            return (
                f"{comment}Varyings main(Attributes attributes) {{\n  Varyings varyings;\n{block}\n"
                "  return varyings;\n}"
            )
        (target,) = self.of_kind("target")
        kind = self.types[target.type]
        return (
            f"{comment}{kind} main(Varyings varyings) : SV_Target {{\n  {kind} {target.name};\n{block}\n"
            f"  return {target.name};\n}}"
        )

    def signature(self, function: Function) -> str:
        arguments = ", ".join(f"{self.types.get(kind, kind)} {name}" for name, kind in function.arguments)
        return f"{self.types.get(function.returns, function.returns)} {function.name}({arguments})"

    def variable(self, name: str, type_name: str, value: str) -> str:
        return f"{self.types.get(type_name, type_name)} {name} = {value};"

    def global_name(self, name: str) -> str:
        if name == "vertexIndex":
            return "int(attributes.vertexIndex)"
        if name == "pixel":
            return "int2(varyings.clipPosition.xy)"
        if name == "clipPosition":
            return "varyings.clipPosition"
        kind = self.program.declarations[name].kind if name in self.program.declarations else ""
        return {"attribute": "attributes.", "varying": "varyings.", "flat": "varyings."}.get(kind, "") + name

    def call(self, name: str, arguments: list[ast.expr]) -> tuple[str, int]:
        texts = [self.expression(argument) for argument in arguments]
        if name == "fetch":
            return f"{texts[0]}.Load(int3({texts[1]}, 0))", 9
        if name == "size":
            return f"tableSize({texts[0]})", 9
        if name == "transform":
            return f"mul({texts[0]}, {texts[1]})", 9
        if name in ("vec2", "vec3", "vec4") and len(texts) == 1:
            return f"{self.types[name]}({', '.join(texts * int(name[-1]))})", 9
        return super().call(name, arguments)


def _beside(entry: Declaration) -> str:
    return f" // {entry.comment}" if entry.comment else ""
