"""The methods of the overdraw study: those of `compress`, for a budget of registers or none, and faiss as a peer."""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib import import_module

import torch

from diffprt.compression import METHODS, encode, lbg
from diffprt.compression.clusters.components import cluster_pca
from diffprt.compression.clusters.partition import member_means
from diffprt.compression.encode import Encoded
from diffprt.compression.methods.starts import unit_box
from diffprt.errors import InputError
from diffprt.study.overdraw.signal import Signal

ORIGINAL = "lbg"
# What the thesis has, without super-clusters, which every row is measured with and without.
THESIS = (ORIGINAL, "lbg-reclassified", "lbg-coherent", "lbg-coherent-reclassified")
PEER, _PEER_ROUNDS = "faiss", 20
# k-means of positions, blind to the signal: what the least overdraw would cost.
PATCHES = "position-only"
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
        name: one of `METHODS`, "faiss" or "position-only".
        coherence: as in `compress`; its default without.
        registers: float4 registers of the display that clusters are formed for; None for no particular one.
        seed: of the start.
        slack: as in `compress`; its default without.
    """

    name: str
    coherence: float | None = None
    registers: int | None = None
    seed: int = 0
    slack: float | None = None

    @staticmethod
    def parse(text: str, seed: int = 0) -> Method:
        """Reads NAME[=COHERENCE][~SLACK][@REGISTERS]; raises InputError where it is not of this form."""
        rest, at, registers = text.partition("@")
        rest, tilde, slack = rest.partition("~")
        name, equals, coherence = rest.partition("=")
        if name not in (PEER, PATCHES, *METHODS):
            raise InputError(f"method '{name}' is unknown: use one of {', '.join([*METHODS, PEER, PATCHES])}")
        if at and not (registers.isdecimal() and len(registers) < 10 and int(registers) > 0):
            raise InputError(f"method '{text}' has registers '{registers}': give a count, such as {name}@256")
        for what, sign, value in (("registers", at, registers), ("slack", tilde, slack)):
            if sign and name not in _FOR_PASSES:
                raise InputError(f"method '{name}' knows no {what}: use {_FOR_PASSES[0]}{sign}{value}")
        weight = _number(text, "coherence", coherence, f"{name}=0.5") if equals else None
        above = _number(text, "slack", slack, f"{name}~0.2") if tilde else None
        return Method(name, weight, int(registers) if at else None, seed, above)

    def __str__(self) -> str:
        weight = "" if self.coherence is None else f"={self.coherence:g}"
        slack = "" if self.slack is None else f"~{self.slack:g}"
        return f"{self.name}{weight}{slack}" + ("" if self.registers is None else f"@{self.registers}")

    def as_list(self) -> list:
        """What it depends on, as plain values."""
        return [str(self), self.seed]

    def cluster(self, signal: Signal, clusters: int, components: int) -> tuple[Encoded, float]:
        """What it finds, and the CPU time [s] that all of it took."""
        if self.name == PEER:
            return _faiss(signal.vectors, clusters, components, self.seed)
        if self.name == PATCHES:
            return _patches(signal, clusters, components, self.seed)
        per_pass = None if self.registers is None else signal.per_pass(self.registers, components)
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
            **({} if self.slack is None else {"slack": self.slack}),
        )
        return found, time.process_time() - begun


def _number(text: str, what: str, value: str, example: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise InputError(f"method '{text}' has {what} '{value}': give a number, such as {example}") from None


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
    vectors = vectors.float().contiguous()
    begun = time.process_time()
    labels = faiss_labels(vectors, clusters, seed=seed, iterations=_PEER_ROUNDS).unique(return_inverse=True)[1]
    parts = cluster_pca(vectors, labels, int(labels.max()) + 1, components)
    spent = time.process_time() - begun
    return Encoded(labels, *parts, PEER, counts={"iterations": _PEER_ROUNDS}), spent


def _patches(signal: Signal, clusters: int, components: int, seed: int) -> tuple[Encoded, float]:
    """k-means of positions, and components of the signal afterwards."""
    begun = time.process_time()
    found = lbg(unit_box(signal.receivers.positions), clusters, seed=seed)
    parts = cluster_pca(signal.vectors, found.labels, len(found.centers), components)
    spent = time.process_time() - begun
    return Encoded(found.labels, *parts, PATCHES, counts={"iterations": found.iterations}), spent


def faiss_labels(vectors: torch.Tensor, clusters: int, *, seed: int, iterations: int) -> torch.Tensor:
    """Labels int64 [V] of k-means of faiss on all rows float32 [V, D]; clusters may be empty."""
    faiss = import_module("faiss")
    rows = vectors.numpy()
    options = {"niter": iterations, "seed": seed, "max_points_per_centroid": len(rows), "min_points_per_centroid": 1}
    peer = faiss.Kmeans(rows.shape[1], min(clusters, len(rows)), **options)
    peer.train(rows)
    return torch.from_numpy(peer.index.search(rows, 1)[1][:, 0])


def cluster_energy(vectors: torch.Tensor, labels: torch.Tensor) -> float:
    """Mean squared distance to the mean of the cluster: what k-means lowers."""
    means = member_means(vectors, labels, int(labels.max()) + 1)
    total = sum(
        float((rows - means[own]).square().sum(dtype=torch.float64))
        for rows, own in zip(vectors.split(4096), labels.split(4096), strict=True)
    )
    return total / len(vectors)
