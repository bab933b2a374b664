"""References ready to be trained on: views frozen, batches drawn, errors of what was held out."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch

from diffprt import sh
from diffprt.optimization.losses import IMAGE_LOSSES
from diffprt.optimization.own_loss import OwnLoss
from diffprt.optimization.references.references import References
from diffprt.rendering import FrozenView, auto_exposure, pixel_radiance

# Bands that no light has still count a little: components could not be told apart there.
_LEAST_PRIOR = 1e-4
_COVERED = 1 - 1e-6
_SEEDS = (1 << 63) - 1


class Pictures:
    """What is trained on, and what is held out.

    Args:
        references: of the asset.
        views: frozen view of each.
        held_out: share of them that is held out.
        by_camera: hold out cameras rather than lights, where lights themselves are trained.
        seed: of batches and of what is held out.

    Attributes:
        trained, held: indices of references; the same where nothing can be held out.
        distinct_lights: float32 [L, K, 3].
    """

    def __init__(
        self,
        references: References,
        views: list[FrozenView],
        *,
        held_out: float,
        by_camera: bool = False,
        seed: int = 0,
    ) -> None:
        self.views, self.seed = views, seed
        # Pixels that the border crosses depend on how samples fall, and on silhouettes, which have no gradient.
        self.inside = [view.coverage > _COVERED for view in views]
        self.pixels = [entry.image[inside] for entry, inside in zip(references, self.inside, strict=True)]
        self.entries = references.entries
        lights: dict[bytes, int] = {}
        self.light_of = [lights.setdefault(light.numpy().tobytes(), len(lights)) for light in references.lights]
        first = [self.light_of.index(i) for i in range(len(lights))]
        self.distinct_lights = torch.stack([references.lights[i] for i in first])
        self.trained, held = references.split(held_out, seed, by_camera=by_camera)
        self.held = held or self.trained
        self._exposures = [auto_exposure(e.image, inside) for e, inside in zip(references, self.inside, strict=True)]

    def prior(self) -> torch.Tensor:
        """Mean square of each light coefficient in the pictures trained on, float64 [K] with mean 1.

        As `light_prior` for lights that may come from anywhere, with each light scaled to a picture of unit energy
        instead of to unit power: errors are relative to pictures, and a light of little constant part, which leaves a
        scene dark, counts more.
        """
        order = sh.order_of_count(len(self.entries[0].light))
        band = sh.band_of_index(order)
        power = torch.zeros(order, dtype=torch.float64)
        for index in self.trained:
            square = self.entries[index].light.double().square().mean(1)
            power.index_add_(0, band, square / self.pixels[index].double().square().mean())
        prior = (power / torch.bincount(band, minlength=order))[band]
        return (prior / prior.mean()).clamp_min(_LEAST_PRIOR)

    def radiance(self, asset, index: int, exposure, lights: torch.Tensor | None) -> torch.Tensor:
        """The asset's pixels [N, 3] that count in reference `index`."""
        light = self.entries[index].light if lights is None else lights[self.light_of[index]]
        view = self.views[index]
        return exposure * pixel_radiance(asset, light, view)[self.inside[index][view.mask]]

    def batch(self, step: int, size: int) -> list[int]:
        """Which references step number `step` sees: every one once in each round, in an order of its own."""
        size = min(size, len(self.trained))
        picked = []
        for position in range(step * size, (step + 1) * size):
            turn, place = divmod(position, len(self.trained))
            generator = torch.Generator().manual_seed((self.seed * 1_000_003 + turn) & _SEEDS)
            order = torch.randperm(len(self.trained), generator=generator)
            picked.append(self.trained[int(order[place])])
        return picked

    def loss(
        self,
        asset,
        step: int,
        size: int,
        terms: dict[str, float],
        own: Mapping[str, OwnLoss] | None = None,
        *,
        exposure: torch.Tensor | float = 1.0,
        lights: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Weighted sum of image losses over a batch, a scalar; gradients reach asset, exposure and lights.

        Args:
            terms: weights by name; those that are not of pictures are left out.
            own: losses beside `IMAGE_LOSSES`.
        """
        picked, losses = self.batch(step, size), {**IMAGE_LOSSES, **(own or {})}
        total = torch.zeros(())
        for index in picked:
            inside = self.inside[index]
            image = _framed(self.radiance(asset, index, exposure, lights), inside)
            reference = _framed(self.pixels[index], inside)
            for name, weight in terms.items():
                if name in losses:
                    value = losses[name](image, reference, inside, self._exposures[index])
                    total = total + weight * value / len(picked)
        return total

    def marks(self, own: Mapping[str, OwnLoss]) -> dict[str, str]:
        """What tells losses of the user's own from others of their names, by name: see `OwnLoss.mark`."""
        index = self.trained[0]
        picture = _framed(self.pixels[index], self.inside[index])
        return {name: loss.mark(picture, self.inside[index], self._exposures[index]) for name, loss in own.items()}

    def error(self, asset, *, exposure: torch.Tensor | float = 1.0, lights: torch.Tensor | None = None) -> float:
        """Relative RMSE of the held-out pictures: the root of the mean over them of squared error over energy."""
        shares = []
        for index in self.held:
            difference = self.radiance(asset, index, exposure, lights) - self.pixels[index]
            shares.append(float(difference.double().square().sum() / self.pixels[index].double().square().sum()))
        return math.sqrt(sum(shares) / len(shares))


def _framed(pixels: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    """Pixels [N, 3] in their picture [H, W, 3], 0 elsewhere; gradients reach them."""
    return pixels.new_zeros(*inside.shape, 3).index_put((inside,), pixels)
