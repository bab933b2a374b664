"""Transfer at the receivers of a mesh, plain or clustered: what it shares, and what is seen of it."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Self

import torch

from diffprt import sh
from diffprt.brdf import hemisphere_gram
from diffprt.errors import InputError
from diffprt.representation.elements import Elements
from diffprt.representation.interface import Representation
from diffprt.representation.lighting import Lighting, LightingLike, stacked_coefficients
from diffprt.representation.lit import ConstantBasis, Lit
from diffprt.representation.metric import Metric
from diffprt.representation.provenance import Provenance
from diffprt.representation.spec import Spec, TensorSpec
from diffprt.sh.frames import tangent_frames
from diffprt.surface.receivers import Receivers
from diffprt.transfer.glossy.mirrored import MirroredBasis, above_horizon, mirrored

OPENNESS: Spec = {
    "openness": TensorSpec(("V",), ("float32",), per_element=True, optional=True, least=0, most=1),
    "bent_normals": TensorSpec(("V", 3), ("float32",), per_element=True, optional=True, least=-1, most=1),
}


class TransferAtReceivers(Representation):
    """Answers to distant light with a signal for each receiver.

    Attributes:
        receivers: where the signal lives.
    """

    elements_type: ClassVar[type[Elements]] = Receivers
    receivers: Receivers

    @property
    def elements(self) -> Receivers:
        return self.receivers

    def with_elements(self, elements: Elements, **tensors: torch.Tensor) -> Self:
        return replace(self, receivers=elements, **tensors)

    @classmethod
    def restored(cls, tensors: dict[str, torch.Tensor], elements: Elements, provenance: Provenance) -> Self:
        return cls(**tensors, receivers=elements, provenance=provenance)  # pyright: ignore[reportCallIssue]

    @property
    @abstractmethod
    def order(self) -> int:
        """SH bands of incident light n; K = n²."""

    @property
    @abstractmethod
    def channels(self) -> int:
        """1 when nothing colors the light, else 3."""

    @abstractmethod
    def exit_radiance(self, lighting: LightingLike) -> torch.Tensor:
        """What leaves each receiver under a light, [V, 3, K_out]; gradients reach signal and light. Of coefficients
        [B, K, 3], a batch, it is [V, 3 B, K_out], the colors of each light in turn, and so it goes on in `lit`."""

    @property
    def beside_signal(self) -> dict[str, torch.Tensor]:
        """What it knows of its receivers that is no part of the signal."""
        return {}

    @property
    def picture_weights(self) -> torch.Tensor:
        """What errors of the signal are multiplied by in pictures, [] or [V, C, 1]; one channel serves three colors,
        whose squared errors add up."""
        return torch.ones(())

    def coefficients_of(self, lighting: LightingLike) -> torch.Tensor:
        """The distant light [K, 3], or [B, K, 3] as it is; raises InputError where there is other light, or of another
        order."""
        if isinstance(lighting, torch.Tensor) and lighting.dim() == 3:
            return stacked_coefficients(lighting.unbind(), self.order, type(self).__name__)
        return Lighting.of(lighting).coefficients(self.order, type(self).__name__)

    def lit_each(self, lightings: Sequence[LightingLike], *, albedo: torch.Tensor | None = None) -> Lit:
        """All lights in one product with the signal."""
        return self.lit(stacked_coefficients(lightings, self.order, type(self).__name__), albedo=albedo)

    def radiance_each(
        self, lightings: Sequence[LightingLike], eye: torch.Tensor | None, *, albedo: torch.Tensor | None = None
    ) -> torch.Tensor:
        batch = stacked_coefficients(lightings, self.order, type(self).__name__)
        return self.radiance(batch, eye, albedo=albedo).unflatten(1, (-1, 3)).transpose(0, 1)


class DiffuseTransfer(TransferAtReceivers):
    """Looks the same from everywhere; the signal leaves out the receivers' albedo, and 1/pi."""

    description: ClassVar[str] = "cosine times visibility plus interreflection, without own albedo and 1/pi"
    openness: torch.Tensor | None
    bent_normals: torch.Tensor | None

    def lit(self, lighting: LightingLike, *, albedo: torch.Tensor | None = None) -> Lit:
        """Radiance as albedo / pi times transfer dot light, constant in the eye. Gradients reach transfer (or means,
        bases and weights), light and albedo."""
        irradiance = self.exit_radiance(lighting)[..., 0]
        albedo = self.receivers.albedo if albedo is None else albedo
        reflected = albedo.to(irradiance.dtype).unsqueeze(-2) / math.pi * irradiance.unflatten(1, (-1, 3))
        return Lit(reflected.flatten(1)[..., None], ConstantBasis())

    def check_albedo(self) -> None:
        pass

    def metric(self, prior: torch.Tensor) -> Metric:
        return Metric.of(prior)

    @property
    def picture_weights(self) -> torch.Tensor:
        albedo = self.receivers.albedo.detach()
        if self.channels == 1:
            albedo = albedo.square().mean(1, keepdim=True).sqrt()
        return albedo[..., None]

    @property
    def beside_signal(self) -> dict[str, torch.Tensor]:
        return {name: value for name in OPENNESS if (value := getattr(self, name)) is not None}

    def check_openness(self) -> None:
        """Refuses openness and bent normals that are not those of the receivers."""
        count = len(self.receivers)
        for name, shape in (("openness", (count,)), ("bent_normals", (count, 3))):
            tensor = getattr(self, name)
            if tensor is not None and tuple(tensor.shape) != shape:
                raise InputError(f"transfer has {name} of shape {tuple(tensor.shape)}: give {shape}")


class GlossyTransferAtReceivers(TransferAtReceivers):
    """Looks different from everywhere; reflectance is inside the signal."""

    description: ClassVar[str] = (
        "light on the scene's axes to exit radiance on the receiver's own (z the normal, tangent by Duff et al. 2017), "
        "BRDF and cosine included"
    )

    @property
    @abstractmethod
    def order_out(self) -> int:
        """SH bands of exit radiance."""

    @property
    def frames(self) -> torch.Tensor:
        """Axes of exit radiance, float32 [V, 3, 3]: columns tangent, bitangent, normal."""
        return tangent_frames(self.receivers.normals)

    def check_albedo(self) -> None:
        raise InputError("a glossy asset has its reflectance inside: leave albedo out, or bake with another brdf")

    def lit(self, lighting: LightingLike, *, albedo: torch.Tensor | None = None) -> Lit:
        """Exit radiance by mirrored direction: see `diffprt.transfer.glossy.mirrored`. Gradients reach transfer (or
        means, bases and weights) and light."""
        if albedo is not None:
            self.check_albedo()
        return Lit(mirrored(self.exit_radiance(lighting), self.frames), MirroredBasis(self.order_out))

    def radiance(
        self, lighting: LightingLike, eye: torch.Tensor | None, *, albedo: torch.Tensor | None = None
    ) -> torch.Tensor:
        """y(view)ᵀ T L on each receiver's own axes, which need not be turned to those of the scene."""
        if albedo is not None:
            self.check_albedo()
        if eye is None:
            raise InputError("a glossy asset looks different from everywhere: give view, such as camera.eye")
        radiance = self.exit_radiance(lighting)
        outward = torch.nn.functional.normalize(eye - self.receivers.positions, dim=-1)
        local = above_horizon(torch.einsum("vij,vi->vj", self.frames, outward))
        return torch.einsum("vco,vo->vc", radiance, sh.basis(local, self.order_out).to(radiance.dtype))

    def metric(self, prior: torch.Tensor) -> Metric:
        return Metric.of(prior, hemisphere_gram(self.order_out, cosine=True) / math.pi)
