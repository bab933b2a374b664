"""BRDFs that diffprt does not know: checked before anything is computed with them, and told from one another."""

from __future__ import annotations

import hashlib
import math

import torch

from diffprt.brdf.description import BRDFS, describe_brdf
from diffprt.brdf.interface import Brdf
from diffprt.errors import InputError

_PAIRS = 64
# How far the lobe may change with both directions turned, as a share of its largest value.
_TURNED = 1e-5


def is_own(brdf: Brdf) -> bool:
    """Whether it is of a class beside those of `BRDFS`."""
    return type(brdf) not in BRDFS.values()


def check_brdf(brdf: Brdf) -> None:
    """Refuses a BRDF of a user's own that tables cannot be made of; what diffprt knows is not asked.

    Raises:
        InputError: weights that are no tensors, a width that is not above 0, or a lobe of another shape, that is not
            finite, below 0, or not isotropic.
    """
    if not is_own(brdf):
        return
    name = type(brdf).__name__
    for weight in ("diffuse", "specular"):
        if not isinstance(getattr(brdf, weight), torch.Tensor):
            raise InputError(f"{name} has an unchecked {weight}: call super().__init__(diffuse=..., specular=...)")
    width = float(brdf.width)
    if not 0 < width < math.inf:
        raise InputError(f"{name}.width is {width}: give the angle within which the lobe changes [radians], above 0")
    incoming, outgoing = _pairs()
    with torch.no_grad():
        lobe = brdf.lobe(incoming, outgoing)
        if not isinstance(lobe, torch.Tensor) or tuple(lobe.shape) not in {(_PAIRS, 1), (_PAIRS, 3)}:
            found = list(lobe.shape) if isinstance(lobe, torch.Tensor) else type(lobe).__name__
            raise InputError(f"{name}.lobe gives {found} for [{_PAIRS}, 3]: give [{_PAIRS}, 1], or three colors")
        if lobe.shape[1] > brdf.channels:
            raise InputError(f"{name}.lobe has 3 colors and channels is {brdf.channels}: let its property be 3")
        if not bool((torch.isfinite(lobe) & (lobe >= 0)).all()):
            worst = lobe[~(torch.isfinite(lobe) & (lobe >= 0))][0]
            raise InputError(f"{name}.lobe has a value of {float(worst)}: give finite ones of 0 or more")
        turned = brdf.lobe(*(_turned(directions) for directions in (incoming, outgoing)))
        change = float((turned - lobe).abs().max()) / (float(lobe.abs().max()) or 1.0)
    if change > _TURNED:
        raise InputError(
            f"{name}.lobe is not isotropic, it changes by {100 * change:.2g} % when both directions turn about the "
            "normal: use their z, and the angle between them about it, alone"
        )


def recorded(brdf: Brdf) -> tuple[dict, str]:
    """The BRDF as plain values for an asset's settings, and why a file cannot hold it, "" where it can."""
    try:
        return describe_brdf(brdf), ""
    except InputError as error:
        kind = type(brdf)
        return {"name": f"{kind.__module__}.{kind.__qualname__}"}, str(error)


def mark(brdf: Brdf) -> str:
    """SHA-256 of its values at fixed directions: one of the same name and parameters may reflect otherwise."""
    with torch.no_grad():
        values = brdf.evaluate(*_pairs()).double()
    return hashlib.sha256(values.cpu().contiguous().numpy().tobytes()).hexdigest()


def _pairs() -> tuple[torch.Tensor, torch.Tensor]:
    """Fixed directions above the surface, float64 [N, 3] each; the first half of them nearly mirrors of each other."""
    generator = torch.Generator().manual_seed(7)
    incoming, outgoing = torch.randn(2, _PAIRS, 3, generator=generator, dtype=torch.float64).unbind()
    near = incoming[: _PAIRS // 2] * torch.tensor([-1.0, -1.0, 1.0]) + 0.1 * outgoing[: _PAIRS // 2]
    outgoing = torch.cat([near, outgoing[_PAIRS // 2 :]])
    above = [torch.cat([d[:, :2], d[:, 2:].abs() + 0.2], dim=1) for d in (incoming, outgoing)]
    first, second = (torch.nn.functional.normalize(d, dim=1) for d in above)
    return first, second


def _turned(directions: torch.Tensor) -> torch.Tensor:
    """Turned about the normal by one radian."""
    c, s = math.cos(1.0), math.sin(1.0)
    x, y, z = directions.unbind(-1)
    return torch.stack([c * x - s * y, s * x + c * y, z], dim=-1)
