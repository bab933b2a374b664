"""Clustered glossy transfer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from diffprt import sh
from diffprt.compression.clustered.signal import ClusteredSignal
from diffprt.compression.clustered.storage import clustered_spec
from diffprt.representation.spec import Spec
from diffprt.transfer.at_receivers import GlossyTransferAtReceivers
from diffprt.transfer.glossy.signal import GlossyTransfer


@dataclass(frozen=True)
class ClusteredGlossyTransfer(ClusteredSignal, GlossyTransferAtReceivers, plain=GlossyTransfer):
    """Glossy transfer compressed by clustered PCA (thesis 2005, section 3.1): see `ClusteredSignal`.

    Attributes:
        means: float [M, C, K_out, K], as in `GlossyTransfer`: from incident light on the scene's axes to exit
            radiance on the receiver's own.
        bases: float [M, P, C, K_out, K], orthonormal over (C, K_out, K).
    """

    name: ClassVar[str] = "clustered_glossy_transfer"
    spec: ClassVar[Spec] = clustered_spec("C", "K_out", "K")
    axes: ClassVar[tuple[str, ...]] = ("C", "K_out", "K")

    @property
    def order_out(self) -> int:
        return sh.order_of_count(self.means.shape[2])

    @staticmethod
    def as_matrices(values: torch.Tensor) -> torch.Tensor:
        return values

    def decode(self) -> GlossyTransfer:
        """The transfer that the compressed form stands for, as large as before compression; gradients reach means,
        bases and weights."""
        return GlossyTransfer(self.blend(self.means, self.bases), self.receivers, self.provenance)
