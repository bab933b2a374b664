"""Pictures of clusterings: where the clusters lie, which triangles are drawn again, and where the error is."""

from __future__ import annotations

from pathlib import Path

import torch
from matplotlib import colormaps
from matplotlib.colors import hsv_to_rgb
from safetensors.torch import load_file

from diffprt.compression import draws, super_clusters
from diffprt.rendering.sheet import contact_sheet
from diffprt.representation import View
from diffprt.scene import Camera
from diffprt.study.overdraw.chart import file_name
from diffprt.study.overdraw.methods import ORIGINAL, THESIS, is_ours
from diffprt.study.overdraw.summary import overdraw_at
from diffprt.surface import Receivers

_DRAWN_ONCE, _TWICE, _THRICE = (0.80, 0.80, 0.78), (0.93, 0.53, 0.18), (0.62, 0.05, 0.12)
_GOLDEN = 0.61803398875
_AMBIENT = 0.45
_SIDE = 420


def study_pictures(folder: Path, receivers: Receivers, rows: list[dict]) -> str | None:
    """Pictures of one signal at one number of clusters, beside each other: original CPCA, the thesis's best, ours.

    The best are those with the least overdraw at the least budget, ours among those with less error than the
    original; super-clusters are of that budget, selected as the summary does.

    Args:
        folder: of the study.
        receivers: of the signal.
        rows: of one signal and number of clusters, with their maps in `folder`.

    Returns:
        the path; None where original CPCA has no maps, or not one cluster fits into any budget.
    """
    drawable = [row for row in rows if (folder / "maps" / f"{row['maps']}.safetensors").exists()]
    originals = [row for row in drawable if row["method"] == ORIGINAL]
    budgets = sorted((b for b, found in rows[0]["super_clusters"].items() if found is not None), key=int)
    if not originals or not budgets or len(receivers.faces) == 0:
        return None
    original = min(originals, key=lambda row: row["seed"])
    thesis = [row for row in drawable if row["method"] in THESIS]
    ours = [row for row in drawable if is_ours(row["method"])]
    ours = [row for row in ours if row["squared_error"] < original["squared_error"]]
    chosen = {f"original CPCA\n({ORIGINAL})": (original, "greedy")}
    for title, found, selection in (("thesis's best", thesis, "greedy"), ("ours", ours, "search")):
        if found:
            best = min(found, key=lambda row: overdraw_at(row, budgets[0], selection))
            chosen[f"{title}\n({best['method']})"] = (best, selection)
    columns = {}
    for title, (row, selection) in chosen.items():
        maps = load_file(folder / "maps" / f"{row['maps']}.safetensors")
        labels, per_pass = maps["labels"].long(), row["super_clusters"][budgets[0]]["clusters_per_pass"]
        groups = super_clusters(labels, receivers.faces, per_pass, selection=selection).groups
        alone, grouped = row["overdraw"], overdraw_at(row, budgets[0], selection)
        title += f"\noverdraw {alone:.3f}, then {grouped:.3f}\nsquared error {row['squared_error']:.3g}"
        columns[title] = {**maps, "passes": groups[labels]}
    path = folder / f"pictures-{file_name(original)}-{original['clusters']}.png"
    overdraw_pictures(path, receivers, columns, super_clusters_of=f"{budgets[0]} registers")
    return str(path)


def overdraw_pictures(
    path: Path, receivers: Receivers, columns: dict[str, dict[str, torch.Tensor]], *, super_clusters_of: str
) -> None:
    """Writes a PNG with a column for each method: clusters, triangles by how often they are drawn, squared error.

    Args:
        path: of the file.
        receivers: a mesh.
        columns: by title, maps as `overdraw_row` makes them, and `passes` int [V], the super-cluster of each receiver.
            Errors share one scale, which ends at the 99.5th percentile of the first column.
        super_clusters_of: what they are for, in words.
    """
    camera = Camera.framing(receivers.positions, width=_SIDE, height=_SIDE)
    view = receivers.view(camera)
    eye = torch.tensor(camera.eye, dtype=receivers.positions.dtype)
    facing = (torch.nn.functional.normalize(eye - receivers.positions, dim=-1) * receivers.normals).sum(1, keepdim=True)
    shading = _AMBIENT + (1 - _AMBIENT) * view.interpolate(facing.clamp_min(0))
    first = next(iter(columns.values()))["squared_error"]
    top = float(first.quantile(0.995)) or 1.0
    pictures = [
        [_drawn(view, shading, _label_colors(view, maps["labels"])) for maps in columns.values()],
        [_drawn(view, shading, _draw_colors(view, maps["labels"])) for maps in columns.values()],
        [_drawn(view, shading, _draw_colors(view, maps["passes"])) for maps in columns.values()],
        [_drawn(view, None, _error_colors(view, maps["squared_error"], top)) for maps in columns.values()],
    ]
    passes, errors = f"super-clusters of {super_clusters_of}", f"squared error, 0 to {top:.2g}"
    titles = ["clusters", "drawn 1, 2 or 3 times", passes, errors]
    contact_sheet(path, pictures, list(columns), titles)


def _drawn(view: View, shading: torch.Tensor | None, colors: torch.Tensor) -> torch.Tensor:
    """Display values [H, W, 3] over white."""
    lit = colors if shading is None else colors * shading
    return torch.where(view.mask[..., None], lit, 1.0)


def _label_colors(view: View, labels: torch.Tensor) -> torch.Tensor:
    """A color for the label of the corner that is nearest to each pixel; hues step by the golden ratio."""
    corner = view.weight.argmax(-1, keepdim=True)
    label = view.framed(labels.long()[view.index.gather(-1, corner)[..., 0]])
    numbers = torch.arange(int(labels.max()) + 1, dtype=torch.float64)
    hsv = torch.stack([(numbers * _GOLDEN) % 1, 0.45 + 0.3 * (numbers % 2), 0.75 + 0.1 * (numbers % 3)], dim=1)
    return torch.from_numpy(hsv_to_rgb(hsv.numpy())).float()[label]


def _draw_colors(view: View, labels: torch.Tensor) -> torch.Tensor:
    """A color for how often the triangle of each pixel is drawn."""
    count = view.framed(draws(labels.long(), view.index)).clamp_min(1)
    return torch.tensor([_DRAWN_ONCE, _TWICE, _THRICE])[count - 1]


def _error_colors(view: View, squared: torch.Tensor, top: float) -> torch.Tensor:
    """The interpolated squared error, on a scale that is even to the eye."""
    share = (view.interpolate(squared.float()[:, None])[..., 0] / top).clamp(0, 1)
    return torch.from_numpy(colormaps["viridis"](share.numpy())[..., :3]).float()
