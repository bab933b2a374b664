"""The methods of the overdraw study: those of `compress`, for a budget of registers or none, and faiss as a peer."""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib import import_module

import torch

from diffprt.compress import METHODS, clusters_per_pass, encode
from diffprt.compress.encode import Encoded
from diffprt.compress.partition import member_means
from diffprt.compress.pca import cluster_pca
from diffprt.errors import InputError
from diffprt.study.overdraw_signal import Signal

ORIGINAL = "lbg"
# What the thesis has, without super-clusters, which every row is measured with and without.
THESIS = (ORIGINAL, "lbg-reclassified", "lbg-coherent", "lbg-coherent-reclassified")
PEER, _PEER_ROUNDS = "faiss", 20
_OURS, _FOR_PASSES = "k-subspaces", ("k-subspaces-overdraw", "k-subspaces-potts")
DEFAULT = (
    ORIGINAL,
    "lbg-reclassified",
    "k-subspaces-overdraw@256",
    "k-subspaces-overdraw",
    "lbg-coherent-reclassified",
    "lbg-coherent",
    PEER,
    "k-subspaces",
    "k-subspaces-potts",
)


@dataclass(frozen=True)
class Method:
    """A way to cluster.

    Attributes:
        name: one of `METHODS`, or "faiss".
        coherence: as in `compress`; its default without.
        registers: float4 registers of the display that clusters are formed for; None for no particular one.
        seed: of the start.
    """

    name: str
    coherence: float | None = None
    registers: int | None = None
    seed: int = 0

    @staticmethod
    def parse(text: str, seed: int = 0) -> Method:
        """Reads NAME[=COHERENCE][@REGISTERS]; raises InputError where it is not of this form."""
        rest, at, registers = text.partition("@")
        name, equals, coherence = rest.partition("=")
        if name != PEER and name not in METHODS:
            raise InputError(f"method '{name}' is unknown: use one of {', '.join([*METHODS, PEER])}")
        if at and not (registers.isdecimal() and int(registers) > 0):
            raise InputError(f"method '{text}' has registers '{registers}': give a count, such as {name}@256")
        if at and name not in _FOR_PASSES:
            raise InputError(f"method '{name}' knows no registers: use {_FOR_PASSES[0]}@{registers}")
        try:
            weight = float(coherence) if equals else None
        except ValueError:
            raise InputError(
                f"method '{text}' has coherence '{coherence}': give a number, such as {name}=0.5"
            ) from None
        return Method(name, weight, int(registers) if at else None, seed)

    def __str__(self) -> str:
        weight = "" if self.coherence is None else f"={self.coherence:g}"
        return f"{self.name}{weight}" + ("" if self.registers is None else f"@{self.registers}")

    def as_list(self) -> list:
        """What it depends on, as plain values."""
        return [str(self), self.seed]

    def cluster(self, signal: Signal, clusters: int, components: int) -> tuple[Encoded, float]:
        """What it finds, and the CPU time [s] that all of it took."""
        if self.name == PEER:
            return _faiss(signal.vectors, clusters, components, self.seed)
        per_pass = None
        if self.registers is not None:
            per_pass = clusters_per_pass(self.registers, components, channels=signal.channels, outputs=signal.outputs)
        begun = time.process_time()
        found = encode(
            signal.vectors,
            clusters=clusters,
            components=components,
            method=self.name,
            positions=signal.receivers.positions,
            faces=signal.receivers.faces,
            coherence=self.coherence,
            per_pass=per_pass,
            seed=self.seed,
        )
        return found, time.process_time() - begun


def is_ours(method: str) -> bool:
    """Whether the thesis lacks a method, given as text."""
    return method.startswith(_OURS)


def has_peer() -> bool:
    """Whether faiss is installed."""
    try:
        import_module("faiss")
    except ImportError:
        return False
    return True


def _faiss(vectors: torch.Tensor, clusters: int, components: int, seed: int) -> tuple[Encoded, float]:
    """k-means of faiss on all rows, and components afterwards."""
    faiss = import_module("faiss")
    rows = vectors.float().contiguous().numpy()
    begun = time.process_time()
    options = {
        "niter": _PEER_ROUNDS,
        "seed": seed,
        "max_points_per_centroid": len(rows),
        "min_points_per_centroid": 1,
    }
    peer = faiss.Kmeans(rows.shape[1], min(clusters, len(rows)), **options)
    peer.train(rows)
    labels = torch.from_numpy(peer.index.search(rows, 1)[1][:, 0])
    labels = labels.unique(return_inverse=True)[1]
    means, bases, weights = cluster_pca(vectors, labels, int(labels.max()) + 1, components)
    spent = time.process_time() - begun
    return Encoded(labels, means, bases, weights, PEER, counts={"iterations": _PEER_ROUNDS}), spent


def cluster_energy(vectors: torch.Tensor, labels: torch.Tensor) -> float:
    """Mean squared distance to the mean of the cluster: what k-means lowers."""
    means = member_means(vectors, labels, int(labels.max()) + 1)
    total = sum(
        float((rows - means[own]).square().sum(dtype=torch.float64))
        for rows, own in zip(vectors.split(4096), labels.split(4096), strict=True)
    )
    return total / len(vectors)
