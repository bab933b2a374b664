"""Glossy pictures: the Lambertian limit, views, coarse meshes, gradients."""

import math
from dataclasses import replace

import pytest
import torch
from tolerances import FLOAT32

from diffprt.brdf import Lambert, ModifiedPhong
from diffprt.compression import ClusteredGlossyTransfer, compress
from diffprt.errors import InputError
from diffprt.rendering import render
from diffprt.scene import Camera, Light, builtin_environment, builtin_scene
from diffprt.shading import shade
from diffprt.surface import Receivers
from diffprt.transfer import GlossyTransfer, bake, bake_glossy


def light_of(order: int) -> Light:
    return builtin_environment("studio").project(order, window="auto")


def test_lambertian_pictures_are_the_diffuse_ones(bumpy):
    glossy = bake_glossy(bumpy, Lambert((0.7, 0.5, 0.3)), order=3, rays=64, bounces=0)
    diffuse = bake(bumpy, order=3, rays=64, bounces=0)
    camera = Camera.framing(diffuse.receivers.positions, width=48, height=40)
    ours, theirs = (render(asset, light_of(3), camera, samples=2, background=0.1) for asset in (glossy, diffuse))
    # The albedo of the scene is float32, as is transfer.
    assert torch.allclose(ours, theirs, atol=1e-4 * float(theirs.max()))
    assert float(theirs.std()) > 0.1 * float(theirs.mean())


@pytest.fixture(scope="module")
def spheres() -> dict[int, GlossyTransfer]:
    """An open sphere, coarse and fine."""
    return {
        s: bake_glossy(builtin_scene("sphere", subdivisions=s), ModifiedPhong(32.0), order=6, rays=16, bounces=0)
        for s in (3, 5)
    }


def test_coarse_pictures_look_like_fine_ones(spheres):
    """Inside the outline; interpolating radiance itself is several times as far off."""
    camera = Camera.framing(spheres[3].receivers.positions, width=96, height=96, margin=0.8)
    light = light_of(6)
    truth, coarse = (render(spheres[s], light, camera) for s in (5, 3))
    view = spheres[3].receivers.view(camera)
    vertices = view.interpolate(shade(spheres[3], light, camera.eye))
    off = [float((picture - truth)[view.mask].norm() / truth[view.mask].norm()) for picture in (coarse, vertices)]
    assert off[0] < 0.01
    assert off[0] < 0.25 * off[1]


def test_a_turned_world_gives_the_same_picture(spheres):
    """Camera and light turned together about a sphere: only its triangles differ."""
    angle = 0.9
    c, s = math.cos(angle), math.sin(angle)
    turn = torch.tensor([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    camera = Camera.framing(spheres[5].receivers.positions, width=48, height=48, margin=0.8)
    moved = replace(camera, eye=tuple((turn @ torch.tensor(camera.eye)).tolist()))
    light = light_of(6)
    still, turned = render(spheres[5], light, camera), render(spheres[5], light.rotate(turn), moved)
    elsewhere = render(spheres[5], light, moved)
    assert float((turned - still).norm()) < 0.01 * float(still.norm())
    assert float((elsewhere - still).norm()) > 0.1 * float(still.norm())


def test_gradients_reach_transfer_and_light():
    """Two triangles with one normal each corner; the camera sees both."""
    generator = torch.Generator().manual_seed(0)
    positions = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    normals = torch.nn.functional.normalize(positions * 0.2 + torch.tensor([0.0, 0, 1]), dim=-1)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    receivers = Receivers(positions, normals, torch.zeros(4, 3), faces)
    camera = Camera((0.5, 0.3, 4.0), (0.0, 0.0, 0.0), width=6, height=5)
    signal = torch.randn(4, 1, 9, 4, dtype=torch.float64, generator=generator, requires_grad=True)
    light = torch.randn(4, 3, dtype=torch.float64, generator=generator, requires_grad=True)
    view = receivers.view(camera)
    assert 8 < int(view.mask.sum()) < 30

    def picture(signal: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        return render(GlossyTransfer(signal, receivers), Light(light), camera)

    assert torch.autograd.gradcheck(picture, (signal, light))
    assert picture(signal.float(), light.float()).dtype == torch.float32
    rendered = render(GlossyTransfer(signal, receivers), Light(light), camera, samples=2)
    gradients = torch.autograd.grad(rendered.sum(), (signal, light))
    assert all(float(g.norm()) > 0 for g in gradients)


def test_clustered_pictures_are_those_of_the_decoded_transfer(bumpy):
    brdf = ModifiedPhong(16.0, specular=(0.9, 0.6, 0.3))
    baked = bake_glossy(bumpy, brdf, order=3, order_out=3, rays=32, bounces=0)
    camera = Camera.framing(baked.receivers.positions, width=40, height=32)
    for channels in (1, 3):
        check_clustered_pictures(baked.with_signal(baked.glossy[:, :channels]), camera)


def check_clustered_pictures(baked: GlossyTransfer, camera: Camera) -> None:
    """Few clusters are seen, more of them less so."""
    asset = compress(baked, clusters=16, components=3)
    sharp = compress(baked, clusters=48, components=8)
    found, decoded, better, given = (
        render(a, light_of(3), camera, background=0.1) for a in (asset, asset.decode(), sharp, baked)
    )
    assert float((found - decoded).abs().max()) < FLOAT32["twin"] * float(decoded.max())
    off, less = (float((picture - given).norm() / given.norm()) for picture in (found, better))
    assert 1e-4 < off < 0.1
    assert less < off / 2


def test_gradients_reach_clusters_through_pixels():
    """A slope of the picture against means, bases, weights and light, by finite differences."""
    generator = torch.Generator().manual_seed(1)
    positions = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    normals = torch.nn.functional.normalize(positions * 0.2 + torch.tensor([0.0, 0, 1]), dim=-1)
    receivers = Receivers(positions, normals, torch.zeros(4, 3), torch.tensor([[0, 1, 2], [0, 2, 3]]))
    camera = Camera((0.5, 0.3, 4.0), (0.0, 0.0, 0.0), width=4, height=3)
    labels = torch.tensor([0, 1, 1, 0])
    shapes = [(4, 3), (2, 1, 9, 4), (2, 2, 1, 9, 4), (4, 2)]
    inputs = [torch.randn(s, dtype=torch.float64, generator=generator, requires_grad=True) for s in shapes]

    def picture(light: torch.Tensor, *parameters: torch.Tensor) -> torch.Tensor:
        return render(ClusteredGlossyTransfer(labels, *parameters, receivers), light, camera)

    assert torch.autograd.gradcheck(picture, inputs)
    assert all(float(g.norm()) > 0 for g in torch.autograd.grad(picture(*inputs).sum(), inputs))


def test_nothing_in_view_is_black(spheres):
    camera = Camera((0.0, 0.0, 5.0), (0.0, 0.0, 10.0), width=8, height=8)
    assert float(render(spheres[3], light_of(6), camera).abs().max()) == 0


def test_bad_input_is_named(spheres):
    with pytest.raises(InputError, match="project the light with order=6"):
        render(spheres[3], light_of(4))
    points = Receivers.points(torch.zeros(2, 3), torch.eye(3)[:2])
    with pytest.raises(InputError, match="points without triangles"):
        render(GlossyTransfer(torch.zeros(2, 1, 4, 4), points), light_of(2), Camera((0, 0, 3), (0, 0, 0)))
