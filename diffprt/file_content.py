"""What a file is by its first bytes, where that is not what its ending says: a web page saved as .glb, say."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from diffprt.errors import InputError

_HEAD = 1 << 16
_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")


@dataclass(frozen=True)
class Content:
    """Something that files are found to be.

    Attributes:
        name: with its article.
        endings: of files that may be this; the first one is usual.
        remedy: what to do with it; without one, to rename it or to convert it.
    """

    name: str
    endings: tuple[str, ...] = ()
    remedy: str = ""


_UNPACK = "unpack it, and give what is in it"
_PAGE = Content("a web page (HTML)", (), "download the file itself, such as by 'Download raw file' on GitHub")
_POINTER = Content("a pointer of Git LFS, not the file itself", (), "fetch the file with 'git lfs pull'")
_ANNEX = Content("a pointer of git-annex, not the file itself", (), "fetch the file with 'git annex get'")
_ANSWER = Content("a server's error message", (), "download it again, from an address that works in a browser")
_GLTF = Content("a glTF file in JSON", (".gltf",))
_ASSET = Content("an asset of diffprt or other tensors", (".prt", ".safetensors"))

_MAGIC: tuple[tuple[bytes, Content], ...] = (
    (b"glTF", Content("a binary glTF file", (".glb",))),
    (b"ply\n", Content("a PLY file", (".ply",))),
    (b"ply\r", Content("a PLY file", (".ply",))),
    (b"solid ", Content("an STL file", (".stl",))),
    (b"#usda", Content("a USD file in text", (".usda", ".usd"))),
    (b"PXR-USDC", Content("a binary USD file", (".usdc", ".usd"))),
    (b"Kaydara FBX Binary", Content("an FBX file")),
    (b"BLENDER", Content("a Blender file")),
    (b"3D Geometry File Format", Content("a Rhino file")),
    (b"#?RADIANCE", Content("a Radiance picture", (".hdr",))),
    (b"#?RGBE", Content("a Radiance picture", (".hdr",))),
    (b"\x76\x2f\x31\x01", Content("an OpenEXR picture", (".exr",))),
    (b"\x89PNG\r\n\x1a\n", Content("a PNG picture", _PICTURES)),
    (b"\xff\xd8\xff", Content("a JPEG picture", (".jpg", *_PICTURES))),
    (b"II*\x00", Content("a TIFF picture", (".tif", *_PICTURES))),
    (b"MM\x00*", Content("a TIFF picture", (".tif", *_PICTURES))),
    (b"GIF8", Content("a GIF picture")),
    (b"8BPS", Content("a Photoshop picture")),
    (b"DDS ", Content("a DDS texture")),
    (b"\xabKTX ", Content("a KTX texture")),
    (b"%PDF", Content("a PDF document")),
    (b"\x7fELF", Content("a program")),
    (b"\x1f\x8b", Content("a gzip archive", (), _UNPACK)),
    (b"PK\x03\x04", Content("a zip archive", (".usdz",), _UNPACK)),
    (b"PK\x05\x06", Content("an empty zip archive", (), _UNPACK)),
    (b"BZh", Content("a bzip2 archive", (), _UNPACK)),
    (b"\xfd7zXZ\x00", Content("an xz archive", (), _UNPACK)),
    (b"\x28\xb5\x2f\xfd", Content("a Zstandard archive", (), _UNPACK)),
    (b"7z\xbc\xaf\x27\x1c", Content("a 7-Zip archive", (), _UNPACK)),
    (b"Rar!", Content("a RAR archive", (), _UNPACK)),
    (b"version https://git-lfs", _POINTER),
)


def content_of(head: bytes) -> Content | None:
    """What begins with these bytes; None for what is not told by them, such as OBJ and binary STL."""
    for magic, content in _MAGIC:
        if head.startswith(magic):
            return content
    if head[257:262] == b"ustar":
        return Content("a tar archive", (), _UNPACK)
    if len(head) > 9 and head[8:9] == b"{" and int.from_bytes(head[:8], "little") < 1 << 40:
        return _ASSET
    text = head.decode("utf-16" if head[:2] in (b"\xff\xfe", b"\xfe\xff") else "latin-1", "replace")
    return _content_of_text(text.removeprefix("\xef\xbb\xbf").lstrip("\ufeff \t\r\n"))


def _content_of_text(text: str) -> Content | None:
    low = text.lower()
    if text.startswith("<"):
        if "<collada" in low:
            return Content("a COLLADA file")
        page = any(mark in low for mark in ("<!doctype html", "<html", "<head", "<body", "<script"))
        return _PAGE if page else Content("an XML text", (), "download or export the file itself")
    if text.startswith("/annex/objects/") or text.startswith("../.git/annex/"):
        return _ANNEX
    if low[:40].startswith(("404: not found", "404 not found", "not found", "access denied", "403 forbidden")):
        return _ANSWER
    if text.startswith("{"):
        if '"asset"' in text and any(word in text for word in ('"meshes"', '"buffers"', '"nodes"', '"scenes"')):
            return _GLTF
        return Content("a JSON text", (".gltf",), "download or export the file itself")
    return None


def check_content(path: Path, what: str, endings: tuple[str, ...] = ()) -> None:
    """Refuses a file that is empty, or by its first bytes something else than a file of its ending.

    Args:
        path: a file, a device or a pipe; no byte of the latter two is read.
        what: what it is for, in the message.
        endings: of what it is to be, whatever its own one is.

    Raises:
        InputError: it is none, or cannot be read.
    """
    if not path.is_file():
        raise InputError(f"{what} {path} is a device or a pipe: give the path of a file")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError as error:
        raise InputError(f"{what} {path} cannot be read ({error.strerror}): check its permissions") from error
    if not head:
        raise InputError(f"{what} {path} has 0 bytes: export it again")
    found = content_of(head)
    wanted = endings or (path.suffix.lower(),)
    if found is not None and not set(found.endings) & set(wanted):
        remedy = found.remedy or (
            f"rename it to {path.stem}{found.endings[0]}, or give another file"
            if found.endings and found.endings[0] != path.suffix.lower()
            else "convert it, or give another file"
        )
        raise InputError(f"{what} {path} is {found.name}, not a {wanted[0]} file: {remedy}")


def missing(path: Path, what: str, wanted: str) -> InputError:
    """The error for a path where nothing is: it says whether that is a pattern that no file fits."""
    if set(str(path)) & set("*?["):
        return InputError(f"{what} {path} does not exist: is it a pattern that no file fits? Give {wanted}")
    return InputError(f"{what} {path} does not exist: give {wanted}")
