"""Assets with geometry in 32 or 16 bits, and what the rounding moves."""

from __future__ import annotations

from typing import TypeVar

import torch

from diffprt.options.ranges import check_geometry
from diffprt.representation.interface import Representation

DISPLACEMENT, DISPLACEMENT_RELATIVE, NORMALS = MEASURED = (
    "geometry_displacement",
    "geometry_displacement_relative",
    "geometry_normals_degrees",
)
Asset = TypeVar("Asset", bound=Representation)


def with_geometry(asset: Asset, bits: int) -> Asset:
    """The asset with geometry as it comes back from a file of so many bits.

    Args:
        asset: any representation; one in 16 bits already is not rounded again.
        bits: 32, or 16: positions move by at most 1/131070 of the side of their box on each axis, normals turn by
            less than 0.004 degrees, an albedo that varies moves by at most 1/131070 of its range.

    Returns:
        the asset, with what was moved in its certificate: `geometry_displacement` of a position at worst [scene units],
        `geometry_displacement_relative` (over the diagonal of the box of all) and `geometry_normals_degrees`.

    Raises:
        InputError: another number of bits, or elements that have no form in 16.
    """
    check_geometry(bits)
    before, after = asset.elements, asset.elements.in_bits(bits)
    if before.bits == after.bits:
        return asset
    changed = asset.with_elements(after)
    if bits != 16:
        return changed
    moved = float((after.positions.double() - before.positions.double()).norm(dim=1).max())
    size = float((before.positions.amax(0) - before.positions.amin(0)).double().norm()) or 1.0
    # The chord, since the cosine of so small an angle is 1.
    own = torch.nn.functional.normalize(before.normals.double(), dim=1)
    chord = float((after.normals.double() - own).norm(dim=1).max())
    found = {
        DISPLACEMENT: moved,
        DISPLACEMENT_RELATIVE: moved / size,
        NORMALS: float(torch.rad2deg(2 * torch.asin(torch.tensor(min(chord / 2, 1.0))))),
    }
    return changed.labeled(asset.provenance.also(certificate=found))
