"""What clustered transfer of every kind shares: each receiver is its cluster's mean plus a few weighted components."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import torch

from diffprt import sh
from diffprt.compression.clustered.quantize import check_format
from diffprt.compression.clusters.blend import blend
from diffprt.compression.encode import encoded_bytes
from diffprt.compression.overdraw.overdraw import overdraw
from diffprt.errors import InputError
from diffprt.surface import Receivers


@dataclass(frozen=True)
class ClusteredSignal:
    """A signal of receivers compressed by clustered PCA (Sloan et al. 2003; thesis 2005, section 3.1).

    Receiver v of cluster m = labels[v] holds  means[m] + sum_p weights[v, p] bases[m, p].

    Attributes:
        axes: what the axes of one signal are called, of each subclass.
        labels: int64 [V], in [0, M).
        means: float [M, ...], one signal per cluster: channels first, coefficients of incident light last.
        bases: float [M, P, ...], orthonormal over a signal's numbers; rows beyond a cluster's rank are zero.
        weights: float [V, P].
        receivers, settings, plan, certificate, scene_hash: as in `Transfer`.
        weights_format, bases_format: "float32", "float16" or "uint8": the numbers above are what comes back from
            storage in that format, with means stored as bases are.

    Raises:
        InputError: shapes or dtypes that do not belong together, labels out of range, or an unknown format.
    """

    axes: ClassVar[tuple[str, ...]]

    labels: torch.Tensor
    means: torch.Tensor
    bases: torch.Tensor
    weights: torch.Tensor
    receivers: Receivers
    settings: dict = field(default_factory=dict, compare=False)
    plan: dict = field(default_factory=dict, compare=False)
    certificate: dict = field(default_factory=dict, compare=False)
    scene_hash: str = ""
    weights_format: str = "float32"
    bases_format: str = "float32"

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
        check_format("weights_format", self.weights_format)
        check_format("bases_format", self.bases_format)
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
        if not 0 <= int(self.labels.min()) <= int(self.labels.max()) < self.clusters:
            raise InputError(
                f"clustered transfer has labels outside 0..{self.clusters - 1}: the file is damaged, compress again"
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

    def overdraw(self, faces: torch.Tensor | None = None) -> float:
        """Average triangle overdraw (thesis 2005, equation 8) over `faces` int64 [F, 3], the receivers' own without."""
        return overdraw(self.labels, self.receivers.faces if faces is None else faces)

    def blend(self, means: torch.Tensor, bases: torch.Tensor) -> torch.Tensor:
        """What receivers hold, [V, ...], of what clusters hold for their means [M, ...] and components [M, P, ...]:
        the signal itself, or the signal applied to a light. Gradients reach both and the weights; see `blend`."""
        return blend(self.labels, self.weights, means, bases)
