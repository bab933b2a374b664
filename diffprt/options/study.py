"""What studies can be told, by Python functions and by `diffprt study`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from diffprt.options.numbers import check_numbers


def _option(default: object, text: str, *flags: str, reads: bool = False) -> Any:
    return field(default=default, metadata={"help": text, "flags": flags, "reads": reads})


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """What every study can be told; in a field's metadata "help" says what it does, "reads" that it names files.

    Attributes:
        say: is told what goes on.
    """

    say: Callable[[str], None] = lambda text: None

    def __post_init__(self) -> None:
        # What is too little for a study, the study says.
        check_numbers(vars(self), absurd=True)

    def settings(self, *left_out: str) -> dict[str, Any]:
        """What was asked for as plain values, for reports, but for what is `left_out`."""
        asked = {name: value for name, value in vars(self).items() if name not in ("say", "browser", *left_out)}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asked.items()}


@dataclass(frozen=True, kw_only=True)
class VisibilityOptions(StudyOptions):
    """Options of `visibility_study`."""

    rays: Sequence[int] = _option((256, 2048), "Rays per receiver; may be repeated.")
    runs: int = _option(5, "Rounds in which all take turns.")
    seconds: float = _option(1.0, "Least length of one timing.")
    large: int = _option(1_500_000, "Triangles of the mesh whose structure is built; 0 for none.")
    test_rays: int = _option(1_000_000, "Rays of the escape test and against brute force.")
    brute_tests: float = _option(1e10, "Most triangle tests of brute force per scene.")
    seed: int = _option(0, "Draws receivers and directions.")


@dataclass(frozen=True, kw_only=True)
class ToleranceOptions(StudyOptions):
    """Options of `tolerance_study`.

    Attributes:
        data: a folder, whose meshes are added; what is no mesh is skipped.
        random: number of random scenes that are added, from `seed`, `seed` + 1, ...
    """

    data: Path | None = None
    random: int = 0
    tolerances: Sequence[float] = _option((0.03, 0.01), "Relative errors asked for; may be repeated.", "--tolerance")
    bounces: Sequence[int] = _option((0, 2), "Diffuse interreflections; may be repeated.")
    order: int = _option(6, "SH bands.")
    seed: int = _option(0, "Of bakes, and of the first random scene.")
    truth_rays: int = _option(20_000_000, "Most rays of a truth; fewer receivers are compared beyond it.")
    finer_rays: int | None = _option(None, "Rays per receiver of a truth; 16 times those that were chosen, without it.")


@dataclass(frozen=True, kw_only=True)
class ClusteringOptions(StudyOptions):
    """Options of `clustering_study`."""

    signal: str = _option("shadow", "shadow, diffuse or a BRDF, NAME:parameter=value,...")
    clusters: int = _option(256, "Clusters.")
    components: int = _option(8, "Components per cluster.")
    registers: int | None = _option(256, "float4 registers of a pass.")
    iterations: int = _option(20, "Of k-means.")
    rounds: int = _option(3, "In which ours and faiss take turns.")
    order: int = _option(6, "SH bands.")
    rays: int = _option(1024, "Rays per receiver.")
    channels: int | None = _option(None, "1 or 3.  [default: as many as the BRDF has]")
    seed: int = _option(0, "Of rays, and of the first round.")


@dataclass(frozen=True, kw_only=True)
class WindowOptions(StudyOptions):
    """Options of `window_study`.

    Attributes:
        scenes: files or "builtin:NAME", with "+ground" for one.
        turns: of every map about +y, degrees.
    """

    scenes: Sequence[str] = _option(
        ("builtin:bunny+ground", "builtin:sphere+ground", "builtin:bowl+ground", "builtin:cornell"),
        "Scene files or builtin:NAME, with +ground for one; may be repeated.",
        "--scene",
        reads=True,
    )
    maps: Sequence[str] = _option(("sky", "studio"), "Maps; may be repeated.", "--map", reads=True)
    turns: Sequence[int] = _option((0, 72, 144, 216, 288), "Turns of every map, degrees; may be repeated.", "--turn")
    order: int = _option(6, "SH bands of the asset.")
    rays: int = _option(512, "Rays per receiver.")


@dataclass(frozen=True, kw_only=True)
class GradientOptions(StudyOptions):
    """Options of `gradient_study`.

    Attributes:
        clusters, components: of the clustered asset whose means, bases and weights are optimized.
    """

    order: int = _option(6, "SH bands of transfer and light.")
    rays: int = _option(1024, "Rays per receiver.")
    bounces: int = _option(2, "Interreflections, of Mitsuba's paths too.")
    size: int = _option(256, "Pixels a side.")
    samples: int = _option(16, "Mitsuba's samples per pixel of a timed step.")
    rows: int = _option(32, "Rows of the environment map whose texels are optimized.")
    clusters: int = 64
    components: int = 8
    rounds: int = _option(7, "In which all take turns.")
    truth_samples: int = _option(1024, "Mitsuba's samples per pixel of the gradients compared.")
    halves: int = _option(2, "Independent gradients of so many samples.")
    seed: int = _option(0, "Of the bake and of Mitsuba.")


@dataclass(frozen=True, kw_only=True)
class InverseOptions(StudyOptions):
    """Options of `inverse_study`."""

    order: int = _option(4, "SH bands of light and transfer.")
    rays: int = _option(4096, "Rays per receiver.")
    views: int = _option(3, "Pictures that a light is found from.")
    albedo_views: int = _option(8, "Pictures that an albedo is found from, under each light.")
    size: int = _option(192, "Pixels a side.")
    samples: int = _option(512, "Mitsuba's samples per pixel.")
    noise: float = _option(0.01, "Added to every pixel, a share of the picture's root mean square.")
    seed: int = _option(0, "Of rays and noise.")


@dataclass(frozen=True, kw_only=True)
class DisplayOptions(StudyOptions):
    """Options of `display_study`.

    Attributes:
        browser: a playwright browser that is running already; without it, one is started.
    """

    clusters: int = _option(64, "Clusters.")
    components: int = _option(8, "Components per cluster.")
    registers: int = _option(256, "float4 uniforms of a pass.")
    order: int = _option(6, "SH bands.")
    rays: int = _option(256, "Rays per receiver.")
    size: int = _option(512, "Pixels a side.")
    frames: int = _option(12, "Frames that are timed in a round.")
    rounds: int = _option(5, "In which all take turns.")
    browser: Any = None


@dataclass(frozen=True, kw_only=True)
class OverdrawOptions(StudyOptions):
    """Options of `overdraw_study`."""

    brdfs: Sequence[str] = _option(
        ("phong:exponent=16", "cook-torrance:roughness=0.3"),
        "NAME:parameter=value,...; diffuse for diffuse transfer; shadow for matrices without BRDF; repeatable.",
        "--brdf",
    )
    clusters: Sequence[int] = _option((256, 64, 128, 192), "Clusters; may be repeated.")
    methods: Sequence[str] | None = _option(
        None,
        "NAME[=COHERENCE][~SLACK][@REGISTERS], NAME as in compress, faiss or position-only; repeatable.  "
        "[default: all that count]",
        "--method",
    )
    components: int = _option(8, "Components per cluster.")
    budgets: Sequence[int] = _option((256, 1024, 4096), "float4 registers of a pass; may be repeated.", "--registers")
    lights: Sequence[str] = _option(
        ("sky", "studio"), "Of the image error: sky, studio or a map; repeatable.", "--light", reads=True
    )
    order: int = _option(6, "SH bands.")
    rays: int = _option(1024, "Rays per receiver.")
    bounces: int = _option(0, "Interreflections.")
    channels: int | None = _option(None, "1 or 3.  [default: as many as the BRDF has]")
    seed: int = _option(0, "Of rays and starts.")
    seeds: int = _option(3, "Starts of original CPCA.")
    minutes: float | None = _option(None, "Begin no row after these; repeat the command to go on.")
