"""The versions of one asset that a page can show and compare: compressed, uncompressed, before, unshadowed, ..."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch

from diffprt import sh
from diffprt.compression import ClusteredGlossyTransfer, ClusteredTransfer
from diffprt.errors import InputError
from diffprt.exporters.packers import Exportable, Packed, floats, pack
from diffprt.transfer import GlossyTransfer, Transfer

MOST_UNCOMPRESSED_BYTES = 20_000_000
_CLUSTERED = (ClusteredTransfer, ClusteredGlossyTransfer)


@dataclass(frozen=True)
class Versions:
    """What a page holds.

    Attributes:
        packed: by the name shown, the asset itself first; geometry includes normals.
        error: squared error of each vertex's transfer, float32 [V], where uncompressed transfer was given.
        left_out: in words, what was given and is not in the page.
    """

    packed: dict[str, Packed]
    error: np.ndarray | None
    left_out: tuple[str, ...]


def collect(
    asset: Exportable,
    *,
    registers: int | None = None,
    versions: Mapping[str, Exportable] | None = None,
    uncompressed: Transfer | GlossyTransfer | None = None,
    before: Exportable | None = None,
) -> Versions:
    """The asset's versions; see `export`.

    Raises:
        InputError: a version has other geometry or another order, a name is taken, or `uncompressed` is compressed.
    """
    own = "Optimized" if before is not None else "Compressed" if isinstance(asset, _CLUSTERED) else "Transfer"
    given: dict[str, Exportable] = {} if before is None else {"Before": before}
    left_out: list[str] = []
    error = None
    if uncompressed is not None:
        error = _squared_error(asset, uncompressed)
        size = _signal(uncompressed).numel() * 4
        if size <= MOST_UNCOMPRESSED_BYTES:
            given["Uncompressed"] = uncompressed
        else:
            left_out.append(
                f"uncompressed transfer: {size / 1e6:.0f} MB, more than {MOST_UNCOMPRESSED_BYTES / 1e6:.0f} MB"
            )
    for name, version in (versions or {}).items():
        if name in (own, "Unshadowed", *given):
            raise InputError(f"version name '{name}' is taken: give another")
        given[name] = version
    packed = {own: _with_normals(pack(asset, registers=registers), asset)}
    for name, version in given.items():
        _check_same(name, asset, version)
        held = registers if isinstance(version, ClusteredTransfer) else None
        packed[name] = _with_normals(pack(version, registers=held), version)
    if isinstance(asset, (Transfer, ClusteredTransfer)):
        packed["Unshadowed"] = _unshadowed(packed[own], asset.order)
    return Versions(packed, error, tuple(left_out))


def _with_normals(packed: Packed, asset: Exportable) -> Packed:
    return replace(packed, geometry={**packed.geometry, "normals": floats(asset.receivers.normals)})


def _unshadowed(packed: Packed, order: int) -> Packed:
    """The open surface's clamped cosine, which the page rotates to every normal: no signal is stored."""
    bands = torch.arange(order, dtype=torch.float64)
    zonal = sh.clamped_cosine(order).double() * torch.sqrt(4 * math.pi / (2 * bands + 1))
    numbers = {"channels": 1, "coefficients": order**2, "zonal": zonal.tolist()}
    facts = {"order": order, "channels": 1}
    return Packed("unshadowed", ("diffuse",), packed.geometry, {}, numbers, facts)


def _signal(asset: Exportable) -> torch.Tensor:
    return asset.glossy if isinstance(asset, GlossyTransfer) else asset.diffuse


def _squared_error(asset: Exportable, uncompressed: Exportable) -> np.ndarray:
    if not isinstance(uncompressed, (Transfer, GlossyTransfer)):
        raise InputError(f"uncompressed is a {type(uncompressed).__name__}: give the transfer that was compressed")
    _check_same("uncompressed", asset, uncompressed)
    shown = _signal(asset.decode() if isinstance(asset, _CLUSTERED) else asset).detach().float()
    truth = _signal(uncompressed).detach().float()
    if shown.shape[2:] != truth.shape[2:]:
        raise InputError(
            f"uncompressed transfer has shape {list(truth.shape)}, the asset stands for {list(shown.shape)}: "
            "give the transfer that was compressed"
        )
    return floats((shown - truth).square().flatten(1).sum(1))


def _check_same(name: str, asset: Exportable, version: Exportable) -> None:
    ours, theirs = asset.receivers, getattr(version, "receivers", None)
    if theirs is None:
        raise InputError(f"version '{name}' is a {type(version).__name__}: give an asset")
    if not torch.equal(ours.positions, theirs.positions) or not torch.equal(ours.faces, theirs.faces):
        raise InputError(
            f"version '{name}' has {len(theirs)} vertices and {len(theirs.faces)} triangles that are not the asset's "
            f"{len(ours)} and {len(ours.faces)}: give versions of the same mesh"
        )
    if asset.order != version.order:
        raise InputError(f"version '{name}' has order {version.order}, the asset {asset.order}: give the same order")
    if _is_glossy(asset) != _is_glossy(version):
        raise InputError(f"version '{name}' is a {type(version).__name__}: compare like with like")


def _is_glossy(asset: Exportable) -> bool:
    return isinstance(asset, (GlossyTransfer, ClusteredGlossyTransfer))
