"""Pictures: cameras, interpolation, background, exposure, gradients."""

import math

import pytest
import torch
from tolerances import FLOAT32

from diffprt.errors import InputError
from diffprt.rendering import auto_exposure, pixel_rays, render
from diffprt.rendering.sheet import contact_sheet
from diffprt.scene import Camera, Light, constant_light, directional_light
from diffprt.shading import shade
from diffprt.surface import Receivers
from diffprt.transfer import Transfer


def test_framing_holds_everything_and_fills_the_picture(bumpy_transfer):
    for azimuth, elevation, size in [(0, 0, (64, 64)), (130, 60, (90, 40)), (-45, -80, (40, 90))]:
        camera = Camera.framing(
            bumpy_transfer.receivers.positions,
            azimuth=azimuth,
            elevation=elevation,
            width=size[0],
            height=size[1],
        )
        mask = bumpy_transfer.receivers.view(camera).mask
        assert not bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
        rows, columns = mask.any(1).double().mean(), mask.any(0).double().mean()
        assert max(float(rows), float(columns)) > 0.8


def test_constant_light_paints_flat_albedo_without_shadows():
    from diffprt.scene import builtin_scene
    from diffprt.transfer import bake

    asset = bake(builtin_scene("sphere").with_albedo((0.6, 0.4, 0.2)), order=2, rays=16, bounces=0)
    image = render(
        asset,
        constant_light((1.0, 1.0, 1.0), 2),
        Camera.framing(asset.receivers.positions, width=48, height=48),
    )
    seen = image.sum(-1) > 0
    assert 500 < int(seen.sum()) < 48 * 48
    assert torch.allclose(image[seen], torch.tensor([0.6, 0.4, 0.2]).expand(int(seen.sum()), 3), atol=FLOAT32["twin"])


def test_a_light_from_the_right_brightens_the_right(bumpy_transfer):
    """Handedness of camera and light together: +x is to the right when looking along -z."""
    camera = Camera.framing(bumpy_transfer.receivers.positions, azimuth=0, elevation=0, width=64, height=64)
    right = render(bumpy_transfer, directional_light((1.0, 0.0, 0.0), (3.0, 3.0, 3.0), 4), camera).sum(-1)
    top = render(bumpy_transfer, directional_light((0.0, 1.0, 0.0), (3.0, 3.0, 3.0), 4), camera).sum(-1)
    assert float(right[:, 32:].mean()) > 2 * float(right[:, :32].mean())
    assert float(top[:32].mean()) > 2 * float(top[32:].mean())


def test_pixel_rays_pass_through_what_pixels_see(bumpy_transfer):
    camera = Camera.framing(bumpy_transfer.receivers.positions, azimuth=40, elevation=30, width=50, height=40)
    view = bumpy_transfer.receivers.view(camera)
    points = view.interpolate(bumpy_transfer.receivers.positions.double())[view.mask]
    expected = torch.nn.functional.normalize(points - torch.tensor(camera.eye, dtype=torch.float64), dim=-1)
    assert int(view.mask.sum()) > 500
    assert torch.allclose(pixel_rays(camera)[view.mask].double(), expected, atol=FLOAT32["twin"])
    depth = (points - torch.tensor(camera.eye, dtype=torch.float64)) @ -camera.view()[2, :3]
    assert torch.allclose(view.depth[view.mask].double(), depth, atol=1e-4)


def test_background_is_the_light_itself(bumpy_transfer):
    light = Light(torch.randn(16, 3, generator=torch.Generator().manual_seed(0)))
    camera = Camera.framing(bumpy_transfer.receivers.positions, width=32, height=32, margin=2.0)
    image = render(bumpy_transfer, light, camera, background="light")
    mask = bumpy_transfer.receivers.view(camera).mask
    assert torch.allclose(image[~mask], light.radiance(pixel_rays(camera))[~mask])
    grey = render(bumpy_transfer, light, camera, background=(0.1, 0.2, 0.3))
    assert torch.allclose(grey[~mask], torch.tensor([0.1, 0.2, 0.3]).expand(int((~mask).sum()), 3))


def test_samples_average(bumpy_transfer):
    light = constant_light((1.0, 1.0, 1.0), 4)
    camera = Camera.framing(bumpy_transfer.receivers.positions, width=24, height=24)
    fine = render(bumpy_transfer, light, Camera(camera.eye, camera.target, fov=camera.fov, width=72, height=72))
    averaged = fine.reshape(24, 3, 24, 3, 3).mean(dim=(1, 3))
    assert torch.allclose(render(bumpy_transfer, light, camera, samples=3), averaged, atol=FLOAT32["rounding"])


def test_auto_exposure_brings_the_mean_to_mid_grey():
    image = torch.rand(8, 8, 3, generator=torch.Generator().manual_seed(0)) * 1e-4
    mask = torch.ones(8, 8, dtype=torch.bool)
    luminance = (image * auto_exposure(image, mask)) @ torch.tensor([0.2126, 0.7152, 0.0722])
    assert float(luminance.mean()) == pytest.approx(0.2, rel=FLOAT32["twin"])
    assert auto_exposure(torch.zeros(8, 8, 3), mask) == 1.0


def test_gradients_reach_light_and_signal(bumpy_transfer):
    camera = Camera.framing(bumpy_transfer.receivers.positions, width=16, height=16)
    view = bumpy_transfer.receivers.view(camera)
    signal = bumpy_transfer.diffuse.double().requires_grad_()
    light = torch.randn(16, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(4), requires_grad=True)

    def loss(signal, light):
        return view.interpolate(shade(Transfer(signal, bumpy_transfer.receivers), light)).square().sum()

    gradients = torch.autograd.grad(loss(signal, light), (signal, light))
    for which, gradient in enumerate(gradients):
        inputs = [signal.detach(), light.detach()]
        direction = torch.randn(gradient.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(5))
        values = []
        for sign in (1, -1):
            moved = list(inputs)
            moved[which] = inputs[which] + sign * 1e-5 * direction
            values.append(float(loss(*moved)))
        numeric = (values[0] - values[1]) / 2e-5
        assert float((gradient * direction).sum()) == pytest.approx(numeric, rel=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Camera((0, 0, 0), (0, 0, 0)), "both"),
        (lambda: Camera((0, 0, 1), (0, 0, 0), fov=180), "field of view of 180"),
        (lambda: Camera((0, 0, 1), (0, 0, 0), width=0), "size 0 x 512"),
        (lambda: Camera((0, 1, 0), (0, 0, 0)).view(), "along its up vector"),
    ],
)
def test_cameras_that_cannot_be_are_named(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_points_without_triangles_are_named():
    points = Receivers.points(torch.rand(3, 3), torch.tensor([[0.0, 1.0, 0.0]]).expand(3, 3))
    with pytest.raises(InputError, match="points without triangles"):
        render(Transfer(torch.zeros(3, 1, 4), points), constant_light((1.0, 1.0, 1.0), 2))


def test_views_of_real_depth_ranges(bumpy_transfer):
    for distance in (1e-3, 1.0, 1e4):
        near, far = Camera((0, 0, distance), (0, 0, 0)).depth_range(bumpy_transfer.receivers.positions)
        assert 0 < near < far and math.isfinite(far)


def test_contact_sheet_holds_every_picture(tmp_path):
    pictures = [[torch.full((20, 30, 3), 0.25 * (r + c)) for c in range(3)] for r in range(2)]
    contact_sheet(tmp_path / "sheet.png", pictures, ["a", "b", "c"], ["x", "y"])
    from diffprt.images import read_image

    sheet = read_image(tmp_path / "sheet.png")[..., :3]
    for value in (0.25, 0.5):
        assert int(((sheet - value).abs() < 0.01).all(-1).sum()) > 2 * 500
