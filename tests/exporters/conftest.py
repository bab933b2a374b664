"""A browser, and assets small enough to open in it many times."""

from __future__ import annotations

import base64
import math
import mimetypes
import os
import shutil
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from diffprt import sh
from diffprt.brdf import ModifiedPhong
from diffprt.compression import ClusteredGlossyTransfer, ClusteredTransfer, compress
from diffprt.exporters import export_glb, write_three
from diffprt.representation import Provenance
from diffprt.scene import Light, Scene
from diffprt.surface import Receivers
from diffprt.transfer import GlossyTransfer, Transfer, bake_glossy

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
]


def bumpy_sphere(order: int, channels: int, *, rows: int = 40) -> Transfer:
    """A dented ball whose transfer is a clamped cosine, dimmed in the dents and, with C = 3, tinted."""
    t = torch.linspace(0.0, math.pi, rows + 1, dtype=torch.float64)
    p = torch.linspace(0.0, 2 * math.pi, 2 * rows + 1, dtype=torch.float64)
    t, p = (grid.reshape(-1) for grid in torch.meshgrid(t, p, indexing="ij"))
    direction = torch.stack([t.sin() * p.sin(), t.cos(), t.sin() * p.cos()], dim=1)
    bump = (5 * direction[:, 0]).sin() * (4 * direction[:, 1] + 1).sin() * (5 * direction[:, 2]).cos()
    positions = direction * (1 + 0.12 * bump)[:, None]
    corner = torch.arange(rows)[:, None] * (2 * rows + 1) + torch.arange(2 * rows)
    a, b, c, d = (corner + step for step in (0, 2 * rows + 1, 2 * rows + 2, 1))
    faces = torch.cat([torch.stack(three, -1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))])
    edges = positions[faces]
    normals = torch.zeros_like(positions)
    area = torch.linalg.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    normals.index_add_(0, faces.reshape(-1), area.repeat_interleave(3, 0))
    seam = torch.arange(rows + 1)[:, None] * (2 * rows + 1) + torch.tensor([0, 2 * rows])
    normals[seam] = normals[seam].sum(1, keepdim=True)
    normals[: 2 * rows + 1] = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    normals[-2 * rows - 1 :] = torch.tensor([0.0, -1.0, 0.0], dtype=torch.float64)
    normals = torch.nn.functional.normalize(normals, dim=1)

    cosine = sh.rotate_zonal(sh.clamped_cosine(order), normals) * (0.72 + 0.28 * bump)[:, None]
    tint = torch.ones(len(positions), channels, dtype=torch.float64)
    if channels == 3:
        tint = 1 + 0.35 * torch.sin(2.3 * positions + torch.tensor([0.0, 2.0, 4.0]))
    albedo = 0.55 + 0.25 * torch.sin(3 * positions.float() + torch.tensor([0.0, 1.0, 2.0]))
    receivers = Receivers(positions.float(), normals.float(), albedo, faces)
    return Transfer((tint[:, :, None] * cosine[:, None, :]).float(), receivers)


def cluster(transfer: Transfer, clusters: int, components: int) -> ClusteredTransfer:
    """Clusters by facing, and the leading components of each: enough structure to exercise every lookup."""
    seeds = torch.randn(clusters, 3, generator=torch.Generator().manual_seed(3))
    labels = (transfer.receivers.normals @ torch.nn.functional.normalize(seeds, dim=1).T).argmax(1)
    signal = transfer.diffuse.flatten(1)
    means = torch.zeros(clusters, signal.shape[1])
    bases = torch.zeros(clusters, components, signal.shape[1])
    for m in labels.unique().tolist():
        rows = signal[labels == m]
        means[m] = rows.mean(0)
        axes = torch.linalg.svd(rows - means[m], full_matrices=False).Vh[:components]
        bases[m, : len(axes)] = axes
    weights = torch.einsum("vpd,vd->vp", bases[labels], signal - means[labels])
    shape = transfer.diffuse.shape[1:]
    return ClusteredTransfer(
        labels,
        means.unflatten(1, shape),
        bases.unflatten(2, shape),
        weights,
        transfer.receivers,
        Provenance(
            certificate={
                "image": {"rmse": 0.0123, "worst": 3},
                "note": "a </script> & a NaN",
                "nan": math.nan,
            }
        ),
    )


def random_light(order: int, seed: int) -> Light:
    """A bright sky of all bands, different in each channel."""
    generator = torch.Generator().manual_seed(seed)
    band = sh.band_of_index(order)
    coefficients = torch.randn(order**2, 3, generator=generator) * (1.1 / (1.0 + band) ** 0.7)[:, None]
    coefficients[0] = torch.tensor([3.0, 2.7, 2.4])
    return Light(coefficients)


class Page:
    """An exported page in a tab, with everything it said and asked for."""

    def __init__(self, tab) -> None:
        self.tab = tab
        self.complaints: list[str] = []
        self.requests: list[str] = []
        tab.on("console", lambda m: m.type in ("error", "warning") and self.complaints.append(m.text))
        tab.on("pageerror", lambda error: self.complaints.append(str(error)))
        tab.on("request", lambda request: self.requests.append(request.url))

    def open(self, path, ready: bool = True) -> None:
        self.tab.goto(f"file://{path}")
        if ready:
            self.tab.evaluate("() => window.diffprt.ready")

    def call(self, name: str, *arguments):
        return self.tab.evaluate(f"(list) => window.diffprt.{name}(...list)", list(arguments))

    def calls(self, *list_of_calls) -> None:
        """Several calls [name, *arguments] before the page draws again."""
        script = "(list) => { for (const [name, ...given] of list) window.diffprt[name](...given); }"
        self.tab.evaluate(script, [list(call) for call in list_of_calls])

    def info(self) -> dict:
        return self.tab.evaluate("() => window.diffprt.info")

    def pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Display values in [0, 1] [H, W, 3], and the mask [H, W] of the asset."""
        answer = self.call("pixels")
        raw = np.frombuffer(base64.b64decode(answer["data"]), np.uint8)
        raw = raw.reshape(answer["height"], answer["width"], 4)
        return raw[..., :3] / 255.0, raw[..., 3] == 255


@pytest.fixture(scope="session")
def browser():
    """Headless Chromium, drawing in software; with DIFFPRT_REQUIRE_BROWSER=1 its absence is a failure."""
    reason = None
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        reason = "playwright is not installed"
    if path is None:
        reason = f"none of {', '.join(BROWSERS)} is on the path"
    if reason:
        (pytest.fail if os.environ.get("DIFFPRT_REQUIRE_BROWSER") == "1" else pytest.skip)(reason)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield chromium
        chromium.close()


class NodeModules(type(Path())):
    """The folder of tests/exporters/package.json's packages, and the program that runs them."""

    node = shutil.which("node")


@pytest.fixture(scope="session")
def node_modules() -> NodeModules:
    """three and gltf-validator from npm; with DIFFPRT_REQUIRE_BROWSER=1 their absence is a failure."""
    folder = NodeModules(Path(__file__).parent / "node_modules")
    if folder.node is None or not (folder / "three").is_dir() or not (folder / "gltf-validator").is_dir():
        required = os.environ.get("DIFFPRT_REQUIRE_BROWSER") == "1"
        (pytest.fail if required else pytest.skip)("no node packages: npm ci --prefix tests/exporters")
    return folder


@pytest.fixture
def three_page(browser, node_modules, tmp_path):
    """three_page(asset, change=) -> the example page in a tab, from a server that is made of routes; `change(path)` may
    rewrite the .glb first."""
    context = browser.new_context(viewport={"width": 320, "height": 240})
    complaints = []

    def start(asset, change=lambda path: None, **options):
        export_glb(asset, tmp_path / "scene.glb", **options)
        change(tmp_path / "scene.glb")
        write_three(tmp_path)
        tab = context.new_page()
        tab.on("console", lambda message: message.type in ("error", "warning") and complaints.append(message.text))
        tab.on("pageerror", lambda error: complaints.append(str(error)))

        def answer(route):
            name = route.request.url.removeprefix("http://localhost/")
            inside = name.removeprefix("node_modules/")
            path = node_modules / inside if inside != name else tmp_path / name
            kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
            route.fulfill(body=path.read_bytes() if path.is_file() else b"", content_type=kind)

        tab.route("http://localhost/**", answer)
        tab.goto("http://localhost/example.html")
        tab.wait_for_function("() => window.mesh", timeout=15000)
        return tab

    yield start
    context.close()
    # Software rendering says of reading pixels that it waits.
    assert not [text for text in complaints if "ReadPixels" not in text], complaints


@pytest.fixture
def gpu_page(browser):
    """A tab in which navigator.gpu answers: it needs a page of this machine's own."""
    context = browser.new_context()
    tab = context.new_page()
    tab.route("http://localhost/", lambda route: route.fulfill(body="<!doctype html>", content_type="text/html"))
    tab.goto("http://localhost/")
    yield tab
    context.close()


@pytest.fixture
def open_page(browser):
    """open_page(path, **context options) -> Page; closed with the test, and checked for having been quiet."""
    opened = []

    @contextmanager
    def tab(**options):
        # Small, for a software rasterizer; tests of pictures set their own size by `resize`.
        context = browser.new_context(**{"viewport": {"width": 200, "height": 160}, **options})
        yield context.new_page()
        context.close()

    def start(path, *, ready: bool = True, script: str = "", **options) -> Page:
        manager = tab(**options)
        page = Page(manager.__enter__())
        opened.append((manager, page))
        if script:
            page.tab.add_init_script(script)
        page.open(path, ready)
        return page

    yield start
    for manager, page in opened:
        manager.__exit__(None, None, None)
        outside = [url for url in page.requests if not url.startswith(("file:", "data:", "blob:"))]
        assert not outside, outside
        assert not page.complaints, page.complaints


@pytest.fixture(scope="session")
def synthetic() -> SimpleNamespace:
    """The makers of this file, for tests that want other sizes than `plain` and `clustered` have."""
    return SimpleNamespace(bumpy_sphere=bumpy_sphere, cluster=cluster, random_light=random_light)


@pytest.fixture(scope="session")
def plain() -> Transfer:
    return bumpy_sphere(order=4, channels=1)


@pytest.fixture(scope="session")
def clustered(plain) -> ClusteredTransfer:
    return cluster(plain, clusters=12, components=5)


@pytest.fixture(scope="session")
def dented() -> Scene:
    """The dented ball's triangles: dents shadow each other a little, and no pixel spans much of one."""
    receivers = bumpy_sphere(order=1, channels=1, rows=24).receivers
    return Scene.from_mesh(receivers.positions, receivers.faces, normals=receivers.normals, name="dented ball")


@pytest.fixture(scope="session")
def glossy_assets(dented) -> tuple[GlossyTransfer, ClusteredGlossyTransfer]:
    """A partly shadowed surface with a Phong lobe, uncompressed and clustered."""
    glossy = bake_glossy(dented, ModifiedPhong(24.0), order=4, order_out=5, rays=64, bounces=0)
    return glossy, compress(glossy, clusters=6, components=7, iterations=4)
