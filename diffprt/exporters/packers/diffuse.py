"""Diffuse transfer: the vertex shader sums its coefficients against the light."""

from __future__ import annotations

import math

import numpy as np
import torch

from diffprt import sh
from diffprt.exporters.packers.packed import Packed, floats, surface_arrays
from diffprt.transfer import Transfer


def pack_diffuse(asset: Transfer) -> Packed:
    """Uncompressed diffuse transfer."""
    geometry = surface_arrays(asset.receivers, albedo=True)
    return Packed(
        kind="diffuse",
        page="diffuse",
        programs=("diffuse",),
        geometry=geometry,
        signal={"transfer": floats(asset.diffuse)},
        numbers={"channels": asset.channels, "coefficients": asset.order**2},
        facts={"order": asset.order, "channels": asset.channels},
        equation="radiance = albedo / pi * sum_k transfer[vertex, c, k] light[k]",
        tables=("transfer",),
        unshadowed=unshadowed(asset.order, geometry),
    )


def unshadowed(order: int, geometry: dict[str, np.ndarray]) -> Packed:
    """The open surface's clamped cosine, which the page rotates to every normal: no signal is stored."""
    bands = torch.arange(order, dtype=torch.float64)
    zonal = sh.clamped_cosine(order).double() * torch.sqrt(4 * math.pi / (2 * bands + 1))
    return Packed(
        kind="unshadowed",
        page="unshadowed",
        programs=("diffuse",),
        geometry=geometry,
        signal={},
        numbers={"channels": 1, "coefficients": order**2, "zonal": zonal.tolist()},
        facts={"order": order, "channels": 1},
    )
