"""Exit radiance by mirrored direction: exact at receivers, nearly constant between them, differentiable."""

import math

import pytest
import torch
from tolerances import FLOAT32

from diffprt import sh
from diffprt.brdf import Brdf, Lambert, ModifiedPhong, hemisphere_moments
from diffprt.errors import InputError
from diffprt.representation import Lit, Samples
from diffprt.scene import builtin_scene
from diffprt.sh.frames import frame_rotations, rows_from_frames, tangent_frames
from diffprt.shading import shade
from diffprt.surface import Receivers
from diffprt.transfer import GlossyTransfer
from diffprt.transfer.glossy.materials import GlossyMaterials
from diffprt.transfer.glossy.mirrored import MirroredBasis


def directions(count: int, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)


def light_of(order: int) -> torch.Tensor:
    bands = sh.band_of_index(order)[:, None]
    return torch.randn(order**2, 3, generator=torch.Generator().manual_seed(3)) / (1 + bands)


def open_transfer(normals: torch.Tensor, brdf: Brdf, order: int, order_out: int) -> GlossyTransfer:
    """Points on the unit sphere that nothing shadows."""
    materials = GlossyMaterials.of(builtin_scene("sphere", subdivisions=0).with_brdf(brdf), order, order_out, 3e-4)
    visible = hemisphere_moments(order + order_out - 1, cosine=True).expand(len(normals), -1)
    local = materials.shade(visible, torch.zeros(len(normals), dtype=torch.int64))
    rotations = frame_rotations(tangent_frames(normals.double()), order)
    signal = rows_from_frames(local.flatten(1, 2), rotations).unflatten(1, local.shape[1:3])
    return GlossyTransfer(signal.float(), Receivers.points(normals, normals))


def towards(coefficients, points, normals, eye):
    """Radiance of points that carry coefficients of their own towards an eye."""
    own, order = torch.arange(len(points))[:, None], math.isqrt(coefficients.shape[-1])
    samples = Samples(own, torch.ones(len(points), 1, dtype=points.dtype), points, normals)
    return Lit(coefficients, MirroredBasis(order)).towards(samples, eye)


def exit_radiance_of(asset, light):
    return asset.exit_radiance(light)


def local_basis(asset, eye):
    """SH at the view on each receiver's own axes."""
    view = torch.nn.functional.normalize(eye - asset.receivers.positions, dim=-1)
    return sh.basis(torch.einsum("vij,vi->vj", asset.frames, view), asset.order_out).double()


def test_at_the_receivers_it_is_shading():
    normals = directions(200, 1)
    generator = torch.Generator().manual_seed(2)
    for channels in (1, 3):
        signal = torch.randn(200, channels, 25, 9, dtype=torch.float64, generator=generator)
        asset = GlossyTransfer(signal, Receivers.points(normals, normals))
        eye = torch.tensor([0.7, 2.0, 1.5])
        found = torch.einsum("vco,vo->vc", exit_radiance_of(asset, light_of(3)), local_basis(asset, eye))
        facing = ((eye - asset.receivers.positions) * normals).sum(1) > 0.01
        assert 50 < int(facing.sum()) < 200
        expected = shade(asset, light_of(3), eye)
        # Positions, normals and so frames are float32.
        assert torch.allclose(found[facing], expected[facing], atol=FLOAT32["twin"] * float(expected.abs().max()))
        assert bool(torch.isfinite(found).all())


@pytest.mark.parametrize("exponent", [8.0, 32.0])
def test_between_receivers_it_is_what_hardly_turns(exponent):
    """Halfway between normals 20 degrees apart, against transfer made for that normal: radiance itself is blurred."""
    middle, order, order_out = directions(300, 4), 6, 8
    tangent = tangent_frames(middle)[:, :, 0]
    ends = [torch.nn.functional.normalize(middle + s * 0.176 * tangent, dim=-1) for s in (-1, 1)]
    views = torch.nn.functional.normalize(middle + 0.6 * directions(300, 5), dim=-1)
    light, brdf = light_of(order), ModifiedPhong(exponent)
    truth = shade(open_transfer(middle, brdf, order, order_out), light, middle + views)
    between, turned = [], []
    for normals in ends:
        asset = open_transfer(normals, brdf, order, order_out)
        between.append(shade(asset, light, asset.receivers.positions + views))
        turned.append(asset.lit(light).coefficients)
    eyes = middle + views
    mixed = towards((turned[0] + turned[1]) / 2, middle, middle, eyes)
    off = [float((picture - truth).norm() / truth.norm()) for picture in (mixed, (between[0] + between[1]) / 2)]
    assert off[0] < 0.02
    assert off[0] < 0.2 * off[1]


def test_the_eye_matters_to_glossy_assets_alone():
    normals = directions(50, 6)
    eyes = [normals + 0.3 * directions(50, seed) for seed in (7, 8)]
    light = light_of(4)
    shiny, matte = (open_transfer(normals, brdf, 4, 4) for brdf in (ModifiedPhong(16.0), Lambert(0.5)))
    one, two = (shade(shiny, light, eye) for eye in eyes)
    assert float((one - two).norm()) > 0.1 * float(one.norm())
    one, two = (shade(matte, light, eye) for eye in eyes)
    assert torch.allclose(one, two, atol=FLOAT32["twin"])


def test_gradients():
    """Transfer, light, positions, normals and eye."""
    generator = torch.Generator().manual_seed(9)
    normals = directions(4, 10)
    receivers = Receivers.points(normals, normals)
    signal = torch.randn(4, 3, 9, 4, dtype=torch.float64, generator=generator, requires_grad=True)
    light = torch.randn(4, 3, dtype=torch.float64, generator=generator, requires_grad=True)
    points = receivers.positions.double().requires_grad_()
    axes = (1.3 * receivers.normals).double().requires_grad_()
    eye = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64, requires_grad=True)

    def radiance(signal, light, points, axes, eye):
        return towards(GlossyTransfer(signal, receivers).lit(light).coefficients, points, axes, eye)

    assert torch.autograd.gradcheck(radiance, (signal, light, points, axes, eye))


def test_bad_input_is_named():
    asset = open_transfer(directions(3, 11), Lambert(0.5), 2, 2)
    with pytest.raises(InputError, match="project the light with order=2"):
        asset.exit_radiance(torch.ones(9, 3))
    with pytest.raises(InputError, match=r"give view, such as camera\.eye"):
        shade(asset, torch.ones(4, 3))
    with pytest.raises(InputError, match="leave albedo out"):
        shade(asset, torch.ones(4, 3), (0.0, 0.0, 3.0), albedo=torch.ones(3, 3))
