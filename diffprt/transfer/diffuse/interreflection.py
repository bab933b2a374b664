"""Interreflection as a sparse operator, constant in the material: T = T0 + G (albedo * T)."""

from __future__ import annotations

import numpy as np
import torch

from diffprt.surface.operator import BounceOperator, OperatorRows


def rows_from_hits(
    hit_face: np.ndarray, hit_weights: np.ndarray, source_of_corner: np.ndarray, sources: int, rays: int
) -> OperatorRows:
    """Gathers what each receiver's rays hit.

    With cosine-distributed rays the irradiance from one bounce is pi times the mean radiance at the hits, and
    radiance is albedo / pi times the hit's own transfer, so every ray weighs 1 / D (pi cancels).

    Args:
        hit_face: int32 [rows, >= D], -1 where nothing reflects.
        hit_weights: float32 [rows, >= D, 2], barycentric coordinates of the first two corners.
        source_of_corner: int64 [F, 3], source of each face corner; -1 for surfaces that only occlude.
        sources: number of sources.
        rays: D.
    """
    rows = len(hit_face)
    row, ray = np.nonzero(hit_face >= 0)
    corners = source_of_corner[hit_face[row, ray]]
    first_two = hit_weights[row, ray].astype(np.float64)
    weights = np.concatenate([first_two, 1.0 - first_two.sum(1, keepdims=True)], axis=1).clip(0.0, 1.0)
    keep = (corners >= 0).ravel()
    key = (row[:, None] * np.int64(sources) + corners).ravel()[keep]
    if len(key) == 0:
        return OperatorRows(np.zeros(rows, np.int32), np.zeros(0, np.int32), np.zeros(0, np.float32))
    order = np.argsort(key, kind="stable")
    key = key[order]
    starts = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    values = np.add.reduceat(weights.ravel()[keep][order], starts) / rays
    key = key[starts]
    counts = np.bincount(key // sources, minlength=rows)
    return OperatorRows(counts.astype(np.int32), (key % sources).astype(np.int32), values.astype(np.float32))


def interreflect(direct: torch.Tensor, operator: BounceOperator, albedo: torch.Tensor, bounces: int) -> torch.Tensor:
    """Transfer after `bounces` diffuse interreflections: T_n = T_0 + G (albedo * T_{n-1}).

    Args:
        direct: [V, C, K], transfer without interreflection, of the surfaces that reflect.
        albedo: [V, C], linear, in [0, 1].

    Returns:
        [V, C, K]. Gradients reach `direct` and `albedo`; G is frozen with the visibility.
    """
    total = direct
    for _ in range(bounces):
        total = direct + operator.gather(albedo[:, :, None] * total)
    return total
