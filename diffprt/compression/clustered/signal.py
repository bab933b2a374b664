"""What clustered transfer of every kind shares: each receiver is its cluster's mean plus a few weighted components."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import torch

from diffprt import sh
from diffprt.compression.clustered.storage import from_tensors, to_tensors
from diffprt.compression.clusters.components import blend
from diffprt.compression.clusters.partition import whole_labels
from diffprt.compression.encode import encoded_bytes
from diffprt.compression.overdraw.overdraw import overdraw
from diffprt.errors import InputError
from diffprt.options.compress import FORMATS
from diffprt.options.ranges import check_choice
from diffprt.representation.interface import Representation
from diffprt.representation.lighting import LightingLike
from diffprt.representation.provenance import Provenance
from diffprt.surface.receivers import Receivers
from diffprt.transfer.at_receivers import TransferAtReceivers
from diffprt.transfer.light_product import under_light

# What each kind of transfer becomes when it is compressed; filled where the types are defined.
CLUSTERED: dict[type[Representation], type[ClusteredSignal]] = {}


@dataclass(frozen=True)
class ClusteredSignal(TransferAtReceivers):
    """A signal of receivers compressed by clustered PCA (Sloan et al. 2003; thesis 2005, section 3.1).

    Receiver v of cluster m = labels[v] holds  means[m] + sum_p weights[v, p] bases[m, p].

    Attributes:
        axes: what the axes of one signal are called, of each subclass.
        labels: int64 [V], in [0, M); given in any integer type.
        means: float [M, ...], one signal per cluster: channels first, coefficients of incident light last.
        bases: float [M, P, ...], orthonormal over a signal's numbers; rows beyond a cluster's rank are zero.
        weights: float [V, P].
        receivers, provenance: as in `Transfer`.
        weights_format, bases_format: "float32", "float16" or "uint8": the numbers above are what comes back from
            storage in that format, with means stored as bases are.

    Raises:
        InputError: shapes or dtypes that do not belong together, labels out of range, or an unknown format.
    """

    compressed: ClassVar[bool] = True
    axes: ClassVar[tuple[str, ...]]

    labels: torch.Tensor
    means: torch.Tensor
    bases: torch.Tensor
    weights: torch.Tensor
    receivers: Receivers
    provenance: Provenance = field(default_factory=Provenance, compare=False)
    weights_format: str = "float32"
    bases_format: str = "float32"

    def __init_subclass__(cls, *, plain: type[TransferAtReceivers] | None = None, **options: Any) -> None:
        super().__init_subclass__(**options)
        if plain is not None:
            CLUSTERED[plain] = cls

    def __post_init__(self) -> None:
        if self.means.dim() != 1 + len(self.axes) or self.bases.dim() != 2 + len(self.axes):
            wanted = ", ".join(self.axes)
            raise InputError(
                f"clustered transfer has means of shape {tuple(self.means.shape)} and bases of shape "
                f"{tuple(self.bases.shape)}: give [M, {wanted}] and [M, P, {wanted}]"
            )
        types = {tensor.dtype for tensor in (self.means, self.bases, self.weights)}
        if len(types) > 1:
            raise InputError(f"clustered transfer has numbers of {', '.join(sorted(map(str, types)))}: give one dtype")
        if self.channels not in (1, 3):
            raise InputError(f"clustered transfer has {self.channels} channels: give 1 or 3")
        for count in self.means.shape[2:]:
            sh.order_of_count(count)
        check_choice("weights_format", self.weights_format, FORMATS)
        check_choice("bases_format", self.bases_format, FORMATS)
        object.__setattr__(self, "labels", whole_labels(self.labels, self.clusters))
        expected = {
            "labels": (len(self.receivers),),
            "bases": (self.clusters, self.components, *self.means.shape[1:]),
            "weights": (len(self.receivers), self.components),
        }
        for name, shape in expected.items():
            if tuple(getattr(self, name).shape) != shape:
                raise InputError(
                    f"clustered transfer has {name} of shape {tuple(getattr(self, name).shape)}: give {shape}"
                )

    @property
    def order(self) -> int:
        """SH bands of incident light n; K = n²."""
        return sh.order_of_count(self.means.shape[-1])

    @property
    def channels(self) -> int:
        """1 when nothing colors the light, else 3."""
        return self.means.shape[1]

    @property
    def clusters(self) -> int:
        """Number of clusters M."""
        return self.means.shape[0]

    @property
    def components(self) -> int:
        """Number of components per cluster P."""
        return self.bases.shape[1]

    @property
    def nbytes(self) -> int:
        """Bytes of the signal as stored: means, bases, weights and labels."""
        return encoded_bytes(self.labels, self.means, self.bases, self.weights, self.weights_format, self.bases_format)

    def stored(self) -> dict[str, torch.Tensor]:
        return {
            **to_tensors(self.labels, self.means, self.bases, self.weights, self.weights_format, self.bases_format),
            **self.beside_signal,
        }

    @classmethod
    def restored(cls, tensors: dict[str, torch.Tensor], elements: Receivers, provenance: Provenance) -> Self:
        return cls(**from_tensors(tensors), receivers=elements, provenance=provenance)

    def overdraw(self, faces: torch.Tensor | None = None) -> float:
        """Average triangle overdraw (thesis 2005, equation 8) over `faces` int64 [F, 3], the receivers' own without."""
        return overdraw(self.labels, self.receivers.faces if faces is None else faces)

    def blend(self, means: torch.Tensor, bases: torch.Tensor) -> torch.Tensor:
        """What receivers hold, [V, ...], of what clusters hold for their means [M, ...] and components [M, P, ...]:
        the signal itself, or the signal applied to a light. Gradients reach both and the weights; see `blend`."""
        return blend(self.labels, self.weights, means, bases)

    def exit_radiance(self, lighting: LightingLike) -> torch.Tensor:
        """As of uncompressed transfer, found as a shader finds it: means and components are applied to the light once
        for each cluster, then blended by the receivers' weights."""
        light = self.coefficients_of(lighting)
        means, bases = (under_light(self.as_matrices(values), light) for values in (self.means, self.bases))
        return self.blend(means, bases)

    @staticmethod
    @abstractmethod
    def as_matrices(values: torch.Tensor) -> torch.Tensor:
        """Signals [..., one signal] as matrices from light to exit radiance, [..., C, K_out, K]."""

    @property
    def signal_shape(self) -> tuple[int, ...]:
        return tuple(self.means.shape[1:])

    @property
    def counts(self) -> dict:
        return {"overdraw": self.overdraw()} if len(self.receivers.faces) else {}

    @property
    def signal(self) -> torch.Tensor:
        self.refuse(
            f"is already compressed, to {self.clusters} clusters x {self.components} components",
            "give the one that was baked, or its decode()",
        )
