"""Error over tolerance against cost over the best, one dot per run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from diffprt.rendering.sheet import save_figure

_COLORS = ("#1f66b5", "#b5531f", "#2f8f57", "#8452a5", "#a58a1f", "#555555")
_MARKERS = "os^Dv*"
_LABELED, _APART = 8, 0.06


def tolerance_chart(path: str | Path, rows: list[dict]) -> None:
    """Writes a PNG: color tells the tolerance, shape the bounces; the runs that stand out have names.

    Args:
        rows: `rows` of `tolerance_study`.
    """
    figure = Figure(figsize=(9.0, 5.6), dpi=110, layout="constrained")
    axis = figure.subplots()
    cost = np.array([row["cost"] for row in rows])
    share = np.array([row["error"] / row["tolerance"] for row in rows])
    right, top = max(2.2, 1.12 * cost.max()), max(1.15, 1.08 * share.max())
    axis.fill_between([0, 2], 0, 1, color="#2f8f57", alpha=0.07, linewidth=0)
    axis.axhline(1, color="0.4", linewidth=1, linestyle="--")
    axis.axvline(2, color="0.4", linewidth=1, linestyle="--")
    tolerances = sorted({row["tolerance"] for row in rows}, reverse=True)
    bounces = sorted({row["bounces"] for row in rows})
    for i, tolerance in enumerate(tolerances):
        for j, count in enumerate(bounces):
            here = [k for k, row in enumerate(rows) if (row["tolerance"], row["bounces"]) == (tolerance, count)]
            axis.scatter(
                cost[here],
                share[here],
                s=34,
                color=_COLORS[i % len(_COLORS)],
                marker=_MARKERS[j % len(_MARKERS)],
                edgecolors="white",
                linewidths=0.6,
                label=f"{tolerance:g}, {count} bounces",
            )
    for k in _standing_out(cost, share):
        axis.annotate(rows[k]["scene"], (cost[k], share[k]), (5, 4), textcoords="offset points", fontsize=7)
    axis.set_xlim(0.9 * min(1.0, cost.min()), right)
    axis.set_ylim(-0.03 * top, top)
    axis.set_xlabel("rays, trials included, over those of the best fixed setting")
    axis.set_ylabel("measured error over tolerance")
    axis.set_title(f"{len(rows)} runs: shaded is kept at no more than twice the best cost", fontsize=10)
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(frameon=False, fontsize=8, ncols=4, loc="outside lower center")
    save_figure(path, figure)


def _standing_out(cost: np.ndarray, share: np.ndarray) -> list[int]:
    """Runs that missed or were dearest, worst first, none so near another that their names would overlap."""
    chosen: list[int] = []
    for k in np.argsort(-np.maximum(share, cost / 2)).tolist():
        near = (abs(share[k] - share[i]) < _APART and abs(cost[k] - cost[i]) < 3 * _APART for i in chosen)
        if len(chosen) < _LABELED and not any(near):
            chosen.append(k)
    return chosen
