"""The ways to partition receivers, by name."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import torch

from diffprt.compression.clusters.partition import Partition, canonical
from diffprt.compression.clusters.randomized_pca import principal_span
from diffprt.compression.clusters.subspaces import fit_subspaces
from diffprt.compression.methods.geometry_coherence import lbg_coherent
from diffprt.compression.methods.k_subspaces import k_subspaces
from diffprt.compression.methods.lbg import lbg
from diffprt.compression.methods.mesh_subspaces import cluster_on_mesh
from diffprt.compression.methods.reclassify import reclassify
from diffprt.compression.methods.starts import placed
from diffprt.compression.overdraw.corners import Corners
from diffprt.errors import InputError

METHODS = {
    "lbg": "clusters around means, components afterwards: original CPCA (Sloan et al. 2003; thesis 2005)",
    "lbg-reclassified": "then receivers join a neighbor's cluster where the error permits (Sloan et al. 2003)",
    "lbg-coherent": "the same with geometry coherence (thesis 2005, equation 9)",
    "lbg-coherent-reclassified": "both",
    "lbg-coherent-mean": "geometry coherence towards the mean position of a cluster, another reading of the thesis",
    "k-subspaces": "clusters around what their components span",
    "k-subspaces-soft": "the same, annealed from soft to hard with a price on expected overdraw",
    "k-subspaces-potts": "the same with a price on mesh edges between clusters",
    "k-subspaces-overdraw": "the same with a price on overdraw itself (thesis 2005, equation 8)",
}
_ON_MESH = {name for name in METHODS if name.endswith(("-reclassified", "-soft", "-potts", "-overdraw"))}
_ALPHA = 0.05
_REMAINDER = 1e-3


@dataclass(frozen=True)
class Clustering:
    """What a method found.

    Attributes:
        labels: int64 [V], in [0, M); no cluster is empty.
        iterations: rounds of clustering.
        coherence: the weight of coherence that was used, None where the method has none.
        timings: seconds of each step.
    """

    labels: torch.Tensor
    iterations: int
    coherence: float | None
    timings: dict[str, float] = field(default_factory=dict)


def best_method(faces: torch.Tensor | None) -> str:
    """The method that `compress` uses when none is named: what needs a mesh is not for points."""
    return "k-subspaces" if faces is None or len(faces) == 0 else "k-subspaces-overdraw"


def cluster(
    vectors: torch.Tensor,
    method: str,
    *,
    clusters: int,
    components: int,
    positions: torch.Tensor | None = None,
    faces: torch.Tensor | None = None,
    coherence: float | None = None,
    slack: float = 0.1,
    per_pass: int | None = None,
    start: str = "k-means++",
    seed: int = 0,
    iterations: int = 50,
) -> Clustering:
    """Partitions receivers by their signals.

    Args:
        vectors: float [V, D], the signal of each receiver.
        method: one of `METHODS`.
        clusters: M, at most.
        components: P that will be kept per cluster.
        positions: float [V, 3], for geometry coherence, and for better starts of "k-subspaces" and its kin.
        faces: int64 [F, 3], for methods that look at overdraw.
        coherence: how much overdraw counts: alpha of equation 9 (thesis: 0.05, the default) for "lbg-coherent" and
            its kin; for "lbg-reclassified" the growth of a receiver's error that is permitted, in mean squared errors
            (0.5); for "-soft" (0.5), "-potts" and "-overdraw" the price of a triangle drawn again, in mean squared
            errors; for the last two by default the highest with an error near the least one and below that of "lbg".
        slack: how near, as a share.
        per_pass: as in `cohere`.
        start, seed, iterations: as in `lbg`.

    Raises:
        InputError: the method is unknown, needs faces or positions that are not there, or an option is out of range.
    """
    if method not in METHODS:
        raise InputError(f"method '{method}' is unknown: use one of {', '.join(METHODS)}")
    if method in _ON_MESH and (faces is None or len(faces) == 0):
        raise InputError(f"method '{method}' needs triangles, these receivers have 0: use k-subspaces or lbg")
    if "coherent" in method and positions is None:
        raise InputError(f"method '{method}' needs positions [V, 3]: give them, or use lbg")
    if coherence is not None and not 0 <= coherence < float("inf"):
        raise InputError(f"coherence is {coherence}: give 0 or more, such as 0.5")
    begun = time.perf_counter()
    span = principal_span(vectors, remainder=_REMAINDER, seed=seed)
    spanned = time.perf_counter()
    options = {"start": start, "seed": seed, "iterations": iterations}
    found: Partition
    if "coherent" in method:
        coherence = _ALPHA if coherence is None else coherence
        place = "mean" if method.endswith("-mean") else "nearest"
        found = lbg_coherent(span.coordinates, positions, clusters, alpha=coherence, place=place, **options)
    else:
        found = lbg(span.coordinates, clusters, **options)
    started = time.perf_counter()
    timings = {"span": spanned - begun, "lbg": started - spanned}
    labels, rounds = found.labels, found.iterations
    if method.endswith("-reclassified"):
        subspaces = fit_subspaces(span.coordinates, labels, len(found.centers), components)
        corners = Corners.of(faces, len(vectors))
        permitted = {} if coherence is None or "coherent" in method else {"tolerance": coherence}
        labels = reclassify(span.coordinates, labels, subspaces, corners, **permitted)
        timings["reclassification"] = time.perf_counter() - started
    starts = [labels]
    if method.startswith("k-subspaces") and positions is not None:
        starts.insert(0, lbg(placed(span.coordinates, positions), len(found.centers), **options).labels)
    if method == "k-subspaces":
        tried = [k_subspaces(span.coordinates, begin, components, iterations=iterations) for begin in starts]
        best = min(tried, key=lambda partition: partition.error)
        labels, rounds = best.labels, rounds + best.iterations
        timings["subspaces"] = time.perf_counter() - started
    elif method.startswith("k-subspaces"):
        on_mesh = cluster_on_mesh(
            span.coordinates,
            starts,
            faces,
            components,
            kind=method.removeprefix("k-subspaces-"),
            price=coherence,
            slack=slack,
            per_pass=per_pass,
            iterations=iterations,
        )
        labels, coherence, rounds = on_mesh.labels, on_mesh.price, rounds + on_mesh.iterations
        timings["coherence"] = time.perf_counter() - started
    return Clustering(canonical(labels)[0], rounds, coherence, timings)
