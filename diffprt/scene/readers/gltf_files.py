"""Files that a glTF file names: buffers, and textures of base colors. What is wrong with one names both."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote

from diffprt.errors import InputError
from diffprt.file_content import check_content, content_of

_HEAD = 1 << 16


def check_buffers(path: Path, header: dict) -> None:
    """Refuses a glTF file with a buffer that is missing, cut, or something else.

    Raises:
        InputError: names the buffer and the glTF file.
    """
    for buffer in header.get("buffers", []):
        file = _file(path, buffer)
        if file is None:
            continue
        if not file.is_file():
            raise InputError(f"mesh {path} needs buffer {file.name}, which is not beside it: put it there")
        size, wanted = file.stat().st_size, buffer.get("byteLength", 0)
        with file.open("rb") as opened:
            found = content_of(opened.read(_HEAD))
        if size < wanted:
            told = f" and is {found.name}" if found else ""
            remedy = found.remedy if found and found.remedy else "download or export it again"
            raise InputError(f"mesh {path} needs buffer {file.name} of {wanted} bytes, it has {size}{told}: {remedy}")


def texture_of(path: Path, header: dict, material: dict, notes: list[str]) -> str | None:
    """The texture of a material's base color, in words that name it; None without one, and where its file is missing,
    which becomes a remark.

    Raises:
        InputError: its file is something else than a picture; names the texture and the glTF file.
    """
    entry = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
    if entry is None:
        return None
    texture = header.get("textures", [])[entry["index"]]
    source = texture.get("source")
    if source is None:
        notes.append(f"texture {entry['index']} is in a format that is not read: left out")
        return None
    image = header.get("images", [])[source]
    file = _file(path, image)
    if file is None:
        return f"texture {image.get('name') or source} in mesh {path}"
    if not file.is_file():
        notes.append(f"texture {file.name} is missing: its factor is used")
        return None
    check_content(file, f"mesh {path} has a texture that cannot be used: image")
    return f"texture {file.name} of mesh {path}"


def _file(path: Path, entry: dict) -> Path | None:
    """The file that an entry names; None for what is inside the glTF file."""
    uri = entry.get("uri")
    return None if uri is None or uri.startswith("data:") else path.parent / unquote(uri)
