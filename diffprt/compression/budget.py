"""Which forms of clustered transfer make a file of at most so many bytes, and which of them is chosen."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NoReturn, TypeVar

import torch

from diffprt.compression.clustered.storage import stored_shapes
from diffprt.errors import InputError
from diffprt.representation.file_size import Shapes, file_size, shapes_of
from diffprt.representation.interface import Representation
from diffprt.representation.provenance import Provenance
from diffprt.surface.receivers import Receivers

# Formats of weights and of bases, by rising size; later ones are tried when the earlier have components to spare.
FORMAT_PAIRS = (("uint8", "uint8"), ("uint8", "float16"), ("float16", "float16"), ("float32", "float32"))
MOST_COMPONENTS = 64
# Relative error from which openness is dropped rather than more of the signal, and of which `compress` warns.
MOST_ERROR = 0.03
# Nothing is given up for a gain below this share, or where the error is this small already.
_GAIN, _FINE = 0.99, 1e-3

Made = TypeVar("Made")


@dataclass(frozen=True)
class Form:
    """What a file holds of clustered transfer.

    Attributes:
        clusters, components: how many.
        weights_format, bases_format: as in `CompressOptions`.
        geometry: bits of positions and normals, 32 or 16.
        beside: whether openness and bent normals are kept.
    """

    clusters: int
    components: int
    weights_format: str = "float32"
    bases_format: str = "float32"
    geometry: int = 32
    beside: bool = True


@dataclass(frozen=True)
class Budget:
    """A file of at most `size` bytes.

    Attributes:
        size: bytes.
        kind: the type of the clustered asset.
        provenance: of an asset of some form; what is measured later as wide as it may become (`unmeasured`).
        receivers: where the signal lives.
        signal_shape: of one receiver.
        beside: dtype and shape of what is known of receivers beside the signal, by name.
        geometry: 32 or 16 where that was asked for; chosen without.
        dtype: of numbers in no fewer bits.
    """

    size: int
    kind: type[Representation]
    provenance: Callable[[Form], Provenance]
    receivers: Receivers
    signal_shape: tuple[int, ...]
    beside: Shapes = field(default_factory=dict)
    geometry: int | None = None
    dtype: torch.dtype = torch.float32

    @property
    def levels(self) -> list[tuple[int, bool]]:
        """Geometry, and whether openness is kept: what costs least is given up first."""
        bits = [self.geometry] if self.geometry else [32, 16] if self.receivers.bits == 32 else [16]
        kept = [(b, True) for b in bits]
        return [*kept, (bits[-1], False)] if self.beside else kept

    @property
    def most(self) -> int:
        """Components, at most."""
        return min(torch.Size(self.signal_shape).numel(), MOST_COMPONENTS)

    def file_bytes(self, form: Form) -> int:
        """Bytes of the file of a form, at most."""
        signal = stored_shapes(
            len(self.receivers),
            form.clusters,
            form.components,
            self.signal_shape,
            form.weights_format,
            form.bases_format,
            self.dtype,
        )
        beside = self.beside if form.beside else {}
        return file_size(self.kind, self.provenance(form), {**signal, **beside, **self._geometries[form.geometry]})

    def forms(self, clusters: int, level: tuple[int, bool], *, least: int = 1) -> list[Form]:
        """The most components that fit, at least `least`, in each pair of formats that may be the best one."""
        found: list[Form] = []
        for formats in FORMAT_PAIRS:
            counts = range(least, self.most + 1)
            fit = last_that_fits(counts, lambda p, f=formats: self.fits(Form(clusters, p, *f, *level)))
            if fit is not None:
                found.append(Form(clusters, fit, *formats, *level))
            if least and fit is not None and fit < self.most and formats[1] == "float16":
                break
        return found

    def fits(self, form: Form) -> bool:
        """Whether the file of a form is small enough."""
        return self.file_bytes(form) <= self.size

    def smallest(self, clusters: int, components: int) -> tuple[int, Form]:
        """The least bytes in which so many clusters and components can be kept, and how."""
        forms = (Form(clusters, components, *formats, *self.levels[-1]) for formats in FORMAT_PAIRS)
        return min(((self.file_bytes(form), form) for form in forms), key=lambda found: found[0])

    def refuse(self, least: int, kept: str, remedy: str) -> NoReturn:
        """Raises InputError that names the least."""
        given_up = f"{kept}, geometry in {self.levels[-1][0]} bits" + (", no openness" if self.beside else "")
        least_text = f"the least file takes {least} ({given_up})"
        raise InputError(f"bytes is {self.size}, {least_text}: give that or more, or {remedy}")

    @cached_property
    def _geometries(self) -> dict[int, Shapes]:
        return {b: shapes_of(self.receivers.in_bits(b).stored()) for b in {level[0] for level in self.levels}}


def choose(levels: Sequence[tuple[int, bool]], best: Callable[[tuple[int, bool]], tuple[float, Made] | None]) -> Made:
    """What is made of the level that is chosen: geometry in 16 bits where that lowers the error, and no openness where
    nothing else fits or the error would be over `MOST_ERROR`.

    Args:
        levels: of the budget, one of which fits.
        best: relative error of a level, and what is made of it; None where nothing fits.
    """
    chosen: tuple[float, Made] | None = None
    for level in levels:
        if chosen is not None and chosen[0] <= (_FINE if level[1] else MOST_ERROR):
            continue
        found = best(level)
        if found is not None and (chosen is None or found[0] < _GAIN * chosen[0]):
            chosen = found
    assert chosen is not None, "the caller has checked that something fits"
    return chosen[1]


def ladder(clusters: int) -> Iterator[int]:
    """Numbers of clusters from many to few: in few bytes fewer clusters with more components may be better."""
    while clusters >= 1:
        yield clusters
        clusters //= 4


def most_clusters(budget: Budget, clusters: int) -> Form | None:
    """The most clusters, at most so many, that fit with one component, or else with none."""
    for components in (1, 0):
        fit = last_that_fits(range(1, clusters + 1), lambda m, p=components: budget.smallest(m, p)[0] <= budget.size)
        if fit is not None:
            return budget.smallest(fit, components)[1]
    return None


def last_that_fits(counts: range, fits: Callable[[int], bool]) -> int | None:
    """The last of rising counts that fits, where all before it do too."""
    low, high = 0, len(counts)
    while low < high:
        middle = (low + high) // 2
        if fits(counts[middle]):
            low = middle + 1
        else:
            high = middle
    return counts[low - 1] if low else None
