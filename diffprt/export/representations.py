"""What each kind of asset hands to the graphics card: the one place to extend for a new representation.

A new kind is a function here, an entry in `_PACKERS`, a vertex shader in `page/` and an entry in
`page/representations.js`; the fragment shader, the controls and the file around them stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from diffprt.compress.clustered import ClusteredTransfer
from diffprt.errors import InputError
from diffprt.transfer import Transfer


@dataclass(frozen=True)
class Packed:
    """An asset's signal in the form that the page uploads.

    Attributes:
        kind: the entry in `page/representations.js` that takes it.
        shader: the vertex shader that reads it, a file of `page/`.
        arrays: float32 or unsigned arrays by name, C order.
        numbers: the sizes that the shader needs to find its way in the arrays.
        facts: the sizes that a reader wants to see beside them.
    """

    kind: str
    shader: str
    arrays: dict[str, np.ndarray]
    numbers: dict[str, int]
    facts: dict[str, int]


def pack(asset: Transfer | ClusteredTransfer) -> Packed:
    """The arrays, sizes and shader of an asset.

    Raises:
        InputError: there is no shader for this type, or not for its size.
    """
    packer = _PACKERS.get(type(asset))
    if packer is None:
        known = " or ".join(kind.__name__ for kind in _PACKERS)
        raise InputError(f"asset is a {type(asset).__name__}, which has no shader: give a {known}")
    return packer(asset)


def _pack_plain(asset: Transfer) -> Packed:
    return Packed(
        kind="diffuse",
        shader="diffuse.vert.glsl",
        arrays={"transfer": floats(asset.diffuse)},
        numbers={"channels": asset.channels, "coefficients": asset.order**2},
        facts={"order": asset.order, "channels": asset.channels},
    )


def _pack_clustered(asset: ClusteredTransfer) -> Packed:
    sizes = {"channels": asset.channels, "clusters": asset.clusters, "components": asset.components}
    return Packed(
        kind="clustered_diffuse",
        shader="clustered_diffuse.vert.glsl",
        arrays={
            "labels": _smallest_unsigned(asset.labels, asset.clusters),
            "means": floats(asset.means),
            "bases": floats(asset.bases),
            "weights": floats(asset.weights),
        },
        numbers={**sizes, "coefficients": asset.order**2},
        facts={"order": asset.order, **sizes},
    )


def floats(tensor: torch.Tensor) -> np.ndarray:
    """float32 values of any floating tensor, on the CPU and in C order."""
    return np.ascontiguousarray(tensor.detach().to("cpu", torch.float32).numpy())


def _smallest_unsigned(labels: torch.Tensor, count: int) -> np.ndarray:
    dtype = np.uint8 if count <= 1 << 8 else np.uint16 if count <= 1 << 16 else np.uint32
    return labels.detach().cpu().numpy().astype(dtype)


_PACKERS: dict[type, Callable[..., Packed]] = {Transfer: _pack_plain, ClusteredTransfer: _pack_clustered}
