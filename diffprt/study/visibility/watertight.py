"""Whether rays escape from closed meshes, and whether the hierarchy finds what brute force finds."""

from __future__ import annotations

import math

import torch

from diffprt.kernels import TriangleMesh, run_chunks
from diffprt.kernels.hemispheres import count_blocked
from diffprt.study.visibility.brute_force import brute_force_hits, edge_clearance
from diffprt.surface.sampling import Pattern

# Rays start from this many points inside.
_POINTS = 128
# How near an edge a ray may be judged either way [diagonals of the mesh].
_EDGE = 1e-6


def winding_number(positions: torch.Tensor, faces: torch.Tensor, point: torch.Tensor) -> float:
    """How often the surface winds around `point` [3]: near 1 or -1 inside a closed mesh, 0 outside.

    The sum of the solid angles of all triangles (van Oosterom and Strackee 1983), in float64.
    """
    a, b, c = (positions.double()[faces.long()] - point.double()).unbind(1)
    la, lb, lc = (x.norm(dim=1) for x in (a, b, c))
    volume = (a * torch.linalg.cross(b, c)).sum(1)
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(torch.atan2(volume, below).sum() / (2 * math.pi))


def points_inside(mesh: TriangleMesh, count: int = _POINTS, *, seed: int = 0) -> torch.Tensor:
    """Points float32 [count, 3] inside a closed mesh, from a ten-thousandth to a tenth of the diagonal deep.

    The winding number decides, without any ray.
    """
    generator = torch.Generator().manual_seed(seed)
    positions, faces = mesh.positions, mesh.faces.long()
    diagonal = float((positions.amax(0) - positions.amin(0)).norm())
    inside: dict[int, torch.Tensor] = {}
    for start in range(0, 64 * count, count):
        corners = positions[faces[torch.randint(len(faces), (count,), generator=generator)]].double()
        normals = torch.nn.functional.normalize(
            torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), dim=1
        )
        # Closed rooms face inward: both sides are tried.
        side = torch.randint(2, (count, 1), generator=generator) * 2 - 1
        depth = 10 ** (-4 + 3 * torch.rand(count, 1, generator=generator, dtype=torch.float64)) * diagonal
        points = (corners.mean(1) + side * depth * normals).float()

        def judge(index: int, points: torch.Tensor = points, start: int = start) -> None:
            if abs(winding_number(positions, faces, points[index])) > 0.5:
                inside[start + index] = points[index]

        for _ in run_chunks(judge, range(count)):
            pass
        if len(inside) >= count:
            break
    # Threads end in any order: the order of drawing counts.
    return torch.stack([inside[key] for key in sorted(inside)[:count]])


def escaped_rays(mesh: TriangleMesh, origins: torch.Tensor, rays: int, *, seed: int = 0) -> dict:
    """Sends `rays` rays, four times, from points inside a closed mesh; every one must hit.

    Args:
        origins: float32 [V, 3], inside.

    Returns:
        Plain numbers: rays, and how many escaped from the packets of a bake, from any-hit and closest-hit
        queries in random directions, and from queries aimed at corners and at points on edges.
    """
    generator = torch.Generator().manual_seed(seed)
    each = -(-rays // len(origins))
    count = each * len(origins)
    normals = torch.nn.functional.normalize(torch.randn(len(origins), 3, generator=generator), dim=1)
    scramble = torch.randint(1 << 32, (len(origins),), generator=generator)
    packets = count_blocked(mesh, origins, normals, Pattern.create(each, scramble))
    starts = origins.repeat_interleave(each, dim=0)
    random = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=1)
    corners = mesh.positions[mesh.faces.long()]
    pairs = corners[torch.randint(len(corners), (count,), generator=generator)]
    share = torch.rand(count, 1, generator=generator) * (torch.arange(count) % 2)[:, None]
    targets = pairs[:, 0] * (1 - share) + pairs[:, 1] * share
    aimed = torch.nn.functional.normalize(targets - starts, dim=1)
    return {
        "origins": len(origins),
        "rays": count,
        "escaped_packets": count - int(packets.sum(dtype=torch.int64)),
        "escaped_any_hit": int((~mesh.occluded(starts, random)).sum()),
        "escaped_closest_hit": int((mesh.closest_hits(starts, random)[1] < 0).sum()),
        "escaped_aimed": int((~mesh.occluded(starts, aimed)).sum()),
        "escaped_aimed_closest_hit": int((mesh.closest_hits(starts, aimed)[1] < 0).sum()),
    }


def brute_force_agreement(mesh: TriangleMesh, rays: int, *, seed: int = 0) -> dict:
    """Random rays from the box around a mesh, against every triangle in float64.

    Returns:
        Plain numbers: rays, the share that hits, how many differ in whether they hit ("visibility") or in which
        face they hit first ("face"), any hit and closest hit; and how many of those are farther from every edge
        than 1e-6 diagonals, which is what counts ("unexcused").
    """
    generator = torch.Generator().manual_seed(seed)
    low, high = mesh.positions.amin(0), mesh.positions.amax(0)
    origins = low + (high - low) * torch.rand(rays, 3, generator=generator)
    directions = torch.nn.functional.normalize(torch.randn(rays, 3, generator=generator), dim=1)
    _, exact = brute_force_hits(mesh.positions, mesh.faces, origins, directions)
    _, face, _ = mesh.closest_hits(origins, directions)
    occluded = mesh.occluded(origins, directions)
    visibility = ((face >= 0) != (exact >= 0)) | (occluded != (exact >= 0))
    different = visibility | (face != exact)
    tolerance = _EDGE * float((high - low).norm())
    unexcused = [
        ray
        for ray in different.nonzero().flatten().tolist()
        if edge_clearance(mesh.positions, mesh.faces, origins[ray], directions[ray]) > tolerance
    ]
    return {
        "rays": rays,
        "hit_share": float((exact >= 0).double().mean()),
        "different_visibility": int(visibility.sum()),
        "different_face": int((face != exact).sum()),
        "unexcused_visibility": sum(bool(visibility[ray]) for ray in unexcused),
        "unexcused": len(unexcused),
    }
