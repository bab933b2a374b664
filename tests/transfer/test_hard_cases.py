"""Hard geometry through the public `bake`: what is repaired, what is refused, and what stays exact.

Flat planes and coarse spheres (26), scales (27), noise and thread counts (29) and killed bakes (30) are also in
`test_direct` and `test_process`; here are the cases that need a mesh of their own.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
from tolerances import FLOAT32

from diffprt import sh
from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh
from diffprt.scene import Material, Mesh, Scene, builtin_scene
from diffprt.scene.resolution import offset_remark
from diffprt.surface import Receivers
from diffprt.transfer import bake
from diffprt.transfer.diffuse.direct import open_transfer

OPTIONS = {"order": 3, "rays": 256, "bounces": 1}
OPEN = float(sh.clamped_cosine(1)[0])


def grid(corner: tuple, along: tuple, across: tuple, cells: int) -> tuple[torch.Tensor, torch.Tensor]:
    """A square of cells² quads over the edges `along` and `across`, which faces along x across."""
    corner, along, across = (torch.tensor(x, dtype=torch.float64) for x in (corner, along, across))
    a, b = torch.meshgrid(*[torch.linspace(0, 1, cells + 1, dtype=torch.float64)] * 2, indexing="ij")
    positions = corner + a.reshape(-1, 1) * along + b.reshape(-1, 1) * across
    i, n = (torch.arange(cells)[:, None] * (cells + 1) + torch.arange(cells)).reshape(-1), cells + 1
    return positions, torch.cat([torch.stack([i, i + n, i + 1], 1), torch.stack([i + 1, i + n, i + n + 1], 1)])


def soup(count: int = 2000) -> Scene:
    """Unconnected triangles through each other, every which way."""
    draw = np.random.default_rng(0)
    corners = draw.uniform(-1, 1, (count, 1, 3)) + 0.3 * draw.standard_normal((count, 3, 3))
    return Scene.from_mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), name="soup")


def relative_drift(one: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    return (one - other).norm(dim=-1).amax(1) / one.norm(dim=-1).mean()


@pytest.mark.parametrize("share", [1.0, 0.1, 0.9])
def test_wrong_winding_is_repaired_reported_and_changes_nothing(bumpy, share):
    """Hard case 24."""
    mesh = bumpy.meshes[0]
    turned = torch.rand(len(mesh.faces), generator=torch.Generator().manual_seed(4)) < share
    faces = torch.where(turned[:, None], mesh.faces.flip(1), mesh.faces)
    scene = Scene.from_mesh(mesh.positions, faces, albedo=(0.7, 0.5, 0.3))
    assert scene.defects.flipped_faces == int(turned.sum())
    assert any("flipped faces" in line for line in scene.defects.lines())
    drift = relative_drift(bake(bumpy, **OPTIONS).diffuse, bake(scene, **OPTIONS).diffuse)
    # Normals are summed in another order; single grazing rays may fall to the other side.
    assert float(drift.median()) < FLOAT32["twin"] and float(drift.max()) < 0.05


def test_inside_out_geometry_that_is_kept_is_black_and_reported():
    """Hard case 24: `winding="keep"` takes the winding at its word, and says so."""
    ball = builtin_scene("sphere", subdivisions=2).meshes[0]
    scene = Scene.from_mesh(ball.positions, ball.faces.flip(1), winding="keep")
    assert float(bake(scene, **OPTIONS).diffuse.abs().max()) == 0
    assert any("inward components: kept, as asked" in line for line in scene.defects.lines())


def test_duplicate_faces_change_nothing(bumpy):
    """Hard case 25: the same faces twice, and a second skin with vertices of its own on the first."""
    mesh = bumpy.meshes[0]
    here = bake(bumpy, **OPTIONS)
    twice = Scene.from_mesh(mesh.positions, torch.cat([mesh.faces, mesh.faces[::3]]), albedo=(0.7, 0.5, 0.3))
    assert twice.defects.duplicate_faces == len(mesh.faces[::3])
    assert torch.equal(bake(twice, **OPTIONS).diffuse, here.diffuse)
    skins = bake(Scene((mesh, mesh), bumpy.materials), **OPTIONS).diffuse
    count = len(mesh.positions)
    assert torch.equal(skins[:count], skins[count:])
    assert float((skins[:count] - here.diffuse).abs().max()) < FLOAT32["twin"]


def test_no_ray_leaves_a_closed_box_with_t_junctions():
    """Hard case 25: walls of 1 to 8 cells meet in a room; more than a million rays, from anywhere inside."""
    x, y, z = (2, 0, 0), (0, 2, 0), (0, 0, 2)
    walls = [
        grid((-1, -1, -1), z, x, 1),
        grid((-1, 1, -1), x, z, 2),
        grid((-1, -1, -1), x, y, 3),
        grid((-1, -1, 1), y, x, 5),
        grid((-1, -1, -1), y, z, 8),
        grid((1, -1, -1), z, y, 7),
    ]
    room = Scene(tuple(Mesh.create(*wall) for wall in walls), (Material(0.5),))
    generator = torch.Generator().manual_seed(5)
    inside = 0.999 * (2 * torch.rand(1000, 3, generator=generator) - 1)
    receivers = Receivers.points(inside, torch.randn(1000, 3, generator=generator))
    report: dict = {}
    transfer = bake(room, receivers=receivers, order=1, rays=1024, bounces=0, report=report)
    assert report["counts"]["rays"] > 1_000_000
    assert float(transfer.diffuse.abs().max()) == 0
    assert float(bake(room, order=1, rays=256, bounces=0).diffuse.abs().max()) == 0, "from its own vertices too"


@pytest.mark.parametrize("turn", [0.1, 0.7, 1.3])
def test_tilted_planes_and_coarse_balls_see_everything_at_grazing_angles(turn):
    """Hard case 26: off the axes, where coordinates round. 4096 rays reach 89.1 degrees; none may meet the plane."""
    c, s = np.cos(turn), np.sin(turn)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    plane = Scene.from_mesh(*grid((-1, 0, -1), (0, 0, 2), (2, 0, 0), 12)).transformed(matrix)
    ball = builtin_scene("sphere", subdivisions=1).transformed(matrix)
    for scene in (plane, ball):
        transfer = bake(scene, order=4, rays=4096, bounces=0)
        assert torch.equal(transfer.diffuse[:, 0], open_transfer(transfer.receivers.normals, 4).float())


def test_far_from_the_origin_drift_is_bounded_and_reported(bumpy):
    """Hard case 27: at 10⁴ sizes, 32-bit coordinates keep 1e-3 of the size and rays start 2 % above the surface."""
    mesh = bumpy.meshes[0]
    offset = torch.tensor([1e4 * bumpy.diagonal, 0.0, 0.0], dtype=torch.float64)
    far = Scene.from_mesh(mesh.positions.double() + offset, mesh.faces, albedo=(0.7, 0.5, 0.3), name="far")
    (line,) = (line for line in far.defects.lines() if "rays start" in line)
    assert re.search(r"'far' is 3.\d+ large with coordinates up to 3\d{4}\.\d, .* \(1.9 % of its size\): move it", line)
    here, there = (bake(scene, order=3, rays=256, bounces=0) for scene in (bumpy, far))
    drift = relative_drift(here.diffuse, there.diffuse)
    assert float(drift.median()) < 0.05 and float(drift.max()) < 0.5
    back = Scene.from_mesh(
        mesh.positions.double() + offset, mesh.faces, albedo=(0.7, 0.5, 0.3), name="far", recenter=True
    )
    assert [line[:8] for line in back.defects.lines()] == ["moved by"]
    moved = relative_drift(here.diffuse, bake(back, order=3, rays=256, bounces=0).diffuse)
    assert float(moved.median()) < 0.01, "only the pattern of rays may differ"


def test_coordinates_of_a_million_with_features_of_a_thousandth_are_refused():
    """32-bit steps are 0.06 there: where the features are all there is, and where they cover a plain."""
    ball = builtin_scene("sphere", subdivisions=2).meshes[0]
    small = ball.positions.double() * 1e-3
    far = small + torch.tensor([1e6, 0.0, 0.0])
    with pytest.raises(InputError, match=r"up to 1e\+06, where 32-bit steps are 0.0625, .*320 of 320 .*: move it to"):
        Scene.from_mesh(far, ball.faces, name="pebble")
    plain = torch.tensor([[1e6, 0.0, 0.0], [1e6 + 500, 0.0, 0.0], [1e6, 0.0, 500.0]], dtype=torch.float64)
    with pytest.raises(InputError, match="320 of 321 faces are lost"):
        Scene.from_mesh(torch.cat([far, plain]), torch.cat([ball.faces, torch.tensor([[162, 164, 163]])]))
    # Without checks of a loader, bake itself refuses.
    matrix = np.eye(4)
    matrix[:3, 3] = 1e6
    with pytest.raises(
        InputError, match=r"'mesh' is 3.46 large .* 32-bit steps are up to 0.119 .* move it to the origin"
    ):
        bake(Scene.from_mesh(ball.positions, ball.faces).transformed(matrix), **OPTIONS)
    here = bake(Scene.from_mesh(far, ball.faces, ball.normals, recenter=True), **OPTIONS)
    assert torch.equal(here.diffuse, bake(Scene.from_mesh(small, ball.faces, ball.normals), **OPTIONS).diffuse)


def test_the_remark_knows_where_rays_start(bumpy):
    """`scene` states the height that `kernels` uses, since it stands before that room."""
    matrix = torch.eye(4)
    matrix[1, 3] = 1e4
    far = bumpy.transformed(matrix).merged()
    low, high = far.positions.amin(0).numpy(), far.positions.amax(0).numpy()
    stated = float(re.search(r"rays start ([\d.e-]+) above", offset_remark(low, high, "far"))[1])
    assert stated == pytest.approx(TriangleMesh(far.positions, far.faces).ray_offset(), rel=0.02)


def test_a_soup_of_crossing_triangles_is_baked_the_same_for_any_thread_count():
    """Hard cases 28 and 29."""
    scene = soup()
    assert scene.defects.components == 2000 and not scene.defects.watertight
    one, three = (bake(scene, order=3, rays=96, bounces=1, threads=n) for n in (1, 3))
    assert torch.equal(one.diffuse, three.diffuse) and one.certificate == three.certificate
    assert bool(torch.isfinite(one.diffuse).all())
    assert float(one.openness.min()) == 0 and 0.05 < float(one.openness.mean()) < 0.5
    assert float(one.diffuse[:, :, 0].max()) <= OPEN * (1 + 1e-6), "reflection never exceeds an open sky"


def test_three_sheets_on_one_edge():
    """Hard case 28: an edge of four faces. The floor beside a long wall sees half the sky, as in case 7."""
    floor, faces = grid((-50, 0, -50), (0, 0, 100), (100, 0, 0), 50)
    wall, wall_faces = grid((0, 0, -50), (0, 100, 0), (0, 0, 100), 50)
    positions, index = torch.unique(torch.cat([floor, wall]), dim=0, return_inverse=True)
    scene = Scene.from_mesh(positions, index[torch.cat([faces, wall_faces + len(floor)])], winding="keep")
    assert scene.defects.non_manifold_edges == 50
    p = positions
    normals = torch.where(p[:, 1:2] > 0, torch.tensor([1.0, 0.0, 0.0]), torch.tensor([0.0, 1.0, 0.0]))
    mesh = scene.meshes[0]
    scene = Scene.from_mesh(p, mesh.faces, normals, winding="keep")
    transfer = bake(scene, order=1, rays=1024, bounces=0)
    beside = (p[:, 0].abs() == 2) & (p[:, 1] == 0) & (p[:, 2].abs() < 20)
    assert int(beside.sum()) == 38
    # From 2 away the wall ends after 30 at the nearest, so that up to 2 % more is seen.
    assert float((transfer.diffuse[beside, 0, 0] / OPEN - 0.5).abs().max()) < 0.025
    assert torch.equal(transfer.diffuse, bake(scene, order=1, rays=1024, bounces=0, threads=3).diffuse)


def test_open_sheets_block_from_both_sides_and_reflect_on_one():
    """Hard case 28: between two large sheets that face up, the lower sees the black back of the upper."""
    low, high = (Mesh.create(*grid((-50, y, -50), (0, 0, 100), (100, 0, 0), 20)) for y in (0, 1))
    transfer = bake(Scene((low, high), (Material(1.0),)), order=1, rays=512, bounces=2)
    middle = transfer.receivers.positions[:, [0, 2]].abs().amax(1) < 10
    lower, upper = transfer.diffuse[:441, 0, 0], transfer.diffuse[441:, 0, 0]
    assert float(lower[middle[:441]].max()) < 0.01 * OPEN
    assert torch.allclose(upper, torch.tensor(OPEN)), "nothing above it"


def test_a_vertex_exactly_on_an_occluder():
    """Hard case 28: a wall on a floor that is not split there stands on its front, and sees half the sky."""
    floor = Mesh.create(*grid((-64, 0, -64), (0, 0, 128), (128, 0, 0), 2))
    wall = Mesh.create(*grid((3, 0, -5), (0, 10, 0), (0, 0, 10), 10))
    scene = Scene((floor, wall), (Material(0.5),))
    transfer = bake(scene, order=1, rays=4096, bounces=0)
    p = transfer.receivers.positions
    foot = (p[:, 0] == 3) & (p[:, 1] == 0) & (p[:, 2].abs() < 5)
    assert int(foot.sum()) == 9
    assert float((transfer.diffuse[foot, 0, 0] / OPEN - 0.5).abs().max()) < 5e-3
    assert torch.equal(transfer.diffuse, bake(scene, order=1, rays=4096, bounces=0, threads=3).diffuse)


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="peak memory is read from Linux's /proc")
def test_peak_memory_does_not_grow_with_the_rays(bumpy):
    """Hard case 30: 16 times the rays, whose hits take 480 MiB; only a chunk of them is held at a time."""

    def peak(rays: int) -> int:
        Path("/proc/self/clear_refs").write_text("5")
        before = _status("VmHWM")
        bake(bumpy, order=3, rays=rays, bounces=1, threads=2)
        return _status("VmHWM") - before

    peak(4096)
    # What chunks leave in the heaps of threads comes to 40 MiB; it was 310 with gaps between aligned blocks.
    assert peak(65536) < 128 << 20


def _status(field: str) -> int:
    """Bytes of a field of /proc/self/status."""
    return int(re.search(rf"{field}:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]) << 10
