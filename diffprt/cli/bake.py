"""Compute how a scene transports light, and save it as an asset."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import typer

from diffprt.cli.batch import Item, items, run_batch
from diffprt.cli.clock import command_begun
from diffprt.cli.from_options import from_options
from diffprt.cli.outputs import BatchJson, check_output
from diffprt.cli.parsing import parse_bounces, parse_color
from diffprt.cli.paths import AssetsWithParts, InputName, InputNames, OutputReports
from diffprt.cli.tables import print_table, size_text
from diffprt.cli.terminal import print
from diffprt.errors import InputError
from diffprt.options import CONVERGED, BakeOptions
from diffprt.progress import status, track

if TYPE_CHECKING:
    from diffprt.transfer import Job


@from_options(BakeOptions, bounces=parse_bounces)
def run(
    source: InputNames = typer.Argument(
        ...,
        metavar="SCENE...",
        help="A .glb, .gltf, .obj, .ply, .stl or .usd file, or builtin:NAME; of several, a failure does not stop the "
        "others.",
    ),
    output: AssetsWithParts = typer.Option(
        "asset.prt", "-o", "--output", help="The asset to write (.prt); for several scenes the folder for one of each."
    ),
    planned: InputName = typer.Option(
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
    occluder: InputNames = typer.Option([], help="A mesh that only blocks light; may be repeated."),
    non_finite: str = typer.Option("refuse", help="refuse, or drop: what to do with NaN vertices."),
    winding: str = typer.Option("repair", help="repair, or keep: for rooms that are seen from within."),
    recenter: bool = typer.Option(False, help="Move the scene to the origin before its coordinates are rounded."),
    dry_run: bool = typer.Option(False, help="Print expected time, memory and bytes; do nothing."),
    reports: OutputReports = BatchJson,
    *,
    options: BakeOptions,
) -> None:
    todo = items(source, output, ".prt")

    from diffprt.brdf import parse_brdf
    from diffprt.cli.scenes import load_light, load_scene
    from diffprt.planning import plan
    from diffprt.representation import files as assets
    from diffprt.transfer import discard_chunks, prepare

    brdfs = [parse_brdf(text) for text in brdf]
    if brdfs and (albedo is not None or planned != "off"):
        given = "plan" if albedo is None else "albedo"
        raise InputError(f"{given} is given with a BRDF: glossy bakes do not take it, leave one of them out")
    if albedo is not None:
        parse_color(albedo, "albedo")
    light = None if planned in ("off", "on") else load_light(planned, 10)
    loading = {
        "albedo": albedo,
        "ground": ground,
        "occluders": occluder,
        "up": up,
        "non_finite": non_finite,
        "winding": winding,
        "recenter": recenter,
    }

    def one(item: Item) -> dict:
        loaded = time.monotonic()
        scene = load_scene(item.source, **loading)
        for line in scene.defects.lines():
            print(f"note: {line}")
        scene = scene.with_brdf(brdfs) if brdfs else scene
        decided = None
        if planned != "off":
            with status("planning"):
                decided = plan(
                    scene, options.tolerance or 0.01, light=light, order=options.order, bounces=options.bounces
                )
            for line in decided.lines():
                print(line)
        # The time of one bake has the start of the command in it.
        begun = command_begun() if item is todo[0] else loaded
        job = prepare(scene, plan=decided, begun=begun, **vars(options))
        output = item.target if dry_run else check_output(item.target)
        with status("trying a few rays"):
            estimate = job.estimate()
        if dry_run:
            return _print_estimate(item.source, job)
        parts, report = output.with_name(output.name + ".parts"), {}
        # A bake that was asked to end in some seconds is not worth resuming, and its rays depend on the clock.
        asset = job.run(checkpoint=parts if options.seconds is None else None, track=track, report=report)
        size = assets.save(asset, output)
        discard_chunks(parts)
        counts, errors = report["counts"], report["errors"]
        if counts.get("resumed_chunks"):
            print(
                f"resumed: {counts['resumed_chunks']} of {counts['chunks']} chunks were done, "
                f"{counts['recomputed_in_flight']} in flight were recomputed"
            )
        if counts.get("damaged_chunks"):
            print(
                f"note: {counts['damaged_chunks']} of {counts['chunks']} chunks in {parts} were damaged or not of this "
                "bake, and were traced again"
            )
        if errors.get("receivers_inside"):
            print(
                f"note: {errors['receivers_inside']:,} receivers lie inside geometry" + ", filled" * options.fill_inside
            )
        if "rays_fewest" in errors:
            print(
                f"note: the machine's speed changed on the way: {errors['rays_fewest']} to {errors['rays_most']} rays, "
                f"{errors['rays_mean']:.0f} in the mean"
            )
        print(
            f"{output}: {estimate.receivers:,} receivers, {_bands_text(job)}, {report['settings']['rays']} rays, "
            f"file {size_text(size)}{_error_text(errors)}"
        )
        report |= {
            "estimate": estimate.as_dict(),
            "defects": scene.defects.as_dict(),
            "outputs": {"asset": str(output), "bytes": size},
        }
        return report

    run_batch("bake", todo, reports, one)


def _bands_text(job: Job) -> str:
    """Orders, in words."""
    out = job.settings.as_dict().get("order_out")
    return f"order {job.settings.order}" + (f", exit order {out}" if out else "")


def _error_text(errors: dict) -> str:
    """What is known of the error of the signal."""
    if "estimated_error" in errors:
        return f", error about {100 * errors['estimated_error']:.2f} %"
    return f", noise below {100 * errors['noise_relative']:.2f} %" if "noise_relative" in errors else ""


def _print_estimate(source: str, job: Job) -> dict:
    """Expected cost, before any work; the report."""
    settings, estimate = job.settings, job.estimate()
    rows = [
        ["receivers", f"{estimate.receivers:,}"],
        ["rays per receiver", f"{settings.rays:,}"],
        ["rays", f"{estimate.rays:,}"],
        ["threads", str(estimate.threads)],
        ["bounces from", "recomputed hits" if estimate.operator == "recompute" else "stored hits"],
        ["time", f"{estimate.seconds:.1f} s"],
        ["memory", size_text(estimate.memory_bytes)],
        ["asset file", size_text(estimate.asset_bytes)],
    ]
    report = {"dry_run": True, "settings": settings.as_dict(), "estimate": estimate.as_dict()}
    if job.sampling is not None:
        rows.append(["error", f"{100 * job.sampling.expected_error:.2f} %"])
        report["sampling"] = job.sampling.as_dict()
    bounces = "all bounces" if settings.bounces == CONVERGED else f"{settings.bounces} bounces"
    print_table(f"{source}: {_bands_text(job)}, {bounces}", ["expected", ""], rows)
    return report
