"""Draw an asset under distant light."""

from __future__ import annotations

import time
from pathlib import Path

import typer

from diffprt import asset as assets
from diffprt.cli.inputs import load_light, parse_color, parse_number, parse_size
from diffprt.cli.report import JsonFile, check_output, write_report
from diffprt.errors import InputError
from diffprt.images import write_image
from diffprt.render import Camera, View, auto_exposure, render
from diffprt.shade import tone_map


def run(
    source: Path = typer.Argument(..., metavar="ASSET", help="A .prt file."),
    light: str = typer.Option("studio", help="sky, studio, constant, or an equirectangular map (.hdr, .exr, .png)."),
    output: Path = typer.Option(Path("render.png"), "-o", "--output", help="A .png (display) or .exr (radiance)."),
    size: str = typer.Option("512", help="Pixels: 512 or 640x480."),
    azimuth: float = typer.Option(25.0, help="Camera, degrees around +y from +z."),
    elevation: float = typer.Option(15.0, help="Camera, degrees above the horizon."),
    fov: float = typer.Option(35.0, help="Vertical field of view, degrees."),
    light_azimuth: float = typer.Option(0.0, help="Turns the light about +y, degrees."),
    window: str = typer.Option("none", help="none, hann, lanczos or auto: trades contrast for less ringing."),
    exposure: str = typer.Option("auto", help="A factor, or auto: mean luminance of the object to 0.2."),
    curve: str = typer.Option("aces", help="linear, reinhard or aces."),
    background: str = typer.Option("0.05", help="A color (0.05 or r,g,b) or 'light'."),
    samples: int = typer.Option(2, help="Samples a side of each pixel."),
    json_file: Path = JsonFile,
) -> None:
    if output.suffix.lower() not in (".png", ".exr"):
        raise InputError(f"output {output} has ending '{output.suffix}': give a .png or .exr file")
    behind = background if background == "light" else parse_color(background, "background")
    width, height = parse_size(size)
    factor = None if exposure == "auto" else parse_number(exposure, "exposure")
    begun = time.perf_counter()
    asset = assets.load(source)
    radiance = load_light(light, asset.order, window=window, azimuth=light_azimuth)
    check_output(output)
    camera = Camera.framing(
        asset.receivers.positions, azimuth=azimuth, elevation=elevation, fov=fov, width=width, height=height
    )
    loaded = time.perf_counter()
    image = render(asset, radiance, camera, background=behind, samples=samples)
    mask = View.of(asset.receivers, camera).mask
    rendered = time.perf_counter()
    factor = auto_exposure(image, mask) if factor is None else factor
    write_image(output, image if output.suffix.lower() == ".exr" else tone_map(image, exposure=factor, curve=curve))
    print(f"{output}: {width} x {height}, exposure {factor:.3g}")
    luminance = float(image[mask].mean()) if bool(mask.any()) else 0.0
    write_report(
        json_file,
        "render",
        {
            "settings": {
                "light": light,
                "window": window,
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
            "errors": {"light": radiance.report, "asset": asset.certificate},
            "outputs": {"image": str(output), "bytes": output.stat().st_size},
        },
    )
