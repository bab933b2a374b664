"""Lights and materials from pictures: inverse lighting, inverse albedo, and both together."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from diffprt.cli.outputs import JsonFile, check_ending, check_output, write_report
from diffprt.cli.parsing import parse_color
from diffprt.cli.paths import InputFile, OutputFile
from diffprt.cli.tables import print_table
from diffprt.cli.terminal import print
from diffprt.errors import InputError

if TYPE_CHECKING:
    import torch

    from diffprt.scene import Light

app = typer.Typer(help=__doc__, no_args_is_help=True, rich_markup_mode=None)

_MAP_ROWS = 128
Source = typer.Argument(..., metavar="ASSET", help="A .prt file: what the pictures show.")
References = typer.Option(..., help="A folder of pictures with references.json.")


@app.command(help="The light of a set of pictures, as an environment map.")
def light(
    source: InputFile = Source,
    references: InputFile = References,
    output: OutputFile = typer.Option(Path("light.exr"), "-o", "--output", help="An .exr environment map."),
    order: int = typer.Option(None, help="SH bands to find.  [default: the asset's]"),
    json_file: OutputFile = JsonFile,
) -> None:
    import torch

    from diffprt.inverse import recover_light
    from diffprt.optimization import load_references
    from diffprt.representation import files as assets

    check_ending(output, ".exr")
    check_output(output)
    begun = time.perf_counter()
    pictures = load_references(references)
    if any(not torch.equal(entry.light, pictures.entries[0].light) for entry in pictures):
        raise InputError(
            f"references {references} were made under several lights: give pictures of one, such as those of "
            "'diffprt render ASSET --reference-set 8 --lights sky --no-turn', or recover them by 'invert joint'"
        )
    found = recover_light(assets.load(source), pictures, order=order)
    write_map(output, found.light)
    print_light(found)
    print(f"{output}: {2 * _MAP_ROWS} x {_MAP_ROWS}")
    _report(json_file, "light", source, references, begun, {"light": found.as_dict()}, output)


@app.command(help="The albedo of every receiver, from pictures under known lights.")
def albedo(
    source: InputFile = Source,
    references: InputFile = References,
    output: OutputFile = typer.Option(Path("albedo.prt"), "-o", "--output", help="The asset with the albedo found."),
    noise: float = typer.Option(None, help="Standard deviation of a pixel, as a share.  [default: what is found]"),
    variation: float = typer.Option(0.05, help="By how much the albedos of neighbors are expected to differ."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.inverse import recover_albedo
    from diffprt.optimization import load_references
    from diffprt.representation import files as assets

    check_ending(output, ".prt")
    check_output(output)
    begun = time.perf_counter()
    asset = assets.load(source)
    found = recover_albedo(asset, load_references(references), noise=noise, variation=variation)
    assets.save(with_albedo(asset, found.albedo), output)
    print_albedo(found)
    print(output)
    _report(json_file, "albedo", source, references, begun, {"albedo": found.as_dict()}, output)


@app.command(help="Lights and albedo together, from pictures under two or more unknown lights.")
def joint(
    source: InputFile = Source,
    references: InputFile = References,
    output: OutputFile = typer.Option(
        Path("albedo.prt"), "-o", "--output", help="The asset; its lights lie beside it."
    ),
    mean_albedo: str = typer.Option("0.5", help="Of what the pictures show, 0.5 or r,g,b: fixes the lights' scale."),
    noise: float = typer.Option(None, help="Standard deviation of a pixel, as a share.  [default: what is found]"),
    variation: float = typer.Option(0.05, help="By how much the albedos of neighbors are expected to differ."),
    json_file: OutputFile = JsonFile,
) -> None:
    import torch

    from diffprt.inverse import recover_light_and_albedo
    from diffprt.optimization import load_references
    from diffprt.representation import files as assets

    check_ending(output, ".prt")
    check_output(output)
    begun = time.perf_counter()
    asset, pictures = assets.load(source), load_references(references)
    kinds: dict[bytes, int] = {}
    lit_by = [kinds.setdefault(entry.light.numpy().tobytes(), len(kinds)) for entry in pictures]
    mean = torch.tensor(parse_color(mean_albedo, "mean-albedo"))
    found = recover_light_and_albedo(asset, pictures, lit_by=lit_by, mean_albedo=mean, noise=noise, variation=variation)
    assets.save(with_albedo(asset, found.albedo.albedo), output)
    print_albedo(found.albedo)
    for index, estimate in enumerate(found.lights):
        file = output.with_name(f"{output.stem}_light{index}.exr")
        write_map(file, estimate.light)
        print_light(estimate)
        print(file)
    print(f"off by {100 * found.mismatch:.2g} %, the next best explanation by {100 * found.next_best:.2g} %")
    _report(json_file, "joint", source, references, begun, found.as_dict(), output)


def with_albedo(asset, albedo: torch.Tensor):
    """The asset with another albedo; its transfer stays as it is."""
    return asset.with_elements(asset.elements.with_albedo(albedo))


def write_map(path: Path, light: Light) -> None:
    """The light as an equirectangular map; where its bands ring below 0 they are kept, EXR holds them."""
    from diffprt import sh
    from diffprt.images import write_image

    write_image(path, sh.render_map(light.coefficients, _MAP_ROWS, 2 * _MAP_ROWS))


def print_light(found) -> None:
    """What each band is known to."""
    rows = [
        [str(l), f"{gain:.4f}", "-" if error == float("inf") else f"{100 * error:.2f} %", "yes" if seen else "no"]
        for l, (gain, error, seen) in enumerate(zip(found.gain, found.standard_error, found.observable, strict=True))
    ]
    print_table("Light by band", ["band", "gain", "standard error", "observable"], rows)
    unseen = [str(l) for l, seen in enumerate(found.observable) if not seen]
    if unseen:
        print(f"note: the pictures do not tell bands {', '.join(unseen)}; they are 0 in the light")
    print(f"unexplained: {100 * found.residual:.2f} % of the pictures")


def print_albedo(found) -> None:
    """What the albedo is, and how much of it the pictures tell."""
    mean = ", ".join(f"{value:.3f}" for value in found.albedo.mean(0).tolist())
    print(f"albedo: mean {mean}; {100 * float((found.told > 0.5).float().mean()):.1f} % told by pixels")
    print(f"unexplained: {100 * found.residual:.2f} % of the pictures")
    if found.clamped > 0.01:
        print(
            f"note: {100 * found.clamped:.1f} % of the values lay outside [0, 1]: is the light right?", file=sys.stderr
        )


def _report(file: Path | None, kind: str, source: Path, references: Path, begun: float, found: dict, output: Path):
    settings = {"asset": str(source), "references": str(references)}
    timings = {"total": time.perf_counter() - begun}
    content = {"settings": settings, "timings": timings, "outputs": {"file": str(output)}, **found}
    write_report(file, f"invert {kind}", content)
