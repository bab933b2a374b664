"""The page in the hands of a reader: pointer, keys, panel, phone, and what it says when something fails."""

from __future__ import annotations

import numpy as np
import pytest

from diffprt.exporters import export

PHONE = {
    "viewport": {"width": 390, "height": 844},
    "has_touch": True,
    "is_mobile": True,
    "reduced_motion": "reduce",
}
DESKTOP = {"viewport": {"width": 680, "height": 400}, "reduced_motion": "reduce"}


@pytest.fixture
def exported(clustered, synthetic, tmp_path):
    lights = {name: synthetic.random_light(clustered.order, seed) for name, seed in (("Noon", 1), ("Dusk", 2))}
    export(clustered, tmp_path, lights=lights, exposure=0.5, title="Dented ball")
    return tmp_path / "index.html"


def picture_of(page) -> np.ndarray:
    return page.pixels()[0]


def changed(page, before: np.ndarray) -> float:
    """Mean absolute change since `before`, in display values."""
    return float(np.abs(picture_of(page) - before).mean())


def test_every_control_changes_the_picture(exported, open_page) -> None:
    page = open_page(exported, **DESKTOP)
    tab = page.tab
    tab.get_by_label("Grey", exact=True).check(force=True)

    def slide(name: str, key: str = "PageUp") -> None:
        tab.get_by_label(name, exact=True).focus()
        tab.keyboard.press(key)
        tab.keyboard.press(key)

    def drag(button: str = "left", shift: bool = False) -> None:
        if shift:
            tab.keyboard.down("Shift")
        tab.mouse.move(150, 200)
        tab.mouse.down(button=button)
        tab.mouse.move(210, 220, steps=3)
        tab.mouse.up(button=button)
        if shift:
            tab.keyboard.up("Shift")
        tab.wait_for_timeout(50)

    def wheel() -> None:
        tab.mouse.move(150, 200)
        tab.mouse.wheel(0, -200)
        tab.wait_for_timeout(50)

    def press(key: str) -> None:
        tab.locator("#view").focus()
        tab.keyboard.press(key)
        tab.wait_for_timeout(50)

    steps = {
        "light": lambda: tab.get_by_label("Dusk").check(force=True),
        "azimuth": lambda: slide("Azimuth"),
        "elevation": lambda: slide("Elevation"),
        "reset light": lambda: tab.get_by_role("button", name="Reset light").click(),
        "exposure": lambda: slide("Exposure", "PageDown"),
        "curve": lambda: tab.get_by_label("Linear").check(force=True),
        "background": lambda: tab.get_by_label("Dark").check(force=True),
        "sky": lambda: tab.get_by_label("Light", exact=True).and_(tab.locator("input")).check(force=True),
        "orbit": drag,
        "pan": lambda: drag("right"),
        "turn the light": lambda: drag(shift=True),
        "zoom": wheel,
        "arrow key": lambda: press("ArrowLeft"),
        "zoom key": lambda: press("-"),
        "light key": lambda: press("1"),
        "reset view": lambda: tab.get_by_role("button", name="Reset view").click(),
    }
    before = picture_of(page)
    for name, step in steps.items():
        step()
        assert changed(page, before) > 1 / 255, name
        before = picture_of(page)
    info = page.info()
    assert info["lightIndex"] == 0
    assert info["azimuth"] == pytest.approx(30.0)
    assert info["elevation"] == pytest.approx(10.0)
    assert info["exposure"] < 0.5
    assert info["curve"] == "linear"


def test_light_spins_until_told_otherwise(exported, open_page) -> None:
    page = open_page(exported, **DESKTOP)
    page.tab.locator("#view").focus()
    page.tab.keyboard.press("Space")
    page.tab.wait_for_function("() => window.diffprt.info.azimuth > 1")
    page.tab.get_by_role("button", name="Spin").click()
    assert not page.info()["spinning"]
    assert page.tab.locator("#frame-time").inner_text().endswith("ms")


def test_panel_hides_shows_and_gives_way(exported, open_page) -> None:
    page = open_page(exported, **DESKTOP)
    tab = page.tab

    def middle() -> float:
        columns = np.flatnonzero(page.pixels()[1].any(0))
        return float(columns[[0, -1]].mean())

    left = tab.locator("#panel").bounding_box()["x"]
    assert middle() == pytest.approx(left / 2, abs=30)
    tab.keyboard.press("h")
    assert not tab.locator("#panel").is_visible()
    assert middle() == pytest.approx(DESKTOP["viewport"]["width"] / 2, abs=30)
    tab.get_by_role("button", name="Controls").click()
    assert tab.locator("#panel").is_visible()
    assert tab.evaluate("document.activeElement.id") == "hide", "focus was lost with the button that had it"


def test_phone_shows_the_whole_asset_above_the_panel(exported, open_page) -> None:
    page = open_page(exported, device_scale_factor=2, **PHONE)
    _, mask = page.pixels()
    assert mask.shape == (1688, 780), "one pixel of the picture per pixel of the screen"
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    panel = page.tab.locator("#panel").bounding_box()
    assert panel["width"] == 390
    assert 0 < rows[0] < rows[-1] < 2 * panel["y"]
    assert 0 < columns[0] < columns[-1] < 779
    assert mask.mean() > 0.12
    assert page.tab.evaluate("document.documentElement.scrollWidth") == 390


def test_two_fingers_zoom_and_pan(exported, open_page) -> None:
    page = open_page(exported, **PHONE)
    touch = page.tab.context.new_cdp_session(page.tab)

    def fingers(kind: str, *places: tuple[int, int]) -> None:
        points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def box() -> tuple[float, float]:
        """Where the asset's middle row is, and how many pixels it covers."""
        mask = page.pixels()[1]
        return float(np.flatnonzero(mask.any(1))[[0, -1]].mean()), float(mask.sum())

    row, area = box()
    fingers("touchStart", (160, 200), (230, 200))
    fingers("touchMove", (180, 200), (210, 200))
    fingers("touchEnd")
    page.tab.wait_for_timeout(50)
    smaller_row, smaller_area = box()
    assert smaller_area < 0.6 * area
    assert smaller_row == pytest.approx(row, abs=8)
    fingers("touchStart", (160, 200), (230, 200))
    fingers("touchMove", (160, 260), (230, 260))
    fingers("touchEnd")
    page.tab.wait_for_timeout(50)
    lower_row, same_area = box()
    assert lower_row == pytest.approx(smaller_row + 60, abs=8), "the asset follows the fingers"
    assert same_area == pytest.approx(smaller_area, rel=0.05)


def test_page_is_labelled(exported, open_page) -> None:
    """Every control has a name and can be reached by the tab key."""
    tab = open_page(exported, **DESKTOP).tab
    controls = tab.locator("input, select, button:visible, canvas[tabindex], summary")
    assert controls.count() > 15
    nameless = controls.evaluate_all(
        "list => list"
        ".filter(e => !(e.getAttribute('aria-label') || e.labels?.length || e.textContent.trim()))"
        ".map(e => e.outerHTML)"
    )
    assert nameless == []
    reached = set()
    for _ in range(24):
        tab.keyboard.press("Tab")
        reached.add(tab.evaluate("document.activeElement.id || document.activeElement.name"))
    assert {
        "view",
        "hide",
        "light",
        "azimuth",
        "elevation",
        "spin",
        "exposure",
        "curve",
        "background",
        "order",
        "open-map",
        "version",
        "other",
    } <= reached
    facts = tab.locator("#facts").inner_text()
    assert all(words in facts for words in ("3,321", "6,400", "12 × 5", "1, uncolored"))
    assert "0.0123" in tab.locator("#certificate").text_content()
    assert tab.title() == "Dented ball"


def test_picture_can_be_saved(exported, open_page) -> None:
    tab = open_page(exported, **DESKTOP).tab
    with tab.expect_download() as download:
        tab.get_by_role("button", name="Save picture").click()
    assert download.value.suggested_filename == "Dented-ball.png"


def test_lost_context_is_told_and_restored(exported, open_page) -> None:
    page = open_page(exported)
    tab = page.tab
    before = picture_of(page)
    assert before.std() > 0.05
    tab.evaluate(
        "() => { const gl = document.getElementById('view').getContext('webgl2');"
        " window.loss = gl.getExtension('WEBGL_lose_context'); loss.loseContext(); }"
    )
    tab.wait_for_function("() => !document.getElementById('message').hidden")
    assert "graphics context was lost" in tab.locator("#message").inner_text()
    page.call("setExposure", 0.5)  # nothing to draw on: must not fail
    tab.evaluate("() => loss.restoreContext()")
    tab.wait_for_function("() => document.getElementById('message').hidden")
    assert changed(page, before) == 0
    page.complaints.clear()  # the browser itself warns of the loss


def test_page_says_why_it_cannot_draw(exported, open_page) -> None:
    page = open_page(exported, ready=False, script="HTMLCanvasElement.prototype.getContext = () => null;")
    message = page.tab.locator("#message")
    message.wait_for(state="visible")
    assert "no WebGL 2" in message.inner_text()
    picture = page.tab.locator("#fallback")
    assert picture.is_visible() and picture.get_attribute("alt") == "Dented ball, one picture"
    assert picture.evaluate("image => image.naturalWidth") == 256
    assert not page.tab.locator("#panel").is_visible()


def test_mistakes_of_scripts_are_told(exported, open_page) -> None:
    page = open_page(exported)
    before = picture_of(page)
    answers = {
        "setLight([1, 2, 3])": "transfer has 16 SH coefficients, light has 1: project the light with order=4",
        "setLight(Array(48).fill(NaN))": "48 finite ones are wanted",
        "setLightRotation([1])": "rotation has 1 numbers, 9",
        "setCamera({ view: [1], projection: [] })": "view has 1 numbers, 16",
        "setExposure(-1)": "give a positive factor",
        "setCurve('filmic')": "linear, reinhard, aces",
        "setOrder(5)": "give 1 to 4",
        "setHeat('error')": "use one of none, clusters, overdraw",
        "setBackground([1])": "background has 1 numbers, 3",
        "resize(0, 10)": "give 1 to",
    }
    for call, words in answers.items():
        script = f"() => {{ try {{ window.diffprt.{call}; }} catch (error) {{ return error.message; }} }}"
        assert words in page.tab.evaluate(script), call
    assert changed(page, before) == 0
    assert "use one of Compressed, Unshadowed" in page.tab.evaluate(
        "() => diffprt.setVersion('other').catch((error) => error.message)"
    )

    page.tab.evaluate("() => { setTimeout(() => { throw new Error('something broke'); }); }")
    message = page.tab.locator("#message")
    message.wait_for(state="visible")
    assert "Something broke." in message.inner_text()
    message.get_by_role("button", name="Dismiss").click()
    assert not message.is_visible()
    assert page.complaints == ["something broke"]
    page.complaints.clear()
