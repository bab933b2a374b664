"""The law of pages, over the table of all kinds of asset: what they draw is what torch renders."""

import numpy as np
import pytest
from representations import REPRESENTATIONS

from diffprt import Camera, export, render, tone_map
from diffprt.errors import InputError
from diffprt.rendering import auto_exposure

EXACT = 1 / 255


@pytest.mark.parametrize("name", [name for name, case in REPRESENTATIONS.items() if case.drawn])
def test_a_page_draws_what_torch_renders(name, tmp_path, open_page):
    case = REPRESENTATIONS[name]
    asset, light = case.make(), case.lights(1.0, 0.5)
    camera = Camera.framing(asset.elements.positions, azimuth=35, elevation=20, width=64, height=48)
    mask = asset.elements.view(camera).mask
    radiance = render(asset, light, camera)
    exposure = 1.5 * auto_exposure(radiance, mask)
    export(asset, tmp_path, lights={"light": light}, camera=camera, exposure=exposure, curve="aces")
    page = open_page(tmp_path / "index.html")
    page.call("resize", camera.width, camera.height)
    picture, drawn = page.pixels()
    inside = drawn & mask.numpy()
    for axis in (0, 1):  # the outline is rasterized by rules of its own
        inside &= np.roll(inside, 1, axis) & np.roll(inside, -1, axis)
    assert inside.sum() > 300
    expected = tone_map(radiance, exposure=exposure, curve="aces").numpy()
    error = np.abs(picture - expected)[inside]
    assert expected[inside].std() > 0.05
    assert error.mean() <= EXACT
    # Where colors jump from face to face, a pixel on an edge may take either.
    assert np.quantile(error, 0.9 if name == "face_colors" else 0.99) <= 3 * EXACT


def test_a_kind_without_a_packer_is_named(tmp_path):
    with pytest.raises(InputError, match="a IrradianceVectors, which has no shader") as caught:
        export(REPRESENTATIONS["irradiance_vectors"].make(), tmp_path)
    assert "\n" not in str(caught.value)
