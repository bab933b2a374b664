"""Pictures of the exported page for the docs: as on a desktop and as on a phone, in a light and in a dark theme."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from diffprt.compression import compress
from diffprt.errors import InputError
from diffprt.exporters import export
from diffprt.exporters.web.lights import balanced_light
from diffprt.scene.procedural import builtin_environment
from diffprt.study.display.study import baked, running_browser
from diffprt.transfer import Transfer
from diffprt.whole_file import make_folder, write_whole

_DESKTOP = {"viewport": {"width": 1280, "height": 800}}
_PHONE = {"viewport": {"width": 390, "height": 844}, "device_scale_factor": 2, "is_mobile": True, "has_touch": True}
_QUALITY = 82
_LIGHTS = ("sky", "studio")
_STUDIO = "document.querySelector('input[name=light][value=\"1\"]').click();"
_DARK = "diffprt.setBackground('dark'); document.getElementById('legend').scrollIntoView({ block: 'center' });"
# Name, device, theme, and what the page is told before the picture is taken.
_SHOTS = (
    ("desktop_dark", _DESKTOP, "dark", ""),
    ("desktop_light", _DESKTOP, "light", ""),
    ("phone_dark", _PHONE, "dark", ""),
    ("phone_light", _PHONE, "light", ""),
    (
        "compare",
        _DESKTOP,
        "dark",
        f"{_STUDIO} await diffprt.setCompare('Unshadowed', 0.37); diffprt.setBackground('grey');",
    ),
    ("overdraw", _DESKTOP, "light", f"diffprt.setHeat('overdraw'); {_DARK}"),
    ("error", _PHONE, "dark", f"diffprt.setHeat('error'); {_DARK}"),
)


def display_pictures(
    source: str | Transfer,
    folder: str | Path,
    *,
    clusters: int = 64,
    components: int = 8,
    registers: int = 256,
    order: int = 6,
    rays: int = 256,
    bounces: int = 2,
    browser: Any = None,
    say: Callable[[str], None] = lambda text: None,
) -> list[Path]:
    """Exports a page with all that it can show, and photographs it in headless Chromium.

    Args:
        source: a scene file, builtin:NAME, or diffuse transfer.
        folder: where the pictures go, as JPEG.
        clusters, components, registers: of the asset.
        order, rays, bounces: of the bake, where `source` is a scene.
        browser: a playwright browser that is running already; without it, one is started.
        say: told what is being done.

    Returns:
        The files.

    Raises:
        InputError: there is no Chromium or no playwright, or the page complained.
    """
    transfer = baked(source, say, order=order, rays=rays, bounces=bounces)
    asset = compress(transfer, clusters=clusters, components=components, registers=registers)
    projected = {name: builtin_environment(name).project(asset.order, window="hann") for name in _LIGHTS}
    lights = {name: balanced_light(asset, light) for name, light in projected.items()}
    title = str(source).removeprefix("builtin:").capitalize() if isinstance(source, str) else "Transfer"
    folder = Path(folder)
    make_folder(folder)
    made = []
    with tempfile.TemporaryDirectory() as place, running_browser(browser) as running:
        page = export(asset, place, lights=lights, title=title, registers=registers, uncompressed=transfer)["path"]
        for name, device, theme, told in _SHOTS:
            say(f"taking {name}")
            made.append(_shoot(running, page, folder / f"{name}.jpg", {**device, "color_scheme": theme}, told))
    return made


def _shoot(browser: Any, page: str, path: Path, options: dict[str, Any], told: str) -> Path:
    context = browser.new_context(reduced_motion="reduce", **options)
    try:
        tab = context.new_page()
        complaints: list[str] = []
        tab.on("console", lambda message: message.type in ("error", "warning") and complaints.append(message.text))
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.goto(f"file://{page}")
        tab.evaluate(f"async () => {{ await diffprt.ready; {told} }}")
        tab.wait_for_timeout(400)
        picture = tab.screenshot(type="jpeg", quality=_QUALITY)
    finally:
        context.close()
    if complaints:
        raise InputError(f"the page complained: {complaints[0]}")
    return write_whole(path, picture, "picture")
