"""The page in a notebook: a frame, and a widget that Python and the reader both move."""

from __future__ import annotations

import builtins
import html
import json
import re

import pytest

from diffprt.errors import InputError
from diffprt.exporters import show
from diffprt.exporters.web import notebook
from diffprt.exporters.web.notebook import Frame, host_script

HOST = """<!doctype html><link rel=icon href="data:,"><body><script type="module">
const state = new Map(Object.entries(__STATE__));
const listeners = new Map();
window.model = {
  get: (name) => state.get(name),
  set: (name, value) => {
    if (JSON.stringify(state.get(name)) === JSON.stringify(value)) return;
    state.set(name, value);
    listeners.get(`change:${name}`)?.();
  },
  save_changes: () => { window.saved = (window.saved ?? 0) + 1; },
  on: (event, action) => listeners.set(event, action),
  off: (event) => listeners.delete(event),
};
const source = __SCRIPT__;
const { default: widget } = await import(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
window.leave = widget.render({ model, el: document.body });
</script>"""


@pytest.fixture
def no_anywidget(monkeypatch):
    notebook._widget_class.cache_clear()
    taken = builtins.__import__

    def refuse(name, *arguments, **options):
        if name == "anywidget":
            raise ImportError(name)
        return taken(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", refuse)
    yield
    notebook._widget_class.cache_clear()


def test_a_frame_holds_the_whole_page(clustered, synthetic, no_anywidget) -> None:
    frame = show(clustered, synthetic.random_light(4, 1), height=300, title='a "b" <c>')
    assert isinstance(frame, Frame)
    shown = frame._repr_html_()
    inside = re.fullmatch(r'<iframe srcdoc="([^"]*)" [^>]*height: 300px[^>]*></iframe>', shown)[1]
    assert html.unescape(inside) == frame.page
    assert "<title>a &quot;b&quot; &lt;c&gt;</title>" in frame.page


def test_mistakes_are_told(clustered, synthetic) -> None:
    with pytest.raises(InputError, match="height is 5"):
        show(clustered, height=5)
    with pytest.raises(InputError, match="project the light with order=4"):
        show(clustered, synthetic.random_light(3, 1))


def test_host_and_page_move_each_other(clustered, synthetic, no_anywidget, browser, tmp_path) -> None:
    """The script that anywidget runs, in a real frame, around a model made by hand."""
    first, second = synthetic.random_light(4, 1), synthetic.random_light(4, 2)
    page = show(clustered, first).page
    state = {"page": page, "height": 200, "coefficients": [], "azimuth": 0, "elevation": 0, "eye": [], "target": []}

    def script_value(value) -> str:
        return json.dumps(value).replace("<", "\\u003c")

    text = HOST.replace("__STATE__", script_value(state)).replace("__SCRIPT__", script_value(host_script()))
    (tmp_path / "host.html").write_text(text)
    context = browser.new_context(viewport={"width": 300, "height": 240}, reduced_motion="reduce")
    tab = context.new_page()
    complaints = []
    tab.on("console", lambda message: message.type in ("error", "warning") and complaints.append(message.text))
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.goto(f"file://{tmp_path / 'host.html'}")

    # The page tells what it shows.
    tab.wait_for_function("() => window.saved > 0", timeout=20000)
    assert tab.evaluate("model.get('coefficients')") == pytest.approx(first.coefficients.flatten().tolist())
    assert len(tab.evaluate("model.get('eye')")) == 3
    inside = next(frame for frame in tab.frames if frame != tab.main_frame)

    # Python sets, the page follows.
    tab.evaluate("(light) => model.set('coefficients', light)", second.coefficients.flatten().tolist())
    tab.evaluate("() => { model.set('azimuth', 40); model.set('eye', [0, 1, 5]); }")
    inside.wait_for_function("() => diffprt.info.azimuth === 40")
    assert inside.evaluate("diffprt.info.light") == pytest.approx(second.coefficients.flatten().tolist())

    # The reader moves, Python hears of it.
    inside.evaluate("() => diffprt.setCameraLookAt({ eye: [3, 0, 0], target: [0, 0, 0] })")
    tab.wait_for_function("() => Math.abs(model.get('eye')[0] - 3) < 1e-6")
    context.close()
    assert not complaints, complaints


def test_widget_has_light_and_view(clustered, synthetic, peer) -> None:
    peer("anywidget")
    light, other = synthetic.random_light(4, 1), synthetic.random_light(4, 2)
    widget = show(clustered, light, height=222)
    assert widget.height == 222 and widget.page.startswith("<!doctype html>") and widget.light is None
    widget.light = other
    assert widget.light.coefficients.tolist() == other.coefficients.tolist()
    assert widget.camera.eye == tuple(widget.eye)
    with pytest.raises(InputError, match="project it with order=4"):
        widget.light = synthetic.random_light(3, 1)
