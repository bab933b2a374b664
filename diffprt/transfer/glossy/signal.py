"""The baked glossy signal: how each receiver sends distant light towards every view."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.representation.lighting import LightingLike
from diffprt.representation.provenance import Provenance
from diffprt.representation.spec import Spec, TensorSpec
from diffprt.surface.receivers import Receivers
from diffprt.transfer.at_receivers import GlossyTransferAtReceivers
from diffprt.transfer.light_product import under_light


@dataclass(frozen=True)
class GlossyTransfer(GlossyTransferAtReceivers):
    """Glossy transfer of every receiver.

    Attributes:
        glossy: float [V, C, K_out, K]: from incident light on the scene's axes to exit radiance on the receiver's
            own (z is the normal, tangent by Duff et al. 2017), BRDF and cosine included: radiance towards a view is
            y(view)ᵀ T L. Defined above the surface. C is 1 when nothing colors the light, else 3. May carry
            gradients.
        receivers: where the signal lives; their albedo plays no part.
        provenance: how it was made; `settings`, `plan`, `certificate` and `scene_hash` are read from it.
    """

    name: ClassVar[str] = "glossy_transfer"
    spec: ClassVar[Spec] = {"glossy": TensorSpec(("V", "C", "K_out", "K"), per_element=True, trainable=True)}

    glossy: torch.Tensor
    receivers: Receivers
    provenance: Provenance = field(default_factory=Provenance, compare=False)

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
        return sh.order_of_count(self.glossy.shape[3])

    @property
    def order_out(self) -> int:
        return sh.order_of_count(self.glossy.shape[2])

    @property
    def channels(self) -> int:
        return self.glossy.shape[1]

    @property
    def signal(self) -> torch.Tensor:
        return self.glossy

    def exit_radiance(self, lighting: LightingLike) -> torch.Tensor:
        """Exit radiance in SH on each receiver's own axes, [V, 3, K_out]; gradients reach transfer and light."""
        return under_light(self.glossy, self.coefficients_of(lighting))

    def with_signal(self, glossy: torch.Tensor) -> GlossyTransfer:
        """The same receivers with another signal; the certificate no longer holds and is dropped."""
        return self.with_tensors(glossy=glossy)
