"""A page of at most so many bytes: what it leaves out of the asset, and of what stands beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, singledispatch

from diffprt.compression import ClusteredSignal, compress
from diffprt.compression.budget import MOST_COMPONENTS, ladder, last_that_fits
from diffprt.compression.clustered.shortened import by_spread, shortened, squared_distances
from diffprt.compression.compress import compression_error
from diffprt.errors import InputError
from diffprt.exporters.web.page_content import Page
from diffprt.representation import Representation
from diffprt.transfer.at_receivers import TransferAtReceivers

Build = Callable[[Representation, tuple[str, ...]], Page]

_CLUSTERS = 64
# Clusters are found around at most so many components.
_MOST_FOUND = 32
# Bytes of a page for each number of the signal: half floats, deflated, in base64.
_BYTES_PER_NUMBER = 2.3


@singledispatch
def shrunk(asset: Representation, size: int, build: Build) -> Page:
    """The page of as much of the asset as `size` bytes hold; only transfer can be shrunk, all else is refused.

    Args:
        asset: whose page is too large.
        size: bytes.
        build: the page of an asset, and what was left out of it in words.

    Raises:
        InputError: the least page is larger, and is named.
    """
    raise _refused(size, len(build(asset, ()).content), "leave versions out")


@shrunk.register
def _shrunk_clusters(asset: ClusteredSignal, size: int, build: Build) -> Page:
    """As many of its components as fit, the widest first."""
    if asset.components < 2:
        raise _refused(size, len(build(asset, ()).content), "compress to fewer clusters")
    sorted_by_spread, signal = by_spread(asset), asset.decode().signal

    @cache
    def page(components: int) -> Page:
        found = shortened(sorted_by_spread, components)
        off = compression_error(signal.flatten(1), squared_distances(found, signal))["compression_relative"]
        found = found.labeled(found.provenance.also(certificate={"shortened_relative": off}))
        text = f"{asset.components - components} of {asset.components} components: the signal moves by {_percent(off)}"
        return build(found, (text,))

    return _most(range(1, asset.components), page, size, "compress to fewer clusters")


@shrunk.register
def _shrunk_transfer(asset: TransferAtReceivers, size: int, build: Build) -> Page:
    """Compressed on the way, to at most 64 clusters and as many components as fit."""
    signal, count = asset.signal.detach(), len(asset.signal)
    numbers = signal[0].numel()
    most = min(numbers, MOST_COMPONENTS)

    def pages(clusters: int, components: int) -> tuple[float, int, Callable[[int], Page]]:
        found = compress(asset, clusters=clusters, components=min(components, most, _MOST_FOUND))
        ordered = by_spread(found)

        @cache
        def page(kept: int) -> Page:
            few = shortened(ordered, kept)
            errors = compression_error(signal.flatten(1), squared_distances(few, signal))
            few = few.labeled(few.provenance.also(certificate=errors))
            text = (
                f"the uncompressed signal: compressed on the way to {few.clusters} clusters x {kept} components, "
                f"error {_percent(errors['compression_relative'])}"
            )
            return build(few, (text,))

        return found.certificate["compression_relative"], found.components, page

    smallest = pages(1, 1)[2]
    least = len(smallest(1).content)
    if least > size:
        raise _refused(size, least, "a mesh of fewer vertices")
    tried: list[tuple[int, float]] = []
    for clusters in ladder(min(_CLUSTERS, count)):
        room = (size - least) / (_BYTES_PER_NUMBER * (count + clusters * numbers))
        if room >= 1 and (not tried or room > 1.2 * tried[-1][1]):
            tried.append((clusters, room))
    starts = [pages(clusters, math.ceil(1.3 * room)) for clusters, room in tried]
    fitting = [start for start in starts if len(start[2](1).content) <= size]
    _, components, page = min(fitting or [(math.inf, 1, smallest)], key=lambda start: start[0])
    return _most(range(1, components + 1), page, size, "a mesh of fewer vertices")


def _most(counts: range, page: Callable[[int], Page], size: int, remedy: str) -> Page:
    """The page of the most components that fit."""
    fit = last_that_fits(counts, lambda components: len(page(components).content) <= size)
    if fit is None:
        raise _refused(size, len(page(counts[0]).content), remedy)
    return page(fit)


def _refused(size: int, least: int, remedy: str) -> InputError:
    return InputError(f"bytes is {size}, the least page takes {least}: give that or more, or {remedy}")


def _percent(share: float) -> str:
    return f"{100 * share:.2f} %"
