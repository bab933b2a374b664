"""The baked signal: how each receiver answers to distant light."""

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
from diffprt.transfer.at_receivers import OPENNESS, DiffuseTransfer
from diffprt.transfer.light_product import under_light


@dataclass(frozen=True)
class Transfer(DiffuseTransfer):
    """Diffuse transfer of every receiver.

    Attributes:
        diffuse: float [V, C, K]: cosine times visibility plus interreflection, in SH, without the receiver's
            own albedo and without 1/pi. C is 1 when nothing colors the light, else 3. May carry gradients.
        receivers: where the signal lives.
        openness: float32 [V] in [0, 1], cosine-weighted share of the sky that is seen (1 minus ambient occlusion);
            None where it is not known. No gradients.
        bent_normals: float32 [V, 3], unit, cosine-weighted mean of the directions seen, the normal where there are
            none; None where they are not known, as at order 1. No gradients.
        provenance: how it was made; `settings`, `plan`, `certificate` and `scene_hash` are read from it.
    """

    name: ClassVar[str] = "transfer"
    spec: ClassVar[Spec] = {"diffuse": TensorSpec(("V", "C", "K"), per_element=True, trainable=True), **OPENNESS}

    diffuse: torch.Tensor
    receivers: Receivers
    provenance: Provenance = field(default_factory=Provenance, compare=False)
    openness: torch.Tensor | None = None
    bent_normals: torch.Tensor | None = None

    def __post_init__(self) -> None:
        shape = tuple(self.diffuse.shape)
        if len(shape) != 3 or shape[0] != len(self.receivers) or shape[1] not in (1, 3):
            raise InputError(
                f"diffuse transfer has shape {shape}: give [{len(self.receivers)} receivers, 1 or 3 channels, order²]"
            )
        sh.order_of_count(shape[2])
        self.check_openness()

    @property
    def order(self) -> int:
        return sh.order_of_count(self.diffuse.shape[2])

    @property
    def channels(self) -> int:
        return self.diffuse.shape[1]

    @property
    def signal(self) -> torch.Tensor:
        return self.diffuse

    def exit_radiance(self, lighting: LightingLike) -> torch.Tensor:
        return under_light(self.diffuse[..., None, :], self.coefficients_of(lighting))

    def with_signal(self, diffuse: torch.Tensor) -> Transfer:
        """The same receivers with another signal; the certificate no longer holds and is dropped."""
        return self.with_tensors(diffuse=diffuse)
