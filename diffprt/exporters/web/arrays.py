"""The arrays of a page: every one once, however many versions of the asset hold it."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from diffprt.exporters.packers.packed import Packed
from diffprt.exporters.web.compact import compact


class ArrayStore:
    """Arrays of all versions, each once."""

    def __init__(self) -> None:
        self.forms: dict[str, dict[str, Any]] = {}
        self.elements: list[str] = []
        self.bytes = {"geometry": 0, "signal": 0}
        self._known: dict[tuple, str] = {}

    def add(self, name: str, array: np.ndarray, part: str = "signal") -> str:
        """The array's name in the page."""
        key = (name, array.dtype.str, array.shape, hashlib.sha256(np.ascontiguousarray(array).data).digest())
        if key not in self._known:
            held = self._known[key] = name if name not in self.forms else f"{name}.{len(self.forms)}"
            stored = compact(name, array)
            element = f'<script type="application/octet-stream;base64" id="array:{held}">{stored.text}</script>'
            self.forms[held] = stored.form | {"dtype": array.dtype.name}
            self.elements.append(element)
            self.bytes[part] += len(element) + 1
        return self._known[key]


def version_entry(name: str, packed: Packed, store: ArrayStore) -> dict[str, Any]:
    """What `page/payload.js` and `page/panel.js` need to know of a version, whose arrays go into the store."""
    geometry = {key: store.add(key, array, "geometry") for key, array in packed.geometry.items()}
    signal = {key: store.add(key, array) for key, array in packed.signal.items()}
    sizes = [sum(array.nbytes for array in part.values()) for part in (packed.geometry, packed.signal)]
    stored = sum(len(store.elements[list(store.forms).index(held)]) for held in signal.values())
    return {
        "name": name,
        "kind": packed.page,
        "numbers": packed.numbers,
        "facts": {
            **packed.facts,
            "geometry_bytes": sizes[0],
            "signal_bytes": sizes[1],
            "stored_bytes": stored,
        },
        "arrays": {**geometry, **signal},
    }
