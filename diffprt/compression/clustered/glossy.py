"""Clustered glossy transfer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from diffprt import sh
from diffprt.compression.clustered.signal import ClusteredSignal
from diffprt.sh.frames import tangent_frames
from diffprt.transfer import GlossyTransfer


@dataclass(frozen=True)
class ClusteredGlossyTransfer(ClusteredSignal):
    """Glossy transfer compressed by clustered PCA (thesis 2005, section 3.1): see `ClusteredSignal`.

    Attributes:
        means: float [M, C, K_out, K], as in `GlossyTransfer`: from incident light on the scene's axes to exit
            radiance on the receiver's own.
        bases: float [M, P, C, K_out, K], orthonormal over (C, K_out, K).
    """

    axes: ClassVar[tuple[str, ...]] = ("C", "K_out", "K")

    @property
    def order_out(self) -> int:
        """SH bands of exit radiance."""
        return sh.order_of_count(self.means.shape[2])

    @property
    def frames(self) -> torch.Tensor:
        """Axes of exit radiance, float32 [V, 3, 3]: columns tangent, bitangent, normal."""
        return tangent_frames(self.receivers.normals)

    def decode(self) -> GlossyTransfer:
        """The transfer that the compressed form stands for, as large as before compression; gradients reach means,
        bases and weights."""
        return GlossyTransfer(
            self.blend(self.means, self.bases),
            self.receivers,
            self.settings,
            self.plan,
            self.certificate,
            self.scene_hash,
        )


# What shading and rendering take as glossy.
GlossyAsset = GlossyTransfer | ClusteredGlossyTransfer
