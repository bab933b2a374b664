"""Ray queries against the brute-force twin and against Embree."""

import numpy as np
import pytest
import torch
from tolerances import FLOAT32

from diffprt.kernels import TriangleMesh, run_chunks
from diffprt.scene import builtin_scene
from diffprt.surface.sampling import Pattern, hemisphere_directions
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.diffuse.reference import closest_hits


def random_rays(mesh: TriangleMesh, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    low, high = mesh.positions.amin(0), mesh.positions.amax(0)
    origins = low + (high - low) * torch.rand(count, 3, generator=generator)
    return origins, torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=1)


def near_edge(weights: torch.Tensor, tolerance: float) -> torch.Tensor:
    return weights.amin(-1) < tolerance


def test_closest_hits_match_brute_force(bumpy, generator):
    merged = bumpy.merged()
    mesh = TriangleMesh(merged.positions, merged.faces)
    origins, directions = random_rays(mesh, 2000, generator)
    distance, face, weights = mesh.closest_hits(origins, directions)
    twin_distance, twin_face, twin_weights = closest_hits(
        merged.positions.double(), merged.faces, origins.double(), directions.double()
    )
    same = face == twin_face
    assert int((face >= 0).sum()) > 500
    assert bool((near_edge(twin_weights, 1e-4) | near_edge(weights, 1e-4))[~same].all())
    hit = same & (face >= 0)
    assert float((distance[hit] - twin_distance[hit]).abs().max()) < FLOAT32["twin"]
    points = (merged.positions[merged.faces[face[hit].long()]] * weights[hit][..., None]).sum(1)
    assert float((points - (origins + distance[:, None] * directions)[hit]).abs().max()) < FLOAT32["twin"]


def test_no_ray_escapes_a_closed_box(generator):
    merged = builtin_scene("closed_box").merged()
    mesh = TriangleMesh(merged.positions, merged.faces)
    origins, directions = random_rays(mesh, 200_000, generator)
    _, face, _ = mesh.closest_hits(origins * 0.999, directions)
    assert int((face < 0).sum()) == 0


@pytest.mark.parametrize("name", ["bunny", "bumpy"])
def test_visibility_agrees_with_embree(name, bumpy, peer):
    """The same directions give the same visibility for 99.99 % of rays; the rest pass within 1e-4 of an edge."""
    embree = peer("embreex.mesh_construction")
    embree_scene = peer("embreex.rtcore_scene")
    scene = bumpy if name == "bumpy" else builtin_scene("bunny", subdivisions=0)
    surfaces = Surfaces.of(scene)
    mesh = TriangleMesh(surfaces.positions, surfaces.faces)
    receivers, rays = surfaces.receivers, 256
    scramble = surfaces.scramble(receivers, 0)
    directions = hemisphere_directions(receivers.normals, Pattern.create(rays, scramble)).reshape(-1, 3)
    origins = receivers.origins(mesh.ray_offset()).repeat_interleave(rays, dim=0)
    _distance, face, _weights = mesh.closest_hits(origins, directions)
    peer_scene = embree_scene.EmbreeScene(robust=True)
    triangles = surfaces.positions[surfaces.faces].numpy()
    embree.TriangleMesh(peer_scene, triangles.astype(np.float32))
    peer_face = torch.from_numpy(peer_scene.run(origins.numpy(), directions.numpy()))
    assert len(face) > 100_000 and 0.02 < float((face >= 0).float().mean()) < 0.98
    different = (face >= 0) != (peer_face >= 0)
    assert float(different.float().mean()) < 1e-4
    for ray in different.nonzero().flatten().tolist():
        _, _, exact = closest_hits(
            surfaces.positions.double(),
            surfaces.faces,
            origins[ray : ray + 1].double(),
            directions[ray : ray + 1].double(),
        )
        clearance = edge_clearance(surfaces, origins[ray].double(), directions[ray].double())
        assert clearance < 1e-4 * surfaces.diagonal, (ray, exact, clearance)


def edge_clearance(surfaces: Surfaces, origin: torch.Tensor, direction: torch.Tensor) -> float:
    """Least distance between a ray and any edge of the mesh."""
    corners = surfaces.positions[surfaces.faces].double()
    a, b = corners.reshape(-1, 3), corners.roll(-1, dims=1).reshape(-1, 3)
    along = b - a
    offset = a - origin
    normal = torch.linalg.cross(along, direction.expand_as(along))
    square = normal.square().sum(1).clamp_min(1e-300)
    t = (torch.linalg.cross(direction.expand_as(offset), -offset) * normal).sum(1) / square
    points = a + t.clamp(0, 1)[:, None] * along - origin
    ahead = (points @ direction).clamp_min(0)
    return float((points - ahead[:, None] * direction).norm(dim=1).min())


def test_ray_offset_scales_with_size_and_with_distance_from_the_origin():
    merged = builtin_scene("sphere", subdivisions=2).merged()
    here = TriangleMesh(merged.positions, merged.faces).ray_offset()
    large = TriangleMesh(merged.positions * 1000, merged.faces).ray_offset()
    far = TriangleMesh(merged.positions + 1e4, merged.faces).ray_offset()
    assert large == pytest.approx(1000 * here, rel=FLOAT32["twin"])
    assert far > 8 * torch.finfo(torch.float32).eps * 1e4


def test_run_chunks_runs_each_chunk_once_and_passes_errors_on():
    assert sorted(run_chunks(lambda chunk: None, range(17), threads=4)) == list(range(17))
    begun = []

    def fail(chunk: int) -> None:
        begun.append(chunk)
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        list(run_chunks(fail, range(1000), threads=2))
    assert len(begun) < 10
