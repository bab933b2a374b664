"""The versions of one asset that a page can show and compare: compressed, uncompressed, before, unshadowed, ..."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.exporters.packers.packed import Packed, floats
from diffprt.exporters.packers.registry import pack
from diffprt.exporters.web.template import page_classes
from diffprt.options import ExportOptions
from diffprt.representation import Representation

MOST_UNCOMPRESSED_BYTES = 20_000_000


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


def collect(asset: Representation, packed: Packed, options: ExportOptions, *, compared: bool = True) -> Versions:
    """The asset's versions; see `export`.

    Args:
        asset: the asset itself.
        packed: the same, for one pass.
        options: of the page.
        compared: whether the uncompressed transfer may be a version; its errors are kept either way.

    Raises:
        InputError: a version has other geometry or another order, a name is taken, `uncompressed` is compressed, or
            the page has no class for a version.
    """
    own_name = "Optimized" if options.before is not None else "Compressed" if asset.compressed else "Transfer"
    given: dict[str, Representation] = {} if options.before is None else {"Before": options.before}
    left_out: list[str] = []
    error = None
    if options.uncompressed is not None:
        error = _squared_error(asset, options.uncompressed)
        size = options.uncompressed.signal.numel() * 4
        if not compared:
            left_out.append("uncompressed transfer as a version, for the page to have the bytes asked for")
        elif size <= MOST_UNCOMPRESSED_BYTES:
            given["Uncompressed"] = options.uncompressed
        else:
            left_out.append(
                f"uncompressed transfer: {size / 1e6:.0f} MB, more than {MOST_UNCOMPRESSED_BYTES / 1e6:.0f} MB"
            )
    for name, version in options.versions.items():
        if name in (own_name, "Unshadowed", *given):
            raise InputError(f"version name '{name}' is taken: give another")
        given[name] = version
    own = packed.in_passes(options.registers)
    drawn = {own_name: own}
    for name, version in given.items():
        other = pack(version)
        _check_same(name, asset, version)
        if not np.array_equal(packed.geometry["indices"], other.geometry["indices"]):
            raise InputError(f"version '{name}' has other triangles than the asset: give versions of the same mesh")
        if packed.view_dependent != other.view_dependent:
            raise InputError(f"version '{name}' is '{other.kind}', the asset '{packed.kind}': compare like with like")
        drawn[name] = other if other.passes is None else other.in_passes(options.registers)
    if own.unshadowed is not None:
        drawn["Unshadowed"] = replace(own.unshadowed, geometry=own.geometry)
    for version in drawn.values():
        if version.page not in (known := page_classes()):
            raise InputError(
                f"'{version.kind}' names the page class '{version.page}', which web/page/representations.js has not: "
                f"name one of {', '.join(known)} in its Packed, or add a class there"
            )
    return Versions(drawn, error, tuple(left_out))


def _squared_error(asset: Representation, uncompressed: Representation) -> np.ndarray:
    if uncompressed.compressed:
        raise InputError(f"uncompressed is a {type(uncompressed).__name__}: give the transfer that was compressed")
    _check_same("uncompressed", asset, uncompressed)
    shown, truth = (signal.detach().float() for signal in (asset.decode().signal, uncompressed.signal))
    if shown.shape[2:] != truth.shape[2:]:
        raise InputError(
            f"uncompressed transfer has shape {list(truth.shape)}, the asset stands for {list(shown.shape)}: "
            "give the transfer that was compressed"
        )
    return floats((shown - truth).square().flatten(1).sum(1))


def _check_same(name: str, asset: Representation, version: Representation) -> None:
    # One of them may have been rounded already.
    bits = min(asset.elements.bits, version.elements.bits)
    ours, theirs = (one.elements.in_bits(bits).positions for one in (asset, version))
    if not torch.equal(ours, theirs):
        raise InputError(
            f"version '{name}' has {len(theirs)} vertices that are not the asset's {len(ours)}: "
            "give versions of the same mesh"
        )
    if asset.order != version.order:
        raise InputError(f"version '{name}' has order {version.order}, the asset {asset.order}: give the same order")
