"""The page inside a notebook, with light and view known to Python where anywidget is installed."""

from __future__ import annotations

import html
from functools import lru_cache
from importlib.resources import files
from typing import Any

import torch

from diffprt.errors import InputError
from diffprt.exporters.web.export import page_of
from diffprt.options import ExportOptions
from diffprt.representation import Representation
from diffprt.scene import Light
from diffprt.scene.camera import Camera

_LEAST_HEIGHT, _MOST_HEIGHT = 100, 10_000


class Frame:
    """A page in an inline frame: what notebooks show of an object. Nothing comes back from it.

    Attributes:
        page: the page's HTML.
        height: of the frame [CSS pixels].
    """

    def __init__(self, page: str, height: int) -> None:
        self.page = page
        self.height = height

    def _repr_html_(self) -> str:
        # No "allow-same-origin": the page cannot reach the notebook it is shown in.
        return (
            f'<iframe srcdoc="{html.escape(self.page)}" sandbox="allow-scripts allow-downloads" '
            f'title="Relit asset" style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )


def show(asset: Representation, light: Light | None = None, *, height: int = 480, **options: Any) -> Any:
    """The asset in a notebook cell, relit as in the page of `export`.

    Where anywidget is installed (`pip install anywidget`) the result is a widget whose `light` [K, 3], `azimuth` and
    `elevation` [degrees], `eye` and `target` [scene units] follow the reader's hand, and move the picture when they
    are set. Without it, the result is a plain frame.

    Args:
        asset: diffuse or glossy transfer, plain or clustered, on receivers with faces.
        light: shown first, of the asset's order; without it, a plain sky with a sun.
        height: of the frame [CSS pixels], 100..10000.
        options: those of `diffprt.options.ExportOptions`, beside the lights.

    Raises:
        InputError: as `export`, or a height out of range.
    """
    if not _LEAST_HEIGHT <= height <= _MOST_HEIGHT:
        raise InputError(f"height is {height}: give {_LEAST_HEIGHT} to {_MOST_HEIGHT} pixels")
    page = page_of(asset, ExportOptions(lights=None if light is None else {"Light": light}, **options))
    text, view = page.content.decode(), page.camera
    try:
        widget = _widget_class()
    except ImportError:
        return Frame(text, height)
    return widget(asset.order, page=text, height=height, eye=list(view.eye), target=list(view.target))


def host_script() -> str:
    """The module that anywidget runs around the frame."""
    return (files("diffprt.exporters.web") / "anywidget" / "frame.js").read_text(encoding="utf-8")


@lru_cache(maxsize=1)
def _widget_class() -> type:
    """Made when first asked for: anywidget is optional.

    Raises:
        ImportError: anywidget is not installed.
    """
    import anywidget
    import traitlets

    class PageWidget(anywidget.AnyWidget):
        _esm = host_script()
        page = traitlets.Unicode().tag(sync=True)
        height = traitlets.Int(480).tag(sync=True)
        coefficients = traitlets.List(traitlets.Float()).tag(sync=True)
        azimuth = traitlets.Float(0.0).tag(sync=True)
        elevation = traitlets.Float(0.0).tag(sync=True)
        eye = traitlets.List(traitlets.Float()).tag(sync=True)
        target = traitlets.List(traitlets.Float()).tag(sync=True)

        def __init__(self, order: int, **values: Any) -> None:
            super().__init__(**values)
            self.order = order

        @property
        def light(self) -> Light | None:
            """The light that is on, before azimuth and elevation turn it; None until the page has opened."""
            values = torch.tensor(self.coefficients)
            return Light(values.view(-1, 3)) if len(values) else None

        @light.setter
        def light(self, light: Light) -> None:
            if light.order != self.order:
                raise InputError(f"light has order {light.order}: project it with order={self.order}")
            self.coefficients = [float(value) for value in light.coefficients.detach().flatten()]

        @property
        def camera(self) -> Camera:
            """The reader's view."""
            (x, y, z), (u, v, w) = self.eye, self.target
            return Camera((x, y, z), (u, v, w))

    return PageWidget
