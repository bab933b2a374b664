"""Time and bytes to build the structure over a large mesh, beside Embree's build."""

from __future__ import annotations

import math

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads
from diffprt.scene import Scene
from diffprt.study.timing import Stopwatch, paired_ratio, spread
from diffprt.study.visibility.peers import Embree


def subdivided(positions: torch.Tensor, faces: torch.Tensor, parts: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Every edge cut into `parts`, so that each triangle becomes parts²; neighbors share their new vertices.

    Args:
        positions: float32 [V, 3].
        faces: int64 [F, 3].

    Returns:
        positions float32 [V', 3] and faces int64 [F parts², 3].
    """
    i, j = np.meshgrid(np.arange(parts + 1), np.arange(parts + 1), indexing="ij")
    inside = i + j <= parts
    place = np.full((parts + 1, parts + 1), -1)
    place[inside] = np.arange(inside.sum())
    weights = np.stack([parts - i - j, i, j], axis=-1)[inside]
    upward = np.stack([place[:-1, :-1], place[1:, :-1], place[:-1, 1:]], axis=-1)[(i + j < parts)[:-1, :-1]]
    downward = np.stack([place[1:, :-1], place[1:, 1:], place[:-1, 1:]], axis=-1)[(i + j < parts - 1)[:-1, :-1]]
    local = np.concatenate([upward, downward])
    corners = faces.numpy()
    # A vertex is known by the corners that weigh in it: across an edge the names agree.
    names = np.where(weights > 0, corners[:, None] * (parts + 1) + weights, -1).reshape(-1, 3)
    names.sort(axis=1)
    _, first, index = np.unique(names, axis=0, return_index=True, return_inverse=True)
    points = np.einsum("pk,fkx->fpx", weights / parts, positions.double().numpy()[corners]).reshape(-1, 3)
    index = index.reshape(len(corners), -1)
    fine = index[:, local].reshape(-1, 3)
    return torch.from_numpy(points[first]).float(), torch.from_numpy(fine)


def structure_row(scenes: list[Scene], wanted: int, *, runs: int = 5) -> dict:
    """Builds over the scene that subdivides most nearly to `wanted` triangles; builders take turns.

    Returns:
        Plain numbers: `seconds` and `cpu_seconds` of ours and of `embreex` (its commit alone, on all cores;
        `attach` is what it takes to hand it the triangles), `ratio` of wall times within rounds, bytes per
        triangle of ours, and `skipped`: why Embree is missing, or None.
    """

    def cuts(scene: Scene) -> int:
        return max(1, round(math.sqrt(wanted / scene.triangle_count)))

    def miss(scene: Scene) -> float:
        return abs(math.log(scene.triangle_count * cuts(scene) ** 2 / wanted))

    scene = min(scenes, key=miss)
    merged = scene.merged()
    positions, faces = subdivided(merged.positions, merged.faces, cuts(scene))
    mesh = TriangleMesh(positions, faces)
    try:
        peer, skipped = Embree(positions, faces), None
    except InputError as error:
        peer, skipped = None, str(error)
    ours, theirs, attach = [], [], []
    for _ in range(runs):
        watch = Stopwatch()
        watch.time(lambda: TriangleMesh(positions, faces))
        ours.append(watch)
        if peer is not None:
            attach.append(Stopwatch())
            built = attach[-1].time(peer.attached)
            theirs.append(Stopwatch())
            theirs[-1].time(lambda built=built: peer.commit(built))

    def figures(watches: list[Stopwatch]) -> dict | None:
        if not watches:
            return None
        return {
            "seconds": spread([watch.seconds for watch in watches]),
            "cpu_seconds": spread([watch.cpu_seconds for watch in watches]),
        }

    return {
        "scene": scene.name,
        "cuts_per_edge": cuts(scene),
        "triangles": len(faces),
        "vertices": len(positions),
        "threads": default_threads(),
        "ours": figures(ours),
        "embreex": figures(theirs),
        "attach": figures(attach),
        "ratio": paired_ratio([w.seconds for w in ours], [w.seconds for w in theirs]) if theirs else None,
        "ratio_cpu": paired_ratio([w.cpu_seconds for w in ours], [w.cpu_seconds for w in theirs]) if theirs else None,
        "bytes_per_triangle": mesh.nbytes / len(faces),
        "skipped": skipped,
    }
