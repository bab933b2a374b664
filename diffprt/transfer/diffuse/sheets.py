"""Interreflection among thin translucent sheets: see `diffprt.surface.sides`."""

from __future__ import annotations

from collections.abc import Callable

import torch

from diffprt.surface.operator import BounceOperator
from diffprt.surface.sides import Sides


class SheetOperator(BounceOperator):
    """The bounce operator of fronts, [V, sources], from that of all sides, [V + B, sources]."""

    def __init__(self, operator: BounceOperator, sides: Sides) -> None:
        self.receivers, self.sources, self.entries = sides.fronts, operator.sources, operator.entries
        self._operator, self._sides = operator, sides

    def product(self, dense: torch.Tensor) -> torch.Tensor:
        return self._sides.combined(self._operator.product(dense))

    def transposed(self) -> Callable[[torch.Tensor], torch.Tensor]:
        before = self._operator.transposed()
        return lambda dense: before(self._sides.spread(dense))
