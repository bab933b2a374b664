"""An asset in the form that a graphics card takes, with all that a page, glTF and shaders need to know of its kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.surface import Receivers


@dataclass(frozen=True, kw_only=True)
class Packed:
    """An asset in the form that a graphics card takes.

    Attributes:
        kind: what glTF calls it.
        page: the class that draws it, an entry in `web/page/representations.js`; empty where none does.
        programs: the shaders that draw it, of `diffprt.exporters.shaders`.
        geometry: arrays by name: positions, indices, normals and, where radiance is per albedo, albedo [V or 1, 3].
        signal: float32 or unsigned arrays by name, C order.
        numbers: the sizes that the shaders need to find their way in the arrays.
        facts: the sizes that a reader wants to see beside them, `order` among them.
        equation: of radiance, in the words that glTF carries; empty where glTF cannot carry the kind.
        tables: those of `signal` that glTF stores as they are; labels and weights are attributes of its vertices.
        conventions: by name, those that glTF states beside those of every asset.
        view_dependent: whether radiance depends on where the eye is.
        passes: makes the same of so many float4 registers a pass, for a kind that can be drawn in passes.
        unshadowed: what remains where nothing casts a shadow, for a kind where that follows from the normals.
    """

    kind: str
    page: str = ""
    programs: tuple[str, ...]
    geometry: dict[str, np.ndarray]
    signal: dict[str, np.ndarray]
    numbers: dict[str, int | list[float]]
    facts: dict[str, int | float]
    equation: str = ""
    tables: tuple[str, ...] = ()
    conventions: Mapping[str, str] = field(default_factory=dict)
    view_dependent: bool = False
    passes: Callable[[int], Packed] | None = None
    unshadowed: Packed | None = None

    def in_passes(self, registers: int | None) -> Packed:
        """Drawn in passes of so many float4 registers; as it is where `registers` is None.

        Raises:
            InputError: the kind is drawn in one pass only, or so few registers hold no cluster.
        """
        if registers is None:
            return self
        if self.passes is None:
            raise InputError(
                f"registers is {registers}, but what is '{self.kind}' is drawn in one pass: leave registers out, "
                "or compress diffuse transfer"
            )
        return self.passes(registers)


def surface_arrays(receivers: Receivers, *, albedo: bool) -> dict[str, np.ndarray]:
    """The geometry of receivers, with or without their albedo, which is stored once where it is the same for all."""
    arrays = {"positions": floats(receivers.positions)}
    if albedo:
        values = floats(receivers.albedo)
        arrays["albedo"] = values[:1] if bool((values == values[:1]).all()) else values
    indices = receivers.faces.detach().cpu().numpy().astype(np.uint32)
    # Pages are the same bytes only with names in this order.
    normals = {"normals": floats(receivers.normals)}
    return arrays | ({"indices": indices} | normals if albedo else normals | {"indices": indices})


def floats(tensor: torch.Tensor) -> np.ndarray:
    """float32 values of any floating tensor, on the CPU and in C order."""
    return np.ascontiguousarray(tensor.detach().to("cpu", torch.float32).numpy())
