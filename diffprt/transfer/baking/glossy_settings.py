"""Options of a glossy bake, checked before any work."""

from __future__ import annotations

from dataclasses import dataclass

from diffprt import sh
from diffprt.errors import InputError
from diffprt.transfer.baking.settings import BakeSettings


@dataclass(frozen=True)
class GlossySettings(BakeSettings):
    """What a glossy bake does; saved in the asset.

    Attributes:
        order_out: SH bands of exit radiance, 1 to 10; `order` where None is given.
        bounce_rays: rays per receiver that gather each bounce; where None is given, a quarter of `rays`, but at
            least 256.
        ridge: smoothing of exit radiance below the surface; see `diffprt.brdf.fit`.

    Raises:
        InputError: an option is out of range.
    """

    order_out: int | None = None
    bounce_rays: int | None = None
    ridge: float = 3e-4

    def __post_init__(self) -> None:
        if isinstance(self.bounces, str):
            raise InputError(f"bounces is '{self.bounces}': glossy transfer takes a number, 0 to 64, such as 2")
        super().__post_init__()
        object.__setattr__(self, "order_out", sh.check_order(self.order if self.order_out is None else self.order_out))
        if self.bounce_rays is None:
            object.__setattr__(self, "bounce_rays", max(256, self.rays // 4))
        if not 1 <= self.bounce_rays <= 1 << 20:
            raise InputError(f"bounce_rays is {self.bounce_rays}: give 1 to 1048576 rays per receiver, such as 256")
        if not self.ridge >= 0:
            raise InputError(f"ridge is {self.ridge}: give 0 or more")
