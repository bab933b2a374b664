"""Clustered transfer as the tensors of a file: numbers in their formats, with the ranges of those in eight bits."""

from __future__ import annotations

import torch

from diffprt.compression.clustered.quantize import LEVELS, Quantized, dequantize, quantize
from diffprt.errors import InputError
from diffprt.representation.spec import FLOATS, Spec, TensorSpec

_FORMATS = {torch.uint8: "uint8", torch.float16: "float16"}
_NUMBERS = ("means", "bases", "weights")
_LABEL_TYPES = (torch.uint8, torch.uint16, torch.int32)
_CODES = (*FLOATS, "float16", "uint8")
_RANGES = tuple(f"{name}_{part}" for name in _NUMBERS for part in ("offsets", "steps"))


def clustered_spec(*axes: str) -> Spec:
    """The tensors of a file with clusters of signals [axes], and of the ranges of what is in eight bits."""
    ranges = {name: TensorSpec((f"{name} rows", f"{name} columns"), ("float32",), optional=True) for name in _RANGES}
    return {
        "labels": TensorSpec(("V",), ("uint8", "uint16", "int32"), per_element=True, index_of="M"),
        "means": TensorSpec(("M", *axes), _CODES, trainable=True),
        "bases": TensorSpec(("M", "P", *axes), _CODES, trainable=True),
        "weights": TensorSpec(("V", "P"), _CODES, per_element=True, trainable=True),
        **ranges,
    }


def to_tensors(
    labels: torch.Tensor,
    means: torch.Tensor,
    bases: torch.Tensor,
    weights: torch.Tensor,
    weights_format: str,
    bases_format: str,
) -> dict[str, torch.Tensor]:
    """The arguments as a file holds them, in their shapes, and `RANGES` of what is in eight bits.

    Weights have a range for each cluster and component, bases for each of theirs, means for each cluster.
    """
    whole = {"means": means, "bases": bases, "weights": weights}
    tensors = {"labels": labels.to(_label_type(len(means)))}
    for name, values, format, ranges in (
        ("means", means.flatten(1)[:, None], bases_format, None),
        ("bases", bases, bases_format, None),
        ("weights", weights, weights_format, labels),
    ):
        if format == "float32":
            tensors[name] = whole[name]
            continue
        stored = quantize(values, format, ranges=ranges)
        tensors[name] = stored.codes.reshape(whole[name].shape)
        if format == "uint8":
            tensors |= {f"{name}_offsets": stored.offsets, f"{name}_steps": stored.steps}
    return tensors


def stored_shapes(
    receivers: int,
    clusters: int,
    components: int,
    signal: tuple[int, ...],
    weights_format: str,
    bases_format: str,
    dtype: torch.dtype = torch.float32,
) -> dict[str, tuple[torch.dtype, tuple[int, ...]]]:
    """Dtype and shape of what `to_tensors` makes, of signals of shape `signal` in `dtype` where bits are not saved."""
    codes = {"float32": dtype, "float16": torch.float16, "uint8": torch.uint8}
    found: dict[str, tuple[torch.dtype, tuple[int, ...]]] = {
        "labels": (_label_type(clusters), (receivers,)),
        "means": (codes[bases_format], (clusters, *signal)),
        "bases": (codes[bases_format], (clusters, components, *signal)),
        "weights": (codes[weights_format], (receivers, components)),
    }
    ranges = {"means": (bases_format, 1), "bases": (bases_format, components), "weights": (weights_format, components)}
    for name, (format, columns) in ranges.items():
        if format == "uint8":
            found |= {f"{name}_{part}": (torch.float32, (clusters, columns)) for part in ("offsets", "steps")}
    return found


def _label_type(clusters: int) -> torch.dtype:
    return next(t for t in _LABEL_TYPES if clusters <= torch.iinfo(t).max + 1)


def from_tensors(tensors: dict[str, torch.Tensor]) -> dict:
    """The arguments of `ClusteredSignal` that `to_tensors` made tensors of; others are passed on.

    Raises:
        InputError: ranges are missing, or not those of the clusters and components.
    """
    labels, clusters = tensors["labels"].to(torch.int64), len(tensors["means"])
    known = len(labels) > 0 and 0 <= int(labels.min()) <= int(labels.max()) < clusters
    found: dict = {key: value for key, value in tensors.items() if key not in (*_NUMBERS, *_RANGES)}
    found["labels"] = labels
    for name in _NUMBERS:
        codes, ranges = tensors[name], labels if name == "weights" else None
        if codes.dtype not in _FORMATS:
            found[name] = codes
            continue
        rows = codes.flatten(1)[:, None] if name == "means" else codes
        wanted = (clusters, rows.shape[1]) if codes.dtype == torch.uint8 else (0,)
        offsets, steps = (tensors.get(f"{name}_{part}", torch.zeros(0)) for part in ("offsets", "steps"))
        if (
            not tuple(offsets.shape) == tuple(steps.shape) == wanted
            or len(codes) != (clusters if ranges is None else len(ranges))
            or not known
        ):
            raise InputError(f"the ranges of {name} do not belong to its {tuple(codes.shape)} codes: compress again")
        if not bool(torch.isfinite(offsets + LEVELS * steps).all()):
            raise InputError(f"the ranges of {name} reach beyond what float32 holds: compress again")
        found[name] = dequantize(Quantized(rows, offsets, steps), ranges=ranges).reshape(codes.shape)
    # A float64 signal with weights in few bits comes back in float64 as a whole.
    wide = torch.float64 if any(tensors[name].dtype == torch.float64 for name in _NUMBERS) else torch.float32
    found |= {name: found[name].to(wide) for name in _NUMBERS}
    found["weights_format"] = _FORMATS.get(tensors["weights"].dtype, "float32")
    found["bases_format"] = _FORMATS.get(tensors["bases"].dtype, "float32")
    return found
