"""Shaders of every representation in four languages, printed from one source of the arithmetic (`programs/`)."""

from __future__ import annotations

from pathlib import Path

from diffprt.errors import InputError
from diffprt.exporters.shaders.glsl import DesktopGlslPrinter, GlslEsPrinter
from diffprt.exporters.shaders.hlsl import HlslPrinter
from diffprt.exporters.shaders.printer import Printer
from diffprt.exporters.shaders.program import STAGES, program_names, read_program
from diffprt.exporters.shaders.wgsl import WgslPrinter
from diffprt.whole_file import make_folder, write_whole

LANGUAGES: dict[str, type[Printer]] = {
    "glsl-es": GlslEsPrinter,
    "glsl": DesktopGlslPrinter,
    "hlsl": HlslPrinter,
    "wgsl": WgslPrinter,
}


def shader_source(name: str, stage: str, language: str, *, sizes: dict[str, int] | None = None) -> str:
    """One stage of a program, ready to compile, entry point `main`.

    Args:
        name: a program, one of `program_names()`.
        stage: "vertex" or "fragment".
        language: one of `LANGUAGES`.
        sizes: lengths of arrays by the name that the program gives them, such as {"REGISTERS": 256}.

    Raises:
        InputError: an unknown program, stage or language.
    """
    if language not in LANGUAGES:
        raise InputError(f"shading language '{language}' is unknown: use one of {', '.join(LANGUAGES)}")
    program = read_program(name, sizes)
    if stage not in program.stages:
        raise InputError(f"shader '{name}' has no stage '{stage}': use one of {', '.join(program.stages)}")
    return LANGUAGES[language](program, stage).text()


def write_shaders(
    directory: str | Path, names: list[str] | None = None, *, sizes: dict[str, int] | None = None
) -> list[Path]:
    """Writes every program, or those of `names`, in every language: `directory/LANGUAGE/PROGRAM.vert` and `.frag`.

    Args:
        directory: made if missing.
        names: programs.
        sizes: as in `shader_source`.

    Returns:
        The files, in order.

    Raises:
        InputError: an unknown program, or files that cannot be written.
    """
    written = []
    for language in LANGUAGES:
        ending = "" if language.startswith("glsl") else f".{language}"
        for name in program_names() if names is None else names:
            for stage in read_program(name).stages:
                path = Path(directory) / language / f"{name}.{stage[:4]}{ending}"
                text = shader_source(name, stage, language, sizes=sizes)
                make_folder(path.parent)
                written.append(write_whole(path, text.encode(), "shader"))
    return written


__all__ = ["LANGUAGES", "STAGES", "program_names", "shader_source", "write_shaders"]
