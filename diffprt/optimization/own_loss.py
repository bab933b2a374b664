"""A loss of the user's own: any function of two pictures, called with as much as it takes."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, field

import torch

from diffprt.errors import InputError

# What a loss may be called with beside the two pictures, by place or by name.
_BESIDE = ("mask", "exposure")
_WRITE = "write it as loss(image, reference), with mask and exposure beside them if need be"


@dataclass(frozen=True)
class OwnLoss:
    """A callable as one of `IMAGE_LOSSES`.

    Attributes:
        name: in reports and checkpoints, module and name: never that of a loss of diffprt's.
        function: called with image and reference [H, W, 3] in linear radiance, 0 outside the mask; and with the mask,
            bool [H, W], and the reference's exposure, a number, where it asks for them.
        places: what it takes as third and fourth argument.
        names: what it takes by name.

    Raises:
        InputError: it takes another number of arguments.
    """

    name: str
    function: Callable[..., object]
    places: tuple[str, ...] = field(init=False)
    names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        places, names = _arguments(self.function, self.name)
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "names", names)

    def __call__(
        self, image: torch.Tensor, reference: torch.Tensor, mask: torch.Tensor, exposure: float
    ) -> torch.Tensor:
        """A scalar whose gradient reaches the image; raises InputError where the function gives anything else."""
        beside = {"mask": mask, "exposure": exposure}
        value = self.function(
            image, reference, *(beside[name] for name in self.places), **{name: beside[name] for name in self.names}
        )
        if not isinstance(value, torch.Tensor):
            raise InputError(f"loss '{self.name}' gave a {type(value).__name__}: return a tensor of one number")
        if value.numel() != 1 or value.is_complex():
            raise InputError(
                f"loss '{self.name}' gave {value.dtype} of shape {tuple(value.shape)}: return one number, its mean say"
            )
        if image.requires_grad and not value.requires_grad:
            raise InputError(
                f"loss '{self.name}' has no gradient to the picture: compute it with torch, without detach, item or "
                "no_grad"
            )
        return value.reshape(())

    def mark(self, picture: torch.Tensor, mask: torch.Tensor, exposure: float) -> str:
        """What the function says of a picture [H, W, 3] and a darker one, to the last bit: a resumed run compares it,
        since no name tells one function from another. The same for one that draws numbers by torch's generator."""
        ramp = torch.linspace(0.5, 0.9, picture.shape[0])[:, None, None]
        with torch.random.fork_rng(devices=[]), torch.no_grad():
            torch.manual_seed(0)
            return float(self(picture * ramp, picture, mask, exposure)).hex()


def own_name(function: Callable) -> str:
    """Module and name of a function, of what a partial stands for, or of the class of another callable."""
    if isinstance(function, functools.partial):
        return own_name(function.func)
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{getattr(named, '__module__', None) or 'builtins'}.{named.__qualname__}"


def _arguments(function: Callable, name: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What it takes beside two pictures, by place and by name."""
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):  # written in C, which says nothing of its arguments
        return (), ()
    by_place = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    any_number = any(p.kind == p.VAR_POSITIONAL for p in parameters)
    named = [p for p in parameters[2:] if p.name in _BESIDE and p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    others = [p for p in parameters if p.default is p.empty and p.name not in _BESIDE]
    required = [p for p in by_place[2:] if p in others]
    unknown = any(p.kind == p.KEYWORD_ONLY for p in others)
    if (len(by_place) < 2 and not any_number) or unknown or (required and named) or len(required) > len(_BESIDE):
        takes = ", ".join(p.name for p in parameters) or "nothing"
        raise InputError(f"loss '{name}' takes {takes}: {_WRITE}")
    return _BESIDE[: len(required)], tuple(p.name for p in named)
