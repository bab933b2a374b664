"""Compute how a scene transports light, and save it as an asset."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from diffprt.cli.from_options import from_options
from diffprt.cli.glossy import bake_glossy_scene, refuse_with_brdf
from diffprt.cli.outputs import JsonFile, check_ending, check_output, write_report
from diffprt.cli.parsing import parse_bounces
from diffprt.cli.tables import print_table, size_text
from diffprt.errors import InputError
from diffprt.options.bake import CONVERGED, BakeOptions, BakeSettings, GlossySettings
from diffprt.progress import status, track

if TYPE_CHECKING:
    from diffprt.transfer import Estimate, SamplingRate


@from_options(BakeOptions, bounces=parse_bounces)
def run(
    source: str = typer.Argument(
        ..., metavar="SCENE", help="A .glb, .gltf, .obj, .ply, .stl or .usd file, or builtin:NAME."
    ),
    output: Path = typer.Option(Path("asset.prt"), "-o", "--output", help="The asset to write (.prt)."),
    planned: str = typer.Option(
        "off", "--plan", help="off; on: simulate what the scene calls for; or the light (sky, a map) it is for."
    ),
    brdf: list[str] = typer.Option(
        [],
        help="Makes surfaces glossy: NAME:KEY=VALUE,..., such as phong:exponent=16,specular=0.5; lambert, phong, "
        "modified-phong, cook-torrance or ggx. One for all, or repeated, one per material.",
    ),
    albedo: str = typer.Option(None, help="Replaces every albedo: 0.8 or r,g,b."),
    up: str = typer.Option(None, help="The axis of the file that points up: x, y, z or -x, -y, -z; y by default."),
    ground: bool = typer.Option(False, help="Add a ground that catches shadows."),
    occluder: list[str] = typer.Option([], help="A mesh that only blocks light; may be repeated."),
    non_finite: str = typer.Option("refuse", help="refuse, or drop: what to do with NaN vertices."),
    winding: str = typer.Option("repair", help="repair, or keep: for rooms that are seen from within."),
    recenter: bool = typer.Option(False, help="Move the scene to the origin before its coordinates are rounded."),
    dry_run: bool = typer.Option(False, help="Print expected time, memory and bytes; do nothing."),
    json_file: Path = JsonFile,
    *,
    options: BakeOptions,
) -> None:
    from diffprt.brdf import parse_brdf
    from diffprt.cli.scenes import load_light, load_scene
    from diffprt.planning import plan
    from diffprt.representation import files as assets
    from diffprt.transfer import (
        available_memory,
        bake,
        check_memory,
        check_time,
        choose_rays,
        discard_chunks,
        estimate_bake,
    )

    check_ending(output, ".prt")
    threads, seconds = options.threads, options.seconds
    glossy = [parse_brdf(text) for text in brdf]
    if glossy:
        own = {"--tolerance": options.tolerance, "--seconds": seconds, "--albedo": albedo}
        refuse_with_brdf(
            {option: value is not None for option, value in own.items()}
            | {"--plan": planned != "off", "--operator": options.operator != "auto"}
        )
    elif given := [name for name in ("order_out", "bounce_rays") if vars(options)[name] is not None]:
        option = given[0].replace("_", "-")
        raise InputError(f"--{option} is given without --brdf: exit radiance has bands where surfaces are glossy")
    settings = options.settings(GlossySettings if glossy else BakeSettings)
    scene = load_scene(
        source,
        albedo=albedo,
        ground=ground,
        occluders=occluder,
        up=up,
        non_finite=non_finite,
        winding=winding,
        recenter=recenter,
    )
    for line in scene.defects.lines():
        print(f"note: {line}")
    if glossy:
        paths = {"output": output, "json_file": json_file}
        bake_glossy_scene(
            scene, source, glossy, settings, **paths, threads=threads, hours=options.hours, dry_run=dry_run
        )
        return
    decided = None
    if planned != "off":
        with status("planning"):
            light = None if planned == "on" else load_light(planned, 10)
            decided = plan(scene, options.tolerance or 0.01, light=light, order=options.order, bounces=options.bounces)
        for line in decided.lines():
            print(line)
        settings = replace(settings, order=decided.order.value, bounces=decided.bounces.value)
    rate = None
    with status("trying a few rays"):
        # Where a plan proves that nothing is shadowed, no ray will be traced and none need be chosen.
        if decided is None or decided.shadows.value:
            settings, rate = choose_rays(
                scene, settings, rays=options.rays, tolerance=options.tolerance, seconds=seconds, threads=threads
            )
        estimate = estimate_bake(scene, settings, operator=options.operator, threads=threads)
    if dry_run:
        _print_estimate(source, settings, estimate, rate, json_file)
        return
    check_memory(estimate, settings, available_memory())
    if seconds is None:
        check_time(estimate, options.hours)
    check_output(output)
    parts = output.with_name(output.name + ".parts")
    report: dict = {}
    transfer = bake(
        scene,
        **settings.as_dict(),
        sampling=rate,
        plan=decided,
        fill_inside=options.fill_inside,
        operator=estimate.operator,
        hours=math.inf,
        threads=threads,
        # A bake that was asked to end in some seconds is not worth resuming, and its rays depend on the clock.
        checkpoint=parts if seconds is None else None,
        track=track,
        report=report,
    )
    size = assets.save(transfer, output)
    discard_chunks(parts)
    counts, errors = report["counts"], report["errors"]
    if counts.get("resumed_chunks"):
        print(
            f"resumed: {counts['resumed_chunks']} of {counts['chunks']} chunks were done, "
            f"{counts['recomputed_in_flight']} in flight were recomputed"
        )
    if errors.get("receivers_inside"):
        print(f"note: {errors['receivers_inside']:,} receivers lie inside geometry" + ", filled" * options.fill_inside)
    print(
        f"{output}: {len(transfer.receivers):,} receivers, order {transfer.order}, {settings.rays} rays, "
        f"{size_text(size)}{_error_text(errors)}"
    )
    report |= {
        "estimate": estimate.as_dict(),
        "defects": scene.defects.as_dict(),
        "outputs": {"asset": str(output), "bytes": size},
    }
    write_report(json_file, "bake", report)


def _error_text(errors: dict) -> str:
    """What is known of the error of the signal."""
    if "estimated_error" in errors:
        return f", error about {100 * errors['estimated_error']:.2f} %"
    return f", noise below {100 * errors['noise_relative']:.2f} %" if "noise_relative" in errors else ""


def _bounces_text(settings: BakeSettings) -> str:
    """How many bounces, in words."""
    return "all bounces" if settings.bounces == CONVERGED else f"{settings.bounces} bounces"


def _print_estimate(
    source: str, settings: BakeSettings, estimate: Estimate, rate: SamplingRate | None, json_file: Path | None
) -> None:
    """Expected cost, before any work."""
    rows = [
        ["receivers", f"{estimate.receivers:,}"],
        ["rays per receiver", f"{settings.rays:,}"],
        ["rays", f"{estimate.rays:,}"],
        ["threads", str(estimate.threads)],
        ["bounces from", "recomputed hits" if estimate.operator == "recompute" else "stored hits"],
        ["time", f"{estimate.seconds:.1f} s"],
        ["memory", size_text(estimate.memory_bytes)],
        ["asset", size_text(estimate.asset_bytes)],
    ]
    report = {"dry_run": True, "settings": settings.as_dict(), "estimate": estimate.as_dict()}
    if rate is not None:
        rows.append(["error", f"{100 * rate.expected_error:.2f} %"])
        report["sampling"] = rate.as_dict()
    print_table(f"{source}: order {settings.order}, {_bounces_text(settings)}", ["expected", ""], rows)
    write_report(json_file, "bake", report)
