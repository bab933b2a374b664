"""Contact sheets: pictures in rows and columns, with names."""

from __future__ import annotations

import io
from pathlib import Path

import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from diffprt.whole_file import write_whole


def contact_sheet(path: str | Path, pictures: list[list[torch.Tensor]], columns: list[str], rows: list[str]) -> None:
    """Writes a PNG of `pictures[row][column]`, each [H, W, 3] in display values."""
    height, width = pictures[0][0].shape[:2]
    side = 3.2
    figure = Figure(
        figsize=(side * len(columns), side * height / width * len(rows) + 0.35),
        dpi=width / side,
        layout=ConstrainedLayoutEngine(w_pad=0.02, h_pad=0.02, hspace=0.0, wspace=0.0),
    )
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(rows), len(columns), squeeze=False)
    for row, name in enumerate(rows):
        for column, title in enumerate(columns):
            axis = axes[row][column]
            axis.imshow(pictures[row][column].detach().clamp(0, 1).numpy(), interpolation="nearest")
            axis.set_xticks([])
            axis.set_yticks([])
            axis.spines[:].set_visible(False)
            if row == 0:
                axis.set_title(title, fontsize=11)
            if column == 0:
                axis.set_ylabel(name, fontsize=11)
    save_figure(path, figure)


def save_figure(path: str | Path, figure: Figure) -> None:
    """Writes a figure as PNG, whole or not at all; raises InputError where it cannot."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png")
    write_whole(Path(path), drawn.getvalue(), "picture")
