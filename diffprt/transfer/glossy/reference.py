"""Plain-torch twins of glossy transfer: every ray against every triangle, the BRDF itself in place of its matrix."""

from __future__ import annotations

import math

import torch

from diffprt import sh
from diffprt.brdf import Brdf
from diffprt.sh.frames import tangent_frames
from diffprt.transfer.diffuse.reference import closest_hits


def visible(
    positions: torch.Tensor, faces: torch.Tensor, origins: torch.Tensor, directions: torch.Tensor
) -> torch.Tensor:
    """Whether nothing lies along each ray, bool [V, D]; origins [V, 3], directions [V, D, 3]."""
    rays = directions.shape[1]
    rows = [
        closest_hits(positions, faces, origin.expand(rays, 3), toward)[1] < 0
        for origin, toward in zip(origins, directions, strict=True)
    ]
    return torch.stack(rows)


def shadow_matrix_by_rays(shown: torch.Tensor, directions: torch.Tensor, order: int, solid: float) -> torch.Tensor:
    """Σ V y_i y_j over rays, [V, K, K]: eq. 1 of the 2005 thesis as it stands.

    Args:
        shown: bool [V, D].
        directions: [V, D, 3].
        solid: solid angle (times cosine, for cosine-distributed rays) of all directions together.
    """
    values = sh.basis(directions, order)
    return torch.einsum("vd,vdi,vdj->vij", shown.to(values), values, values) * (solid / directions.shape[1])


def radiance_by_rays(
    shown: torch.Tensor,
    directions: torch.Tensor,
    normals: torch.Tensor,
    brdf: Brdf,
    light: torch.Tensor,
    views: torch.Tensor,
) -> torch.Tensor:
    """Exit radiance [V, 3] without bounces, with the BRDF evaluated along every ray: no projection of any kind.

    Args:
        shown: bool [V, D].
        directions: [V, D, 3], cosine-distributed about `normals` [V, 3].
        light: coefficients [K, 3].
        views: unit [V, 3], scene axes, away from the surface.
    """
    frames = tangent_frames(normals)
    incoming = torch.einsum("vij,vdi->vdj", frames, directions)
    outgoing = torch.einsum("vij,vi->vj", frames, views)[:, None].expand_as(incoming)
    reflected = brdf.evaluate(incoming, outgoing) * sh.evaluate(light, directions) * shown[..., None]
    return math.pi * reflected.mean(1)
