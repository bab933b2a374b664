"""Frozen views: the pictures of `render`, and gradients from every parameter to the picture."""

from dataclasses import replace

import pytest
import torch
from tolerances import FLOAT32

from diffprt import sh
from diffprt.brdf import CookTorrance, ModifiedPhong, fitted_matrix
from diffprt.compression import ClusteredTransfer, compress
from diffprt.compression.overdraw.overdraw import soft_assignment
from diffprt.errors import InputError
from diffprt.rendering import FrozenView, picture, render
from diffprt.scene import Camera, Environment, builtin_environment
from diffprt.sh.frames import frame_rotations, rows_from_frames, tangent_frames
from diffprt.shading import CURVES, tone_map
from diffprt.surface import Receivers
from diffprt.transfer import GlossyTransfer, Transfer, bake_glossy


@pytest.fixture(scope="module")
def assets(bumpy, bumpy_transfer) -> dict:
    glossy = bake_glossy(bumpy, ModifiedPhong(16.0), order=4, order_out=5, rays=16, bounces=0)
    return {
        "diffuse": bumpy_transfer,
        "clustered": compress(bumpy_transfer, clusters=8, components=3),
        "glossy": glossy,
        "clustered glossy": compress(glossy, clusters=4, components=2),
    }


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("name", ["diffuse", "clustered", "glossy", "clustered glossy"])
def test_pictures_are_those_of_render(assets, name, samples):
    asset = assets[name]
    light = builtin_environment("studio").project(4, window="auto")
    camera = Camera.framing(asset.receivers.positions, width=44, height=36)
    frozen = FrozenView.of(asset.receivers, camera, samples=samples)
    expected = render(asset, light, camera, samples=samples)
    found = picture(asset, light, frozen)
    assert torch.equal(expected.ne(0).any(-1), frozen.mask) and float(expected.std()) > 0
    # Sums over up to 27 float32 products, in another order.
    assert torch.allclose(found, expected, rtol=FLOAT32["twin"], atol=FLOAT32["rounding"] * float(expected.max()))
    assert len(frozen.seen) < len(asset.receivers)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_products_are_interpolation(bumpy_transfer, dtype, generator):
    """Values and vector-Jacobian products, against `View.interpolate`."""
    receivers = bumpy_transfer.receivers
    camera = Camera.framing(receivers.positions, width=40, height=30)
    frozen, view = FrozenView.of(receivers, camera), receivers.view(camera)
    values = torch.randn(len(receivers), 5, generator=generator, dtype=dtype, requires_grad=True)
    along = torch.randn(30, 40, 5, generator=generator, dtype=dtype)
    ours, twin = frozen.image(values[frozen.seen]), view.interpolate(values)
    assert torch.allclose(ours, twin, atol=FLOAT32["rounding"])
    gradients = [torch.autograd.grad((image * along).sum(), values)[0] for image in (ours, twin)]
    assert torch.allclose(*gradients, atol=2e-6 * float(gradients[1].abs().max()))
    unseen = torch.ones(len(receivers), dtype=torch.bool).index_fill(0, frozen.seen, False)
    assert bool(unseen.any()) and float(gradients[0][unseen].abs().max()) == 0


def square() -> tuple[Receivers, FrozenView]:
    """Two triangles that a camera sees askew, and a third that it does not see."""
    positions = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, -9]])
    normals = torch.nn.functional.normalize(positions * 0.2 + torch.tensor([0.0, 0, 1]), dim=-1)
    albedo = torch.linspace(0.2, 0.9, 15).reshape(5, 3)
    receivers = Receivers(positions, normals, albedo, torch.tensor([[0, 1, 2], [0, 2, 3], [3, 4, 0]]))
    frozen = FrozenView.of(receivers, Camera((0.5, 0.3, 3.5), (0.0, 0.0, 0.0), width=5, height=4), samples=2)
    assert len(frozen.seen) == 4 and int(frozen.mask.sum()) > 8
    return receivers, frozen


def doubles(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, dtype=torch.float64, generator=generator).requires_grad_()


def test_gradients_of_transfer_albedo_and_light():
    receivers, frozen = square()
    inputs = (doubles(5, 3, 4), doubles(5, 3, seed=1), doubles(4, 3, seed=2))
    assert torch.autograd.gradcheck(lambda t, a, l: picture(Transfer(t, receivers), l, frozen, albedo=a), inputs)


def test_gradients_of_means_bases_and_weights():
    receivers, frozen = square()
    labels = torch.tensor([0, 1, 1, 0, 1])
    inputs = (doubles(2, 1, 4), doubles(2, 2, 1, 4, seed=1), doubles(5, 2, seed=2), doubles(4, 3, seed=3))

    def drawn(means, bases, weights, light):
        return picture(ClusteredTransfer(labels, means, bases, weights, receivers), light, frozen)

    assert torch.autograd.gradcheck(drawn, inputs)


def test_gradients_of_soft_labels():
    """Receivers that mix clusters by soft assignment, from the errors that decide it to the picture."""
    receivers, frozen = square()
    light = doubles(4, 3, seed=2).detach()

    def drawn(errors, decoded):
        mixed = torch.einsum("vm,vmck->vck", soft_assignment(errors, 0.7), decoded)
        return picture(Transfer(mixed, receivers), light, frozen)

    assert torch.autograd.gradcheck(drawn, (doubles(5, 3), doubles(5, 3, 1, 4, seed=1)))


def test_gradients_of_glossy_transfer_and_light():
    receivers, frozen = square()
    inputs = (doubles(5, 1, 4, 9), doubles(9, 3, seed=1))
    assert torch.autograd.gradcheck(lambda t, l: picture(GlossyTransfer(t, receivers), l, frozen), inputs)


@pytest.mark.parametrize(
    ("make", "start", "step"),
    [(ModifiedPhong, 12.0, 0.05), (lambda roughness: CookTorrance(roughness=roughness), 0.35, 1e-3)],
    ids=["phong", "cook-torrance"],
)
def test_gradients_of_gloss(make, start, step):
    """From an exponent or a roughness, through the BRDF's matrix on each receiver's axes, to the picture."""
    receivers, frozen = square()
    light, along = doubles(16, 3, seed=2).detach(), doubles(*frozen.mask.shape, 3, seed=3).detach()
    rotations = frame_rotations(tangent_frames(receivers.normals.double()), 4)

    def total(shape: torch.Tensor) -> torch.Tensor:
        matrix = fitted_matrix(make(shape), 4, 4)
        rows = rows_from_frames(matrix.expand(len(receivers), *matrix.shape).flatten(1, 2), rotations)
        drawn = picture(GlossyTransfer(rows.unflatten(1, matrix.shape[:2]), receivers), light, frozen)
        return (drawn * along).sum()

    shape = torch.tensor(start, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(total(shape), shape)
    with torch.no_grad():
        difference = (total(shape + step) - total(shape - step)) / (2 * step)
    # The quadrature's nodes gather around the lobe, whose width they take as a constant.
    assert float(gradient) == pytest.approx(float(difference), rel=1e-3) and abs(float(gradient)) > 1e-3


@pytest.mark.parametrize("curve", CURVES)
def test_gradients_of_texels_exposure_and_curve(curve):
    """From an environment's texels, through projection, shading, exposure and the curve, to display values."""
    receivers, frozen = square()
    transfer = Transfer(doubles(5, 1, 4).detach().abs() * torch.tensor([1.0, 0.1, 0.1, 0.1]), receivers)
    texels = (doubles(1, 2, 3, seed=4).detach().abs() * 0.1 + 0.3).requires_grad_()
    exposure = torch.tensor(0.6, dtype=torch.float64, requires_grad=True)

    def shown(texels, exposure):
        light = Environment(texels).project(2)
        return tone_map(picture(transfer, light, frozen), exposure=exposure, curve=curve)[frozen.mask][::5]

    values = shown(texels, exposure).detach()
    assert float(values.min()) > 0.01 and float(values.max()) < 1, "the curve clips where it has no gradient"
    assert torch.autograd.gradcheck(shown, (texels, exposure))


def test_a_texel_reaches_the_light_by_its_basis(generator):
    """The gradient of a texel is its solid angle's integral of the basis times the light's gradient."""
    texels = torch.rand(8, 16, 3, dtype=torch.float64, generator=generator, requires_grad=True)
    along = torch.randn(9, 3, dtype=torch.float64, generator=generator)
    (gradient,) = torch.autograd.grad((Environment(texels).project(3).coefficients * along).sum(), texels)
    fine = sh.render_map(along, 8 * 32, 16 * 32) * sh.row_weights(8 * 32)[:, None, None]
    expected = fine.reshape(8, 32, 16, 32, 3).sum(dim=(1, 3))
    # The midpoint rule over 32 x 32 parts of each texel is good to 1e-4 of the largest.
    assert torch.allclose(gradient, expected, rtol=0, atol=1e-4 * float(expected.abs().max()))


def test_bad_input_is_named(bumpy_transfer):
    receivers, frozen = square()
    with pytest.raises(InputError, match="sees none of 5 receivers"):
        FrozenView.of(receivers, Camera((0.0, 0.0, 20.0), (0.0, 0.0, 40.0)))
    with pytest.raises(InputError, match="samples is 0"):
        FrozenView.of(receivers, frozen.camera, samples=0)
    with pytest.raises(InputError, match="give values\\[seen\\]"):
        frozen.pixels(torch.zeros(5, 3))
    with pytest.raises(InputError, match="freeze it again"):
        picture(bumpy_transfer, torch.zeros(16, 3), frozen)
    with pytest.raises(InputError, match="project the light with order=2"):
        picture(Transfer(torch.zeros(5, 1, 4), receivers), torch.zeros(9, 3), frozen)
    glossy = GlossyTransfer(torch.zeros(5, 1, 4, 4), receivers)
    with pytest.raises(InputError, match="leave albedo out"):
        picture(glossy, torch.zeros(4, 3), frozen, albedo=torch.zeros(5, 3))
    points = replace(receivers, faces=receivers.faces[:0])
    with pytest.raises(InputError, match="points without triangles"):
        FrozenView.of(points, frozen.camera)
