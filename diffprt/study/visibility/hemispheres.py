"""A load for visibility contests: receivers of a scene and the same hemisphere rays for every contender."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.surface.sampling import Pattern, hemisphere_directions
from diffprt.surface.surfaces import Surfaces

# Receivers are drawn in runs of neighbors, as a bake traces them: single ones would take from every contender what
# near receivers share.
_RUN = 128


@dataclass(frozen=True)
class Hemispheres:
    """Cosine-distributed rays above the horizon of receivers.

    Attributes:
        origins: float32 [V, 3], where rays start, off the surface [scene units].
        normals: float32 [V, 3], unit.
        pattern: directions, one row per receiver; near directions stand together, which is packet order.
    """

    origins: torch.Tensor
    normals: torch.Tensor
    pattern: Pattern

    @staticmethod
    def drawn(surfaces: Surfaces, offset: float, rays: int, wanted: int, *, seed: int = 0) -> Hemispheres:
        """Random runs of receivers, about `wanted` rays in all.

        A scene with fewer gives every receiver, several times over with other directions each time.

        Args:
            offset: how far rays start above the surface [scene units].
            rays: per receiver.
        """
        receivers = surfaces.receivers
        runs = -(-len(receivers) // _RUN)
        some = max(1, min(runs, round(wanted / (rays * _RUN))))
        generator = torch.Generator().manual_seed(seed)
        first = torch.randperm(runs, generator=generator)[:some].sort().values * _RUN
        rows = (first[:, None] + torch.arange(_RUN)).flatten()
        rows = receivers.along_curve()[rows[rows < len(receivers)]]
        times = max(1, round(wanted / (rays * len(rows)))) if some == runs else 1
        scramble = torch.cat([surfaces.scramble(receivers, seed + again)[rows] for again in range(times)])
        # Origins come from all receivers: what moves them off a border is in their triangles.
        origins = receivers.origins(offset)[rows].repeat(times, 1)
        return Hemispheres(origins, receivers.normals[rows].repeat(times, 1), Pattern.create(rays, scramble))

    def __len__(self) -> int:
        return len(self.origins)

    @property
    def rays(self) -> int:
        """Rays per receiver."""
        return len(self.pattern.spiral)

    @property
    def total(self) -> int:
        """Rays of all receivers."""
        return len(self) * self.rays

    def part(self, wanted: int) -> Hemispheres:
        """The first receivers, about `wanted` rays in all."""
        return self.rows(slice(0, max(1, wanted // self.rays)))

    def rows(self, rows: slice) -> Hemispheres:
        """Some of the receivers."""
        pattern = Pattern(self.pattern.spiral, self.pattern.rotation[rows], self.pattern.ring_shift[rows])
        return Hemispheres(self.origins[rows], self.normals[rows], pattern)

    def directions(self) -> torch.Tensor:
        """All directions, float32 [V, D, 3], in packet order."""
        return hemisphere_directions(self.normals, self.pattern)
