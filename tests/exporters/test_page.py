"""The exported page against the torch renderer, in a browser, from a file URL."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from diffprt import sh
from diffprt.brdf import Phong
from diffprt.compression import compress
from diffprt.exporters import export
from diffprt.rendering import auto_exposure, render
from diffprt.scene import Camera, Light
from diffprt.shading import tone_map
from diffprt.transfer import bake_glossy

# At export the page knew only the built-in light and its own framing camera.
UNSEEN_VIEWS = (
    Camera((2.1, 1.3, -3.4), (0.1, -0.05, 0.0), fov=38.0, width=256, height=192),
    Camera((-2.9, -0.6, 0.8), (0.0, 0.1, 0.0), fov=50.0, width=160, height=160),
    Camera((0.4, 4.5, 0.9), (0.0, 0.0, 0.1), fov=33.0, width=144, height=200),
)
UNSEEN_VIEW = UNSEEN_VIEWS[0]
EXACT = 1 / 255
DIFFERENT = 10 / 255


def matrices(camera: Camera, positions: torch.Tensor) -> dict:
    near, far = camera.depth_range(positions)
    return {
        "view": camera.view().flatten().tolist(),
        "projection": camera.projection(near, far).flatten().tolist(),
    }


def show(page, asset, camera: Camera, light: Light, *, exposure: float, curve: str) -> None:
    page.calls(
        ("setCamera", matrices(camera, asset.receivers.positions)),
        ("setLight", light.coefficients.flatten().tolist()),
        ("setExposure", exposure),
        ("setCurve", curve),
        ("setBackground", "grey"),
        ("resize", camera.width, camera.height),
    )


def inner(mask: np.ndarray) -> np.ndarray:
    """Pixels whose neighbours are covered too: on the outline a pixel centre may fall on either side."""
    padded = np.pad(mask, 1)
    height, width = mask.shape
    shifts = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.logical_and.reduce(shifts)


@pytest.fixture(scope="session")
def assets(synthetic, dented, glossy_assets) -> dict:
    one, three = synthetic.bumpy_sphere(4, 1), synthetic.bumpy_sphere(6, 3)
    glossy, clustered_glossy = glossy_assets
    colored = bake_glossy(dented, Phong(8.0, specular=(0.6, 0.4, 0.2), diffuse=(0.1, 0.3, 0.5)), order=3, rays=64)
    return {
        "plain, one channel": one,
        "plain, three channels": three,
        "clustered, one channel": synthetic.cluster(one, 12, 5),
        "clustered, three channels": synthetic.cluster(three, 20, 8),
        "glossy, one channel": glossy,
        "glossy, three channels": colored,
        "clustered glossy, one channel": clustered_glossy,
        "clustered glossy, three channels": compress(colored, clusters=9, components=4, iterations=4),
    }


@pytest.mark.parametrize(
    ("name", "curve", "registers"),
    [
        ("plain, one channel", "linear", None),
        ("plain, three channels", "aces", None),
        ("clustered, one channel", "reinhard", None),
        ("clustered, three channels", "aces", None),
        ("clustered, one channel", "linear", 9),
        ("clustered, three channels", "aces", 64),
        ("glossy, one channel", "aces", None),
        ("glossy, three channels", "aces", None),
        ("clustered glossy, one channel", "reinhard", None),
        ("clustered glossy, three channels", "aces", None),
    ],
)
def test_page_draws_what_torch_renders(name, curve, registers, assets, synthetic, tmp_path, open_page) -> None:
    """Three lights and three views that the page did not know when it was exported."""
    asset = assets[name]
    export(asset, tmp_path, registers=registers)
    page = open_page(tmp_path / "index.html")
    assert page.info()["path"] == ("single" if registers is None else "passes")
    assert page.info().get("passes", 0) == {None: 0, 9: 6, 64: 3}[registers]
    # Plain transfer has one shader and no cluster to mistake: one view of it does.
    for seed, camera in enumerate(UNSEEN_VIEWS if "clustered" in name else UNSEEN_VIEWS[:1], 11):
        light = synthetic.random_light(asset.order, seed)
        view = asset.receivers.view(camera)
        radiance = render(asset, light, camera)
        exposure = auto_exposure(radiance, view.mask) * 1.5
        show(page, asset, camera, light, exposure=exposure, curve=curve)
        picture, mask = page.pixels()
        expected_mask = view.mask.numpy()
        assert (mask != expected_mask).mean() < 0.001
        inside = inner(mask & expected_mask)
        assert inside.mean() > 0.2

        expected = tone_map(radiance, exposure=exposure, curve=curve).numpy()[inside]
        assert 0.3 < expected.mean() < 0.75, "a dark or blown picture would prove little"
        assert expected.std() > 0.05
        error = np.abs(picture[inside] - expected)
        assert error.mean() <= EXACT
        assert np.quantile(error, 0.999) <= 3 * EXACT
        wrong = render(asset, synthetic.random_light(asset.order, seed + 50), camera)
        wrong = tone_map(wrong, exposure=exposure, curve=curve).numpy()[inside]
        assert np.abs(picture[inside] - wrong).mean() > DIFFERENT


@pytest.mark.parametrize("name", ["clustered, three channels", "clustered glossy, one channel"])
def test_basis_coefficients_are_what_is_drawn(name, assets, synthetic, tmp_path, open_page) -> None:
    """Every component of the largest cluster, changed, changes pixels as torch says."""
    asset = assets[name]
    bases = asset.bases.clone()
    bases[asset.labels.mode().values] *= -1
    changed = replace(asset, bases=bases)
    light, camera = synthetic.random_light(asset.order, 21), UNSEEN_VIEWS[0]
    pictures = []
    for version in (asset, changed):
        export(version, tmp_path, registers=None)
        page = open_page(tmp_path / "index.html")
        exposure = auto_exposure(render(asset, light, camera), asset.receivers.view(camera).mask)
        show(page, asset, camera, light, exposure=exposure, curve="linear")
        picture, mask = page.pixels()
        pictures.append(picture)
        expected = tone_map(render(version, light, camera), exposure=exposure).numpy()
        assert np.abs(picture - expected)[inner(mask)].mean() <= EXACT
    assert np.abs(pictures[0] - pictures[1]).max() > DIFFERENT


def test_passes_and_one_pass_are_the_same_picture(assets, synthetic, tmp_path, open_page) -> None:
    """Whatever the budget; with a face twice, which passes must not add twice; on a canvas as in `pixels`."""
    asset = assets["clustered, three channels"]
    faces = torch.cat([asset.receivers.faces, asset.receivers.faces[100:400, [2, 0, 1]]])
    asset = replace(asset, receivers=replace(asset.receivers, faces=faces))
    light, camera = synthetic.random_light(asset.order, 31), UNSEEN_VIEWS[1]
    passes = []
    for registers in (7, 200):
        report = export(asset, tmp_path, registers=registers)
        assert report["bytes"] > 0
        page = open_page(tmp_path / "index.html")
        show(page, asset, camera, light, exposure=0.4, curve="aces")
        page.call("setBackground", "light")
        summed, _ = page.pixels()
        page.call("setPath", "single")
        single, mask = page.pixels()
        difference = np.abs(summed - single).max(-1)
        assert difference[~mask].max() == 0
        assert np.quantile(difference, 0.999) <= 1.01 * EXACT, "a tie in depth may mix two triangles of the outline"
        assert single[mask].std() > 0.05
        passes.append(page.info()["passes"])
        assert 1 <= page.info()["overdraw"] <= 3
    assert passes == [20, 1]


def test_too_small_devices_draw_in_one_pass(assets, tmp_path, open_page) -> None:
    """A device with fewer uniforms than the export asked for says so to scripts, and draws all the same."""
    export(assets["clustered, three channels"], tmp_path, registers=5000)
    page = open_page(tmp_path / "index.html")
    assert page.info()["paths"] == ["single"]
    assert page.info()["path"] == "single"
    assert page.pixels()[0].std() > 0.05


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

    # The light behind the asset turns with it.
    page.call("setBackground", "light")
    picture, mask = page.pixels()
    behind = render(plain, light.rotate(turn), UNSEEN_VIEW, background="light")
    expected = tone_map(behind, exposure=0.4, curve="aces").numpy()
    outside = ~inner(mask) & ~mask
    assert np.abs(picture - expected)[outside].mean() <= EXACT
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
