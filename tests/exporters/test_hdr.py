"""Maps dropped on the page: read and projected as in Python, and refused without a trace when broken."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

import diffprt.exporters
from diffprt import bake
from diffprt.exporters import export
from diffprt.rendering import PictureWindow
from diffprt.scene import Camera, Environment, builtin_scene

HEIGHT, WIDTH = 16, 32


def rgbe(pixels: np.ndarray) -> np.ndarray:
    """Texels [H, W, 4], eight bits each."""
    largest = pixels.max(-1)
    mantissa, exponent = np.frexp(largest)
    scale = np.where(largest > 1e-32, mantissa * 256 / np.maximum(largest, 1e-38), 0)
    return np.concatenate(
        [(pixels * scale[..., None]), np.where(largest > 1e-32, exponent + 128, 0)[..., None]], -1
    ).astype(np.uint8)


def header(width: int = WIDTH, height: int = HEIGHT) -> bytes:
    return b"#?RADIANCE\nSOFTWARE=test\nFORMAT=32-bit_rle_rgbe\n\n" + f"-Y {height} +X {width}\n".encode()


def flat(texels: np.ndarray) -> bytes:
    return header() + texels.tobytes()


def runs(texels: np.ndarray) -> bytes:
    """The newer encoding: each row in four planes, of a run and of single bytes."""
    out = header()
    for row in texels:
        out += bytes([2, 2, WIDTH >> 8, WIDTH & 255])
        for plane in row.T:
            same = next((i for i in range(1, WIDTH) if plane[i] != plane[0]), WIDTH)
            out += bytes([128 + same, plane[0]])
            if same < WIDTH:
                out += bytes([WIDTH - same]) + plane[same:].tobytes()
    return out


@pytest.fixture(scope="module")
def texels() -> np.ndarray:
    generator = np.random.default_rng(5)
    pixels = generator.uniform(0.1, 2.0, (HEIGHT, WIDTH, 3))
    pixels[3, 20] = (900.0, 700.0, 400.0)
    pixels[8:, :9] = 0.25
    pixels[0] = 0
    return rgbe(pixels)


@pytest.fixture
def page(clustered, synthetic, tmp_path, open_page):
    export(clustered, tmp_path, lights={"Noon": synthetic.random_light(clustered.order, 1)})
    return open_page(tmp_path / "index.html", reduced_motion="reduce")


def test_maps_are_projected_as_in_python(texels, page, clustered, tmp_path) -> None:
    (tmp_path / "map.hdr").write_bytes(flat(texels))
    environment = Environment.load(tmp_path / "map.hdr")
    for order in (1, 4, 10):
        expected = environment.project(order).coefficients
        for content in (flat(texels), runs(texels)):
            found = page.call("projectHdr", base64.b64encode(content).decode(), order)
            found = torch.tensor(found).view(-1, 3)
            assert (found - expected).abs().max() < 1e-3 * expected.abs().max()

    # Through the file chooser it becomes a light, windowed, at most as bright as the first.
    first = torch.tensor(page.info()["light"]).view(-1, 3)
    page.tab.set_input_files("#map", tmp_path / "map.hdr")
    page.tab.wait_for_function("() => diffprt.info.lightIndex === 1")
    light = torch.tensor(page.info()["light"]).view(-1, 3)
    window = PictureWindow.of(clustered, Camera.framing(clustered.elements.subject))
    expected = window.project(environment).coefficients
    expected = expected * (light[0].sum() / expected[0].sum())
    assert light[0].sum() <= first[0].sum() * 1.001
    torch.testing.assert_close(light, expected, rtol=1e-3, atol=1e-3)
    assert page.tab.get_by_label("map").is_checked()


def older_runs(texels: np.ndarray) -> bytes:
    """The older encoding: a texel, then how often it comes again."""
    out = header()
    for row in texels:
        x = 0
        while x < WIDTH:
            same = next((i for i in range(x + 1, WIDTH) if (row[i] != row[x]).any()), WIDTH) - x
            out += row[x].tobytes() + (bytes([1, 1, 1, same - 1]) if same > 1 else b"")
            x += same
    return out


MEMORY = """
import { readFileSync } from "node:fs";
import { projectMap } from "./project_map.js";
import { readRadiance } from "./radiance_hdr.js";
const bytes = new Uint8Array(readFileSync(process.argv[2]));
let largest = 0;
for (const name of ["Uint8Array", "Float32Array", "Float64Array"]) {
  const whole = globalThis[name];
  globalThis[name] = class extends whole {
    constructor(...given) {
      super(...given);
      if (typeof given[0] === "number") largest = Math.max(largest, this.byteLength);
    }
  };
}
let said = "";
try {
  said = projectMap(readRadiance(bytes), 2)[0].toFixed(3);
} catch (error) {
  said = error.message;
}
console.log(JSON.stringify({ said, largest }));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="runs the page's parser in Node")
def test_files_cost_what_they_hold_not_what_they_promise(texels, tmp_path) -> None:
    """A file of 52 bytes that promises 11584 x 5792 texels took 805 MB."""
    page = Path(diffprt.exporters.__file__).parent / "web" / "page"
    for name in ("radiance_hdr.js", "project_map.js", "sh.js"):
        (tmp_path / name).write_text((page / name).read_text("utf-8"))
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "run.js").write_text(MEMORY)
    promise = b"#?RADIANCE\n\n-Y 5792 +X 11584\n"
    row = bytes([2, 2, 11584 >> 8, 11584 & 255])
    flat_texel, again = bytes([9, 9, 9, 130]), bytes([1, 1, 1, 255])
    cases = {
        "tiny": (promise + bytes(52 - len(promise)), "ends before its last row"),
        "no rows": (promise + bytes(4 * 5792), "ends before its last row"),
        "newer": (promise + row + bytes([255, 7] * 91 + [155, 7]) * 4 + bytes(30000), "ends before its last row"),
        "older": (promise + flat_texel + again * 2 + bytes(30000), "leaves its row"),
        "whole, older": (older_runs(texels), None),
        "whole, newer": (runs(texels), None),
    }
    found = {}
    for name, (content, words) in cases.items():
        (tmp_path / "x.hdr").write_bytes(content)
        done = subprocess.run(["node", "run.js", "x.hdr"], cwd=tmp_path, capture_output=True, text=True, check=True)
        found[name] = json.loads(done.stdout)
        assert words is None or words in found[name]["said"], (name, found[name])
        assert found[name]["largest"] < 1 << 20, (name, found[name])
    assert found["whole, older"]["said"] == found["whole, newer"]["said"]
    assert float(found["whole, newer"]["said"]) > 1


def test_the_page_chooses_the_window_that_python_chooses(tmp_path, open_page) -> None:
    asset = bake(builtin_scene("cornell", subdivisions=1), order=4, rays=128, bounces=0)
    chosen = PictureWindow.of(asset, Camera.framing(asset.elements.subject))
    export(asset, tmp_path)
    page, found = open_page(tmp_path / "index.html"), {}
    for column in range(0, WIDTH, 4):
        sun = np.full((HEIGHT, WIDTH, 3), 0.25)
        sun[4:6, column : column + 2] = 128.0
        (tmp_path / "sun.hdr").write_bytes(flat(rgbe(sun)))
        light = chosen.project(Environment.load(tmp_path / "sun.hdr"))
        text = base64.b64encode((tmp_path / "sun.hdr").read_bytes()).decode()
        answer = page.call("lightOfHdr", text)
        found[column] = answer["window"]
        assert answer["window"] == light.report["window"]
        own = torch.tensor(answer["coefficients"]).view(-1, 3)
        assert (own - light.coefficients).abs().max() < 1e-3 * light.coefficients.abs().max()
    assert len(set(found.values())) > 1, found
    page.tab.set_input_files("#map", tmp_path / "sun.hdr")
    page.tab.wait_for_function("() => diffprt.info.lightIndex === 1")
    for turn in ([1, 0, 0, 0, 1, 0, 0, 0, 1], [-1, 0, 0, 0, 1, 0, 0, 0, -1]):
        page.call("setLightRotation", turn)
        shown, mask = page.pixels()
        assert shown[~mask].max() < 1.0
    export(asset, tmp_path, window="hann")
    page.open(tmp_path / "index.html")
    assert page.call("lightOfHdr", text)["window"] == "hann"


def test_broken_maps_change_nothing(texels, page) -> None:
    whole = runs(texels)
    row = len(header())
    wide = bytearray(whole)
    wide[row + 4] = 255  # a run longer than the row
    cases = {
        "no.hdr": (b"GIF89a" + bytes(40), "not a Radiance picture"),
        "empty.hdr": (b"", "not a Radiance picture"),
        "short.hdr": (whole[:-40], "ends before its last row"),
        "flat.hdr": (flat(texels)[:-1], "ends before its last row"),
        "run.hdr": (bytes(wide), "a run that leaves its row"),
        "square.hdr": (header(16, 16) + bytes(16 * 16 * 4), "twice as wide as high"),
        "xyz.hdr": (whole.replace(b"_rgbe", b"_xyze"), "not RGBE"),
        "huge.hdr": (header(80000, 40000), "more than fits"),
        "up.hdr": (whole.replace(b"-Y 16 +X", b"+Y 16 +X"), "do not run from the top left"),
    }
    before, info = page.pixels()[0], page.info()
    for name, (content, words) in cases.items():
        script = """([name, text]) => {
          const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
          const transfer = new DataTransfer();
          transfer.items.add(new File([bytes], name));
          document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true }));
        }"""
        page.tab.evaluate(script, [name, base64.b64encode(content).decode()])
        page.tab.wait_for_function(f"() => document.querySelector('#message p').textContent.startsWith('{name}')")
        said = page.tab.locator("#message p").inner_text()
        assert words in said and said.endswith("nothing was changed."), said
        page.tab.get_by_role("button", name="Dismiss").click()
    assert page.info() == info
    assert np.array_equal(page.pixels()[0], before)
