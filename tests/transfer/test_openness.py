"""Ambient occlusion and bent normals: closed forms, entering through `bake`."""

import math

import pytest
import torch
from tolerances import FLOAT32

from diffprt.compression import compress
from diffprt.errors import InputError
from diffprt.planning import plan
from diffprt.representation import files as asset
from diffprt.scene import Scene, builtin_scene
from diffprt.surface import Receivers
from diffprt.surface.sampling import Pattern, hemisphere_directions
from diffprt.transfer import Transfer, bake


def test_wall_beside_a_floor():
    """Hard case 7: half the sky, and a mean direction along (0.325735, 0.511663) from (opening, normal)."""
    transfer = bake(builtin_scene("wall_and_floor"), order=2, rays=16384, bounces=0)
    at = int((transfer.receivers.positions - torch.tensor([1.0, 0.0, 0.0])).norm(dim=1).argmin())
    assert float(transfer.openness[at]) == pytest.approx(0.5, abs=5e-4)
    length = math.hypot(0.325735, 0.511663)
    expected = [0.325735 / length, 0.511663 / length, 0.0]
    assert transfer.bent_normals[at].tolist() == pytest.approx(expected, abs=1e-3)


def test_bowl_is_half_open_and_bends_upwards():
    transfer = bake(builtin_scene("bowl", subdivisions=1), order=3, rays=4096, bounces=0)
    p, n = transfer.receivers.positions, transfer.receivers.normals
    deep = p[:, 1] < -0.05
    assert float(transfer.openness[deep].mean()) == pytest.approx(0.5, abs=2e-3)
    bottom = int(p[:, 1].argmin())
    assert transfer.bent_normals[bottom].tolist() == pytest.approx([0, 1, 0], abs=2e-3)
    slope = deep & (p[:, 1] > -0.8)
    assert bool((transfer.bent_normals[slope][:, 1] > n[slope][:, 1]).all())


def test_open_surfaces_are_exactly_open(bumpy):
    patch = builtin_scene("wall_and_floor").meshes[0]
    for scene in (
        Scene.from_mesh(patch.positions, patch.faces, patch.normals),
        builtin_scene("sphere", subdivisions=1),
    ):
        for options in ({"rays": 64, "bounces": 1}, {"plan": plan(scene, 0.1)}):
            transfer = bake(scene, order=2, **options)
            assert bool((transfer.openness == 1).all())
            assert torch.allclose(transfer.bent_normals, transfer.receivers.normals, atol=FLOAT32["rounding"])


@pytest.mark.parametrize("height", [1.2, 2.0])
def test_sphere_above_a_plane(height):
    """Hard case 8: 1 - (R/h)² remains, around the normal."""
    floor = Receivers.points(torch.tensor([[0.0, -height, 0.0]]), torch.tensor([[0.0, 1.0, 0.0]]))
    transfer = bake(builtin_scene("sphere", subdivisions=5), receivers=floor, order=2, rays=16384, bounces=0)
    assert float(transfer.openness) == pytest.approx(1 - 1 / height**2, abs=2e-3)
    assert transfer.bent_normals[0].tolist() == pytest.approx([0, 1, 0], abs=1e-3)


def test_closed_rooms_are_shut_and_keep_their_normals():
    transfer = bake(builtin_scene("closed_box", subdivisions=2), order=2, rays=64, bounces=1)
    assert float(transfer.openness.max()) == 0
    assert torch.equal(transfer.bent_normals, transfer.receivers.normals)


def test_they_are_the_mean_of_unblocked_rays(bumpy):
    """Against counting rays with single-ray queries."""
    from diffprt.kernels import TriangleMesh
    from diffprt.surface import Surfaces

    transfer = bake(bumpy, order=2, rays=256, bounces=1)
    surfaces = Surfaces.of(bumpy)
    mesh = TriangleMesh(surfaces.positions, surfaces.faces)
    r = surfaces.receivers
    pick = torch.arange(0, len(r), 29)
    scramble = surfaces.scramble(r, 0)[pick]
    directions = hemisphere_directions(r.normals[pick], Pattern.create(256, scramble))
    origins = r.origins(mesh.ray_offset())[pick]
    blocked = mesh.occluded(origins.repeat_interleave(256, 0), directions.reshape(-1, 3)).reshape(-1, 256)
    share = (~blocked).float().mean(1)
    assert float((share - 1).abs().max()) > 0.1
    assert torch.allclose(transfer.openness[pick], share, atol=2.1 / 256)
    open_sum = (directions * ~blocked[..., None]).sum(1)
    cosine = (torch.nn.functional.normalize(open_sum, dim=1) * transfer.bent_normals[pick]).sum(1)
    # Transfer takes blocked rays from the exact whole, not open ones from nothing.
    assert float(cosine.min()) > 0.999


def test_order_one_has_no_bent_normals_and_assets_keep_what_there_is(bumpy, tmp_path):
    assert bake(bumpy, order=1, rays=16, bounces=0).bent_normals is None
    transfer = bake(bumpy, order=2, rays=32, bounces=1)
    assert float((transfer.bent_normals.norm(dim=1) - 1).abs().max()) < FLOAT32["rounding"]
    compressed = compress(transfer, clusters=4, components=2)
    for given in (transfer, compressed, compressed.decode(), bake(bumpy, order=1, rays=16, bounces=0)):
        asset.save(given, tmp_path / "a.prt")
        back = asset.load(tmp_path / "a.prt")
        assert torch.equal(back.openness, given.openness)
        assert (back.bent_normals is None) == (given.bent_normals is None)
        if given.bent_normals is not None:
            assert torch.equal(back.bent_normals, given.bent_normals)
    bare = Transfer(transfer.diffuse, transfer.receivers)
    asset.save(bare, tmp_path / "a.prt")
    assert asset.load(tmp_path / "a.prt").openness is None
    with pytest.raises(InputError, match="openness of shape"):
        Transfer(transfer.diffuse, transfer.receivers, openness=torch.ones(3))
