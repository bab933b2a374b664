"""Receivers in few bits, as files may hold them: positions over their box, octahedral normals, faces in few bytes.

Positions and albedo are 16-bit fixed point over their range, column by column: a coordinate moves by at most 1/131070
of the box's side. Normals are two octahedral codes, off by less than 0.004 degrees. An albedo that is the same
everywhere is one row in float32, and faces are in the smallest integers that hold them: both lose nothing. What was
rounded once is not changed again.
"""

from __future__ import annotations

import torch

from diffprt.errors import InputError
from diffprt.representation.spec import Spec, TensorSpec
from diffprt.surface.octahedral import octahedral, unfolded

BOX = "positions_box"
FEW_BITS: Spec = {
    "positions": TensorSpec(("V", 3), ("uint16",), per_element=True),
    BOX: TensorSpec((2, 3), ("float32",)),
    "normals": TensorSpec(("V", 2), ("uint16",), per_element=True),
    "albedo": TensorSpec(("rows of albedo", 3), ("float32", "uint16")),
    "albedo_box": TensorSpec((2, 3), ("float32",), optional=True, least=0, most=1),
    "faces": TensorSpec(("F", 3), ("uint8", "uint16", "int32"), index_of="V"),
}
_MOST_CODE = 65535
_INDEX_TYPES = (torch.uint8, torch.uint16, torch.int32)


def to_few_bits(
    positions: torch.Tensor, normals: torch.Tensor, albedo: torch.Tensor, faces: torch.Tensor
) -> dict[str, torch.Tensor]:
    """The tensors of `FEW_BITS`; of float [V, 3] thrice and int64 [F, 3]."""
    albedo = albedo.detach().cpu().float()
    index_type = next(t for t in _INDEX_TYPES if len(positions) <= torch.iinfo(t).max + 1)
    codes, box = _fixed_point(positions)
    found = {
        "positions": codes,
        BOX: box,
        # Some edges have two codes: the ones that they come back to.
        "normals": torch.from_numpy(octahedral(unfolded(octahedral(normals.detach().cpu().numpy())))),
        "faces": faces.to(index_type),
    }
    if bool((albedo == albedo[:1]).all()):
        return found | {"albedo": albedo[:1].clone()}
    codes, box = _fixed_point(albedo)
    return found | {"albedo": codes, "albedo_box": box}


def from_few_bits(tensors: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """The arguments of `to_few_bits` as they come back, by name.

    Raises:
        InputError: the albedo has neither one row nor one for each receiver, or lacks its range.
    """
    albedo, count = tensors["albedo"], len(tensors["positions"])
    ranged = albedo.dtype == torch.uint16
    if ranged != ("albedo_box" in tensors) or len(albedo) not in ((count,) if ranged else (1,)):
        raise InputError(
            f"albedo has {len(albedo)} rows of {str(albedo.dtype).removeprefix('torch.')} beside {count} receivers: "
            "give 1 of float32, or one for each of uint16 with their range"
        )
    if not ranged and not bool(((albedo >= 0) & (albedo <= 1)).all()):
        raise InputError(f"albedo reaches from {float(albedo.min()):.6g} to {float(albedo.max()):.6g}: give 0 to 1")
    return {
        "positions": _from_fixed_point(tensors["positions"], tensors[BOX]),
        "normals": torch.from_numpy(unfolded(tensors["normals"].numpy())),
        "albedo": _from_fixed_point(albedo, tensors["albedo_box"]) if ranged else albedo.expand(count, 3).contiguous(),
        "faces": tensors["faces"].to(torch.int64),
    }


def _fixed_point(values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Codes uint16 [V, 3] and the range of each column, float32 [2, 3]."""
    values = values.detach().cpu().float()
    box = torch.stack([values.amin(0), values.amax(0)])
    low, high = box.double()
    share = (values.double() - low) / torch.where(high > low, high - low, 1.0)
    return (share * _MOST_CODE).round().long().to(torch.uint16), box


def _from_fixed_point(codes: torch.Tensor, box: torch.Tensor) -> torch.Tensor:
    low, high = box.double()
    return (low + (high - low) * codes.double() / _MOST_CODE).float()
