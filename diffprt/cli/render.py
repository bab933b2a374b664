"""Draw an asset under distant light."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import typer

from diffprt.cli.from_options import field_option
from diffprt.cli.light_sequence import light_names, picture_files, write_sequence
from diffprt.cli.outputs import JsonFile, check_ending, check_output, write_report
from diffprt.cli.parsing import parse_color, parse_number, parse_point, parse_size
from diffprt.cli.paths import InputFile, InputName, OutputFile, OutputFolder
from diffprt.cli.terminal import print
from diffprt.errors import InputError
from diffprt.options import LIGHTS, ExportOptions, ViewOptions
from diffprt.progress import track


def run(
    source: InputFile = typer.Argument(..., metavar="ASSET", help="A .prt file."),
    light: InputName = typer.Option(
        None, help=f"sky, studio, constant, or an equirectangular map (.hdr, .exr, .png).  [default: {LIGHTS[0]}]"
    ),
    output: OutputFolder = typer.Option(
        None,
        "-o",
        "--output",
        help="A .png (display) or .exr (radiance); with --lights a folder, or a name such as day/{light}.exr, where "
        "{light} is the map's name and {index} counts from 0.  [default: render.png; with --lights the folder render]",
    ),
    size: str = typer.Option("512", help="Pixels: 512 or 640x480."),
    azimuth: float = field_option(ViewOptions, "azimuth"),
    elevation: float = field_option(ViewOptions, "elevation"),
    target: str = field_option(ViewOptions, "target"),
    distance: float = field_option(ViewOptions, "distance"),
    fov: float = field_option(ViewOptions, "fov"),
    light_azimuth: float = typer.Option(0.0, help="Turns the light about +y, degrees."),
    window: str = field_option(ViewOptions, "window"),
    exposure: str = typer.Option(
        "auto",
        help="A factor, or auto: mean luminance of the object to 0.2, and less where a sky behind it would be white.",
    ),
    curve: str = field_option(ExportOptions, "curve"),
    background: str = typer.Option("0.05", help="A color (0.05 or r,g,b) or 'light'."),
    samples: int = typer.Option(2, help="Samples a side of each pixel."),
    reference_set: int = typer.Option(
        None, help="Write this many pictures, each of a random view and light, with references.json, to the folder -o."
    ),
    lights: InputName = typer.Option(
        None,
        help="Lights and maps, separated by commas, or a folder of maps: a picture under each, all of one exposure. "
        f"With --reference-set they are taken in turn.  [default there: {','.join(LIGHTS)}]",
    ),
    turn: bool = typer.Option(True, help="With --reference-set: turn every picture's light at random."),
    seed: int = typer.Option(0, help="With --reference-set: of views and turns."),
    json_file: OutputFile = JsonFile,
) -> None:
    if light is not None and lights is not None:
        raise InputError("--light and --lights were given together: give one light, or all of them as --lights")
    if reference_set is not None:
        names, output = light_names(lights or ",".join(LIGHTS)), output or Path("render.png")
        return _reference_set(source, names, output, reference_set, size, window, samples, turn, seed, json_file)
    names = None if lights is None else light_names(lights)
    files = None if names is None else picture_files(output, names)
    light, output = light or LIGHTS[0], output or Path("render.png")
    check_ending(output if files is None else files[0], ".png", ".exr")
    behind = background if background == "light" else parse_color(background, "background")
    width, height = parse_size(size)
    factor = None if exposure == "auto" else parse_number(exposure, "exposure")
    aim = None if target is None else parse_point(target, "target")
    begun = time.perf_counter()

    from diffprt.cli.scenes import load_light
    from diffprt.images import write_image
    from diffprt.rendering import PictureWindow, clipped_share, render, view_exposure
    from diffprt.representation import files as assets
    from diffprt.scene import Camera
    from diffprt.shading import tone_map

    asset = assets.load(source)
    camera = Camera.framing(
        asset.elements.subject,
        azimuth=azimuth,
        elevation=elevation,
        fov=fov,
        width=width,
        height=height,
        target=aim,
        distance=distance,
    )
    picture = PictureWindow.of(asset, camera) if window == ViewOptions.window and asset.order else None
    load = partial(load_light, order=asset.order, window=window, azimuth=light_azimuth, picture=picture)
    if names is not None and files is not None:
        look: dict = {"exposure": factor, "curve": curve, "background": behind, "samples": samples}
        return write_sequence(names, files, asset, camera, load, **look, window=window, json_file=json_file)
    radiance = load(light)
    check_output(output)
    loaded = time.perf_counter()
    image = render(asset, radiance, camera, background=behind, samples=samples)
    mask = asset.elements.view(camera).mask
    rendered = time.perf_counter()
    clipped, image = clipped_share(image, mask), image.clamp_min(0)
    if factor is None:
        factor = view_exposure(asset, radiance, camera, curve=curve, sky=behind == "light")
    write_image(output, image if output.suffix.lower() == ".exr" else tone_map(image, exposure=factor, curve=curve))
    chosen = radiance.report["window"]
    print(
        f"{output}: {width} x {height}, exposure {factor:.3g}, window {chosen}, {100 * clipped:.2g} % of the object's "
        "radiance was negative and clipped"
    )
    luminance = float(image[mask].mean()) if bool(mask.any()) else 0.0
    write_report(
        json_file,
        "render",
        {
            "settings": {
                "light": light,
                "window": chosen,
                "exposure": factor,
                "curve": curve,
                "samples": samples,
            },
            "timings": {"load": loaded - begun, "render": rendered - loaded},
            "counts": {
                "pixels": width * height,
                "covered_pixels": int(mask.sum()),
                "mean_radiance": luminance,
            },
            "errors": {"light": radiance.report, "negative_radiance_clipped": clipped, "asset": asset.certificate},
            "outputs": {"image": str(output), "bytes": output.stat().st_size},
        },
    )


def _reference_set(
    source: Path,
    lights: list[str],
    folder: Path,
    count: int,
    size: str,
    window: str,
    samples: int,
    turn: bool,
    seed: int,
    json_file: Path | None,
) -> None:
    """Writes random views of an uncompressed asset under random lights, for 'diffprt optimize --references'."""
    if folder.suffix:
        raise InputError(f"output {folder} has an ending: give a folder, such as -o references")
    width, height = parse_size(size)
    begun = time.perf_counter()

    from diffprt.cli.scenes import load_light
    from diffprt.optimization import make_references, save_references
    from diffprt.optimization.references.listing import MOST
    from diffprt.optimization.references.references import FILE, picture_names
    from diffprt.representation import files as assets
    from diffprt.whole_file import check_target

    asset = assets.load(source)
    projected = [load_light(light.strip(), asset.order, window=window) for light in lights]
    check_output(folder, directory=True)
    for name in (*picture_names(min(count, MOST)), FILE):
        check_target(folder / name, "picture")
    references = make_references(
        asset, projected, count, width=width, height=height, samples=samples, turn=turn, seed=seed, track=track
    )
    save_references(references, folder)
    print(f"{folder}: {count} pictures of {width} x {height}, lights {', '.join(lights)}")
    settings = {
        "lights": lights,
        "window": window,
        "samples": samples,
        "size": [width, height],
        "turn": turn,
        "seed": seed,
    }
    report = {"settings": settings, "timings": {"total": time.perf_counter() - begun}, "counts": {"pictures": count}}
    write_report(json_file, "render", report | {"outputs": {"references": str(folder)}})
