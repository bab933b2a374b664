"""Hemisphere packets against the pure-Warp twin, and the law that no ray escapes a closed surface."""

import pytest
import torch

from diffprt import sh
from diffprt.kernels import TriangleMesh
from diffprt.kernels.hemispheres import HemisphereTracer, count_blocked
from diffprt.kernels.reference import trace_reference
from diffprt.scene import builtin_scene
from diffprt.surface.sampling import Pattern
from diffprt.surface.surfaces import Surfaces

ORDER = 5


def set_up(scene, rays: int):
    surfaces = Surfaces.of(scene)
    mesh = TriangleMesh(surfaces.positions, surfaces.faces)
    receivers = surfaces.receivers
    pattern = Pattern.create(rays, surfaces.scramble(receivers, 0))
    return mesh, receivers.origins(mesh.ray_offset()), receivers.normals, pattern


@pytest.mark.parametrize("rays", [1, 15, 16, 100, 256])
def test_packets_match_the_pure_warp_twin(bumpy, rays):
    mesh, origins, normals, pattern = set_up(bumpy, rays)
    tables = sh.recurrence_tables(ORDER, torch.float32)
    tracer = HemisphereTracer(mesh, origins, normals, pattern, ORDER, tables)
    sums, face, weights, blocked = tracer.trace(range(len(origins)), hits=True)
    twin_sums, twin_face, twin_weights = trace_reference(
        mesh.positions,
        mesh.faces,
        origins,
        normals,
        pattern.spiral,
        pattern.rotation,
        pattern.ring_shift,
        ORDER,
        tables,
        hits=True,
    )
    assert bool((face[:, rays:] == -1).all())
    face, weights = face[:, :rays], weights[:, :rays]
    assert rays == 1 or float((face >= 0).float().mean()) > 0.05
    same = face == twin_face
    assert float((~same).float().mean()) < 2e-3
    seen = same & (face >= 0)
    assert float((weights - twin_weights)[seen].abs().max()) < 1e-3
    agree = same.all(1)
    assert float(agree.float().mean()) > 0.6
    difference = (sums - twin_sums).abs().amax(dim=(0, 2))[agree]
    assert float(difference.quantile(0.98)) < 1e-4 * rays**0.5 and float(difference.max()) < 3
    # Any-hit and closest-hit traversal see the same rays blocked.
    any_sums, *_, any_blocked = tracer.trace(range(len(origins)), hits=False)
    assert torch.equal(blocked, any_blocked)
    assert torch.equal(sums, any_sums)
    assert torch.equal(count_blocked(mesh, origins, normals, pattern), blocked)


def test_no_hemisphere_ray_escapes_from_inside(bumpy):
    """From inside a closed surface every ray of every hemisphere is blocked."""
    mesh, _, _, _ = set_up(bumpy, 16)
    generator = torch.Generator().manual_seed(1)
    origins = 0.3 * torch.nn.functional.normalize(torch.randn(512, 3, generator=generator), dim=1)
    normals = torch.nn.functional.normalize(torch.randn(512, 3, generator=generator), dim=1)
    pattern = Pattern.create(2048, torch.randint(0, 1 << 32, (512,), generator=generator))
    assert bool((count_blocked(mesh, origins, normals, pattern) == 2048).all())


@pytest.mark.parametrize("name", ["closed_box", "sphere", "bunny"])
def test_a_million_rays_stay_inside(name, generator):
    """Hard case 25, from anywhere inside and towards vertices and edges, where cracks would be."""
    merged = builtin_scene(name, **({"subdivisions": 0} if name == "bunny" else {})).merged()
    mesh = TriangleMesh(merged.positions, merged.faces)
    center = merged.positions.mean(0)
    if name == "bunny":
        center = torch.tensor([-0.1, 0.6, 0.0])
    directions = torch.nn.functional.normalize(torch.randn(1_000_000, 3, generator=generator), dim=1)
    spread = 1e-3 * torch.randn(1_000_000, 3, generator=generator)
    _, face, _ = mesh.closest_hits(center + spread, directions)
    assert int((face < 0).sum()) == 0
    corners = merged.positions[merged.faces[torch.randint(len(merged.faces), (200_000,), generator=generator)]]
    share = torch.rand(200_000, 1, generator=generator).round(decimals=1)
    targets = torch.cat([corners[:, 0] + share * (corners[:, 1] - corners[:, 0]), merged.positions])
    hit = mesh.occluded(center.expand(len(targets), 3), targets - center)
    assert bool(hit.all())
