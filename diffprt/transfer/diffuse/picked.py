"""Some receivers of a scene, traced as a bake of all of them would be: hidden ones are filled as it fills them."""

from __future__ import annotations

from dataclasses import replace

import torch

from diffprt.kernels import TriangleMesh, run_chunks
from diffprt.surface.operator import StoredOperator
from diffprt.surface.receivers import Receivers
from diffprt.surface.sampling import Pattern
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.diffuse.direct import DirectTracer, direct_transfer
from diffprt.transfer.diffuse.inside import Fill


class PickedReceivers:
    """The scene's own receivers `pick`, with those that they are filled from.

    Args:
        surfaces: the scene.
        pick: int64 [S], ascending.
        fill: what a bake fills; None where it fills nothing.
        threads: CPU threads.

    Attributes:
        traced: how many hemispheres one trace takes.
        alike: int64 [S], one number for those that are filled with the same mean.
    """

    def __init__(self, surfaces: Surfaces, pick: torch.Tensor, fill: Fill | None, threads: int | None = None) -> None:
        self._surfaces, self._threads = surfaces, threads
        self._mesh = surfaces.mesh(threads)
        needed, self._means, self.alike = (pick, None, pick) if fill is None else fill.at(pick)
        receivers = some_receivers(surfaces.receivers, needed, self._mesh.ray_offset())
        self._sides = Sides.of(receivers)
        self._receivers = receivers if self._sides is None else self._sides.traced
        self.traced = len(self._receivers)

    def trace(
        self, rays: int, seed: int, order: int, *, reflected: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Transfer float64 [S, C, K] and its standard error [S, 1, K], both as `trace_some` finds them."""
        pattern = self._surfaces.pattern(self._receivers, rays, seed)
        transfer, error = trace_some(
            self._surfaces, self._mesh, self._receivers, pattern, order, reflected=reflected, threads=self._threads
        )
        if self._sides is not None:
            transfer, error = self._sides.combined(transfer), self._sides.combined_error(error)
        if self._means is not None:
            transfer, error = self._means.gather(transfer), self._means.gather(error)
        return transfer, error


def some_receivers(receivers: Receivers, pick: torch.Tensor, offset: float) -> Receivers:
    """The receivers `pick` int64 [S], without triangles, yet with rays that start where theirs do.

    Args:
        offset: as in `Receivers.origins`, which moves receivers on a border inwards.
    """
    positions = (receivers.origins(offset).double() - offset * receivers.normals.double()).float()
    return replace(receivers, positions=positions, albedo=receivers.albedo.detach()).picked(pick)


def reflected_light(surfaces: Surfaces, transfer: torch.Tensor) -> torch.Tensor:
    """Albedo times `transfer` [V, C, K] of the scene's own receivers; C is 1 where nothing is colored."""
    albedo = surfaces.receivers.albedo.detach()
    return (albedo if surfaces.colored else albedo[:, :1])[:, :, None] * transfer


def trace_some(
    surfaces: Surfaces,
    mesh: TriangleMesh,
    receivers: Receivers,
    pattern: Pattern,
    order: int,
    *,
    reflected: torch.Tensor | None = None,
    threads: int | None = None,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Transfer of `receivers`, whose last bounce gathers `reflected`; no operator is kept.

    Args:
        reflected: [V, C, K], see `reflected_light`; None for direct transfer.

    Returns:
        Transfer float64 [S, C, K], and the standard error of its direct part [S, 1, K] as of `direct_transfer`.
    """
    sources = len(surfaces.receivers)
    corners = None if reflected is None else surfaces.source_of_corner.numpy()
    tracer = DirectTracer(mesh, receivers, pattern, order, corners, sources)
    parts: dict[int, tuple] = {}

    def work(chunk: int) -> None:
        sums, blocked, rows = tracer.trace(chunk)
        gathered = None if rows is None else StoredOperator([rows], sources).gather(reflected)
        parts[chunk] = torch.from_numpy(sums), torch.from_numpy(blocked), gathered

    for _ in run_chunks(work, range(len(tracer.cut)), threads=threads):
        pass
    sums, blocked, gathered = zip(*(parts[chunk] for chunk in range(len(tracer.cut))), strict=True)
    direct, error = direct_transfer(receivers.normals, torch.cat(sums, dim=1), torch.cat(blocked), tracer.rays)
    transfer = direct.double() if reflected is None else direct.double() + torch.cat(gathered).double()
    return transfer, error.double()
