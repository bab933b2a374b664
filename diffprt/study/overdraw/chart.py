"""Squared error over overdraw, a mark for each method."""

from __future__ import annotations

import re
from itertools import cycle
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diffprt.rendering.sheet import save_figure
from diffprt.study.overdraw.methods import ORIGINAL, PATCHES, PEER, is_ours
from diffprt.study.overdraw.summary import overdraw_at
from diffprt.study.rows import grouped

# The thesis's methods in warm colors, ours in cold ones, peers in gray.
_WARM = ("#b5531f", "#d98c3f", "#c03a5b", "#8a6d1c")
_COLD = ("#1f66b5", "#2f8f57", "#6a4fb0", "#1f9fb5", "#103a66", "#5a8f2f")
_MARKERS = "osD^vP*X<>"


def overdraw_charts(folder: Path, rows: list[dict]) -> list[str]:
    """Writes a PNG for each scene, BRDF and number of channels; returns their paths.

    Panels: numbers of clusters from left to right; clusters alone above, super-clusters at the least budget below,
    for the thesis's methods as figure 4.6 selects them, for ours the better selection.
    """
    written = []
    for (scene, brdf, channels), own in sorted(grouped(rows, "scene", "brdf", "channels").items()):
        path = folder / f"overdraw-{file_name(own[0])}.png"
        if _chart(path, own, f"{scene}, {brdf}" + (", RGB" if channels == 3 else "")):
            written.append(str(path))
    return written


def file_name(row: dict) -> str:
    """What files about the signal of a row are called."""
    channels = "-rgb" if row["channels"] == 3 else ""
    return re.sub(r"[^\w.=-]+", "_", f"{row['scene']}-{row['brdf']}{channels}")


def _chart(path: Path, rows: list[dict], title: str) -> bool:
    originals = {row["clusters"]: row for row in sorted(rows, key=lambda r: -r["seed"]) if row["method"] == ORIGINAL}
    counts = sorted(count for count, row in originals.items() if row["squared_error"] > 0)
    if not counts:
        return False
    budgets = [b for b, found in originals[counts[0]]["super_clusters"].items() if found is not None]
    panels = ["clusters", *sorted(budgets, key=int)[:1]]
    styles = _styles(rows)
    figure = Figure(figsize=(3.4 * len(counts) + 2.2, 3.2 * len(panels) + 0.6), dpi=110, layout="constrained")
    axes = figure.subplots(len(panels), len(counts), squeeze=False)
    for line, budget in enumerate(panels):
        for column, count in enumerate(counts):
            axis = axes[line][column]
            _panel(axis, [row for row in rows if row["clusters"] == count], originals[count], budget, styles)
            if line == 0:
                axis.set_title(f"{count} clusters", fontsize=10)
            if column == 0:
                drawn = "each cluster a pass" if budget == "clusters" else f"super-clusters, {budget} registers"
                axis.set_ylabel(f"{drawn}\nsquared error over original", fontsize=9)
            if line == len(panels) - 1:
                axis.set_xlabel("average triangle overdraw", fontsize=9)
    handles: dict = {}
    for axis in axes.flat:
        handles |= dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    labels = [name for name in styles if name in handles]
    figure.legend([handles[name] for name in labels], labels, frameon=False, fontsize=8, loc="outside right center")
    figure.suptitle(title, fontsize=11)
    save_figure(path, figure)
    return True


def _panel(axis: Axes, rows: list[dict], original: dict, budget: str, styles: dict[str, dict]) -> None:
    axis.axhline(1, color="0.6", linewidth=0.8, linestyle="--")
    for row in rows:
        selection = "search" if is_ours(row["method"]) else "greedy"
        drawn = overdraw_at(row, budget, selection)
        if drawn is not None:
            share = row["squared_error"] / original["squared_error"]
            axis.scatter([drawn], [share], s=42, edgecolors="white", linewidths=0.6, **styles[row["method"]])
    axis.margins(0.12)
    axis.tick_params(labelsize=8)
    axis.spines[["top", "right"]].set_visible(False)


def _styles(rows: list[dict]) -> dict[str, dict]:
    """Color, mark and label of every method."""
    methods = sorted({row["method"] for row in rows})
    thesis = [m for m in methods if not is_ours(m) and m not in (PEER, PATCHES)]
    ours = [m for m in methods if is_ours(m)]
    colors = dict(zip(thesis, cycle(_WARM), strict=False)) | dict(zip(ours, cycle(_COLD), strict=False))
    colors |= {m: gray for m, gray in ((PEER, "0.45"), (PATCHES, "0.65")) if m in methods}
    return {
        method: {"color": color, "marker": _MARKERS[i % len(_MARKERS)], "label": method}
        for i, (method, color) in enumerate(colors.items())
    }
