"""Mesh files by their ending; every failure is one readable line."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

from diffprt.errors import InputError
from diffprt.file_content import check_content, missing
from diffprt.scene.readers.parts import Parts

# Each is imported when a file asks for it: parsers take longer to load than small files to read.
READERS = {
    ".glb": "gltf:read_gltf",
    ".gltf": "gltf:read_gltf",
    ".obj": "obj:read_obj",
    ".ply": "ply:read_ply",
    ".stl": "stl:read_stl",
    ".usd": "usd:read_usd",
    ".usda": "usd:read_usd",
    ".usdc": "usd:read_usd",
    ".usdz": "usd:read_usd",
}


def read_parts(path: Path) -> Parts:
    """Reads a mesh file.

    Raises:
        InputError: the path is missing or a folder, the ending is unknown, the content cannot be read as
            that format, or it holds no triangles.
    """
    ending = path.suffix.lower()
    if path.is_dir():
        raise InputError(f"mesh {path} is a folder: give one file ({', '.join(READERS)})")
    if not path.exists():
        raise missing(path, "mesh", f"the path of a {', '.join(READERS)} file")
    if ending not in READERS:
        raise InputError(f"mesh {path} has ending '{ending}': convert it to one of {', '.join(READERS)}")
    check_content(path, "mesh")
    module, _, reader = READERS[ending].partition(":")
    read = getattr(import_module(f"diffprt.scene.readers.{module}"), reader)
    try:
        result = read(path)
    except InputError as error:
        raise error.of(path) from error.__cause__
    except Exception as error:
        # The parsers raise whatever a damaged file makes them stumble on.
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(f"mesh {path} cannot be read as {ending} ({reason}): export it again") from error
    try:
        result.parts = [part.checked() for part in result.parts]
    except InputError as error:
        raise InputError(f"mesh {path} is damaged: {error}; export it again") from error
    if not any(len(part.faces) for part in result.parts):
        count = sum(len(part.positions) for part in result.parts)
        raise InputError(f"mesh {path} has {count} vertices and no faces: give a file with triangles")
    result.parts = [
        replace(part, material=result.default_material(part.colors is not None)) if part.material < 0 else part
        for part in result.parts
    ]
    return result
