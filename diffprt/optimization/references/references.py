"""Reference pictures with the camera and the light of each: what an asset is optimized to look like.

On disk they are a folder with one `references.json` and one picture for each entry, EXR in linear radiance (float32) or
PNG in sRGB, which is decoded.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.images import read_image, write_image
from diffprt.optimization.references.listing import MOST_SAMPLES, VERSION, Row, parse_listing
from diffprt.representation import Elements
from diffprt.scene import Camera
from diffprt.scene.srgb import linear_from_srgb
from diffprt.shading import srgb_encode
from diffprt.whole_file import write_together, write_whole

FILE = "references.json"
UNITS = "linear radiance [W/m²/sr]"


@dataclass(frozen=True)
class Reference:
    """One picture of a scene.

    Attributes:
        image: float32 [H, W, 3], linear radiance [W/m²/sr]; pixels beside the object do not count.
        camera: where it was taken from, of the picture's size.
        light: float32 [K, 3], coefficients of the distant light that was on.
    """

    image: torch.Tensor
    camera: Camera
    light: torch.Tensor

    def __post_init__(self) -> None:
        shape, wanted = tuple(self.image.shape), (self.camera.height, self.camera.width, 3)
        if shape != wanted:
            raise InputError(
                f"reference picture has shape {shape}, its camera {wanted}: give the camera of the picture"
            )
        if self.light.dim() != 2 or self.light.shape[1] != 3:
            raise InputError(f"reference light has shape {tuple(self.light.shape)}: give coefficients [order², 3]")
        sh.order_of_count(self.light.shape[0])


@dataclass(frozen=True)
class References:
    """Pictures of one scene.

    Attributes:
        entries: at least one, lights all of the same order.
        scene_hash: of the scene that was baked, "" where it is not known (photographs).
        bounds: least and greatest corner of what is shown, scene units; () where it is not known.
        samples: samples a side of each pixel, over black, that models of the pictures take.
    """

    entries: tuple[Reference, ...]
    scene_hash: str = ""
    bounds: tuple[tuple[float, ...], ...] = ()
    samples: int = 1

    def __post_init__(self) -> None:
        if not self.entries:
            raise InputError("there are no references: give at least one picture with camera and light")
        if not (isinstance(self.samples, int) and 1 <= self.samples <= MOST_SAMPLES):
            raise InputError(f"references have samples {self.samples}: give 1 to {MOST_SAMPLES} a side")
        if self.bounds and [len(corner) for corner in self.bounds] != [3, 3]:
            raise InputError(f"references have bounds {self.bounds}: give two corners of three numbers")
        orders = sorted({sh.order_of_count(len(entry.light)) for entry in self.entries})
        if len(orders) > 1:
            raise InputError(f"references have lights of orders {orders}: project all of them at one")

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[Reference]:
        return iter(self.entries)

    @property
    def order(self) -> int:
        """SH bands of the lights."""
        return sh.order_of_count(len(self.entries[0].light))

    @property
    def lights(self) -> list[torch.Tensor]:
        """Coefficients [K, 3] of every entry."""
        return [entry.light for entry in self.entries]

    def split(self, share: float, seed: int = 0, *, by_camera: bool = False) -> tuple[list[int], list[int]]:
        """Indices of those to train on, and of about `share` that are held out; the latter may be none.

        Pictures under the same light stay together (those from the same camera, where there is but one light or with
        `by_camera`), so that what is held out is never seen in training.
        """
        if not 0 <= share < 1:
            raise InputError(f"held_out is {share}: give a share from 0 up to 1, such as 0.2")
        groups = self._groups(by_camera)
        if len(groups) == 1:
            groups = self._groups(not by_camera)
        if share == 0 or len(groups) == 1:
            return list(range(len(self))), []
        order = torch.randperm(len(groups), generator=torch.Generator().manual_seed(seed)).tolist()
        count = min(max(1, round(share * len(groups))), len(groups) - 1)
        held = sorted(i for group in order[:count] for i in groups[group])
        return sorted(i for group in order[count:] for i in groups[group]), held

    def _groups(self, by_camera: bool) -> list[list[int]]:
        """Indices that share a camera, or a light."""
        found: dict = {}
        for index, entry in enumerate(self.entries):
            key = entry.camera if by_camera else entry.light.numpy().tobytes()
            found.setdefault(key, []).append(index)
        return list(found.values())


def bounds_of(elements: Elements) -> tuple[tuple[float, ...], ...]:
    """Least and greatest corner of the elements' positions."""
    return tuple(tuple(corner(elements.positions, 0).tolist()) for corner in (torch.amin, torch.amax))


def save_references(references: References, folder: str | Path, *, format: str = "exr") -> None:
    """Writes pictures and `references.json`; the latter last, so that a folder with one is whole. Until all are
    written, a set that was there stays.

    Args:
        format: "exr" keeps linear radiance in float32; "png" has 8 bits and clips at 1.

    Raises:
        InputError: the format is unknown, or the folder cannot be written.
    """
    if format not in ("exr", "png"):
        raise InputError(f"reference format '{format}' is unknown: use exr or png")
    names = picture_names(len(references), format)
    rows = [
        {"image": name, "camera": asdict(entry.camera), "light": entry.light.double().tolist()}
        for name, entry in zip(names, references, strict=True)
    ]
    content = {
        "version": VERSION,
        "units": UNITS,
        "order": references.order,
        "scene_hash": references.scene_hash,
        "bounds": references.bounds,
        "samples": references.samples,
        "references": rows,
    }
    text = f"{json.dumps(content, indent=1, sort_keys=True)}\n".encode()
    parse_listing(text, "what would be references.json")

    def picture(entry: Reference) -> Callable[[Path], object]:
        encode = (lambda image: image) if format == "exr" else (lambda image: srgb_encode(image.clamp(0, 1)))
        return lambda path: write_image(path, encode(entry.image))

    writers = {name: picture(entry) for name, entry in zip(names, references, strict=True)}
    write_together(Path(folder), {**writers, FILE: lambda path: write_whole(path, text, "references")}, "references")


def picture_names(count: int, format: str = "exr") -> list[str]:
    """What the pictures of a set are called."""
    return [f"{index:04d}.{format}" for index in range(count)]


def load_references(folder: str | Path) -> References:
    """Reads a folder with `references.json`.

    Raises:
        InputError: it is missing or damaged, or a picture is missing, of another size than its camera, or has pixels
            that are not finite.
    """
    folder = Path(folder)
    file = folder / FILE
    if not file.is_file():
        raise InputError(f"references {folder} has no {FILE}: make one with 'diffprt render ASSET --reference-set 32'")
    try:
        text = file.read_bytes()
    except OSError as error:
        raise InputError(f"references {file} cannot be read ({error.strerror}): make them again") from error
    listing = parse_listing(text, f"references {file}")
    entries = tuple(_entry(folder, row) for row in listing.rows)
    return References(entries, listing.scene_hash, listing.bounds, listing.samples)


def _entry(folder: Path, row: Row) -> Reference:
    name, camera = row.image, row.camera
    light = torch.tensor(row.light, dtype=torch.float32)
    pixels = read_image(folder / name)
    if pixels.shape[2] < 3:
        raise InputError(f"reference picture {folder / name} has {pixels.shape[2]} channels: give RGB")
    image = pixels[..., :3].contiguous()
    if not name.lower().endswith((".exr", ".hdr")):
        image = linear_from_srgb(image)
    if tuple(image.shape[:2]) != (camera.height, camera.width):
        raise InputError(
            f"reference picture {folder / name} is {image.shape[1]} x {image.shape[0]}, its camera {camera.width} x "
            f"{camera.height}: resize one of them"
        )
    return Reference(image, camera, light)
