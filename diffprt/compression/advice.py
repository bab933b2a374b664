"""What brings the error of compressed transfer under a limit: foretold on the clusters at hand, then tried."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import torch

from diffprt.compression.budget import FORMAT_PAIRS, MOST_COMPONENTS, MOST_ERROR, Budget, Form
from diffprt.compression.clusters.components import cluster_pca
from diffprt.compression.clusters.randomized_pca import principal_span
from diffprt.compression.encode import Encoded, encode, squared_errors, stored_form
from diffprt.compression.to_bytes import encode_to_bytes
from diffprt.errors import InputError
from diffprt.options.compress import ClusterOptions
from diffprt.torch_threads import one_torch_thread

_REMAINDER = 1e-4
_MOST_TRIES = 4


@dataclass(frozen=True)
class Remedy:
    """Options that keep the error under a limit.

    Attributes:
        clusters, components, weights_format, bases_format: as in `CompressOptions`; with bytes, what these come to.
        bytes: what to ask for, where the form was chosen to fit bytes.
        relative: the error, as it was measured.
        file_bytes: of the file, at most.
    """

    clusters: int
    components: int
    weights_format: str
    bases_format: str
    bytes: int | None
    relative: float
    file_bytes: int


def advice(vectors: torch.Tensor, encoded: Encoded, options: ClusterOptions, budget: Budget, form: Form) -> dict:
    """For the report of `compress`: `warnings`, in words, and the `remedy`, where the error is over `MOST_ERROR`.

    Args:
        vectors: float [V, D] that were encoded.
        encoded: what became of them.
        options: of that.
        budget: of the file, its size 0 where none was asked for.
        form: of the file.
    """
    error = _relative(vectors, encoded)
    if error <= MOST_ERROR:
        return {"warnings": []}
    found = _remedy_in_bytes if budget.size else _remedy
    remedy = found(vectors, encoded, options, budget, form)
    over = f"the signal's error is {100 * error:.2f} %, over {100 * MOST_ERROR:.0f} %"
    if remedy is None:
        return {"warnings": [f"{over}: its receivers have too little in common, keep it uncompressed"], "remedy": None}
    if remedy.bytes is not None:
        asked, size = f"--bytes {remedy.bytes}", ""
    else:
        asked = f"--clusters {remedy.clusters} --components {remedy.components}"
        for name in ("weights", "bases"):
            needed = getattr(remedy, f"{name}_format")
            asked += f" --{name}-format {needed}" if needed != getattr(options, f"{name}_format") else ""
        size = f", in a file of {remedy.file_bytes / 1e6:.2f} MB"
    return {
        "warnings": [f"{over}: {asked} brings it to {100 * remedy.relative:.2f} %{size}"],
        "remedy": vars(remedy),
    }


def _remedy(
    vectors: torch.Tensor, encoded: Encoded, options: ClusterOptions, budget: Budget, form: Form
) -> Remedy | None:
    """The fewest components that are enough, in the formats at hand or finer ones; else more clusters."""
    most = min(vectors.shape[1], MOST_COMPONENTS)
    foretold = _foretold(vectors, encoded, options)
    clusters, components, formats = options.clusters, most, ("float32", "float32")
    if foretold is not None:
        components, formats = foretold
    for _ in range(_MOST_TRIES):
        if foretold is None:
            clusters = min(4 * clusters, len(vectors), 1 << 16)
        known: dict[str, Any] = {"clusters": clusters, "components": components}
        known |= {"weights_format": formats[0], "bases_format": formats[1]}
        relative = _relative(vectors, found := encode(vectors, **(vars(options) | known)))
        if relative <= MOST_ERROR:
            needed = replace(form, **(known | {"clusters": len(found.means)}))
            return Remedy(clusters, components, *formats, None, relative, budget.file_bytes(needed))
        if foretold is not None and components == most:
            foretold = None
        components = min(most, components + max(1, components // 8))
    return None


def _remedy_in_bytes(
    vectors: torch.Tensor, encoded: Encoded, options: ClusterOptions, budget: Budget, form: Form
) -> Remedy | None:
    """Bytes that are enough, for clusters, components and formats that are chosen to fit."""
    fewest = replace(encoded, weights_format="uint8", bases_format="uint8")
    foretold = _foretold(vectors, fewest, options)
    size = 2 * budget.size
    if foretold is not None:
        components, (weights_format, bases_format) = foretold
        needed = replace(form, components=components, weights_format=weights_format, bases_format=bases_format)
        size = max(budget.size, budget.file_bytes(needed))
    for _ in range(_MOST_TRIES):
        found, chosen = encode_to_bytes(vectors, options, replace(budget, size=size))
        relative = _relative(vectors, found)
        if relative <= MOST_ERROR:
            formats = (chosen.weights_format, chosen.bases_format)
            return Remedy(chosen.clusters, chosen.components, *formats, size, relative, size)
        size += size // 8 if foretold is not None else size
    return None


def _relative(vectors: torch.Tensor, encoded: Encoded) -> float:
    """The root of the share of the signal's energy."""
    energy = float(vectors.square().sum(1, dtype=torch.float64).sum())
    return (float(squared_errors(vectors, encoded).sum()) / (energy or 1.0)) ** 0.5


@one_torch_thread()
def _foretold(vectors: torch.Tensor, encoded: Encoded, options: ClusterOptions) -> tuple[int, tuple[str, str]] | None:
    """The fewest components that are enough on the clusters at hand, and formats; None where 64 are not."""
    vectors, labels = vectors.detach(), encoded.labels
    energy = float(vectors.square().sum(1, dtype=torch.float64).sum()) or 1.0
    clusters, most, wanted = len(encoded.means), min(vectors.shape[1], MOST_COMPONENTS), MOST_ERROR**2
    span = principal_span(vectors, remainder=_REMAINDER)
    means, _, weights = cluster_pca(span.coordinates, labels, clusters, most)
    left = (span.coordinates - means[labels]).square().sum(dtype=torch.float64)
    left = left + span.remainder * (vectors - span.mean).square().sum(dtype=torch.float64)
    enough = ((left - weights.square().sum(0, dtype=torch.float64).cumsum(0)) / energy <= wanted).nonzero()
    if not len(enough):
        return None
    least = max(int(enough[0]) + 1, encoded.bases.shape[1])
    widest = min(most, least + max(2, least // 4))
    scale = None if options.prior is None else options.prior.to(vectors).sqrt()
    weighted = vectors if scale is None else vectors * scale
    means, bases, weights = cluster_pca(weighted, labels, clusters, widest)
    for formats in _no_coarser(encoded.weights_format, encoded.bases_format):
        for components in range(least, widest + 1):
            fitted = (means, bases[:, :components], weights[:, :components].contiguous())
            try:
                stored = stored_form(weighted, labels, fitted, scale, *formats)
            except InputError:  # a number beyond float16
                break
            if _relative(vectors, Encoded(labels, *stored, encoded.method, *formats)) ** 2 <= wanted:
                return components, formats
    return None


def _no_coarser(weights_format: str, bases_format: str) -> Iterator[tuple[str, str]]:
    """The formats at hand, then finer ones."""
    rank = {"uint8": 0, "float16": 1, "float32": 2}
    yield weights_format, bases_format
    for weights, bases in FORMAT_PAIRS:
        finer = rank[weights] >= rank[weights_format] and rank[bases] >= rank[bases_format]
        if finer and (weights, bases) != (weights_format, bases_format):
            yield weights, bases
