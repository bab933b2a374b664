"""Image files: Radiance, OpenEXR and PNG through OpenImageIO, linear radiance in and out."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import torch

from diffprt.errors import InputError
from diffprt.file_content import check_content, missing

READABLE = (".hdr", ".exr", ".png", ".jpg", ".jpeg", ".tif", ".tiff")
_LARGEST_PIXELS = 1 << 28


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
    source = oiio.ImageInput.open(str(path), as_stored)
    if source is None:
        reason = oiio.geterror().splitlines()
        raise InputError(
            f"image {path} cannot be read ({reason[0] if reason else 'unknown format'}): "
            f"give a valid {', '.join(READABLE)} file"
        )
    try:
        spec = source.spec()
        if spec.width * spec.height > _LARGEST_PIXELS:
            raise InputError(
                f"image {path} is {spec.width} x {spec.height}: at most {_LARGEST_PIXELS} pixels, resize it"
            )
        pixels = source.read_image(oiio.FLOAT)
        if pixels is None:
            raise InputError(f"image {path} is damaged ({source.geterror()}): write it again")
    finally:
        source.close()
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    return torch.from_numpy(pixels.reshape(spec.height, spec.width, -1))


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
    height, width, channels = pixels.shape
    kind = oiio.UINT8 if path.suffix.lower() == ".png" else oiio.FLOAT
    partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    target = oiio.ImageOutput.create(str(partial))
    spec = oiio.ImageSpec(width, height, channels, kind)
    if kind == oiio.FLOAT:
        spec.attribute("compression", "zip")
    else:
        spec.attribute("oiio:UnassociatedAlpha", 1)
    written = target is not None and target.open(str(partial), spec) and target.write_image(pixels)
    reason = (target.geterror() if target is not None else oiio.geterror()).strip()
    if target is not None:
        written = target.close() and written
    if not written:
        partial.unlink(missing_ok=True)
        raise InputError(f"image {path} cannot be written ({reason}): choose a folder that you may write")
    partial.replace(path)
