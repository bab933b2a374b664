"""Clustered diffuse transfer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from diffprt.compression.clustered.signal import ClusteredSignal
from diffprt.compression.clustered.storage import clustered_spec
from diffprt.representation.spec import Spec
from diffprt.transfer.at_receivers import OPENNESS, DiffuseTransfer
from diffprt.transfer.diffuse.signal import Transfer


@dataclass(frozen=True)
class ClusteredTransfer(ClusteredSignal, DiffuseTransfer, plain=Transfer):
    """Diffuse transfer compressed by clustered PCA: see `ClusteredSignal`.

    Attributes:
        means: float [M, C, K].
        bases: float [M, P, C, K], orthonormal over (C, K).
        openness, bent_normals: as in `Transfer`.
    """

    name: ClassVar[str] = "clustered_transfer"
    spec: ClassVar[Spec] = {**clustered_spec("C", "K"), **OPENNESS}
    axes: ClassVar[tuple[str, ...]] = ("C", "K")

    openness: torch.Tensor | None = None
    bent_normals: torch.Tensor | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_openness()

    @staticmethod
    def as_matrices(values: torch.Tensor) -> torch.Tensor:
        return values[..., None, :]

    def decode(self) -> Transfer:
        """The transfer that the compressed form stands for; gradients reach means, bases and weights."""
        signal = self.blend(self.means, self.bases)
        return Transfer(signal, self.receivers, self.provenance, self.openness, self.bent_normals)
