"""Versions of an asset in one page: each drawn as torch renders it, compared by a line, and mapped in false colors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.exporters import export, pack
from diffprt.exporters.web import versions
from diffprt.options import ExportOptions
from diffprt.rendering import render
from diffprt.scene import Camera, Light
from diffprt.shading import tone_map

CAMERA = Camera((2.1, 1.3, -3.4), (0.1, -0.05, 0.0), fov=38.0, width=192, height=144)
EXACT = 1 / 255
HOSTILE = """</script><img src=x onerror="window.hacked=1">'"&<b>{{script}}`${window.hacked=1}"""


@pytest.fixture(scope="module")
def family(synthetic):
    """The asset, its uncompressed transfer, one before optimization, and the open surface."""
    plain = synthetic.bumpy_sphere(4, 1, rows=24)
    asset = synthetic.cluster(plain, clusters=12, components=2)
    before = replace(asset, means=asset.means * 0.6)
    cosine = sh.rotate_zonal(sh.clamped_cosine(4), plain.receivers.normals.double())
    return asset, plain, before, replace(plain, diffuse=cosine[:, None].float())


@pytest.fixture(scope="module")
def file(family, synthetic, tmp_path_factory):
    asset, plain, before, _ = family
    folder = tmp_path_factory.mktemp("versions")
    lights = {HOSTILE: synthetic.random_light(4, 3), "second": synthetic.random_light(4, 4)}
    named = {HOSTILE: before}
    report = export(
        asset, folder, lights=lights, registers=18, title=HOSTILE, uncompressed=plain, before=before, versions=named
    )
    assert report["left_out"] == []
    return folder / "index.html"


def show(page, asset, light: Light) -> None:
    near, far = CAMERA.depth_range(asset.receivers.positions)
    view = {
        "view": CAMERA.view().flatten().tolist(),
        "projection": CAMERA.projection(near, far).flatten().tolist(),
    }
    page.calls(
        ("setCamera", view),
        ("setLight", light.coefficients.flatten().tolist()),
        ("setExposure", 0.4),
        ("setBackground", "dark"),
        ("resize", CAMERA.width, CAMERA.height),
    )


def expected_of(asset, light: Light) -> np.ndarray:
    return tone_map(render(asset, light, CAMERA), exposure=0.4, curve="aces").numpy()


def inner(mask: np.ndarray) -> np.ndarray:
    rolled = [np.roll(mask, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    return np.logical_and.reduce(rolled)


def test_versions_wipe_bands_and_maps(file, family, synthetic, open_page) -> None:
    """One page, everything it can show; names that would break out of any place do not."""
    page = open_page(file, reduced_motion="reduce", viewport={"width": 700, "height": 500})
    tab = page.tab
    asset, plain, before, open_surface = family
    light = synthetic.random_light(4, 9)
    show(page, asset, light)
    info = page.info()
    assert info["versions"] == ["Optimized", "Before", "Uncompressed", HOSTILE, "Unshadowed"]
    assert info["heatMaps"] == ["clusters", "overdraw", "error"]
    assert tab.evaluate("window.hacked") is None
    assert tab.title() == tab.locator("h1").inner_text() == HOSTILE == info["lights"][0]
    assert HOSTILE in tab.locator("#version").inner_text()

    drawn = {}
    for name, version in zip(info["versions"], (asset, before, plain, before, open_surface), strict=True):
        page.call("setVersion", name)
        picture, mask = page.pixels()
        drawn[name] = picture
        error = np.abs(picture - expected_of(version, light))[inner(mask)]
        assert error.mean() <= EXACT, name
        assert np.quantile(error, 0.99) <= 3 * EXACT, name
    assert page.info()["kind"] == "unshadowed"
    assert "from normals" in tab.locator("#facts").inner_text()
    for one, other in (("Optimized", "Before"), ("Optimized", "Unshadowed"), ("Optimized", "Uncompressed")):
        assert np.abs(drawn[one] - drawn[other])[mask].mean() > EXACT, (one, other)

    # A line between two of them, left and right of it.
    tab.locator("#version").select_option("Optimized")
    tab.locator("#other").select_option("Before")
    tab.wait_for_function("() => diffprt.info.other === 1 && diffprt.info.version === 0")
    tab.locator("#wipe").fill("40")
    edge = round(0.4 * CAMERA.width)
    picture = page.pixels()[0]
    assert np.array_equal(picture[:, :edge], drawn["Optimized"][:, :edge])
    assert np.array_equal(picture[:, edge:], drawn["Before"][:, edge:])
    box = tab.locator("#wipe-handle").bounding_box()
    tab.mouse.move(box["x"] + 12, 200)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 82, 200)
    tab.mouse.up()
    assert page.info()["wipe"] == pytest.approx(0.5, abs=0.01)
    page.call("setCompare", None)

    # Fewer bands of the light.
    page.call("setOrder", 2)
    few = torch.zeros(16, 3)
    few[:4] = light.coefficients[:4]
    picture, mask = page.pixels()
    assert np.abs(picture - expected_of(asset, Light(few)))[inner(mask)].mean() <= EXACT
    page.call("setOrder", 4)

    # One pass or several, by the reader's hand.
    assert page.info()["path"] == "passes"
    tab.get_by_label("One pass").check(force=True)
    assert page.info()["path"] == "single"
    assert np.abs(page.pixels()[0] - drawn["Optimized"])[inner(mask)].max() <= 3 * EXACT

    # False colors are no picture of the light; triangles between passes are few.
    maps = {}
    for name, words in (("Clusters", "12 clusters"), ("Overdraw", "passes on average"), ("Error", "Squared error")):
        tab.get_by_label(name, exact=True).check(force=True)
        assert words in tab.locator("#legend").inner_text()
        maps[name] = page.pixels()[0][inner(mask)]
        assert maps[name].std() > 0.03
    blue = maps["Overdraw"][:, 2] > maps["Overdraw"][:, 0]
    assert 0.4 < blue.mean() < 0.99
    tab.get_by_label("None", exact=True).check(force=True)
    assert not tab.locator("#legend").is_visible()


def test_error_map_follows_the_error(family) -> None:
    asset, plain, _, _ = family
    error = versions.collect(asset, pack(asset), ExportOptions(uncompressed=plain)).error
    expected = (asset.decode().diffuse - plain.diffuse).square().sum((1, 2))
    np.testing.assert_allclose(error, expected.numpy(), rtol=1e-4, atol=1e-9)


def test_arrays_that_versions_share_are_stored_once(family, tmp_path) -> None:
    asset, _, before, _ = family
    alone = export(asset, tmp_path)["parts"]
    both = export(asset, tmp_path, before=before)["parts"]
    assert both["geometry"] == alone["geometry"]
    text = (tmp_path / "index.html").read_text()
    assert text.count('id="array:means') == 2 and text.count('id="array:weights') == 1


def test_large_transfer_leaves_its_error_map(family, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(versions, "MOST_UNCOMPRESSED_BYTES", 1000)
    asset, plain, _, _ = family
    report = export(asset, tmp_path, uncompressed=plain)
    assert len(report["left_out"]) == 1 and "uncompressed transfer" in report["left_out"][0]
    text = (tmp_path / "index.html").read_text()
    assert "Uncompressed" not in text.partition('id="manifest"')[2].partition("</script>")[0]
    assert 'id="array:error"' in text


def test_versions_that_cannot_be(family, glossy_assets, synthetic, tmp_path) -> None:
    asset, plain, before, _ = family
    other = synthetic.bumpy_sphere(4, 1, rows=20)
    higher = synthetic.bumpy_sphere(5, 1, rows=24)
    for options, words in [
        ({"before": other}, "'Before' has 861 vertices"),
        ({"uncompressed": before}, "give the transfer that was compressed"),
        ({"uncompressed": higher}, "has order 5, the asset 4"),
        ({"versions": {"Unshadowed": plain}}, "'Unshadowed' is taken"),
        ({"versions": {"a": torch.zeros(2)}}, "is a Tensor"),
        ({"versions": {"a": replace(glossy_assets[0], receivers=plain.receivers)}}, "compare like with like"),
    ]:
        with pytest.raises(InputError, match=words):
            export(asset, tmp_path, **options)
