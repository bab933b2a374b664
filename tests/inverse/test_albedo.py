"""Inverse albedo: exact on exact pictures, through interreflection, by receiver and by group."""

import pytest
import torch

from diffprt.brdf import ModifiedPhong
from diffprt.errors import InputError
from diffprt.inverse import observe, recover_albedo
from diffprt.inverse.surface_fit import SurfaceFit, edge_differences
from diffprt.rendering import render
from diffprt.scene import Camera, Light, builtin_environment
from diffprt.transfer import GlossyTransfer, bake_glossy, trace


@pytest.fixture(scope="module")
def transport(bumpy):
    return trace(bumpy, order=3, rays=64, bounces=3)


@pytest.fixture(scope="module")
def light() -> Light:
    return builtin_environment("sky").project(3, window="auto")


def painted(positions: torch.Tensor) -> torch.Tensor:
    x, y, z = positions.T
    return torch.stack([0.5 + 0.3 * (3 * x).sin(), 0.4 + 0.3 * (2 * y + z).cos(), 0.6 + 0.2 * (2 * z).sin()], dim=1)


def photographs(transfer, light: Light, count: int = 6, size: int = 80) -> list:
    positions = transfer.receivers.positions
    found = []
    for index in range(count):
        camera = Camera.framing(
            positions, azimuth=360 * index / count, elevation=(-40, 40)[index % 2], width=size, height=size
        )
        found.append((render(transfer, light, camera, samples=2), camera, light.coefficients))
    return found


def off(found, truth: torch.Tensor) -> float:
    told = found.told.amin(1) > 0.5
    assert float(told.float().mean()) > 0.8
    return float((found.albedo - truth)[told].norm() / truth[told].norm())


def test_fixed_transfer_gives_the_albedo(transport, light):
    truth = painted(transport.receivers.positions)
    transfer = transport.transfer(0, albedo=truth)
    found = recover_albedo(transport.transfer(0), photographs(transfer, light), noise=1e-3)
    assert off(found, truth) < 0.01
    assert found.turns == 0 and found.residual < 0.005 and found.clamped == 0


def test_light_between_surfaces_is_told_apart(transport, light):
    """With the operator, the light that surfaces pass on is not taken for a brighter albedo."""
    truth = painted(transport.receivers.positions)
    pictures = photographs(transport.transfer(albedo=truth), light)
    follows = recover_albedo(transport, pictures, noise=1e-3)
    direct = recover_albedo(transport.transfer(0), pictures, noise=1e-3)
    assert off(follows, truth) < 0.01
    assert off(direct, truth) > 2 * off(follows, truth)
    assert 2 <= follows.turns <= 6


def test_groups_share_an_albedo(transport, light):
    groups = (transport.receivers.positions[:, 0] > 0).long() * 7 + 2
    truth = torch.tensor([[0.2, 0.7, 0.4], [0.8, 0.3, 0.5]])[(groups == 9).long()]
    pictures = photographs(transport.transfer(0, albedo=truth), light, count=2)
    found = recover_albedo(transport.transfer(0), pictures, groups=groups)
    assert torch.allclose(found.albedo, truth, atol=2e-3)


def test_what_nobody_sees_comes_from_neighbors(transport, light):
    truth = torch.full((len(transport.receivers), 3), 0.35)
    found = recover_albedo(transport.transfer(0), photographs(transport.transfer(0, albedo=truth), light, count=1))
    unseen = found.told.amax(1) == 0
    assert bool(unseen.any())
    assert torch.allclose(found.albedo[unseen], truth[unseen], atol=0.01)


def test_edges_make_the_laplacian(transport):
    receivers = transport.receivers
    laplacian = edge_differences(receivers)
    values = torch.randn(len(receivers), generator=torch.Generator().manual_seed(0)).double().numpy()
    faces = receivers.faces.numpy()
    edges = {tuple(sorted(edge)) for face in faces for edge in zip(face, face[[1, 2, 0]], strict=True)}
    expected = sum((values[a] - values[b]) ** 2 for a, b in edges)
    assert values @ (laplacian @ values) == pytest.approx(expected)


def test_bad_input_is_named(bumpy, transport, light):
    transfer = transport.transfer(0)
    image, camera, coefficients = photographs(transfer, light, count=1)[0]
    cases = [
        ({"references": [(image, camera)]}, "reference 0: the light is not known"),
        ({"references": [(image, camera, torch.ones(16, 3))]}, "project the light with order=3"),
        ({"references": [(image, camera, torch.zeros(9, 3))]}, "the lights do not reach"),
        ({"noise": 0.0}, "noise is 0.0: give a positive share"),
        ({"groups": torch.zeros(3)}, r"groups have shape \[3\]"),
    ]
    for changed, message in cases:
        with pytest.raises(InputError, match=message):
            recover_albedo(transfer, **{"references": [(image, camera, coefficients)], **changed})
    glossy = bake_glossy(bumpy, ModifiedPhong(8.0), order=2, order_out=2, rays=8, bounces=0)
    assert isinstance(glossy, GlossyTransfer)
    with pytest.raises(InputError, match="a glossy asset has its reflectance inside"):
        recover_albedo(glossy, [(image, camera, coefficients)])


def test_a_surface_fit_reads_smooth_values(transport, light):
    """With factors of 1 it inverts interpolation."""
    transfer = transport.transfer(0)
    observations = observe(transfer.receivers, photographs(transfer, light, count=2))
    values = (0.5 + 0.2 * transfer.receivers.positions[:, 0]).double().numpy()
    fit = SurfaceFit.of(transfer.receivers, observations, variation=0.05, noise=1e-4)
    ones = [torch.ones(len(seen)).double().numpy() for seen in fit.seen]
    pixels = [p @ values[seen] for p, seen in zip(fit.contributions, fit.seen, strict=True)]
    found, told, left = fit.solve(ones, pixels)
    assert abs(found - values)[told > 0.9].max() < 1e-3 and left < 1e-4
    assert (told > 0.9).mean() > 0.4
