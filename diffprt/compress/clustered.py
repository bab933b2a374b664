"""Clustered transfer: each receiver is its cluster's mean plus a few weighted components."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.transfer import Receivers, Transfer


@dataclass(frozen=True)
class ClusteredTransfer:
    """Diffuse transfer compressed by clustered PCA (Sloan et al. 2003; thesis 2005, section 3.1).

    Receiver v of cluster m = labels[v] holds  means[m] + sum_p weights[v, p] bases[m, p].

    Attributes:
        labels: int64 [V], in [0, M).
        means: float [M, C, K].
        bases: float [M, P, C, K], orthonormal over (C, K); rows beyond a cluster's rank are zero.
        weights: float [V, P].
        receivers, settings, plan, certificate, scene_hash: as in `Transfer`.
    """

    labels: torch.Tensor
    means: torch.Tensor
    bases: torch.Tensor
    weights: torch.Tensor
    receivers: Receivers
    settings: dict = field(default_factory=dict, compare=False)
    plan: dict = field(default_factory=dict, compare=False)
    certificate: dict = field(default_factory=dict, compare=False)
    scene_hash: str = ""

    def __post_init__(self) -> None:
        count, (clusters, channels, coefficients) = len(self.receivers), self.means.shape
        if channels not in (1, 3):
            raise InputError(f"clustered transfer has {channels} channels: give 1 or 3")
        sh.order_of_count(coefficients)
        expected = {
            "labels": (count,),
            "bases": (clusters, self.bases.shape[1], channels, coefficients),
            "weights": (count, self.bases.shape[1]),
        }
        for name, shape in expected.items():
            if tuple(getattr(self, name).shape) != shape:
                raise InputError(
                    f"clustered transfer has {name} of shape {tuple(getattr(self, name).shape)}: give {shape}"
                )
        if not 0 <= int(self.labels.min()) <= int(self.labels.max()) < clusters:
            raise InputError(
                f"clustered transfer has labels outside 0..{clusters - 1}: the file is damaged, compress again"
            )

    @property
    def order(self) -> int:
        """Number of SH bands n; K = n²."""
        return sh.order_of_count(self.means.shape[2])

    @property
    def channels(self) -> int:
        """1 when nothing colours the light, else 3."""
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
        """Bytes of the signal: means, bases, weights and labels (one byte up to 256 clusters, else two)."""
        label_bytes = 1 if self.clusters <= 256 else 2 if self.clusters <= 65536 else 4
        floats = self.means.numel() + self.bases.numel() + self.weights.numel()
        return floats * self.means.element_size() + self.labels.numel() * label_bytes

    def decode(self) -> Transfer:
        """The transfer that the compressed form stands for; gradients reach means, bases and weights."""
        detail = torch.einsum("vp,vpck->vck", self.weights, self.bases[self.labels])
        return Transfer(
            self.means[self.labels] + detail,
            self.receivers,
            self.settings,
            self.plan,
            self.certificate,
            self.scene_hash,
        )
