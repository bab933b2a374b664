"""The files that a scene file names, or a folder of references holds: what reading it reads besides.

They are found without reading any of them as scenes; what is damaged names nothing.
"""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path
from urllib.parse import unquote

FOLDER_INPUTS = ("references.json",)
_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".tga", ".bmp", ".webp", ".ktx2", ".exr", ".hdr")
_MESHES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".usd", ".usda", ".usdc", ".usdz")
_MOST_HEADER = 1 << 16


def named_files(path: Path) -> list[Path]:
    """Paths of the files that the scene file or folder `path` names, whether they exist or not.

    Raises:
        OSError, ValueError: it cannot be read.
    """
    if path.is_dir():
        return [file for file in path.iterdir() if file.name in FOLDER_INPUTS or _ends(file, _PICTURES + _MESHES)]
    find = _FINDERS.get(path.suffix.lower())
    if find is None or not path.is_file():
        return []
    return [file for name in find(path) if (file := _joined(path.parent, name)) is not None]


def _ends(path: Path, endings: tuple[str, ...]) -> bool:
    return path.suffix.lower() in endings


def _joined(folder: Path, name: str) -> Path | None:
    """A path as a file of `folder` names it; backslashes are taken as Windows means them where nothing else is so."""
    if not name or "\0" in name or name.startswith("data:"):
        return None
    plain = folder / name
    return plain if plain.exists() or "\\" not in name else folder / name.replace("\\", "/")


def _gltf(path: Path) -> list[str]:
    with path.open("rb") as file:
        start = file.read(20)
        if start[:4] == b"glTF" and len(start) == 20:
            text = file.read(struct.unpack("<I", start[12:16])[0])
        else:
            text = start + file.read()
    document = json.loads(text)
    entries = [entry for kind in ("buffers", "images") for entry in document.get(kind, ())]
    return [unquote(entry["uri"]) for entry in entries if isinstance(entry.get("uri"), str)]


def _obj(path: Path) -> list[str]:
    names = []
    with path.open("r", encoding="utf-8", errors="replace") as file:
        libraries = [
            line.split(maxsplit=1)[1].strip() for line in file if line.startswith("mtllib ") and line.split()[1:]
        ]
    for library in libraries:
        names.append(library)
        place = _joined(path.parent, library)
        if place is None or not place.is_file():
            continue
        text = place.read_text("utf-8", errors="replace")
        maps = re.findall(r"^\s*(?:map_\w+|bump|disp|decal|refl|norm)\s+(.+?)\s*$", text, re.MULTILINE | re.IGNORECASE)
        # Options stand before the name, which may hold blanks itself.
        names += [name for line in maps for name in {line, line.split()[-1]}]
    return names


def _ply(path: Path) -> list[str]:
    with path.open("rb") as file:
        header = file.read(_MOST_HEADER).partition(b"end_header")[0]
    return re.findall(r"^comment TextureFile (.+?)\s*$", header.decode("utf-8", "replace"), re.MULTILINE)


def _usd(path: Path) -> list[str]:
    """Of text, what stands between @; binary layers do not show it: pictures and layers in their folder then."""
    with path.open("rb") as file:
        text = file.read() if file.read(5) == b"#usda" else None
    if text is not None:
        return re.findall(r"@+([^@\n]+)@", text.decode("utf-8", "replace"))
    around = [file for pattern in ("*", "*/*") for file in path.parent.glob(pattern)]
    return [str(file.absolute()) for file in around if _ends(file, (*_PICTURES, ".usd", ".usda", ".usdc"))]


_FINDERS = {".gltf": _gltf, ".glb": _gltf, ".obj": _obj, ".ply": _ply}
_FINDERS |= dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), _usd)
