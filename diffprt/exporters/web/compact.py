"""Arrays in few bytes, for a page: codes of 16 bits, differences between rows that follow each other, planes of bytes,
deflate.

`page/payload.js` undoes it. Positions and albedo are fixed point over their range, column by column; normals are
octahedral, in two codes; a signal is half floats times a power of two, which keep a relative error of 2^-11 whatever
the signal's scale; labels and indices are kept exactly.
"""

from __future__ import annotations

import base64
import math
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffprt.surface.octahedral import octahedral

_LEVEL = 6  # of deflate: the file is a few percent larger than at 9, in a fraction of the time
_MOST_CODE = 65535
# Rows of these follow each other over the surface.
_COHERENT = ("positions", "albedo", "normals", "indices", "labels")


@dataclass(frozen=True)
class Compact:
    """An array as a page holds it.

    Attributes:
        text: base64 of deflated bytes.
        form: what `page/payload.js` needs to read it.
    """

    text: str
    form: dict[str, Any]


def compact(name: str, array: np.ndarray) -> Compact:
    """Codes of one array.

    Args:
        name: its name in `Packed`, which says what it holds.
        array: float32 or unsigned integers, any shape; rows are along its first axis.
    """
    rows = array.reshape(len(array), -1) if array.ndim > 1 else array.reshape(-1, 1)
    if array.dtype.kind == "u":
        codes, form = rows, {"as": "numbers"}
    elif name == "normals":
        codes, form = octahedral(rows), {"as": "octahedral"}
    elif name in ("positions", "albedo"):
        codes, form = _fixed_point(rows)
    else:
        codes, form = _halves(rows)
    form |= {"code": codes.dtype.name, "rows": codes.shape[0], "width": codes.shape[1]}
    if name in _COHERENT:
        form = form | {"differences": True}
        codes = np.diff(codes, axis=0, prepend=np.zeros_like(codes[:1]))  # modulo the code's size
    planes = np.ascontiguousarray(codes.T).astype(codes.dtype.newbyteorder("<")).view(np.uint8)
    planes = np.ascontiguousarray(planes.reshape(-1, codes.dtype.itemsize).T)
    return Compact(base64.b64encode(zlib.compress(planes.tobytes(), _LEVEL)).decode("ascii"), form)


def _fixed_point(rows: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    wide = rows.astype(np.float64)
    low, high = wide.min(axis=0), wide.max(axis=0)
    step = np.where(high > low, (high - low) / _MOST_CODE, 1.0)
    codes = np.rint((wide - low) / step).astype(np.uint16)
    return codes, {"as": "fixed", "offset": low.tolist(), "step": step.tolist()}


def _halves(rows: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    """Scaled so that the largest number is about 2^14: what is smaller by 2^28 still has all its bits."""
    largest = float(np.abs(rows).max(initial=0.0))
    exponent = math.frexp(largest)[1] - 14 if largest > 0 and math.isfinite(largest) else 0
    halves = np.ldexp(rows.astype(np.float64), -exponent).astype(np.float16)
    return halves.view(np.uint16), {"as": "half", "scale": math.ldexp(1.0, exponent)}
