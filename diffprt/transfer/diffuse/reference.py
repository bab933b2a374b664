"""Plain-torch twins of the transfer kernels: readable, slow, exact; used by tests and in float64."""

from __future__ import annotations

import math

import torch

from diffprt import sh
from diffprt.surface.sampling import Pattern, hemisphere_directions
from diffprt.transfer.diffuse.direct import open_transfer


def closest_hits(
    positions: torch.Tensor, faces: torch.Tensor, origins: torch.Tensor, directions: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """First hits by testing every triangle (Moller and Trumbore 1997), both sides.

    Args:
        positions: [V, 3].
        faces: int64 [F, 3].
        origins, directions: [D, 3].

    Returns:
        distance [D] (infinite without a hit), face int64 [D] (-1 without a hit), barycentrics [D, 3].
    """
    a, b, c = positions[faces].unbind(1)
    edge1, edge2 = b - a, c - a
    p = torch.linalg.cross(directions[:, None], edge2[None])
    determinant = (edge1 * p).sum(-1)
    inverse = torch.where(determinant == 0, torch.inf, 1.0 / determinant)
    t = origins[:, None] - a
    u = (t * p).sum(-1) * inverse
    q = torch.linalg.cross(t, edge1[None].expand_as(t))
    v = (directions[:, None] * q).sum(-1) * inverse
    distance = (edge2 * q).sum(-1) * inverse
    inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0) & torch.isfinite(inverse)
    distance = torch.where(inside, distance, torch.inf)
    nearest, face = distance.min(dim=1)
    rows = torch.arange(len(origins))
    weights = torch.stack([1 - u[rows, face] - v[rows, face], u[rows, face], v[rows, face]], dim=-1)
    missed = torch.isinf(nearest)
    return nearest, face.masked_fill(missed, -1), weights.masked_fill(missed[:, None], 0.0)


def direct_transfer_and_gather(
    positions: torch.Tensor,
    faces: torch.Tensor,
    origins: torch.Tensor,
    normals: torch.Tensor,
    pattern: Pattern,
    order: int,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Direct transfer [V, K] and the dense bounce operator [V, N] over all N vertices, ray by ray."""
    directions = hemisphere_directions(normals, pattern)
    rays = directions.shape[1]
    transfer = open_transfer(normals, order).to(positions.dtype)
    gather = torch.zeros(len(origins), len(positions), dtype=positions.dtype)
    face_normals = torch.linalg.cross(
        positions[faces[:, 1]] - positions[faces[:, 0]], positions[faces[:, 2]] - positions[faces[:, 0]]
    )
    for v in range(len(origins)):
        origin = origins[v].expand(rays, 3)
        _, face, weights = closest_hits(positions, faces, origin, directions[v])
        blocked = face >= 0
        if 2 * int(blocked.sum()) > rays:
            transfer[v] = math.pi / rays * sh.basis(directions[v][~blocked], order).sum(0)
        else:
            transfer[v] -= math.pi / rays * sh.basis(directions[v][blocked], order).sum(0)
        front = blocked & ((face_normals[face.clamp_min(0)] * directions[v]).sum(-1) < 0)
        gather[v].index_add_(0, faces[face[front]].flatten(), weights[front].flatten() / rays)
    return transfer, gather
