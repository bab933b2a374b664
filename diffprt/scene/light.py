"""Distant light as spherical harmonic coefficients."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from diffprt import sh
from diffprt.errors import InputError


@dataclass(frozen=True)
class Light:
    """Distant incident radiance, projected to spherical harmonics (conventions: `diffprt.sh`).

    Attributes:
        coefficients: float [K, 3], K = order², RGB radiance [W/m²/sr]. May carry gradients.
        report: what projection and windowing cost (plain numbers), for `--json` reports.
    """

    coefficients: torch.Tensor
    report: dict = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        shape = tuple(self.coefficients.shape)
        if len(shape) != 2 or shape[1] != 3:
            raise InputError(f"light coefficients have shape {shape}: give [order², 3]")
        sh.order_of_count(shape[0])

    @property
    def order(self) -> int:
        """Number of bands n; K = n²."""
        return sh.order_of_count(self.coefficients.shape[0])

    def rotate(self, rotation: torch.Tensor) -> Light:
        """The light turned by `rotation` [3, 3]: L'(d) = L(Rᵀ d). Gradients reach both."""
        return Light(sh.rotate(self.coefficients, rotation), self.report)

    def seen(self) -> Light:
        """The light as it is drawn behind an object: through a Hann window where it is a map's projection without a
        window, whose ringing would show as dark rims around what is bright; else as it is."""
        if "environment" not in self.report or self.report.get("window") != "none":
            return self
        factors = sh.window("hann", self.order)[sh.band_of_index(self.order)].to(self.coefficients)
        return Light(self.coefficients * factors[:, None], self.report | {"window": "hann"})

    def to(self, target: torch.device | torch.dtype | str) -> Light:
        """The light on another device, or in another floating dtype."""
        return Light(self.coefficients.to(target), self.report)

    def radiance(self, directions: torch.Tensor) -> torch.Tensor:
        """Band-limited radiance [..., 3] towards unit `directions` [..., 3]."""
        return sh.evaluate(self.coefficients, directions)
