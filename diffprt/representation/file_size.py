"""How large a file will be, before anything that it holds has been computed."""

from __future__ import annotations

import json
from collections.abc import Mapping

import torch

from diffprt.representation.files import header_of
from diffprt.representation.header import KEY, header_text
from diffprt.representation.interface import Representation
from diffprt.representation.provenance import Provenance

Shapes = Mapping[str, tuple[torch.dtype, tuple[int, ...]]]

# As safetensors calls them, widest first: tensors stand in a file in this order.
_NAMES = {
    torch.float64: "F64",
    torch.int64: "I64",
    torch.float32: "F32",
    torch.int32: "I32",
    torch.float16: "F16",
    torch.uint16: "U16",
    torch.uint8: "U8",
}
WIDEST = -2.2250738585072014e-308  # no number's text is longer


def file_size(kind: type[Representation], provenance: Provenance, shapes: Shapes) -> int:
    """Bytes of the file of an asset.

    Args:
        kind: its type.
        provenance: how it was made; `unmeasured` where that is not known yet.
        shapes: dtype and shape of every tensor by name, as files hold them.
    """
    header: dict = {"__metadata__": {KEY: header_text(header_of(kind, provenance))}}
    offset = 0
    for name, (dtype, shape) in sorted(shapes.items(), key=lambda item: (-item[1][0].itemsize, item[0])):
        size = torch.Size(shape).numel() * dtype.itemsize
        entry = {"dtype": _NAMES[dtype], "shape": list(shape), "data_offsets": [offset, offset + size]}
        header[name], offset = entry, offset + size
    # JSON's text is ASCII already, and safetensors writes it without blanks, in a multiple of 8 bytes.
    text = len(json.dumps(header, separators=(",", ":")))
    return 8 + (text + 7) // 8 * 8 + offset


def size_in_file(asset: Representation) -> int:
    """Bytes of the file that `save` would write of an asset."""
    return file_size(type(asset), asset.provenance, shapes_of({**asset.stored(), **asset.elements.stored()}))


def shapes_of(tensors: Mapping[str, torch.Tensor]) -> dict[str, tuple[torch.dtype, tuple[int, ...]]]:
    """Dtypes and shapes of tensors."""
    return {name: (tensor.dtype, tuple(tensor.shape)) for name, tensor in tensors.items()}


def unmeasured(*names: str) -> dict[str, float]:
    """Entries of a certificate that are yet to be measured, as wide as any number."""
    return dict.fromkeys(names, WIDEST)
