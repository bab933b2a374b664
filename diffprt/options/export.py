"""What `export`, `show` and `diffprt export` can be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from diffprt.errors import InputError
from diffprt.options.numbers import check_numbers
from diffprt.options.ranges import check_choice
from diffprt.options.view import WINDOWS, ViewOptions

CURVES = ("linear", "reinhard", "aces")


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """What is beside the asset in a page.

    Attributes:
        lights: of type `Light`, to choose from, by the name shown, of the asset's order; the first one is shown first.
            Without them, a plain sky with a sun. Readers may drop an .hdr file on the page for more.
        camera: a `Camera`, the first view; without it, one that frames the asset, not the ground under it.
        window: of maps that readers drop on the page: "picture", "none", "lanczos" or "hann"; "auto", which takes
            a search, is "picture" there. `lights` are as given.
        exposure: factor on radiance, positive.
        curve: tone curve that is on first, one of `CURVES`.
        title: shown as the page's heading.
        registers: draws clustered diffuse transfer super-cluster by super-cluster, with that many float4 uniforms a
            pass (256 in the thesis of 2005), and adds the passes up; without it, in one pass from textures.
        versions: other assets on the same mesh and of the same order, by the name shown, such as direct light alone
            and with interreflection.
        uncompressed: the transfer that was compressed: a version where it has 20 MB or less, and a heat map of each
            vertex's squared error.
        before: the asset before optimization, a version.
        bytes: what the page, index.html, may take. Where all does not fit, the uncompressed version is left out first,
            then components of clustered transfer; plain transfer is compressed on the way.

    Raises:
        InputError: no lights in `lights`, an unknown curve, or an exposure that is not positive.
    """

    lights: Mapping[str, Any] | None = None
    camera: Any = None
    window: str = ViewOptions.window
    exposure: float = 1.0
    curve: str = field(default="aces", metadata={"help": "linear, reinhard or aces."})
    title: str = field(default="", metadata={"help": "Shown on the page; the asset's name by default."})
    registers: int | None = field(
        default=None,
        metadata={
            "help": "Draws clusters in passes of that many float4 uniforms, such as 256.  [default: in one pass]"
        },
    )
    versions: Mapping[str, Any] = field(
        default_factory=dict,
        metadata={"help": "Another asset (.prt) of the same mesh, to compare with; may be repeated."},
    )
    uncompressed: Any = field(
        default=None,
        metadata={
            "help": "The transfer that was compressed (.prt): a version to compare with, and a heat map of errors."
        },
    )
    before: Any = field(default=None, metadata={"help": "The asset before optimization (.prt), to compare with."})
    bytes: int | None = field(
        default=None,
        metadata={
            "help": "What the page may take, such as 2MB: components are left out to fit, and an asset that is not "
            "compressed is compressed on the way."
        },
    )

    def __post_init__(self) -> None:
        if self.lights is not None and not self.lights:
            raise InputError("lights are empty: give at least one, or None for the built-in one")
        if self.curve not in CURVES:
            raise InputError(f"tone curve '{self.curve}' is unknown: use one of {', '.join(CURVES)}")
        check_choice("window", self.window, WINDOWS)
        check_numbers(vars(self))
