"""Image files: Radiance, OpenEXR and PNG through OpenImageIO, linear radiance in and out."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import torch

from diffprt.errors import InputError
from diffprt.file_content import check_content, missing
from diffprt.whole_file import write_whole

READABLE = (".hdr", ".exr", ".png", ".jpg", ".jpeg", ".tif", ".tiff")
_LARGEST_PIXELS = 1 << 28
_PNG_END = b"IEND\xaeB`\x82"


def read_image(path: str | Path) -> torch.Tensor:
    """Reads an image file as it is stored.

    Args:
        path: a .hdr, .exr, .png, .jpg or .tif file.

    Returns:
        float32 [H, W, C]: HDR formats in linear radiance, 8- and 16-bit formats as encoded values in [0, 1].
        Colours are not multiplied by alpha where the file does not do so.

    Raises:
        InputError: the file is missing, unreadable, not an image, or larger than 2^28 pixels.
    """
    path = Path(path)
    wanted = f"the path of a {', '.join(READABLE)} file"
    if path.is_dir():
        raise InputError(f"image {path} is a folder: give {wanted}")
    if not path.exists():
        raise missing(path, "image", wanted)
    check_content(path, "image")
    as_stored = oiio.ImageSpec()
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    try:
        source = oiio.ImageInput.open(str(path), as_stored)
    except UnicodeError as error:
        raise InputError(f"image {path} has a name that is not UTF-8: rename it") from error
    if source is None:
        reason = _said(oiio.geterror)
        raise InputError(
            f"image {path} cannot be read ({reason or 'unknown format'}): give a valid {', '.join(READABLE)} file"
        )
    try:
        spec = source.spec()
        if spec.width * spec.height > _LARGEST_PIXELS:
            raise InputError(
                f"image {path} is {spec.width} x {spec.height}: at most {_LARGEST_PIXELS} pixels, resize it"
            )
        pixels = source.read_image(oiio.FLOAT)
        if pixels is None:
            raise InputError(f"image {path} is damaged ({_said(source.geterror)}): write it again")
    except UnicodeError as error:
        raise InputError(f"image {path} is damaged (it holds text that is not UTF-8): write it again") from error
    finally:
        source.close()
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    return torch.from_numpy(pixels.reshape(spec.height, spec.width, -1))


def _said(error: Callable[[], str]) -> str:
    """What OpenImageIO says of an error, in one line; it repeats bytes of damaged files, which may be no text."""
    try:
        return "".join(c if c.isprintable() else " " for c in " ".join(error().split()))[:200]
    except UnicodeError:
        return "it holds text that is not UTF-8"


def write_image(path: str | Path, image: torch.Tensor) -> None:
    """Writes an image; the file appears whole or not at all.

    Args:
        path: .png (8 bit, values in [0, 1] already display-encoded), .exr (float32) or .hdr.
        image: [H, W, C] with C = 1, 3 or 4; .hdr has no alpha, and repeats a single channel.

    Raises:
        InputError: the ending is unknown, the shape does not fit it, or the folder cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".png", ".exr", ".hdr"):
        raise InputError(f"image {path} has ending '{path.suffix}': use .png, .exr or .hdr")
    if not path.parent.is_dir():
        raise InputError(f"folder {path.parent} does not exist: create it, or write {path.name} elsewhere")
    allowed = (1, 3) if path.suffix.lower() == ".hdr" else (1, 3, 4)
    if image.ndim != 3 or image.shape[2] not in allowed or image.numel() == 0:
        raise InputError(
            f"image {path.name} has shape {tuple(image.shape)}: {path.suffix} wants [H, W, C] with "
            f"C = {', '.join(map(str, allowed))}"
        )
    pixels = image.detach().to("cpu", torch.float32)
    if path.suffix.lower() == ".hdr":
        pixels = pixels.expand(-1, -1, 3)
    pixels = pixels.contiguous().numpy()
    write_whole(path, lambda partial: _write(partial, pixels), "image")


def _write(path: Path, pixels: np.ndarray) -> None:
    """Writes float32 [H, W, C] and reads it again: writers say nothing of a full disk."""
    height, width, channels = pixels.shape
    kind = oiio.UINT8 if path.suffix.lower() == ".png" else oiio.FLOAT
    target = oiio.ImageOutput.create(str(path))
    spec = oiio.ImageSpec(width, height, channels, kind)
    # Else the time of day, and other bytes each time.
    spec.attribute("DateTime", "")
    if kind == oiio.FLOAT:
        spec.attribute("compression", "zip")
    else:
        spec.attribute("oiio:UnassociatedAlpha", 1)
    written = target is not None and target.open(str(path), spec) and target.write_image(pixels)
    reason = (target.geterror() if target is not None else oiio.geterror()).strip()
    if target is not None:
        written = target.close() and written
    if written and _whole(path, pixels.shape):
        return
    if shutil.disk_usage(path.parent).free < pixels.nbytes:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    raise OSError(errno.EIO, " ".join(reason.split()) or "what was written cannot be read again")


def _whole(path: Path, shape: tuple[int, ...]) -> bool:
    """Whether a file that was just written holds a picture of that shape."""
    with path.open("rb") as file:
        # libpng prints a line of its own where a file is cut off.
        file.seek(-min(len(_PNG_END), path.stat().st_size), os.SEEK_END)
        if path.suffix.lower() == ".png" and file.read() != _PNG_END:
            return False
    try:
        return tuple(read_image(path).shape) == shape
    except InputError:
        return False
