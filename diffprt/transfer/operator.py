"""Interreflection as a sparse operator, constant in the material: T = T0 + G (albedo * T)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import torch


@dataclass(frozen=True)
class OperatorRows:
    """Rows of G for consecutive receivers, duplicates summed, columns ascending.

    Attributes:
        counts: int32 [rows], entries in each row.
        columns: int32 [entries], sources (vertices that reflect light).
        values: float32 [entries], each in (0, 1]; a row sums to the share of its rays that hit a front face.
    """

    counts: np.ndarray
    columns: np.ndarray
    values: np.ndarray


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


class BounceOperator:
    """G [receivers, sources], sparse; `gather(x)` is G @ x with gradients to x."""

    def __init__(self, rows: list[OperatorRows], sources: int) -> None:
        counts = np.concatenate([r.counts for r in rows])
        self.sources = sources
        self._crow = torch.from_numpy(np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]))
        self._columns = torch.from_numpy(np.concatenate([r.columns for r in rows]))
        self._values = torch.from_numpy(np.concatenate([r.values for r in rows]))
        index = torch.int32 if len(self._columns) < 2**31 else torch.int64
        with warnings.catch_warnings():
            # torch calls its CSR tensors beta, once per process, on the user's terminal.
            warnings.simplefilter("ignore", UserWarning)
            self.matrix = torch.sparse_csr_tensor(
                self._crow.to(index),
                self._columns.to(index),
                self._values,
                size=(len(counts), sources),
                check_invariants=False,
            )

    @property
    def entries(self) -> int:
        """Number of stored entries."""
        return len(self._values)

    @property
    def nbytes(self) -> int:
        """Bytes of the stored entries and row starts."""
        return self.entries * 8 + len(self._crow) * 4

    def gather(self, signal: torch.Tensor) -> torch.Tensor:
        """Mean over each receiver's rays of `signal` at what they hit: [sources, ...] to [receivers, ...]."""
        flat = signal.reshape(len(signal), -1)
        return _SparseProduct.apply(self.matrix, flat).reshape(self.matrix.shape[0], *signal.shape[1:])


class _SparseProduct(torch.autograd.Function):
    """G @ x with the gradient G^T @ g: the values of G are constants, so that nothing densifies."""

    @staticmethod
    def forward(ctx, matrix: torch.Tensor, dense: torch.Tensor) -> torch.Tensor:
        ctx.matrix = matrix
        return matrix.to(dense.dtype) @ dense

    @staticmethod
    def backward(ctx, gradient: torch.Tensor):
        m = ctx.matrix
        transposed = torch.sparse_csc_tensor(
            m.crow_indices(),
            m.col_indices(),
            m.values().to(gradient.dtype),
            size=(m.shape[1], m.shape[0]),
            check_invariants=False,
        )
        return None, transposed.to_sparse_csr() @ gradient


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
