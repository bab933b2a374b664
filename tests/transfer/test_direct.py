"""Direct transfer: analytic answers through the public `bake`, and the kernel against its twin."""

import math

import pytest
import torch
from tolerances import FLOAT32, FLOAT64

from diffprt import sh
from diffprt.kernels import TriangleMesh
from diffprt.scene import Scene, builtin_scene
from diffprt.sh.frames import tangent_frames
from diffprt.surface import Receivers, Surfaces
from diffprt.surface.sampling import Pattern, hemisphere_directions
from diffprt.transfer import bake
from diffprt.transfer.diffuse.direct import DirectTracer, direct_transfer, open_transfer
from diffprt.transfer.diffuse.reference import direct_transfer_and_gather


def nearest(positions: torch.Tensor, point: tuple) -> int:
    return int((positions - torch.tensor(point, dtype=torch.float32)).norm(dim=1).argmin())


@pytest.mark.parametrize("bounces", [0, 1])
def test_kernel_matches_the_twin(bumpy, bounces):
    surfaces = Surfaces.of(bumpy)
    mesh = TriangleMesh(surfaces.positions, surfaces.faces)
    every = surfaces.receivers
    some = Receivers(
        every.positions[::40], every.normals[::40], every.albedo[::40], torch.zeros((0, 3), dtype=torch.int64)
    )
    pattern = Pattern.create(128, surfaces.scramble(some, 3))
    corners = surfaces.source_of_corner.numpy() if bounces else None
    tracer = DirectTracer(mesh, some, pattern, 5, corners, len(every))
    sums, blocked, rows = tracer.trace_rows(range(len(some)))
    transfer, _ = direct_transfer(some.normals, torch.from_numpy(sums), torch.from_numpy(blocked), 128)
    twin, gather = direct_transfer_and_gather(
        surfaces.positions.double(),
        surfaces.faces,
        some.origins(mesh.ray_offset()).double(),
        some.normals.double(),
        pattern,
        5,
    )
    # A ray that grazes an edge may differ between float32 and float64: allow one such ray of 128 per receiver.
    off = (transfer[:, 0].double() - twin).abs().amax(1)
    assert float(off.median()) < FLOAT32["twin"]
    assert float((off > 1e-4).double().mean()) < 0.05
    assert float(off.max()) < 2 * math.pi / 128
    assert float((open_transfer(some.normals, 5)[:, 0] - twin[:, 0]).mean()) > 0.05
    if bounces:
        dense = torch.zeros(len(some), len(every), dtype=torch.float64)
        row = torch.repeat_interleave(torch.arange(len(some)), torch.from_numpy(rows.counts).long())
        dense[row, torch.from_numpy(rows.columns).long()] = torch.from_numpy(rows.values).double()
        difference = (dense - gather).abs().sum(1)
        assert float(difference.median()) < 1e-5
        assert float(difference.max()) < 4 / 128


def test_convex_object_is_exactly_unoccluded():
    """Hard case 1, and 26: a coarse sphere has no dark terminator."""
    transfer = bake(builtin_scene("sphere", subdivisions=1), order=7, rays=256, bounces=0)
    expected = open_transfer(transfer.receivers.normals, 7)
    assert torch.equal(transfer.diffuse[:, 0], expected.float())
    zonal = sh.clamped_cosine(7)
    assert zonal.tolist() == pytest.approx(
        [0.886227, 1.023327, 0.495416, 0, -0.110778, 0, 0.049927], abs=FLOAT32["rounding"]
    )


def test_infinite_wall_beside_a_floor():
    """Hard case 7."""
    transfer = bake(builtin_scene("wall_and_floor"), order=2, rays=16384, bounces=0)
    at = nearest(transfer.receivers.positions, (1, 0, 0))
    assert transfer.receivers.normals[at].tolist() == [0, 1, 0]
    t = transfer.diffuse[at, 0]
    # Polar axis +z: band 1 is (-y, z, -x). The opening is towards +x, the normal is +y.
    assert t.tolist() == pytest.approx([0.443113, -0.511663, 0.0, -0.325735], abs=5e-4)


@pytest.mark.parametrize("height", [1.2, 2.0, 4.0])
def test_sphere_over_a_receiver_blocks_the_squared_sine(height):
    """Hard case 8: a sphere of radius R centred at height h on the normal blocks (R/h)² of the cosine."""
    ball = builtin_scene("sphere", subdivisions=5)
    floor = Receivers.points(torch.tensor([[0.0, -height, 0.0]]), torch.tensor([[0.0, 1.0, 0.0]]))
    transfer = bake(ball, receivers=floor, order=1, rays=16384, bounces=0)
    seen = float(transfer.diffuse[0, 0, 0]) / float(sh.clamped_cosine(1)[0])
    assert seen == pytest.approx(1 - 1 / height**2, abs=2e-3)


def test_every_point_inside_a_bowl_sees_half_the_sky():
    """Hard case 6."""
    transfer = bake(builtin_scene("bowl", subdivisions=2), order=1, rays=4096, bounces=0)
    inside = transfer.receivers.positions[:, 1] < -0.05
    seen = transfer.diffuse[inside, 0, 0] / float(sh.clamped_cosine(1)[0])
    assert float(seen.mean()) == pytest.approx(0.5, abs=2e-3)
    assert float((seen - 0.5).abs().max()) < 0.02


def test_nothing_enters_a_closed_box():
    """Corners and edges included, where receivers lie exactly on other walls."""
    transfer = bake(builtin_scene("closed_box"), order=1, rays=512, bounces=0)
    assert float(transfer.diffuse.abs().max()) == 0.0
    dark = bake(builtin_scene("closed_box"), order=6, rays=64, bounces=3)
    assert float(dark.diffuse.abs().max()) == 0.0, "no noise at any order"


def test_flat_plane_sees_everything():
    """Hard case 26: grazing rays."""
    patch = builtin_scene("wall_and_floor").meshes[0]
    transfer = bake(Scene.from_mesh(patch.positions, patch.faces, patch.normals), order=4, rays=4096, bounces=0)
    assert torch.equal(transfer.diffuse[:, 0], open_transfer(transfer.receivers.normals, 4).float())


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_scale_changes_nothing(bumpy, scale):
    """Hard case 27."""
    here = bake(bumpy, order=4, rays=256, bounces=1)
    scaled = bake(bumpy.transformed(torch.diag(torch.tensor([scale, scale, scale, 1.0]))), order=4, rays=256, bounces=1)
    difference = (here.diffuse - scaled.diffuse).norm(dim=-1) / here.diffuse.norm(dim=-1).mean()
    # Rounding may flip single grazing rays and, rarely, a scramble.
    assert float(difference.median()) < 1e-5
    assert float(difference.max()) < 0.05


def test_offset_of_ten_thousand_sizes_is_bounded_and_deterministic(bumpy):
    """Hard case 27: positions lose 13 bits there, which moves surfaces by 1e-3 of the size."""
    matrix = torch.eye(4)
    matrix[0, 3] = 1e4 * bumpy.diagonal
    moved = bumpy.transformed(matrix)
    here = bake(bumpy, order=3, rays=256, bounces=0)
    there = bake(moved, order=3, rays=256, bounces=0)
    drift = (here.diffuse - there.diffuse).norm(dim=-1) / here.diffuse.norm(dim=-1).mean()
    assert float(drift.median()) < 0.05
    assert torch.equal(there.diffuse, bake(moved, order=3, rays=256, bounces=0).diffuse)


def test_seam_vertices_agree_and_vertex_order_survives():
    """Hard case 22: a mesh cut along seams has the same transfer on both sides."""
    whole = builtin_scene("bunny", subdivisions=0).meshes[0]
    corners = whole.faces.reshape(-1)
    cut = Scene.from_mesh(
        whole.positions[corners],
        torch.arange(len(corners)).reshape(-1, 3),
        whole.normals[corners],
        name="cut",
    )
    transfer = bake(cut, order=3, rays=64, bounces=1)
    assert torch.equal(transfer.receivers.positions, whole.positions[corners])
    reference = transfer.diffuse.new_zeros(len(whole.positions), 1, 9)
    reference[corners] = transfer.diffuse
    assert float((reference[corners] - transfer.diffuse).abs().max()) < FLOAT32["rounding"]
    together = bake(Scene.from_mesh(whole.positions, whole.faces, whole.normals), order=3, rays=64, bounces=1)
    assert float((together.diffuse[corners] - transfer.diffuse).abs().max()) < FLOAT32["twin"]


def test_noise_falls_at_least_like_the_root_of_the_rays(bumpy):
    """Hard case 29: from 64 to 4096 rays the error must fall at least 8 times; stratified rays do better."""
    truth = bake(bumpy, order=4, rays=65536, bounces=0, seed=9).diffuse
    errors = [
        float((bake(bumpy, order=4, rays=n, bounces=0).diffuse - truth).square().mean().sqrt()) for n in (64, 4096)
    ]
    assert errors[0] / errors[1] > 8


def test_the_stated_noise_bounds_the_error(bumpy):
    truth = bake(bumpy, order=4, rays=65536, bounces=0, seed=9)
    for rays in (64, 256, 1024):
        rough = bake(bumpy, order=4, rays=rays, bounces=0)
        error = float((rough.diffuse - truth.diffuse).square().sum(-1).mean().sqrt())
        assert 0.2 * rough.certificate["noise_rms"] < error < 1.1 * rough.certificate["noise_rms"]


def test_directions_are_cosine_distributed_and_turn_with_the_normal(generator):
    normals = torch.nn.functional.normalize(torch.randn(50, 3, generator=generator, dtype=torch.float64), dim=1)
    frames = tangent_frames(normals)
    identity = torch.eye(3, dtype=torch.float64).expand(50, 3, 3)
    assert torch.allclose(frames.transpose(1, 2) @ frames, identity, atol=FLOAT64["rounding"])
    assert torch.allclose(torch.linalg.det(frames), torch.ones(50, dtype=torch.float64), atol=FLOAT64["rounding"])
    pattern = Pattern.create(4096, torch.randint(0, 1 << 32, (50,), generator=generator))
    directions = hemisphere_directions(normals, pattern)
    cosine = torch.einsum("vdi,vi->vd", directions, normals)
    assert float(cosine.min()) > 0
    assert cosine.mean(1).tolist() == pytest.approx([2 / 3] * 50, abs=1e-3)
    assert torch.allclose(directions.mean(1), normals * 2 / 3, atol=5e-3)
