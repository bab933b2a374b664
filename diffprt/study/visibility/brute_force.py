"""Every ray against every triangle, in float64 (Moller and Trumbore 1997): what a hierarchy is held against.

The twin `diffprt.transfer.diffuse.reference.closest_hits` does the same in torch, a hundred times slower.
"""

from __future__ import annotations

import torch
import warp as wp

from diffprt.kernels import compile_kernels, run_chunks

_RAYS_PER_LAUNCH = 256


def brute_force_hits(
    positions: torch.Tensor, faces: torch.Tensor, origins: torch.Tensor, directions: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """First hits, both sides of a triangle.

    Args:
        positions: [V, 3], scene units.
        faces: int [F, 3].
        origins, directions: [D, 3].

    Returns:
        distance float64 [D] in lengths of the direction (infinite without a hit), face int32 [D] (-1 without one).
    """
    compile_kernels(nearest_of_all)
    a, b, c = (x.contiguous() for x in positions.double()[faces.long()].unbind(1))
    held = [a, (b - a).contiguous(), (c - a).contiguous(), *(t.double().contiguous() for t in (origins, directions))]
    count = len(origins)
    distance = torch.full((count,), torch.inf, dtype=torch.float64)
    face = torch.full((count,), -1, dtype=torch.int32)
    inputs = [wp.from_torch(t, dtype=wp.vec3d) for t in held]
    outputs = [wp.from_torch(distance), wp.from_torch(face)]

    def work(first: int) -> None:
        size = min(_RAYS_PER_LAUNCH, count - first)
        wp.launch(nearest_of_all, size, inputs=[*inputs, first], outputs=outputs, device="cpu", record_tape=False)

    for _ in run_chunks(work, range(0, count, _RAYS_PER_LAUNCH)):
        pass
    return distance, face


def edge_clearance(
    positions: torch.Tensor, faces: torch.Tensor, origin: torch.Tensor, direction: torch.Tensor
) -> float:
    """Least distance between a ray and any edge, scene units, in float64; origin and direction [3]."""
    corners = positions.double()[faces.long()]
    origin, direction = origin.double(), torch.nn.functional.normalize(direction.double(), dim=0)
    first = corners.reshape(-1, 3)
    along = corners.roll(-1, dims=1).reshape(-1, 3) - first
    offset = first - origin
    # The point of the edge nearest to the line: the edge's part across the ray, against its start's.
    across = along - (along @ direction)[:, None] * direction
    start = offset - (offset @ direction)[:, None] * direction
    share = -(start * across).sum(1) / across.square().sum(1).clamp_min(1e-300)
    nearest = offset + share.clamp(0, 1)[:, None] * along
    ahead = (nearest @ direction).clamp_min(0)
    return float((nearest - ahead[:, None] * direction).norm(dim=1).min())


@wp.kernel(enable_backward=False)
def nearest_of_all(
    corners: wp.array(dtype=wp.vec3d),
    edges1: wp.array(dtype=wp.vec3d),
    edges2: wp.array(dtype=wp.vec3d),
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    first: int,
    distance: wp.array(dtype=wp.float64),
    face: wp.array(dtype=wp.int32),
):
    """One ray per thread; `distance` and `face` start as a miss."""
    ray = first + wp.tid()
    o = origins[ray]
    d = directions[ray]
    zero = wp.float64(0.0)
    nearest = distance[ray]
    found = face[ray]
    for f in range(corners.shape[0]):
        p = wp.cross(d, edges2[f])
        determinant = wp.dot(edges1[f], p)
        t = o - corners[f]
        # Times the determinant's sign, so that no quotient is needed to leave.
        u = wp.dot(t, p) * wp.sign(determinant)
        if u >= zero and u <= wp.abs(determinant) and determinant != zero:
            q = wp.cross(t, edges1[f])
            v = wp.dot(d, q) * wp.sign(determinant)
            if v >= zero and u + v <= wp.abs(determinant):
                at = wp.dot(edges2[f], q) / determinant
                if at > zero and at < nearest:
                    nearest = at
                    found = f
    if found >= 0:
        distance[ray] = nearest
        face[ray] = found
