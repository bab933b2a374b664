"""The three.js module in Chromium, with three from npm, against the torch renderer."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from PIL import Image

from diffprt.exporters import ENGINES, to_engine
from diffprt.rendering import auto_exposure, render
from diffprt.scene import Camera
from diffprt.shading import tone_map

CAMERA = Camera((2.1, 1.3, -3.4), (0.1, -0.05, 0.0), fov=38.0, width=200, height=160)
EXACT = 1 / 255
KINDS = ("diffuse", "clustered_diffuse", "glossy", "clustered_glossy")

DRAW = """([light, eye, target, fov, size, exposure]) => {
  renderer.setAnimationLoop(null);
  renderer.setPixelRatio(1);
  renderer.setSize(...size);
  mesh.setLight(light);
  Object.assign(mesh, { exposure, curve: "aces" });
  const view = new THREE.PerspectiveCamera(fov, size[0] / size[1], 0.1, 20);
  view.position.set(...eye);
  view.lookAt(...target);
  const picture = new THREE.WebGLRenderTarget(...size);
  renderer.setRenderTarget(picture);
  renderer.setClearColor(0, 0);
  renderer.clear();
  renderer.render(scene, view);
  const pixels = new Uint8Array(size[0] * size[1] * 4);
  renderer.readRenderTargetPixels(picture, 0, 0, ...size, pixels);
  renderer.setRenderTarget(null);
  return Array.from(pixels);
}"""


def draw(tab, light: torch.Tensor, exposure: float) -> tuple[np.ndarray, np.ndarray]:
    size = [CAMERA.width, CAMERA.height]
    arguments = [light.flatten().tolist(), CAMERA.eye, CAMERA.target, CAMERA.fov, size, exposure]
    pixels = np.array(tab.evaluate(DRAW, arguments), dtype=np.uint8).reshape(CAMERA.height, CAMERA.width, 4)[::-1]
    return pixels[..., :3] / 255.0, pixels[..., 3] == 255


@pytest.mark.parametrize("name", KINDS)
def test_three_draws_what_torch_renders(name, plain, clustered, glossy_assets, synthetic, three_page) -> None:
    asset = (plain, clustered, *glossy_assets)[KINDS.index(name)]
    tab = three_page(asset, lights={"first": synthetic.random_light(asset.order, 1)})
    assert tab.evaluate("() => mesh.description.kind") == name
    view = asset.receivers.view(CAMERA)
    pictures = []
    for seed in (2, 3):
        light = synthetic.random_light(asset.order, seed)
        radiance = render(asset, light, CAMERA)
        exposure = auto_exposure(radiance, view.mask)
        picture, mask = draw(tab, light.coefficients, exposure)
        expected = tone_map(radiance, exposure=exposure, curve="aces").numpy()
        both = mask & view.mask.numpy()
        assert (mask != view.mask.numpy()).mean() < 0.001
        assert both.mean() > 0.2
        # A pixel on an outline inside the picture may show either side.
        error = np.abs(picture - expected)[both]
        assert error.mean() <= EXACT
        assert np.quantile(error, 0.99) <= 3 * EXACT
        pictures.append(picture[both])
    assert np.abs(pictures[0] - pictures[1]).mean() > 10 * EXACT


def test_lights_of_three_and_of_the_file(plain, synthetic, three_page) -> None:
    """A SphericalHarmonics3 is converted as `to_engine` says; the file's lights are there, the first one is on."""
    first = synthetic.random_light(plain.order, 1)
    tab = three_page(plain, lights={"first": first})
    lights = tab.evaluate("() => mesh.lights")
    np.testing.assert_array_equal(np.float32(lights["first"]), first.coefficients.flatten().numpy())
    light = synthetic.random_light(3, 5).coefficients
    stored = to_engine(light, "three.js")
    assert "three.js" in ENGINES
    script = """(rows) => {
      const sh = new THREE.SphericalHarmonics3();
      rows.forEach((row, i) => sh.coefficients[i].set(...row));
      mesh.setLight(sh);
      return Array.from(mesh.material.uniforms.light.value);
    }"""
    taken = torch.tensor(tab.evaluate(script, stored.tolist())).view(-1, 4)
    torch.testing.assert_close(taken[:9, :3], light, rtol=1e-6, atol=1e-6)
    assert not taken[9:].any()
    message = "() => { try { mesh.setLight([1, 2]); } catch (error) { return error.message; } }"
    assert "light has 2 numbers, 48 finite ones are wanted" in tab.evaluate(message)


def test_example_is_short_and_shows_something(clustered, synthetic, three_page, tmp_path) -> None:
    tab = three_page(clustered, lights={"first": synthetic.random_light(clustered.order, 1)})
    code = (tmp_path / "example.html").read_text().partition('<script type="module">')[2]
    assert len(code.strip().splitlines()) <= 20
    tab.wait_for_timeout(300)
    tab.screenshot(path=tmp_path / "shot.png")
    picture = np.asarray(Image.open(tmp_path / "shot.png").convert("RGB")) / 255.0
    assert (picture.max(-1) > 0.1).mean() > 0.1
