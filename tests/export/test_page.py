"""The exported page against the torch renderer, in a browser, from a file URL."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from diffprt import sh
from diffprt.export import export
from diffprt.render import Camera, render
from diffprt.render.view import View
from diffprt.scene import Light
from diffprt.shade import tone_map

# At export the page knew only the built-in light and its own framing camera.
UNSEEN_VIEW = Camera((2.1, 1.3, -3.4), (0.1, -0.05, 0.0), fov=38.0, width=256, height=192)
EXACT = 1 / 255
DIFFERENT = 10 / 255
SEEDS = {"seen": 11, "other": 12}


def matrices(camera: Camera, positions: torch.Tensor) -> dict:
    near, far = camera.depth_range(positions)
    return {
        "view": camera.view().flatten().tolist(),
        "projection": camera.projection(near, far).flatten().tolist(),
    }


def show(page, asset, camera: Camera, light: Light, *, exposure: float, curve: str) -> None:
    page.call("resize", camera.width, camera.height)
    page.call("setCamera", matrices(camera, asset.receivers.positions))
    page.call("setLight", light.coefficients.flatten().tolist())
    page.call("setExposure", exposure)
    page.call("setCurve", curve)


def inner(mask: np.ndarray) -> np.ndarray:
    """Pixels whose neighbours are covered too: on the outline a pixel centre may fall on either side."""
    padded = np.pad(mask, 1)
    height, width = mask.shape
    shifts = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.logical_and.reduce(shifts)


@pytest.fixture(scope="session")
def assets(synthetic) -> dict:
    one, three = synthetic.bumpy_sphere(4, 1), synthetic.bumpy_sphere(6, 3)
    return {
        "plain, one channel": one,
        "plain, three channels": three,
        "clustered, one channel": synthetic.cluster(one, 12, 5),
        "clustered, three channels": synthetic.cluster(three, 20, 8),
    }


@pytest.mark.parametrize(
    ("name", "curve"),
    [
        ("plain, one channel", "linear"),
        ("plain, three channels", "aces"),
        ("clustered, one channel", "reinhard"),
        ("clustered, three channels", "aces"),
    ],
)
def test_page_draws_what_torch_renders(name, curve, assets, synthetic, tmp_path, open_page) -> None:
    asset = assets[name]
    exposure = 0.4
    lights = {key: synthetic.random_light(asset.order, seed) for key, seed in SEEDS.items()}
    export(asset, tmp_path)
    page = open_page(tmp_path / "index.html")
    show(page, asset, UNSEEN_VIEW, lights["seen"], exposure=exposure, curve=curve)
    picture, mask = page.pixels()

    expected_mask = View.of(asset.receivers, UNSEEN_VIEW).mask.numpy()
    assert (mask != expected_mask).mean() < 0.001
    inside = inner(mask & expected_mask)
    assert inside.mean() > 0.2

    def torch_picture(light: Light) -> np.ndarray:
        return tone_map(render(asset, light, UNSEEN_VIEW), exposure=exposure, curve=curve).numpy()[inside]

    expected = torch_picture(lights["seen"])
    assert 0.3 < expected.mean() < 0.75, "a dark or blown picture would prove little"
    assert expected.std() > 0.05
    error = np.abs(picture[inside] - expected)
    assert error.mean() <= EXACT
    assert np.quantile(error, 0.999) <= 2 * EXACT

    assert np.abs(picture[inside] - torch_picture(lights["other"])).mean() > DIFFERENT
    page.call("setLight", lights["other"].coefficients.tolist())
    other, _ = page.pixels()
    assert np.abs(other[inside] - torch_picture(lights["other"])).mean() <= EXACT
    assert np.abs(other[inside] - expected).mean() > DIFFERENT


def test_page_turns_the_light_as_torch_does(plain, synthetic, tmp_path, open_page) -> None:
    light = synthetic.random_light(plain.order, 5)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(1)))[0]
    turn = turn * torch.linalg.det(turn).sign()
    export(plain, tmp_path)
    page = open_page(tmp_path / "index.html")
    show(page, plain, UNSEEN_VIEW, light, exposure=0.4, curve="aces")
    page.call("setLightRotation", turn.flatten().tolist())
    picture, mask = page.pixels()
    expected = tone_map(render(plain, light.rotate(turn), UNSEEN_VIEW), exposure=0.4, curve="aces").numpy()
    unturned = tone_map(render(plain, light, UNSEEN_VIEW), exposure=0.4, curve="aces").numpy()
    inside = inner(mask)
    assert np.abs(picture - expected)[inside].mean() <= EXACT
    assert np.abs(picture - unturned)[inside].mean() > DIFFERENT

    # The light behind the asset turns with it. Half floats and a bilinear map: three levels, not one.
    page.call("setBackground", "light")
    picture, mask = page.pixels()
    behind = render(plain, light.rotate(turn), UNSEEN_VIEW, background="light")
    expected = tone_map(behind, exposure=0.4, curve="aces").numpy()
    outside = ~inner(mask) & ~mask
    assert np.abs(picture - expected)[outside].mean() <= 3 * EXACT
    assert picture[outside].mean() > 0.2


def test_rotation_in_the_page_is_that_of_torch(plain, tmp_path, open_page) -> None:
    export(plain, tmp_path)
    page = open_page(tmp_path / "index.html")
    generator = torch.Generator().manual_seed(2)
    for order in (1, 2, 3, 6, 10):
        coefficients = torch.randn(order**2, 3, generator=generator, dtype=torch.float64)
        turn = torch.linalg.qr(torch.randn(3, 3, generator=generator, dtype=torch.float64))[0]
        turn = turn * torch.linalg.det(turn).sign()
        turned = page.call("rotateCoefficients", coefficients.flatten().tolist(), turn.flatten().tolist())
        turned = torch.tensor(turned, dtype=torch.float64).view(-1, 3)
        torch.testing.assert_close(turned, sh.rotate(coefficients, turn), rtol=0, atol=1e-10)


def test_back_faces_and_any_shape_of_picture_are_drawn(clustered, synthetic, tmp_path, open_page) -> None:
    """From inside the ball, in an upright picture whose rows are no multiple of four pixels."""
    camera = Camera((0.2, 0.1, 0.0), (0.0, 0.3, -1.0), fov=60.0, width=91, height=133)
    light = synthetic.random_light(clustered.order, 7)
    export(clustered, tmp_path)
    page = open_page(tmp_path / "index.html")
    show(page, clustered, camera, light, exposure=0.4, curve="aces")
    picture, mask = page.pixels()
    assert picture.shape == (133, 91, 3)
    assert mask.all()
    expected = tone_map(render(clustered, light, camera), exposure=0.4, curve="aces").numpy()
    assert np.abs(picture - expected).mean() <= EXACT


def test_many_clusters_and_no_components(plain, synthetic, tmp_path, open_page) -> None:
    """More clusters than a texture has rows (8192 in the software rasterizer); P = 0 and an odd P."""
    light = synthetic.random_light(plain.order, 8)
    for components in (0, 3):
        asset = synthetic.cluster(plain, clusters=6, components=components)
        spread = 9001
        wide = replace(
            asset,
            labels=asset.labels + spread - 6,
            means=torch.cat([torch.randn(spread - 6, *asset.means.shape[1:]), asset.means]),
            bases=torch.cat([torch.randn(spread - 6, *asset.bases.shape[1:]), asset.bases]),
        )
        export(wide, tmp_path)
        page = open_page(tmp_path / "index.html")
        assert page.info()["clusters"] == spread
        show(page, wide, UNSEEN_VIEW, light, exposure=0.4, curve="aces")
        picture, mask = page.pixels()
        expected = tone_map(render(asset, light, UNSEEN_VIEW), exposure=0.4, curve="aces").numpy()
        assert np.abs(picture - expected)[inner(mask)].mean() <= EXACT


def test_largest_order_fits_the_plain_shader(synthetic, tmp_path, open_page) -> None:
    asset = synthetic.bumpy_sphere(order=10, channels=3, rows=24)
    light = synthetic.random_light(10, 9)
    export(asset, tmp_path)
    page = open_page(tmp_path / "index.html")
    show(page, asset, UNSEEN_VIEW, light, exposure=0.4, curve="aces")
    picture, mask = page.pixels()
    expected = tone_map(render(asset, light, UNSEEN_VIEW), exposure=0.4, curve="aces").numpy()
    assert np.abs(picture - expected)[inner(mask)].mean() <= EXACT
