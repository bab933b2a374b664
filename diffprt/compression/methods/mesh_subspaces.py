"""Subspace clusters of receivers that triangles join: from where they start to what overdraw costs them."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.compression.clusters.subspaces import fit_subspaces
from diffprt.compression.methods.anneal import anneal
from diffprt.compression.methods.k_subspaces import k_subspaces
from diffprt.compression.methods.priced_overdraw import cohere

_SOFT_PRICE = 0.5
_BELOW_LBG = 0.95
_ROUNDS = 8


@dataclass(frozen=True)
class MeshPartition:
    """What was found.

    Attributes:
        labels: int64 [V], in [0, M); clusters may be empty.
        price: of one extra drawn triangle, in mean squared errors.
        iterations: rounds of `k_subspaces`.
    """

    labels: torch.Tensor
    price: float
    iterations: int


def cluster_on_mesh(
    vectors: torch.Tensor,
    starts: list[torch.Tensor],
    faces: torch.Tensor,
    components: int,
    *,
    kind: str,
    price: float | None,
    slack: float,
    per_pass: int | None,
    iterations: int,
) -> MeshPartition:
    """Subspaces with a price on overdraw, from the first start that leads below the error of the last one.

    Args:
        vectors: float [V, D].
        starts: labels int64 [V]; the last are those of `lbg`, whose error is the limit where the price is chosen.
        faces: int64 [F, 3].
        components: P.
        kind: "soft" (`anneal`), "potts" or "overdraw" (`cohere`).
        price, slack, per_pass: as in `cohere`.
        iterations: of `k_subspaces`, at most; here they are few.
    """
    limit, rounds = float("inf"), 0
    if price is None and kind != "soft":
        plain = fit_subspaces(vectors, starts[-1], int(starts[-1].max()) + 1, components)
        limit = _BELOW_LBG * float(plain.own(vectors, starts[-1]).double().mean())
    for start in starts:
        first = k_subspaces(vectors, start, components, iterations=min(iterations, _ROUNDS))
        rounds += first.iterations
        if kind == "soft":
            price = _SOFT_PRICE if price is None else price
            return MeshPartition(anneal(vectors, first.labels, faces, first.subspaces, price=price), price, rounds)
        found = cohere(
            vectors,
            first.labels,
            faces,
            first.subspaces,
            price=price,
            limit=limit,
            slack=slack,
            per_pass=per_pass,
            edges=kind == "potts",
        )
        if found.error <= limit:
            break
    return MeshPartition(found.labels, found.price, rounds)
