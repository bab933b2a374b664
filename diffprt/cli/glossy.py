"""What `bake --brdf` does: glossy transfer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from diffprt.cli.outputs import check_output, write_report
from diffprt.cli.tables import print_table, size_text
from diffprt.errors import InputError
from diffprt.options.bake import GlossySettings
from diffprt.progress import status, track

if TYPE_CHECKING:
    from diffprt.brdf import Brdf
    from diffprt.scene import Scene
    from diffprt.transfer import GlossyEstimate


def refuse_with_brdf(given: dict[str, bool]) -> None:
    """Names the first option that is given and that glossy bakes do not take."""
    option = next((option for option, present in given.items() if present), None)
    if option is not None:
        raise InputError(f"{option} is given with --brdf: glossy bakes do not take it, leave one of them out")


def bake_glossy_scene(
    scene: Scene,
    source: str,
    brdf: Sequence[Brdf],
    settings: GlossySettings,
    *,
    output: Path,
    threads: int | None,
    hours: float,
    dry_run: bool,
    json_file: Path | None,
) -> None:
    """Estimates, bakes, saves and reports."""
    from diffprt.representation import files as assets
    from diffprt.transfer import (
        available_memory,
        bake_glossy,
        check_glossy_memory,
        check_glossy_time,
        discard_chunks,
        estimate_glossy,
    )

    given = brdf[0] if len(brdf) == 1 else brdf
    with status("trying a few rays"):
        estimate = estimate_glossy(scene, given, settings, threads=threads)
    if dry_run:
        _print_estimate(source, settings, estimate, json_file)
        return
    check_glossy_memory(estimate.memory_bytes, available_memory(), settings)
    check_glossy_time(estimate, hours)
    check_output(output)
    report: dict = {}
    parts = output.with_name(output.name + ".parts")
    transfer = bake_glossy(
        scene, given, **settings.as_dict(), threads=threads, checkpoint=parts, track=track, report=report
    )
    size = assets.save(transfer, output)
    discard_chunks(parts)
    counts = report["counts"]
    if counts["resumed_chunks"]:
        print(
            f"resumed: {counts['resumed_chunks']} of {counts['chunks']} chunks were done, "
            f"{counts['recomputed_in_flight']} in flight were recomputed"
        )
    noise = report["errors"]["noise_relative"]
    print(
        f"{output}: {len(transfer.receivers):,} receivers, order {transfer.order}, exit order {transfer.order_out}, "
        f"{settings.rays} rays, {size_text(size)}, noise below {100 * noise:.2f} %"
    )
    report |= {
        "estimate": estimate.as_dict(),
        "defects": scene.defects.as_dict(),
        "outputs": {"asset": str(output), "bytes": size},
    }
    write_report(json_file, "bake", report)


def _print_estimate(source: str, settings: GlossySettings, estimate: GlossyEstimate, json_file: Path | None) -> None:
    """Expected cost, before any work."""
    rows = [
        ["receivers", f"{estimate.receivers:,}"],
        ["rays per receiver", f"{settings.rays:,}"],
        ["rays per receiver and bounce", f"{settings.bounce_rays:,}"],
        ["rays", f"{estimate.rays:,}"],
        ["threads", str(estimate.threads)],
        ["time", f"{estimate.seconds:.1f} s"],
        ["memory", size_text(estimate.memory_bytes)],
        ["asset", size_text(estimate.asset_bytes)],
    ]
    title = f"{source}: order {settings.order}, exit order {settings.order_out}, {settings.bounces} bounces"
    print_table(title, ["expected", ""], rows)
    report = {"dry_run": True, "settings": settings.as_dict(), "estimate": estimate.as_dict()}
    write_report(json_file, "bake", report)
