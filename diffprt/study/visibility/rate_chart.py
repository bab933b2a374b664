"""Rays per second of all contenders, side by side."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from diffprt.rendering.sheet import save_figure

# Ours in one hue and each peer in its own; one core lighter than all.
_CONTENDERS = (
    ("ours_one_core", "diffprt, 1 core", "#8ab6e8"),
    ("embreex", "embreex, 1 core", "#e9b18a"),
    ("ours", "diffprt, all cores", "#1f66b5"),
    ("mitsuba", "Mitsuba LLVM, all cores", "#b5531f"),
)


def rate_chart(path: str | Path, rows: list[dict], *, title: str) -> None:
    """Writes a PNG: medians as bars with their quartiles, one group of bars for each scene and ray count.

    Args:
        rows: `rows` of `visibility_study`.
    """
    figure = Figure(figsize=(max(7.0, 1.6 * len(rows) + 2.0), 4.8), dpi=110, layout="constrained")
    axis = figure.subplots()
    width = 0.8 / len(_CONTENDERS)
    highest = 0.0
    for place, (key, label, color) in enumerate(_CONTENDERS):
        shown = [(index, row["contenders"][key]) for index, row in enumerate(rows)]
        shown = [(index, entry["rate"]) for index, entry in shown if entry["skipped"] is None]
        if not shown:
            continue
        at = [index + (place - (len(_CONTENDERS) - 1) / 2) * width for index, _ in shown]
        medians = [rate["median"] / 1e6 for _, rate in shown]
        errors = [
            [(rate["median"] - rate["low"]) / 1e6 for _, rate in shown],
            [(rate["high"] - rate["median"]) / 1e6 for _, rate in shown],
        ]
        axis.bar(at, medians, 0.92 * width, label=label, color=color)
        axis.errorbar(at, medians, yerr=errors, fmt="none", ecolor="0.25", elinewidth=1, capsize=2)
        for x, median, above in zip(at, medians, errors[1], strict=True):
            axis.annotate(
                f"{median:.3g}", (x, median + above), (0, 2), textcoords="offset points", ha="center", fontsize=7
            )
        highest = max(highest, *(m + e for m, e in zip(medians, errors[1], strict=True)))
    axis.set_xticks(range(len(rows)), [f"{row['scene']}\n{row['rays_per_receiver']} rays" for row in rows], fontsize=8)
    axis.set_ylabel("million rays per second")
    axis.set_ylim(0, 1.08 * highest or 1.0)
    axis.set_title(title, fontsize=10)
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(frameon=False, fontsize=8, ncols=4, loc="outside lower center")
    save_figure(path, figure)
