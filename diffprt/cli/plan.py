"""Decide what a bake of a scene would simulate, and say why."""

from __future__ import annotations

import textwrap
import time

import typer

from diffprt.cli.outputs import JsonFile, write_report
from diffprt.cli.parsing import parse_bounces
from diffprt.cli.paths import InputName, InputNames, OutputFile
from diffprt.cli.terminal import print
from diffprt.planning.decision import EFFECTS, value_text
from diffprt.progress import status


def run(
    source: InputName = typer.Argument(
        ..., metavar="SCENE", help="A .glb, .gltf, .obj, .ply, .stl or .usd file, or builtin:NAME."
    ),
    tolerance: float = typer.Option(0.01, help="Relative error that all that is left out may have, in (0, 1]."),
    light: InputName = typer.Option(None, help="The light to plan for: sky, studio, ..., or an equirectangular map."),
    shadows: bool = typer.Option(None, help="Ask for shadows, or for none."),
    bounces: str = typer.Option(None, help="Ask for this many diffuse interreflections, or converged."),
    channels: int = typer.Option(None, help="Ask for 1 or 3 channels."),
    order: int = typer.Option(None, help="Ask for this many SH bands, 1 to 10."),
    albedo: str = typer.Option(None, help="Replaces every albedo: 0.8 or r,g,b."),
    up: str = typer.Option(None, help="The axis of the file that points up: x, y, z or -x, -y, -z; y by default."),
    ground: bool = typer.Option(False, help="Add a ground that catches shadows."),
    occluder: InputNames = typer.Option([], help="A mesh that only blocks light; may be repeated."),
    non_finite: str = typer.Option("refuse", help="refuse, or drop: what to do with NaN vertices."),
    winding: str = typer.Option("repair", help="repair, or keep: for rooms that are seen from within."),
    json_file: OutputFile = JsonFile,
) -> None:
    from diffprt.cli.scenes import load_light, load_scene
    from diffprt.planning import plan

    asked = parse_bounces(bounces)
    scene = load_scene(
        source, albedo=albedo, ground=ground, occluders=occluder, up=up, non_finite=non_finite, winding=winding
    )
    for line in scene.defects.lines():
        print(f"note: {line}")
    lit = None if light is None else load_light(light, 10)
    begun = time.perf_counter()
    with status("sending pilot rays"):
        decided = plan(scene, tolerance, light=lit, shadows=shadows, bounces=asked, channels=channels, order=order)
    seconds = time.perf_counter() - begun
    print(f"{source}: tolerance {100 * tolerance:g} %" + (f", light {light}" if light else ""))
    print()
    rows = [("effect", "decision", "reason")]
    rows += [(name, value_text(getattr(decided, name).value), getattr(decided, name).reason) for name in EFFECTS]
    for row in rows:
        for line in _row(*row):
            print(line)
    write_report(
        json_file,
        "plan",
        {"plan": decided.as_dict(), "timings": {"plan": seconds}, "counts": {"triangles": scene.triangle_count}},
    )


def _row(effect: str, decision: str, reason: str) -> list[str]:
    """One row of the table, its reason wrapped under itself."""
    return textwrap.wrap(f"{effect:<10}{decision:<10}{reason}", 100, subsequent_indent=" " * 20)
