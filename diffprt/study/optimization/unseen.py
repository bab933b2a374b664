"""Optimization towards effects that the bake never saw: references by a path tracer, a bake without interreflection."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from diffprt.compression import compress
from diffprt.optimization import References, optimize
from diffprt.optimization.references.checks import check_references
from diffprt.optimization.references.pictures import Pictures
from diffprt.scene import load_scene
from diffprt.study.optimization.sheet import optimization_sheet
from diffprt.transfer import bake
from diffprt.whole_file import make_folder

_PARAMETERS = ("means", "bases", "weights", "albedo", "exposure")
_LOSS = "image + transfer"


def unseen_study(
    source: str | Path,
    references: References,
    output: Path,
    *,
    clusters: int = 64,
    components: int = 8,
    order: int = 6,
    rays: int = 1024,
    steps: int = 100,
    parameters: Sequence[str] = _PARAMETERS,
    loss: str = _LOSS,
) -> dict:
    """Bakes direct light alone, compresses it and trains it towards pictures with everything in them.

    Args:
        source: the scene of the references.
        references: such as `mitsuba_references` makes.
        output: folder for the sheet: reference, before, after and differences of a picture that was held out.

    Returns:
        the report of `optimize` with the sheet's path and seconds of CPU.
    """
    transfer = bake(load_scene(source), order=order, rays=rays, bounces=0)
    start = compress(transfer, clusters=clusters, components=components)
    report: dict = {}
    begun = time.process_time()
    options = {"target": transfer, "parameters": parameters, "loss": loss, "steps": steps}
    found = optimize(start, references, **options, report=report)
    report["timings"]["cpu"] = time.process_time() - begun
    views = check_references(start, references)
    held = Pictures(references, views, held_out=0.2).held[0]
    make_folder(output)
    path = output / "unseen.png"
    optimization_sheet(
        path, {"before": start, "after": found}, ("before", "after"), references.entries[held], views[held]
    )
    return report | {"files": {"sheet": str(path)}}
