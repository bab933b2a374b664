"""The desktop GLSL without a browser: drawn by moderngl, on Mesa or any other OpenGL 3.3, where there is one."""

from __future__ import annotations

import importlib
import math
import os

import numpy as np
import pytest

from diffprt.exporters import pack
from diffprt.exporters.shaders import shader_source
from diffprt.rendering import auto_exposure, render
from diffprt.scene import Camera
from diffprt.shading import tone_map

CAMERA = Camera((2.1, 1.3, -3.4), (0.1, -0.05, 0.0), fov=38.0, width=200, height=160)
EXACT = 1 / 255


@pytest.fixture(scope="module")
def context():
    """OpenGL without a window; with DIFFPRT_REQUIRE_BROWSER=1 its absence is a failure."""
    required = os.environ.get("DIFFPRT_REQUIRE_BROWSER") == "1"
    moderngl = importlib.import_module("moderngl") if required else pytest.importorskip("moderngl")
    try:
        made = moderngl.create_context(standalone=True, backend="egl", require=330)
    except Exception as error:
        (pytest.fail if required else pytest.skip)(f"no OpenGL 3.3 without a window: {error}")
    yield made
    made.release()


def table(context, rows: np.ndarray):
    """Rows of floats as a texture of four floats a texel, each row padded, in a width that is no multiple of one."""
    padded = np.zeros((len(rows), -(-rows.shape[1] // 4) * 4), dtype=np.float32)
    padded[:, : rows.shape[1]] = rows
    texels = padded.reshape(-1, 4)
    width = math.isqrt(len(texels)) + 1
    height = -(-len(texels) // width)
    filled = np.zeros((width * height, 4), dtype=np.float32)
    filled[: len(texels)] = texels
    texture = context.texture((width, height), 4, filled.tobytes(), dtype="f4")
    texture.filter = (context.NEAREST, context.NEAREST)
    return texture


def draw(context, name: str, uniforms: dict, tables: dict, attributes: list, indices=None, vertices=-1):
    """Display values [H, W, 3] and the mask, top row first."""
    sources = [shader_source(name, stage, "glsl") for stage in ("vertex", "fragment")]
    program = context.program(vertex_shader=sources[0], fragment_shader=sources[1])
    for unit, (key, rows) in enumerate(tables.items()):
        table(context, rows).use(unit)
        program[key] = unit
    for key, value in uniforms.items():
        program[key] = value
    contents = [(context.buffer(values.tobytes()), kind, key) for key, kind, values in attributes]
    array = context.vertex_array(
        program, contents, index_buffer=None if indices is None else context.buffer(indices.tobytes())
    )
    size = (CAMERA.width, CAMERA.height)
    target = context.simple_framebuffer(size, components=4)
    target.use()
    target.clear()
    context.enable(context.DEPTH_TEST)
    array.render(vertices=vertices)
    pixels = np.frombuffer(target.read(components=4), np.uint8).reshape(*size[::-1], 4)[::-1]
    return pixels[..., :3] / 255.0, pixels[..., 3] == 255


def shared_uniforms(asset, exposure: float) -> dict:
    near, far = CAMERA.depth_range(asset.receivers.positions)
    matrix = (CAMERA.projection(near, far) @ CAMERA.view()).T  # columns first in memory
    return {"projectionView": tuple(matrix.flatten().tolist()), "exposure": exposure, "curve": 2}


def compare(asset, light, drawn) -> None:
    view = asset.receivers.view(CAMERA)
    radiance = render(asset, light, CAMERA)
    exposure = auto_exposure(radiance, view.mask)
    picture, mask = drawn(shared_uniforms(asset, exposure))
    expected = tone_map(radiance, exposure=exposure, curve="aces").numpy()
    assert (mask != view.mask.numpy()).mean() < 0.001
    both = mask & view.mask.numpy()
    assert both.mean() > 0.2 and expected[both].std() > 0.05
    error = np.abs(picture - expected)[both]
    assert error.mean() <= EXACT
    # A pixel on an outline inside the picture may show either side.
    assert np.quantile(error, 0.99) <= 3 * EXACT


def test_clustered_diffuse(context, clustered, synthetic) -> None:
    light = synthetic.random_light(clustered.order, 3)
    signal = pack(clustered).signal
    entries = np.concatenate([signal["means"][:, None], signal["bases"]], axis=1)[:, :, 0]
    colors = (entries @ light.coefficients.numpy()).reshape(-1, 3)
    receivers = clustered.receivers

    def drawn(uniforms):
        return draw(
            context,
            "clustered_diffuse",
            {**uniforms, "components": clustered.components},
            {"clusters": colors, "weights": signal["weights"]},
            [
                ("position", "3f", receivers.positions.numpy()),
                ("albedo", "3f", receivers.albedo.numpy()),
                ("label", "1u", clustered.labels.numpy().astype(np.uint32)),
            ],
            receivers.faces.numpy().astype(np.uint32),
        )

    compare(clustered, light, drawn)


def test_glossy(context, glossy_assets, synthetic) -> None:
    asset = glossy_assets[0]
    light = synthetic.random_light(asset.order, 3)
    exit = asset.exit_radiance(light).transpose(1, 2).reshape(-1, 3).numpy()
    receivers = asset.receivers
    faces = receivers.faces.numpy()

    def drawn(uniforms):
        return draw(
            context,
            "glossy",
            {**uniforms, "eye": CAMERA.eye, "order": asset.order_out},
            {
                "triangles": faces.astype(np.float32),
                "positions": receivers.positions.numpy(),
                "normals": receivers.normals.numpy(),
                "exit": exit,
            },
            [],
            vertices=faces.size,
        )

    compare(asset, light, drawn)
