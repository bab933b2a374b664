"""What `compress`, `encode`, `cluster` and `diffprt compress` can be told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from diffprt.errors import InputError
from diffprt.options.numbers import check_numbers
from diffprt.options.ranges import check_choice, check_geometry

FORMATS = ("float32", "float16", "uint8")
STARTS = ("k-means++", "hyper-box")


@dataclass(frozen=True)
class Method:
    """A way to partition receivers by their signals.

    Attributes:
        description: in one line.
        function: FILE:FUNCTION in diffprt/compression/methods, called with the signals' coordinates float [V, R] and
            `ClusterOptions`; returns a `Clustering`.
        needs: which of "positions" and "faces" it cannot do without.
    """

    description: str
    function: str
    needs: tuple[str, ...] = ()


METHODS = {
    "lbg": Method(
        "clusters around means, components afterwards: original CPCA (Sloan et al. 2003; thesis 2005)", "lbg:by_means"
    ),
    "lbg-reclassified": Method(
        "then receivers join a neighbor's cluster where the error permits (Sloan et al. 2003)",
        "reclassify:by_means_reclassified",
        ("faces",),
    ),
    "lbg-coherent": Method(
        "the same with geometry coherence (thesis 2005, equation 9)",
        "geometry_coherence:by_nearest_member",
        ("positions",),
    ),
    "lbg-coherent-reclassified": Method("both", "reclassify:by_nearest_member_reclassified", ("faces", "positions")),
    "lbg-coherent-mean": Method(
        "geometry coherence towards the mean position of a cluster, another reading of the thesis",
        "geometry_coherence:by_mean_position",
        ("positions",),
    ),
    "k-subspaces": Method("clusters around what their components span", "k_subspaces:by_subspaces"),
    "k-subspaces-soft": Method(
        "the same, annealed from soft to hard with a price on expected overdraw", "anneal:by_annealing", ("faces",)
    ),
    "k-subspaces-potts": Method(
        "the same with a price on mesh edges between clusters", "priced_overdraw:by_edges", ("faces",)
    ),
    "k-subspaces-overdraw": Method(
        "the same with a price on overdraw itself (thesis 2005, equation 8)", "priced_overdraw:by_overdraw", ("faces",)
    ),
}
_MISSING = {
    "faces": "triangles, these receivers have 0: use k-subspaces or lbg",
    "positions": "positions [V, 3]: give them, or use lbg",
}


def _option(default: object, text: str) -> Any:
    return field(default=default, metadata={"help": text})


@dataclass(frozen=True, kw_only=True)
class CompressOptions:
    """What compression is asked for; "help" in the metadata of a field says what it does.

    Attributes:
        coherence: alpha of equation 9 (thesis: 0.05, the default) for "lbg-coherent" and its kin; for
            "lbg-reclassified" the growth of a receiver's error that is permitted, in mean squared errors (0.5); for
            "-soft" (0.5), "-potts" and "-overdraw" the price of a triangle drawn again, in mean squared errors; for the
            last two by default the highest with an error within `slack` of the least one and below that of "lbg".
        prior: float tensor, mean square of each coefficient of incident light (`light_prior`).
        report: a dictionary that is filled with timings, counts and errors.

    Raises:
        InputError: an option is out of range.
    """

    clusters: int = _option(64, "Clusters, at most.")
    components: int = _option(8, "Principal components per cluster.")
    method: str | None = _option(None, f"{', '.join(METHODS)}; the best one if not given.")
    coherence: float | None = _option(
        None,
        "How much overdraw counts, in the method's unit (the price of a triangle drawn again, in mean squared errors; "
        "alpha for lbg-coherent); chosen if not given.",
    )
    slack: float = _option(0.1, "How far above the least error the choice of coherence may go, as a share.")
    registers: int | None = _option(
        None, "float4 registers of a display that draws in passes: spare triangles between passes first."
    )
    weights_format: str = _option("float32", f"{', '.join(FORMATS)}, of the weights.")
    bases_format: str = _option("float32", f"{', '.join(FORMATS)}, of means and components.")
    start: str = _option("k-means++", f"{', '.join(STARTS)}.")
    seed: int = _option(0, "Of the clustering's start.")
    iterations: int = _option(50, "Rounds of clustering, at most, and of subspaces after it.")
    bytes: int | None = _option(
        None,
        "What the file may take, such as 2MB: components, formats, geometry and whether openness is kept are then "
        "chosen, and clusters are at most those.",
    )
    geometry: int | None = _option(
        None, "16: positions, normals and faces in 16 bits, 32: as they are.  [default: 32; chosen with --bytes]"
    )
    prior: Any = None
    report: dict | None = None

    def __post_init__(self) -> None:
        check_numbers(vars(self))
        if self.method is not None and self.method not in METHODS:
            raise InputError(f"method '{self.method}' is unknown: use one of {', '.join(METHODS)}")
        check_geometry(self.geometry)
        if self.bytes is not None and self.registers is not None:
            raise InputError("registers is given with bytes, which chooses components: give one of them")
        check_choice("weights_format", self.weights_format, FORMATS)
        check_choice("bases_format", self.bases_format, FORMATS)

    @property
    def lbg(self) -> dict[str, Any]:
        """What `lbg` is told."""
        return {"start": self.start, "seed": self.seed, "iterations": self.iterations}


@dataclass(frozen=True, kw_only=True)
class ClusterOptions(CompressOptions):
    """The same for rows of numbers, with what is known of their receivers.

    Attributes:
        positions: float [V, 3], for geometry coherence, and for better starts of "k-subspaces" and its kin.
        faces: int64 [F, 3], for methods that look at overdraw.
        per_pass: clusters that share a pass, in place of `registers` (`clusters_per_pass`).
        prior: float [D], what an error in each entry weighs; of `encode` alone.
    """

    positions: Any = None
    faces: Any = None
    per_pass: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.bytes is not None or self.geometry is not None:
            raise InputError("bytes and geometry are of files, which rows of numbers have not: give them to compress")

    @property
    def chosen(self) -> str:
        """The method: without a name the best one; what needs a mesh is not for points.

        Raises:
            InputError: it needs faces or positions that are not there.
        """
        has = {name for name in ("faces", "positions") if (value := getattr(self, name)) is not None and len(value)}
        method = self.method or ("k-subspaces-overdraw" if "faces" in has else "k-subspaces")
        for need in METHODS[method].needs:
            if need not in has:
                raise InputError(f"method '{method}' needs {_MISSING[need]}")
        return method
