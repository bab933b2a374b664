"""The baked signal: how each receiver answers to distant light."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.surface.receivers import Receivers


@dataclass(frozen=True)
class Transfer:
    """Diffuse transfer of every receiver.

    Attributes:
        diffuse: float [V, C, K]: cosine times visibility plus interreflection, in SH, without the receiver's
            own albedo and without 1/pi. C is 1 when nothing colours the light, else 3. May carry gradients.
        receivers: where the signal lives.
        openness: float32 [V] in [0, 1], cosine-weighted share of the sky that is seen (1 minus ambient occlusion);
            None where it is not known. No gradients.
        bent_normals: float32 [V, 3], unit, cosine-weighted mean of the directions seen, the normal where there are
            none; None where they are not known, as at order 1. No gradients.
        settings: the options it was made with (plain values).
        plan: which effects were simulated, and why (plain values).
        certificate: measured error of the signal (plain values).
        scene_hash: SHA-256 of the scene it was baked from.
    """

    diffuse: torch.Tensor
    receivers: Receivers
    settings: dict = field(default_factory=dict, compare=False)
    plan: dict = field(default_factory=dict, compare=False)
    certificate: dict = field(default_factory=dict, compare=False)
    scene_hash: str = ""
    openness: torch.Tensor | None = None
    bent_normals: torch.Tensor | None = None

    def __post_init__(self) -> None:
        shape = tuple(self.diffuse.shape)
        if len(shape) != 3 or shape[0] != len(self.receivers) or shape[1] not in (1, 3):
            raise InputError(
                f"diffuse transfer has shape {shape}: give [{len(self.receivers)} receivers, 1 or 3 channels, order²]"
            )
        sh.order_of_count(shape[2])
        check_openness(len(self.receivers), self.openness, self.bent_normals)

    @property
    def order(self) -> int:
        """Number of SH bands n; K = n²."""
        return sh.order_of_count(self.diffuse.shape[2])

    @property
    def channels(self) -> int:
        """1 when nothing colours the light, else 3."""
        return self.diffuse.shape[1]

    @property
    def nbytes(self) -> int:
        """Bytes of the signal alone."""
        return self.diffuse.numel() * self.diffuse.element_size()

    def with_signal(self, diffuse: torch.Tensor) -> Transfer:
        """The same receivers with another signal; the certificate no longer holds and is dropped."""
        return replace(self, diffuse=diffuse, certificate={})


def check_openness(count: int, openness: torch.Tensor | None, bent_normals: torch.Tensor | None) -> None:
    """Refuses openness and bent normals that are not those of `count` receivers."""
    for name, tensor, shape in (("openness", openness, (count,)), ("bent_normals", bent_normals, (count, 3))):
        if tensor is not None and tuple(tensor.shape) != shape:
            raise InputError(f"transfer has {name} of shape {tuple(tensor.shape)}: give {shape}")
