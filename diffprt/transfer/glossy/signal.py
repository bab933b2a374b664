"""The baked glossy signal: how each receiver sends distant light towards every view."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.sh.frames import tangent_frames
from diffprt.surface.receivers import Receivers


@dataclass(frozen=True)
class GlossyTransfer:
    """Glossy transfer of every receiver.

    Attributes:
        glossy: float [V, C, K_out, K]: from incident light on the scene's axes to exit radiance on the receiver's
            own (z is the normal, tangent by Duff et al. 2017), BRDF and cosine included: radiance towards a view is
            y(view)ᵀ T L. Defined above the surface. C is 1 when nothing colors the light, else 3. May carry
            gradients.
        receivers: where the signal lives; their albedo plays no part.
        settings: the options it was made with (plain values).
        plan: which effects were simulated, and why (plain values).
        certificate: measured error of the signal (plain values).
        scene_hash: SHA-256 of the scene it was baked from.
    """

    glossy: torch.Tensor
    receivers: Receivers
    settings: dict = field(default_factory=dict, compare=False)
    plan: dict = field(default_factory=dict, compare=False)
    certificate: dict = field(default_factory=dict, compare=False)
    scene_hash: str = ""

    def __post_init__(self) -> None:
        shape = tuple(self.glossy.shape)
        if len(shape) != 4 or shape[0] != len(self.receivers) or shape[1] not in (1, 3):
            raise InputError(
                f"glossy transfer has shape {shape}: give [{len(self.receivers)} receivers, 1 or 3 channels, "
                "order_out², order²]"
            )
        sh.order_of_count(shape[2])
        sh.order_of_count(shape[3])

    @property
    def order(self) -> int:
        """SH bands of incident light; K = order²."""
        return sh.order_of_count(self.glossy.shape[3])

    @property
    def order_out(self) -> int:
        """SH bands of exit radiance."""
        return sh.order_of_count(self.glossy.shape[2])

    @property
    def channels(self) -> int:
        """1 when nothing colors the light, else 3."""
        return self.glossy.shape[1]

    @property
    def nbytes(self) -> int:
        """Bytes of the signal alone."""
        return self.glossy.numel() * self.glossy.element_size()

    @property
    def frames(self) -> torch.Tensor:
        """Axes of exit radiance, float32 [V, 3, 3]: columns tangent, bitangent, normal."""
        return tangent_frames(self.receivers.normals)

    def with_signal(self, glossy: torch.Tensor) -> GlossyTransfer:
        """The same receivers with another signal; the certificate no longer holds and is dropped."""
        return replace(self, glossy=glossy, certificate={})
