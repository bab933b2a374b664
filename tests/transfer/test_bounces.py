"""Interreflection: closed forms, color, and gradients to the albedo."""

import itertools
import math

import pytest
import torch
from tolerances import FLOAT32

from diffprt.errors import InputError
from diffprt.scene import Scene, builtin_scene
from diffprt.shading import shade
from diffprt.surface import Receivers, StoredOperator
from diffprt.surface.operator import OperatorRows
from diffprt.transfer import bake, interreflect, trace
from diffprt.transfer.diffuse.interreflection import rows_from_hits

UNIT = math.sqrt(4 * math.pi)


def radiance_under_unit_light(transfer, albedo: float) -> torch.Tensor:
    """Exit radiance [V] under light of radiance 1 everywhere."""
    return albedo / math.pi * transfer.diffuse[:, 0, 0] * UNIT


def test_bowl_error_falls_like_half_the_albedo_per_bounce():
    """Hard case 6: the error after n bounces falls like (r/2)^n."""
    albedo = 0.8
    transport = trace(builtin_scene("bowl", subdivisions=2).with_albedo(albedo), order=1, rays=1024, bounces=1)
    inside = transport.receivers.positions[:, 1] < -0.3
    limit = radiance_under_unit_light(transport.transfer(60), albedo)[inside].mean()
    errors = [float(limit - radiance_under_unit_light(transport.transfer(n), albedo)[inside].mean()) for n in range(5)]
    for before, after in itertools.pairwise(errors):
        assert after / before == pytest.approx(albedo / 2, rel=0.03)


def test_convex_object_reflects_its_albedo():
    """Hard case 5."""
    transfer = bake(builtin_scene("sphere").with_albedo(0.3), order=3, rays=64, bounces=4)
    assert torch.allclose(radiance_under_unit_light(transfer, 0.3), torch.tensor(0.3), atol=FLOAT32["rounding"])


def test_colored_walls_bleed():
    transfer = bake(builtin_scene("cornell"), order=2, rays=256, bounces=2)
    assert transfer.channels == 3
    p, n = transfer.receivers.positions, transfer.receivers.normals
    floor = (n[:, 1] > 0.9) & (p[:, 1] < p[:, 1].min() + 1e-3)
    left = floor & (p[:, 0] < p[floor, 0].min() + 0.25)
    right = floor & (p[:, 0] > p[floor, 0].max() - 0.25)
    light = transfer.diffuse[:, :, 0]
    assert float((light[left, 0] / light[left, 1]).mean()) > 1.02
    assert float((light[right, 1] / light[right, 0]).mean()) > 1.02


def test_grey_scenes_have_one_channel_and_agree_with_three(bumpy):
    transport = trace(bumpy.with_albedo(0.6), order=3, rays=128, bounces=2)
    one = transport.transfer()
    three = transport.transfer(albedo=transport.receivers.albedo.clone().requires_grad_())
    assert one.channels == 1 and three.channels == 3
    assert torch.allclose(one.diffuse.expand(-1, 3, -1), three.diffuse, atol=FLOAT32["rounding"])


def test_occluder_only_geometry_blocks_and_absorbs():
    floor = builtin_scene("wall_and_floor").meshes[0]
    scene = Scene.from_mesh(floor.positions, floor.faces, floor.normals, albedo=1.0)
    roof = Scene.from_mesh(
        torch.tensor([[-50.0, 1, -50], [50, 1, -50], [50, 1, 50], [-50, 1, 50]]),
        torch.tensor([[0, 1, 2], [0, 2, 3]]),
        albedo=1.0,
    )
    transfer = bake(scene.with_occluder(roof), order=1, rays=1024, bounces=4)
    assert len(transfer.receivers) == len(floor.positions)
    at = int((transfer.receivers.positions - torch.tensor([1.0, 0.0, 0.0])).norm(dim=1).argmin())
    assert float(transfer.diffuse[at, 0, 0]) < 0.01


def test_free_receivers_agree_with_vertices(bumpy):
    vertices = bake(bumpy, order=3, rays=256, bounces=2)
    r = vertices.receivers
    free = bake(
        bumpy,
        receivers=Receivers.points(r.positions[::7], r.normals[::7], r.albedo[::7]),
        order=3,
        rays=256,
        bounces=2,
    )
    assert free.channels == 3
    difference = (free.diffuse - vertices.diffuse[::7]).norm(dim=-1) / vertices.diffuse.norm(dim=-1).mean()
    # Free receivers have no border to move away from: single rays may differ.
    assert float(difference.median()) < 1e-3 and float(difference.max()) < 0.05


def test_gradients_reach_the_albedo(bumpy):
    transport = trace(bumpy, order=2, rays=64, bounces=3)
    albedo = transport.receivers.albedo.double().requires_grad_()
    direct = transport.direct.double().expand(-1, 3, -1)

    def loss(a: torch.Tensor) -> torch.Tensor:
        return interreflect(direct, transport.operator, a, 3).square().sum()

    (gradient,) = torch.autograd.grad(loss(albedo), albedo)
    direction = torch.randn(albedo.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    step = 1e-5
    with torch.no_grad():
        numeric = (loss(albedo + step * direction) - loss(albedo - step * direction)) / (2 * step)
    assert float((gradient * direction).sum()) == pytest.approx(float(numeric), rel=1e-6)


def test_sparse_product_passes_gradcheck():
    rows = OperatorRows(
        torch.tensor([2, 0, 1], dtype=torch.int32).numpy(),
        torch.tensor([0, 3, 2], dtype=torch.int32).numpy(),
        torch.tensor([0.5, 0.25, 1.0]).numpy(),
    )
    operator = StoredOperator([rows], 4)
    signal = torch.randn(4, 2, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(operator.gather, signal)
    dense = torch.tensor([[0.5, 0, 0, 0.25], [0, 0, 0, 0], [0, 0, 1, 0]], dtype=torch.float64)
    assert torch.allclose(operator.gather(signal), torch.einsum("rs,sck->rck", dense, signal))


def test_rows_from_hits_sums_duplicates_and_skips_occluders():
    import numpy as np

    face = np.array([[0, 0, 1, -1]], np.int32)
    weights = np.array([[[1, 0], [0.5, 0.5], [0.25, 0.25], [0, 0]]], np.float32)
    rows = rows_from_hits(face, weights, np.array([[0, 1, 2], [2, -1, 3]]), 4, 4)
    assert rows.counts.tolist() == [4]
    assert rows.columns.tolist() == [0, 1, 2, 3]
    assert rows.values.tolist() == pytest.approx([1.5 / 4, 0.5 / 4, 0.25 / 4, 0.5 / 4])
    empty = rows_from_hits(
        np.full((2, 3), -1, np.int32), np.zeros((2, 3, 2), np.float32), np.zeros((1, 3), np.int64), 1, 3
    )
    assert empty.counts.tolist() == [0, 0]


def test_albedo_given_later_is_used_for_bounces_and_on_exit(bumpy):
    transport = trace(bumpy, order=2, rays=64, bounces=2)
    light = torch.rand(4, 3, generator=torch.Generator().manual_seed(0))
    later = shade(transport.transfer(albedo=torch.tensor([0.2, 0.4, 0.6])), light)
    before = shade(bake(bumpy.with_albedo((0.2, 0.4, 0.6)), order=2, rays=64, bounces=2), light)
    assert torch.allclose(later, before, atol=FLOAT32["rounding"])
    for wrong, message in [(torch.rand(5), "shape"), (torch.full((3,), 1.5), "values from 1.5")]:
        with pytest.raises(InputError, match=message):
            transport.transfer(albedo=wrong)


def test_bounces_without_a_traced_operator_are_refused(bumpy):
    with pytest.raises(InputError, match="trace with bounces=1"):
        trace(bumpy, order=1, rays=4, bounces=0).transfer(2)
