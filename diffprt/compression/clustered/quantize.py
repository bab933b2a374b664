"""Weights and bases in fewer bits: float16, or uint8 over the range of each cluster and component."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from diffprt.compression.clusters.partition import whole_labels
from diffprt.errors import InputError
from diffprt.options.compress import FORMATS
from diffprt.options.ranges import check_choice

LEVELS = 255
_LARGEST_HALF = torch.finfo(torch.float16).max


@dataclass(frozen=True)
class Quantized:
    """Numbers in few bits: value = offset + step * code, both of the code's own range.

    Attributes:
        codes: float32, float16 or uint8 [N, P, ...].
        offsets, steps: float32 [R, P], of each range; empty unless the codes are uint8.
    """

    codes: torch.Tensor
    offsets: torch.Tensor
    steps: torch.Tensor

    @property
    def nbytes(self) -> int:
        """Bytes of the codes and their ranges."""
        return sum(t.numel() * t.element_size() for t in (self.codes, self.offsets, self.steps))


def stored_bytes(numbers: int, ranges: int, format: str, element_size: int = 4) -> int:
    """Bytes that `numbers` take in a format, with the offsets and steps of `ranges` ranges when they are uint8."""
    if format == "uint8":
        return numbers + 8 * ranges
    return numbers * (2 if format == "float16" else element_size)


def quantize(values: torch.Tensor, format: str, *, ranges: torch.Tensor | None = None) -> Quantized:
    """Numbers as they are stored.

    Args:
        values: float [N, P, ...]; the weights [V, P] of receivers, or the bases [M, P, D] of clusters.
        format: "float32"; "float16"; or "uint8", 256 levels from the least to the largest value of a range. A range
            holds one column p of all rows of one range number; whatever dimensions follow share it.
        ranges: [N], whole numbers of any type, range number of each row, such as its cluster; each row its own without.

    Raises:
        InputError: the format is unknown, or a value does not fit into float16.
    """
    check_choice("format", format, FORMATS)
    none = values.new_zeros(0, values.shape[1], dtype=torch.float32)
    values = values.detach()
    if format == "float32":
        return Quantized(values.float(), none, none)
    if format == "float16":
        largest = float(values.abs().max()) if values.numel() else 0.0
        if largest > _LARGEST_HALF:
            raise InputError(f"a value of {largest:g} is beyond float16's {_LARGEST_HALF:g}: use uint8 or float32")
        return Quantized(values.half(), none, none)
    ranges = None if ranges is None else whole_labels(ranges)
    offsets, steps = spans(values.float(), ranges)
    rows = torch.arange(len(values), device=values.device) if ranges is None else ranges
    shape = (len(values), values.shape[1]) + (1,) * (values.dim() - 2)
    offset, step = offsets[rows].view(shape), steps[rows].view(shape)
    # a range of zero width has step 0: its code is 0 and its value the offset
    codes = ((values - offset) / torch.where(step > 0, step, 1.0)).round().clamp(0, LEVELS)
    return Quantized(codes.to(torch.uint8), offsets, steps)


def dequantize(stored: Quantized, *, ranges: torch.Tensor | None = None) -> torch.Tensor:
    """The float32 numbers that `stored` stands for; `ranges` as given to `quantize`."""
    if stored.codes.dtype != torch.uint8:
        return stored.codes.float()
    rows = torch.arange(len(stored.codes), device=stored.codes.device) if ranges is None else whole_labels(ranges)
    shape = (len(stored.codes), stored.codes.shape[1]) + (1,) * (stored.codes.dim() - 2)
    return stored.offsets[rows].view(shape) + stored.steps[rows].view(shape) * stored.codes.float()


def rounded(values: torch.Tensor, format: str, *, ranges: torch.Tensor | None = None) -> torch.Tensor:
    """Values as they come back from storage, with gradients as if they had not been rounded (straight-through).

    Args:
        values: float [N, P, ...], may carry gradients.
        format, ranges: as in `quantize`.

    Returns:
        the shape and dtype of `values`, within half a step (uint8), or half a unit in the last place (float16).
        The gradient is passed on unchanged, which is what lets training see its rounding (Bengio et al. 2013).
    """
    stored = dequantize(quantize(values, format, ranges=ranges), ranges=ranges).to(values.dtype)
    if format == "float32":
        stored = values.detach()
    return values + (stored - values).detach() if values.requires_grad else stored


def spans(
    values: torch.Tensor, ranges: torch.Tensor | None, count: int | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Offset and step [R, P] of each range of float [N, P, ...]; `count` is R where the last ranges are empty."""
    flat = values.unsqueeze(-1).flatten(2)
    low, high = flat.amin(2), flat.amax(2)
    if ranges is not None:
        index = ranges[:, None].expand_as(low)
        start = low.new_zeros(int(ranges.max()) + 1 if count is None else count, low.shape[1])
        low = start.scatter_reduce(0, index, low, "amin", include_self=False)
        high = start.scatter_reduce(0, index, high, "amax", include_self=False)
    return low, (high - low) / LEVELS
