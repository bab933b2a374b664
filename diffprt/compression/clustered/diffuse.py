"""Clustered diffuse transfer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from diffprt.compression.clustered.signal import ClusteredSignal
from diffprt.transfer import Transfer, check_openness


@dataclass(frozen=True)
class ClusteredTransfer(ClusteredSignal):
    """Diffuse transfer compressed by clustered PCA: see `ClusteredSignal`.

    Attributes:
        means: float [M, C, K].
        bases: float [M, P, C, K], orthonormal over (C, K).
        openness, bent_normals: as in `Transfer`.
    """

    axes: ClassVar[tuple[str, ...]] = ("C", "K")

    openness: torch.Tensor | None = None
    bent_normals: torch.Tensor | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_openness(len(self.receivers), self.openness, self.bent_normals)

    def decode(self) -> Transfer:
        """The transfer that the compressed form stands for; gradients reach means, bases and weights."""
        return Transfer(
            self.blend(self.means, self.bases),
            self.receivers,
            self.settings,
            self.plan,
            self.certificate,
            self.scene_hash,
            self.openness,
            self.bent_normals,
        )
