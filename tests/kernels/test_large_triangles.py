"""Triangles far larger than their distance: packets block the rays that single rays find blocked, and no others."""

import torch

from diffprt.kernels import TriangleMesh
from diffprt.kernels.hemispheres import count_blocked
from diffprt.scene import builtin_scene
from diffprt.surface.sampling import Pattern, hemisphere_directions
from diffprt.surface.surfaces import Surfaces


def test_where_a_wall_of_ten_thousand_ends(generator):
    """Rays beside its end share packets with rays that hit it."""
    surfaces = Surfaces.of(builtin_scene("wall_and_floor", subdivisions=1))
    mesh = TriangleMesh(surfaces.positions, surfaces.faces)
    receivers = surfaces.receivers
    ends = receivers.positions[:, 2].abs() == 1e4
    assert int(ends.sum()) > 20
    origins, normals = receivers.origins(mesh.ray_offset())[ends], receivers.normals[ends]
    pattern = Pattern.create(256, torch.randint(1 << 32, (len(origins),), generator=generator))
    packets = count_blocked(mesh, origins, normals, pattern).long()
    directions = hemisphere_directions(normals.double(), pattern).float()
    starts = origins[:, None].expand_as(directions).reshape(-1, 3).contiguous()
    single = mesh.occluded(starts, directions.reshape(-1, 3).contiguous()).reshape(len(origins), 256).sum(1)
    assert 0.1 < float(single.double().mean()) / 256 < 0.6
    # Rounding of directions may turn a ray or two at an edge.
    assert int((packets - single).abs().max()) <= 2
