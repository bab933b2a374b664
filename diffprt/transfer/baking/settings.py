"""Options of a bake, checked before any work."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from numbers import Integral

from diffprt import sh
from diffprt.errors import InputError
from diffprt.planning import CONVERGED

QUALITIES = {
    "draft": {"order": 4, "rays": 256, "bounces": 1},
    "good": {"order": 6, "rays": 1024, "bounces": 2},
    "best": {"order": 8, "rays": 4096, "bounces": 4},
}


@dataclass(frozen=True)
class BakeSettings:
    """What a bake does; saved in the asset.

    Attributes:
        order: SH bands, 1 to 10.
        rays: rays per receiver, all over its own upper hemisphere.
        bounces: diffuse interreflections, 0 to 64, or "converged" for all of them; an asset that was baked to
            convergence records how many products of the bounce operator that took.
        seed: turns every receiver's pattern.
    """

    order: int = 6
    rays: int = 1024
    bounces: int | str = 2
    seed: int = 0

    def __post_init__(self) -> None:
        sh.check_order(self.order)
        if not 1 <= self.rays <= 1 << 20:
            raise InputError(f"rays is {self.rays}: give 1 to 1048576 rays per receiver, such as 1024")
        if self.bounces != CONVERGED and not (isinstance(self.bounces, Integral) and 0 <= self.bounces <= 64):
            raise InputError(f"bounces is {self.bounces}: give 0 to 64, such as 2, or 'converged'")
        if not 0 <= self.seed < 1 << 64:
            raise InputError(f"seed is {self.seed}: give a non-negative integer")

    @staticmethod
    def of(
        quality: str = "good",
        *,
        order: int | None = None,
        rays: int | None = None,
        bounces: int | str | None = None,
        seed: int = 0,
    ) -> BakeSettings:
        """The preset `quality` ("draft", "good" or "best"), with what is given in its place."""
        if quality not in QUALITIES:
            raise InputError(f"quality '{quality}' is unknown: use one of {', '.join(QUALITIES)}")
        given = {"order": order, "rays": rays, "bounces": bounces}
        return BakeSettings(**(QUALITIES[quality] | {k: v for k, v in given.items() if v is not None}), seed=seed)

    @property
    def reflects(self) -> bool:
        """Whether any bounce is wanted."""
        return self.bounces != 0

    def as_dict(self) -> dict:
        """Plain values."""
        return asdict(self)
