"""A triangle mesh with Warp's bounding volume hierarchy, and ray queries against it."""

from __future__ import annotations

import torch
import warp as wp

from diffprt.kernels.launch import compile_kernels, default_threads, run_chunks, start

_RAYS_PER_LAUNCH = 1 << 16


class TriangleMesh:
    """Triangles to trace against; rays hit both sides.

    Args:
        positions: float32 [V, 3].
        faces: int [F, 3].
    """

    def __init__(self, positions: torch.Tensor, faces: torch.Tensor) -> None:
        start()
        self.positions = positions.detach().to("cpu", torch.float32).contiguous()
        self.faces = faces.detach().to("cpu", torch.int32).contiguous()
        self._mesh = wp.Mesh(
            points=wp.from_torch(self.positions, dtype=wp.vec3),
            indices=wp.from_torch(self.faces.reshape(-1), dtype=wp.int32),
            bvh_constructor="sah",
        )

    @property
    def id(self) -> wp.uint64:
        """The handle that kernels take."""
        return self._mesh.id

    def ray_offset(self) -> float:
        """How far rays start above their receiver [scene units].

        1e-5 of the box's diagonal, but at least 16 units in the last place of the largest coordinate, so
        that a mesh far from the origin does not shadow itself.
        """
        low, high = self.positions.amin(0), self.positions.amax(0)
        magnitude = float(torch.maximum(low.abs(), high.abs()).max())
        return 1e-5 * float((high - low).norm()) + 16 * 2.0**-23 * magnitude

    def closest_hits(
        self, origins: torch.Tensor, directions: torch.Tensor, *, threads: int | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """The first triangle along each ray.

        Args:
            origins, directions: float32 [D, 3]; directions unit.

        Returns:
            distance float32 [D] (infinite without a hit), face int32 [D] (-1 without a hit), and
            barycentric coordinates of the face's corners float32 [D, 3].
        """
        count = len(origins)
        distance = torch.full((count,), torch.inf)
        face = torch.full((count,), -1, dtype=torch.int32)
        weights = torch.zeros((count, 3))
        compile_kernels(closest_hit)
        arrays = [
            wp.from_torch(origins.to(torch.float32).contiguous(), dtype=wp.vec3),
            wp.from_torch(directions.to(torch.float32).contiguous(), dtype=wp.vec3),
        ]
        outputs = [wp.from_torch(distance), wp.from_torch(face), wp.from_torch(weights, dtype=wp.vec3)]

        def trace(first: int) -> None:
            wp.launch(
                closest_hit,
                min(_RAYS_PER_LAUNCH, count - first),
                inputs=[self.id, *arrays, first],
                outputs=outputs,
                device="cpu",
                record_tape=False,
            )

        for _ in run_chunks(trace, range(0, count, _RAYS_PER_LAUNCH), threads=threads or default_threads()):
            pass
        return distance, face, weights


@wp.kernel(enable_backward=False)
def closest_hit(
    mesh: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    first: int,
    distance: wp.array(dtype=wp.float32),
    face: wp.array(dtype=wp.int32),
    weights: wp.array(dtype=wp.vec3),
):
    ray = first + wp.tid()
    hit = wp.mesh_query_ray(mesh, origins[ray], directions[ray], 3.0e38)
    if hit.result:
        distance[ray] = hit.t
        face[ray] = hit.face
        weights[ray] = wp.vec3(hit.u, hit.v, 1.0 - hit.u - hit.v)
