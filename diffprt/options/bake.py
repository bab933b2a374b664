"""Options of a bake: as asked for, and as settled and saved in the asset."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from numbers import Integral
from typing import TypeVar

from diffprt.errors import InputError
from diffprt.options.numbers import check_numbers
from diffprt.options.ranges import check_choice, check_order, check_threads

QUALITIES = {
    "draft": {"order": 4, "rays": 256, "bounces": 1},
    "good": {"order": 6, "rays": 1024, "bounces": 2},
    "best": {"order": 8, "rays": 4096, "bounces": 4},
}
OPERATORS = ("auto", "stored", "recompute")
# Bounces of light that hardly fades: all of them, by solving for what they converge to.
CONVERGED = "converged"


@dataclass(frozen=True)
class BakeSettings:
    """What a bake does; saved in the asset.

    Attributes:
        order: SH bands, 1 to 10.
        rays: rays per receiver, all over its own upper hemisphere.
        bounces: diffuse interreflections, 0 to 64, or "converged" for all of them; an asset that was baked to
            convergence records how many products of the bounce operator that took.
        seed: turns every receiver's pattern.

    Raises:
        InputError: an option is out of range.
    """

    order: int = 6
    rays: int = 1024
    bounces: int | str = 2
    seed: int = 0

    def __post_init__(self) -> None:
        check_order(self.order)
        if self.bounces != CONVERGED and not (isinstance(self.bounces, Integral) and 0 <= self.bounces <= 64):
            raise InputError(f"bounces is {self.bounces}: give 0 to 64, such as 2, or 'converged'")
        check_numbers(vars(self))

    @property
    def reflects(self) -> bool:
        """Whether any bounce is wanted."""
        return self.bounces != 0

    def as_dict(self) -> dict:
        """Plain values."""
        return asdict(self)


@dataclass(frozen=True)
class GlossySettings(BakeSettings):
    """What a glossy bake does; saved in the asset.

    Attributes:
        order_out: SH bands of exit radiance, 1 to 10; `order` where None is given.
        bounce_rays: rays per receiver that gather each bounce; where None is given, a quarter of `rays`, but at
            least 256.
        ridge: smoothing of exit radiance below the surface; see `diffprt.brdf.fit`.
    """

    order_out: int | None = None
    bounce_rays: int | None = None
    ridge: float = 3e-4

    def __post_init__(self) -> None:
        if isinstance(self.bounces, str):
            raise InputError(f"bounces is '{self.bounces}': glossy transfer takes a number, 0 to 64, such as 2")
        super().__post_init__()
        object.__setattr__(self, "order_out", check_order(self.order if self.order_out is None else self.order_out))
        if self.bounce_rays is None:
            object.__setattr__(self, "bounce_rays", max(256, self.rays // 4))
        check_numbers({"bounce_rays": self.bounce_rays})


Settings = TypeVar("Settings", bound=BakeSettings)


def check_tolerance(tolerance: float) -> None:
    """Refuses what is no share of the signal."""
    if not 0 < tolerance < 1:
        raise InputError(f"tolerance is {tolerance}: give a share between 0 and 1, such as 0.01")


def _option(default: object, text: str) -> object:
    return field(default=default, metadata={"help": text})


@dataclass(frozen=True, kw_only=True)
class BakeOptions:
    """What a bake is asked for; "help" in the metadata of a field says what it does.

    Raises:
        InputError: an option is out of range, or more than one of rays, tolerance and seconds is given.
    """

    quality: str = _option("good", "draft, good or best: sets order, rays and bounces.")
    order: int | None = _option(None, "SH bands, 1 to 10.")
    rays: int | None = _option(None, "Rays per receiver.")
    bounces: int | str | None = _option(None, "Interreflections: a number, or converged for all of them.")
    tolerance: float | None = _option(None, "Instead of rays: the relative error that sampling may leave.")
    seconds: float | None = _option(None, "Instead of rays: about how long this machine may work.")
    order_out: int | None = _option(None, "With --brdf: SH bands of exit radiance, 1 to 10; --order by default.")
    bounce_rays: int | None = _option(
        None, "With --brdf: rays that gather each bounce; a quarter of --rays, but at least 256, by default."
    )
    ridge: float = _option(3e-4, "With --brdf: smoothing of exit radiance below the surface.")
    seed: int = _option(0, "Turns the sample patterns.")
    fill_inside: bool = _option(True, "Fill receivers inside geometry from their neighbors outside.")
    operator: str = _option(
        "auto", "stored: keep what rays hit for the bounces; recompute: trace again for each; auto: what fits."
    )
    hours: float = _option(1.0, "Refuse a bake that is expected to take longer; --seconds takes precedence.")
    threads: int | None = _option(None, "CPU threads; all by default.")

    def __post_init__(self) -> None:
        if self.quality not in QUALITIES:
            raise InputError(f"quality '{self.quality}' is unknown: use one of {', '.join(QUALITIES)}")
        check_choice("operator", self.operator, OPERATORS)
        check_threads(self.threads)
        check_numbers({name: value for name, value in vars(self).items() if name != "bounces"})
        given = [name for name in ("rays", "tolerance", "seconds") if getattr(self, name) is not None]
        if len(given) > 1:
            raise InputError(f"{' and '.join(given)} were given together: give one of them")
        if self.tolerance is not None:
            check_tolerance(self.tolerance)
        self.settings()

    def settings(self, kind: type[Settings] = BakeSettings, **planned: object) -> Settings:
        """The preset of the quality, with what is `planned`, and then with what is asked for, in its place."""
        asked = {f.name: value for f in fields(kind) if (value := getattr(self, f.name)) is not None}
        return kind(**(QUALITIES[self.quality] | planned | asked))

    def of(self, kind: type[BakeOptions]) -> dict:
        """Those options that `kind` has, as keywords."""
        return {f.name: getattr(self, f.name) for f in fields(kind)}

    def beyond(self, kind: type[BakeOptions]) -> dict:
        """Those that it does not have."""
        return {name: value for name, value in vars(self).items() if name not in self.of(kind)}
