"""One view under many lights, such as a time of day: names, files, pictures of one exposure, and their report."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from diffprt.cli.outputs import check_ending, check_output, write_report
from diffprt.cli.terminal import print
from diffprt.errors import InputError
from diffprt.progress import track

if TYPE_CHECKING:
    from diffprt.representation import Representation
    from diffprt.scene import Camera, Light

_FOLDER = Path("render")
_EXAMPLE = "such as day, or day/{light}.exr"
# Pictures that are held at a time.
_AT_ONCE = 32


def light_names(text: str) -> list[str]:
    """Lights from names and files separated by commas; a folder stands for the maps in it, 2.hdr before 10.hdr.

    Raises:
        InputError: a name is empty, or a folder has no maps.
    """
    from diffprt.images import READABLE
    from diffprt.scene import BUILTIN_ENVIRONMENTS

    found: list[str] = []
    for name in [text] if Path(text).exists() else [part.strip() for part in text.split(",")]:
        if not name:
            raise InputError(f"lights '{text}' has an empty name: give lights, maps or a folder, separated by commas")
        if name in BUILTIN_ENVIRONMENTS or not Path(name).is_dir():
            found.append(name)
            continue
        files = [path for path in Path(name).iterdir() if path.is_file() and not path.name.startswith(".")]
        maps = [str(path) for path in files if path.suffix.lower() in READABLE]
        if not maps:
            raise InputError(f"folder {name} has no maps: give one with files that end in {', '.join(READABLE)}")
        found += sorted(maps, key=_by_number)
    return found


def picture_files(output: Path | None, names: list[str]) -> list[Path]:
    """A file for each light: NAME.png in the folder `output`, or `output` itself with {light} and {index} filled in.

    Raises:
        InputError: `output` is the name of one picture, or a pattern that gives no name of its own to each.
    """
    output = output or _FOLDER
    shown = _distinct([Path(name.removeprefix("builtin:")).stem for name in names])
    if "{" not in str(output):
        if output.suffix and not output.is_dir():
            raise InputError(f"output {output} is one file, --lights writes a picture each: give a folder, {_EXAMPLE}")
        return [output / f"{name}.png" for name in shown]
    check_ending(output, ".png", ".exr")
    try:
        files = [Path(str(output).format(light=name, index=index)) for index, name in enumerate(shown)]
    except (KeyError, IndexError, ValueError, AttributeError):
        raise InputError(f"output {output} has braces around other words than light and index: {_EXAMPLE}") from None
    if len(set(files)) < len(files):
        raise InputError(f"output {output} is the same for several lights: put {{light}} or {{index}} in the name")
    return files


def write_sequence(
    names: list[str],
    files: list[Path],
    asset: Representation,
    camera: Camera,
    load: Callable[[str], Light],
    *,
    exposure: float | None,
    curve: str,
    background: tuple[float, float, float] | str,
    samples: int,
    window: str,
    json_file: Path | None,
) -> None:
    """Draws an asset under each light and writes the pictures, once all lights are read and all pictures are drawn.

    Args:
        names, files: of each light.
        load: the light of a name.
        exposure: of all pictures; None brings the mean luminance of the object over all of them to 0.2, or less where a
            sky would be white.
        window: of the lights, for the report.
    """
    import torch

    from diffprt.images import write_image
    from diffprt.rendering import clipped_share, render, view_exposure
    from diffprt.shading import tone_map

    begun = time.perf_counter()
    lights = []
    with track("reading lights", len(names)) as advance:
        for name in names:
            lights.append(load(name))
            advance()
    for file in files:
        check_output(file)
    loaded = time.perf_counter()
    parts = [lights[first : first + _AT_ONCE] for first in range(0, len(lights), _AT_ONCE)]
    drawn = []
    with track("drawing", len(parts)) as advance:
        for part in parts:
            drawn.append(render(asset, part, camera, background=background, samples=samples))
            advance()
    images = torch.cat(drawn)
    mask = asset.elements.view(camera).mask
    rendered = time.perf_counter()
    factor = exposure
    if factor is None:
        factor = view_exposure(asset, lights, camera, curve=curve, sky=background == "light")
    entries = []
    for name, light, file, image in zip(names, lights, files, images, strict=True):
        clipped, image = clipped_share(image, mask), image.clamp_min(0)
        shown = image if file.suffix.lower() == ".exr" else tone_map(image, exposure=factor, curve=curve)
        write_image(file, shown)
        entries.append(
            {
                "light": name,
                "image": str(file),
                "bytes": file.stat().st_size,
                "mean_radiance": float(image[mask].mean()) if bool(mask.any()) else 0.0,
                "errors": {"light": light.report, "negative_radiance_clipped": clipped},
            }
        )
    where = f"{files[0]} to {files[-1]}" if len(files) > 1 else str(files[0])
    print(f"{where}: {len(files)} pictures of {camera.width} x {camera.height}, exposure {factor:.3g}")
    report = {
        "settings": {"lights": names, "window": window, "exposure": factor, "curve": curve, "samples": samples},
        "timings": {"load": loaded - begun, "render": rendered - loaded},
        "counts": {
            "pictures": len(files),
            "pixels": camera.width * camera.height,
            "covered_pixels": int(mask.sum()),
        },
        "errors": {"asset": asset.certificate},
        "pictures": entries,
    }
    write_report(json_file, "render", report)


def _by_number(path: str) -> list:
    """A key under which numbers in a name count as numbers."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path)]


def _distinct(names: list[str]) -> list[str]:
    """Names in which a repeated one is numbered: day, day_2. Capitals make no difference, as on some disks."""
    taken: set[str] = set()
    found = []
    for name in names:
        free = next(n for n in (name, *(f"{name}_{i}" for i in range(2, len(names) + 2))) if n.lower() not in taken)
        taken.add(free.lower())
        found.append(free)
    return found
