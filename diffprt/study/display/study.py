"""What a frame costs in a browser: clusters in one pass, in passes of super-clusters, and uncompressed transfer."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from diffprt.compression import compress
from diffprt.errors import InputError
from diffprt.exporters import Packed, export, pack
from diffprt.options import takes
from diffprt.options.study import DisplayOptions
from diffprt.scene import Scene
from diffprt.study.timing import paired_ratio, spread
from diffprt.transfer import Transfer, bake

_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# Software rendering, so that figures mean the same on every machine of as many cores.
_ARGUMENTS = ("--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_WARM_UP = 3


@takes(DisplayOptions)
def display_study(source: str | Transfer, asked: DisplayOptions) -> dict[str, Any]:
    """Times whole frames of the exported page in headless Chromium, which draws in software.

    Every round draws `frames` frames each way, first under a light at rest, then under one that turns a little before
    every frame, and keeps the medians; ratios are taken within a round.

    Args:
        source: a scene file, builtin:NAME, or diffuse transfer.
        order, rays: of the bake, where `source` is a scene.

    Returns:
        {"settings", "counts", "rows", "ratios"}: a row for each way with milliseconds "still" and "turning" (median,
        quartiles, runs), triangles drawn per frame, bytes of the signal, and multiplications that a light costs the
        processor; ratios of milliseconds to those of one pass.

    Raises:
        InputError: there is no Chromium, or playwright is not installed.
    """
    transfer = baked(source, asked.say, order=asked.order, rays=asked.rays, bounces=0)
    asked.say(f"compressing into {asked.clusters} clusters")
    clustered = compress(transfer, clusters=asked.clusters, components=asked.components, registers=asked.registers)
    ways = {
        "one pass": (clustered, asked.registers, "single"),
        "passes": (clustered, asked.registers, "passes"),
        "uncompressed": (transfer, None, "single"),
    }
    times: dict[str, dict[str, list[float]]] = {name: {"still": [], "turning": []} for name in ways}
    with running_browser(asked.browser) as running, _pages(running, ways, asked.size) as pages:
        facts = {name: page.evaluate("window.diffprt.info") for name, page in pages.items()}
        for round_ in range(-1, asked.rounds):  # the first one warms up
            asked.say(f"round {round_ + 1} of {asked.rounds}")
            for name, page in pages.items():
                for motion in ("still", "turning"):
                    call = "([count, turning]) => window.diffprt.timeFrames(count, turning)"
                    taken = page.evaluate(call, [asked.frames if round_ >= 0 else _WARM_UP, motion == "turning"])
                    if round_ >= 0:
                        times[name][motion].append(spread(taken)["median"])
    return {
        "settings": asked.settings("rays") | {"clusters": clustered.clusters, "order": transfer.order},
        "counts": {
            "vertices": len(transfer.receivers),
            "triangles": len(transfer.receivers.faces),
            "passes": facts["passes"]["passes"],
            "overdraw": facts["passes"]["overdraw"],
        },
        "rows": [
            {
                "way": name,
                "still_ms": spread(times[name]["still"]),
                "turning_ms": spread(times[name]["turning"]),
                "triangles_drawn": _triangles_drawn(facts[name], path),
                "signal_bytes": sum(array.nbytes for array in packed.signal.values()),
                "light_products": _light_products(packed),
            }
            for name, (asset, _, path) in ways.items()
            for packed in (pack(asset),)
        ],
        "ratios": {
            name: {motion: paired_ratio(times[name][motion], times["one pass"][motion]) for motion in times[name]}
            for name in ways
            if name != "one pass"
        },
    }


def _triangles_drawn(facts: dict[str, Any], path: str) -> int:
    """Passes draw every triangle once for its depth, and once for each super-cluster that it touches."""
    return round(facts["triangles"] * (1 + facts["overdraw"])) if path == "passes" else facts["triangles"]


def _light_products(packed: Packed) -> int:
    """Multiplications by which the processor meets a light: none, or each cluster's mean and components."""
    sizes = packed.numbers
    return sizes.get("clusters", 0) * (sizes.get("components", 0) + 1) * 3 * sizes["coefficients"]


def baked(source: str | Transfer, say: Callable[[str], None], **options: int) -> Transfer:
    """The transfer, or that of a scene file."""
    if not isinstance(source, str):
        return source
    say(f"baking {source}")
    return bake(Scene.load(source), **options)


@contextmanager
def running_browser(running: Any = None) -> Iterator[Any]:
    """`running`, or a new one.

    Raises:
        InputError: there is no Chromium, or playwright is not installed.
    """
    if running is not None:
        yield running
        return
    path = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if path is None:
        raise InputError(f"there is no browser on the path: install one of {', '.join(_BROWSERS)}")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise InputError("playwright, which drives the browser, is not installed: pip install playwright") from None
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(_ARGUMENTS))
        yield browser
        browser.close()


@contextmanager
def _pages(browser: Any, ways: dict[str, tuple], size: int) -> Iterator[dict[str, Any]]:
    """Every way's page, open and set to draw that way."""
    with tempfile.TemporaryDirectory() as folder:
        # Small until it is told its size: what is drawn while a page opens is not timed.
        context = browser.new_context(viewport={"width": 200, "height": 160})
        pages = {}
        for name, (asset, registers, path) in ways.items():
            file = export(asset, Path(folder) / name, registers=registers)["path"]
            page = pages[name] = context.new_page()
            page.goto(f"file://{file}")
            page.evaluate("() => window.diffprt.ready")
            if path not in page.evaluate("window.diffprt.info.paths"):
                raise InputError(f"this browser has fewer than {registers} registers: give fewer")
            page.evaluate("([path, size]) => { diffprt.setPath(path); diffprt.resize(size, size); }", [path, size])
            page.evaluate("() => diffprt.setBackground('grey')")
        yield pages
        context.close()
