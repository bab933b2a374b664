"""Clustered transfer: each receiver is its cluster's mean plus a few weighted components."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from diffprt import sh
from diffprt.compress.encode import encoded_bytes
from diffprt.compress.overdraw import overdraw
from diffprt.compress.quantize import check_format
from diffprt.errors import InputError
from diffprt.transfer import Receivers, Transfer, check_openness


@dataclass(frozen=True)
class ClusteredTransfer:
    """Diffuse transfer compressed by clustered PCA (Sloan et al. 2003; thesis 2005, section 3.1).

    Receiver v of cluster m = labels[v] holds  means[m] + sum_p weights[v, p] bases[m, p].

    Attributes:
        labels: int64 [V], in [0, M).
        means: float [M, C, K].
        bases: float [M, P, C, K], orthonormal over (C, K); rows beyond a cluster's rank are zero.
        weights: float [V, P].
        receivers, settings, plan, certificate, scene_hash, openness, bent_normals: as in `Transfer`.
        weights_format, bases_format: "float32", "float16" or "uint8": the numbers above are what comes back from
            storage in that format, with means stored as bases are.
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
    openness: torch.Tensor | None = None
    bent_normals: torch.Tensor | None = None
    weights_format: str = "float32"
    bases_format: str = "float32"

    def __post_init__(self) -> None:
        check_openness(len(self.receivers), self.openness, self.bent_normals)
        count, (clusters, channels, coefficients) = len(self.receivers), self.means.shape
        if channels not in (1, 3):
            raise InputError(f"clustered transfer has {channels} channels: give 1 or 3")
        sh.order_of_count(coefficients)
        check_format("weights_format", self.weights_format)
        check_format("bases_format", self.bases_format)
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
        """Bytes of the signal as stored: means, bases, weights and labels."""
        return encoded_bytes(self.labels, self.means, self.bases, self.weights, self.weights_format, self.bases_format)

    def overdraw(self, faces: torch.Tensor | None = None) -> float:
        """Average triangle overdraw (thesis 2005, equation 8) over `faces` int64 [F, 3], the receivers' own without."""
        return overdraw(self.labels, self.receivers.faces if faces is None else faces)

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
            self.openness,
            self.bent_normals,
        )
