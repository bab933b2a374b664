"""Interreflection as a sparse operator, constant in the material: T = T0 + G (albedo * T)."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

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


class BounceOperator(ABC):
    """G [receivers, sources]: the mean over each receiver's rays of a signal at what they hit.

    Attributes:
        receivers, sources: its shape.
        entries: stored entries; 0 where they are traced again for every product.
    """

    receivers: int
    sources: int
    entries: int

    @abstractmethod
    def product(self, dense: torch.Tensor) -> torch.Tensor:
        """G @ dense: [sources, N] to [receivers, N], float32 or float64, without gradients."""

    @abstractmethod
    def transposed(self) -> Callable[[torch.Tensor], torch.Tensor]:
        """The product with Gᵀ, [receivers, N] to [sources, N], prepared for many uses."""

    def gather(self, signal: torch.Tensor) -> torch.Tensor:
        """G applied to `signal` [sources, ...], giving [receivers, ...]; gradients reach it."""
        flat = signal.reshape(self.sources, -1)
        return _Product.apply(self, flat).reshape(self.receivers, *signal.shape[1:])


class StoredOperator(BounceOperator):
    """G as a sparse matrix.

    Args:
        rows: of all receivers, one after the other.
        sources: number of columns.
        order: int64 [receivers], which receiver each row belongs to; without it they come in order.
    """

    def __init__(self, rows: list[OperatorRows], sources: int, order: torch.Tensor | None = None) -> None:
        counts = np.concatenate([r.counts for r in rows])
        self.receivers, self.sources, self._order = len(counts), sources, order
        crow = torch.from_numpy(np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]))
        columns = torch.from_numpy(np.concatenate([r.columns for r in rows]))
        values = torch.from_numpy(np.concatenate([r.values for r in rows]))
        self.entries = len(values)
        index = torch.int32 if self.entries < 2**31 else torch.int64
        with warnings.catch_warnings():
            # torch says that its CSR tensors are in beta, once per process, on the user's terminal.
            warnings.simplefilter("ignore", UserWarning)
            self.matrix = torch.sparse_csr_tensor(
                crow.to(index), columns.to(index), values, size=(len(counts), sources), check_invariants=False
            )

    @staticmethod
    def of(matrix: Any) -> StoredOperator:
        """SciPy's sparse matrix, in its own dtype."""
        matrix.sort_indices()
        counts, columns = (part.astype(np.int32) for part in (np.diff(matrix.indptr), matrix.indices))
        return StoredOperator([OperatorRows(counts, columns, matrix.data)], matrix.shape[1])

    def product(self, dense: torch.Tensor) -> torch.Tensor:
        result = self.matrix.to(dense.dtype) @ dense
        return result if self._order is None else torch.empty_like(result).index_copy_(0, self._order, result)

    def transposed(self) -> Callable[[torch.Tensor], torch.Tensor]:
        return lambda dense: self._turned.to(dense.dtype) @ (dense if self._order is None else dense[self._order])

    @cached_property
    def _turned(self) -> torch.Tensor:
        """Gᵀ by rows, kept for the next gradient: it takes no more than gathering the rows of G took."""
        m = self.matrix
        return torch.sparse_csc_tensor(
            m.crow_indices(), m.col_indices(), m.values(), size=(m.shape[1], m.shape[0]), check_invariants=False
        ).to_sparse_csr()


class _Product(torch.autograd.Function):
    """G @ x with the gradient Gᵀ @ g: the values of G are constants, so that nothing densifies."""

    @staticmethod
    def forward(ctx, operator: BounceOperator, dense: torch.Tensor) -> torch.Tensor:
        ctx.operator = operator
        return operator.product(dense)

    @staticmethod
    def backward(ctx, gradient: torch.Tensor):
        return None, ctx.operator.transposed()(gradient)
