"""What each kind of asset hands to the graphics card: the one place to extend for a new representation.

A new kind is a program in `shading/programs/`, a function here with its entry in `_PACKERS`, and a class in
`page/representations.js`; the controls and the file around them stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from diffprt.compression import ClusteredGlossyTransfer, ClusteredTransfer
from diffprt.errors import InputError
from diffprt.exporters.cluster_passes import by_passes
from diffprt.surface import Receivers
from diffprt.transfer import GlossyTransfer, Transfer

Exportable = Transfer | ClusteredTransfer | GlossyTransfer | ClusteredGlossyTransfer

# Uncompressed glossy transfer is for looking at small assets: V K_out K floats.
_MOST_GLOSSY_BYTES = 64 << 20


@dataclass(frozen=True)
class Packed:
    """An asset in the form that a graphics card takes.

    Attributes:
        kind: the entry in `page/representations.js` that takes it.
        programs: the shaders that draw it, of `diffprt.exporters.shaders`.
        geometry: arrays by name: positions, indices, and albedo or normals.
        signal: float32 or unsigned arrays by name, C order.
        numbers: the sizes that the shaders need to find their way in the arrays.
        facts: the sizes that a reader wants to see beside them.
    """

    kind: str
    programs: tuple[str, ...]
    geometry: dict[str, np.ndarray]
    signal: dict[str, np.ndarray]
    numbers: dict[str, int]
    facts: dict[str, int | float]


def pack(asset: Exportable, *, registers: int | None = None) -> Packed:
    """The arrays, sizes and shaders of an asset.

    Args:
        asset: diffuse or glossy transfer, plain or clustered.
        registers: float4 registers of a pass, for drawing clusters super-cluster by super-cluster; without it they
            are only drawn in one pass. Clustered diffuse transfer only.

    Raises:
        InputError: there is no shader for this type, or not for its size; registers for another type, or too few.
    """
    packer = _PACKERS.get(type(asset))
    if packer is None:
        known = " or ".join(kind.__name__ for kind in _PACKERS)
        raise InputError(f"asset is a {type(asset).__name__}, which has no shader: give a {known}")
    if registers is not None and not isinstance(asset, ClusteredTransfer):
        raise InputError(
            f"registers is {registers}, but a {type(asset).__name__} is drawn in one pass: leave registers out, "
            "or compress diffuse transfer"
        )
    return packer(asset) if registers is None else _pack_clustered(asset, registers)


def _pack_plain(asset: Transfer) -> Packed:
    return Packed(
        kind="diffuse",
        programs=("diffuse",),
        geometry=_diffuse_geometry(asset.receivers),
        signal={"transfer": floats(asset.diffuse)},
        numbers={"channels": asset.channels, "coefficients": asset.order**2},
        facts={"order": asset.order, "channels": asset.channels},
    )


def _pack_clustered(asset: ClusteredTransfer, registers: int | None = None) -> Packed:
    packed = Packed(
        kind="clustered_diffuse",
        programs=("clustered_diffuse",),
        geometry=_diffuse_geometry(asset.receivers),
        signal=_cluster_arrays(asset),
        numbers=_cluster_numbers(asset),
        facts={"order": asset.order, **_sizes(asset)},
    )
    return packed if registers is None else by_passes(packed, asset, registers)


def _pack_glossy(asset: GlossyTransfer) -> Packed:
    if asset.glossy.numel() * 4 > _MOST_GLOSSY_BYTES:
        raise InputError(
            f"uncompressed glossy transfer has {asset.glossy.numel() * 4 / 1e6:.0f} MB, more than "
            f"{_MOST_GLOSSY_BYTES / 1e6:.0f} MB: compress it first"
        )
    return Packed(
        kind="glossy",
        programs=("glossy_exit", "glossy"),
        geometry=_glossy_geometry(asset.receivers),
        signal={"transfer": floats(asset.glossy)},
        numbers={
            "channels": asset.channels,
            "coefficients": asset.order**2,
            "exitCoefficients": asset.order_out**2,
        },
        facts={"order": asset.order, "order_out": asset.order_out, "channels": asset.channels},
    )


def _pack_clustered_glossy(asset: ClusteredGlossyTransfer) -> Packed:
    return Packed(
        kind="clustered_glossy",
        programs=("clustered_glossy_exit", "glossy"),
        geometry=_glossy_geometry(asset.receivers),
        signal=_cluster_arrays(asset),
        numbers={**_cluster_numbers(asset), "exitCoefficients": asset.order_out**2},
        facts={"order": asset.order, "order_out": asset.order_out, **_sizes(asset)},
    )


def _sizes(asset: ClusteredTransfer | ClusteredGlossyTransfer) -> dict[str, int]:
    return {"channels": asset.channels, "clusters": asset.clusters, "components": asset.components}


def _cluster_numbers(asset: ClusteredTransfer | ClusteredGlossyTransfer) -> dict[str, int]:
    return {**_sizes(asset), "coefficients": asset.order**2}


def _cluster_arrays(asset: ClusteredTransfer | ClusteredGlossyTransfer) -> dict[str, np.ndarray]:
    return {
        "labels": _smallest_unsigned(asset.labels, asset.clusters),
        "means": floats(asset.means),
        "bases": floats(asset.bases),
        "weights": floats(asset.weights),
    }


def _diffuse_geometry(receivers: Receivers) -> dict[str, np.ndarray]:
    albedo = floats(receivers.albedo)
    uniform = bool((albedo == albedo[:1]).all())
    return {
        "positions": floats(receivers.positions),
        "albedo": albedo[:1] if uniform else albedo,
        "indices": _indices(receivers),
    }


def _glossy_geometry(receivers: Receivers) -> dict[str, np.ndarray]:
    return {
        "positions": floats(receivers.positions),
        "normals": floats(receivers.normals),
        "indices": _indices(receivers),
    }


def _indices(receivers: Receivers) -> np.ndarray:
    return receivers.faces.detach().cpu().numpy().astype(np.uint32)


def floats(tensor: torch.Tensor) -> np.ndarray:
    """float32 values of any floating tensor, on the CPU and in C order."""
    return np.ascontiguousarray(tensor.detach().to("cpu", torch.float32).numpy())


def _smallest_unsigned(labels: torch.Tensor, count: int) -> np.ndarray:
    dtype = np.uint8 if count <= 1 << 8 else np.uint16 if count <= 1 << 16 else np.uint32
    return labels.detach().cpu().numpy().astype(dtype)


_PACKERS: dict[type, Callable[..., Packed]] = {
    Transfer: _pack_plain,
    ClusteredTransfer: _pack_clustered,
    GlossyTransfer: _pack_glossy,
    ClusteredGlossyTransfer: _pack_clustered_glossy,
}
