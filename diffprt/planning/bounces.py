"""How many diffuse interreflections are simulated, and in how many channels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from diffprt.options.bake import CONVERGED
from diffprt.planning.confidence import CONFIDENCE, mean_above, mean_below, share_below
from diffprt.planning.decision import Decision, percent
from diffprt.planning.pilot import MOST_BOUNCES, Pilot, Walks

# Norms of an open receiver's transfer in one band, and in all: no receiver's has more.
_ONE_BAND, _ALL_BANDS = math.sqrt(math.pi) / 2, math.sqrt(2 * math.pi / 3)
# Fewer walks than these say too little about a bounce: the weakest contraction so far goes on.
_FEWEST_WALKS = 256


@dataclass(frozen=True)
class Contraction:
    """How reflected light fades.

    Attributes:
        terms: float64 [B + 1, C], RMS over receivers of (G A)^k 1, upper bounds; terms[0] is 1.
        factor: contraction from bounce to bounce beyond the walks; at 1 or above it never fades.
        scale: what a term of 1 amounts to, relative to the RMS of the full signal; infinite where that may be 0.
    """

    terms: torch.Tensor
    factor: float
    scale: float

    def error_after(self, bounces: int) -> float:
        """Bound on the relative error of stopping after `bounces`.

        The signal left out is sum_{k > n} (G A)^k T_0, and no receiver's direct transfer T_0 exceeds the open
        one's, so by Minkowski's inequality its RMS is below the open norm times sum_{k > n} terms[k].
        """
        rest = self.terms[bounces + 1 :].sum(0)
        last = float(self.terms[-1].amax())
        if last > 0:
            rest = rest + (self.terms[-1] * self.factor / (1 - self.factor) if self.factor < 1 else math.inf)
        return self.scale * float(rest.norm())


def contraction(pilot: Pilot, walks: Walks) -> Contraction:
    """The contraction of a scene from its walks."""
    highest = pilot.albedo.amax(0)[: walks.throughput.shape[2]]
    squares = mean_below(walks.throughput)
    terms = torch.zeros_like(squares)
    terms[0] = 1
    # A mean of shares in [0, 1] bounds the mean of their squares.
    terms[1] = highest * math.sqrt(share_below(walks.reflected, walks.count))
    if walks.reflected >= _FEWEST_WALKS:
        terms[1] = torch.minimum(squares[1].sqrt(), terms[1])
    # The first ratio is the share of receivers that see anything; only later ones tell how light fades. They
    # rise towards the largest eigenvalue, as a power iteration's do.
    factor = 0.0
    for k in range(2, MOST_BOUNCES + 1):
        if int(walks.alive[k]) >= _FEWEST_WALKS:
            terms[k] = torch.minimum(squares[k].sqrt(), highest * terms[k - 1])
            factor = max(factor, float((terms[k] / terms[k - 1].clamp_min(1e-300)).max()))
        else:
            factor = factor or float(highest.max())
            terms[k] = factor * terms[k - 1]
    power = walks.power.sum(2)
    scales = []
    for bands, norm in ((1, _ONE_BAND), (2, _ALL_BANDS), (3, _ALL_BANDS)):
        size = float(mean_above(power[:, :bands].sum(1)).sqrt())
        scales.append(norm / size if size > 0 else math.inf)
    return Contraction(terms, factor, max(scales))


def decide_bounces(shadows: bool, pilot: Pilot | None, walks: Walks | None, tolerance: float) -> Decision:
    """The fewest bounces whose remainder is bounded by `tolerance`; all of them where light hardly fades."""
    if pilot is None:
        return Decision(0, "proved: no receiver sees a surface", {"error": 0.0})
    if not shadows:
        return Decision(0, "within the bound for shadows: nothing is traced", {"error": 0.0})
    albedo = pilot.albedo
    reflected = walks.reflected / walks.count
    evidence = {
        "albedo_mean": float(albedo[:, :3].mean()),
        "albedo_max": float(albedo.max()),
        "reflecting_fraction": reflected,
        "walks": walks.count,
    }
    if float(albedo.max()) == 0:
        return Decision(0, "every albedo is 0: nothing reflects", evidence | {"error": 0.0})
    if walks.reflected == 0:
        evidence["reflecting_fraction_bound"] = share_below(0, walks.count)
        return Decision(0, f"none of {walks.count:,} pilot rays met a surface that reflects", evidence)
    if walks.escaped == 0:
        evidence |= {"rays": walks.rays, "sky_fraction_bound": share_below(0, walks.count)}
        return Decision(0, f"no light comes in: none of {walks.rays:,} pilot rays reached the sky", evidence)
    fading = contraction(pilot, walks)
    errors = [fading.error_after(n) for n in range(MOST_BOUNCES + 1)]
    bounces = next((n for n, error in enumerate(errors) if error <= tolerance), MOST_BOUNCES)
    evidence |= {
        "first_bounce": float(fading.terms[1].max()),
        "contraction": fading.factor,
        "error_without": errors[0],
        "error_one_less": errors[max(bounces - 1, 0)],
        "error": errors[bounces],
        "budget": tolerance,
        "confidence": CONFIDENCE,
    }
    if errors[bounces] > tolerance:
        reason = f"light hardly fades, by a factor of {fading.factor:.3f} a bounce: after {MOST_BOUNCES}, "
        return Decision(CONVERGED, f"{reason}{percent(errors[bounces])} may remain", evidence)
    if bounces == 0:
        return Decision(0, f"all that is reflected is at most {percent(errors[0])} of the signal", evidence)
    reason = (
        f"{percent(reflected)} of pilot rays meet a reflecting front, light fades by a factor of {fading.factor:.2f} "
        f"a bounce, and at most {percent(errors[bounces])} remains"
    )
    return Decision(bounces, reason, evidence)


def decide_channels(bounces: int | str, pilot: Pilot | None, walks: Walks | None, tolerance: float) -> Decision:
    """Three where one albedo for all channels changes the signal by more than `tolerance`."""
    if bounces == 0:
        return Decision(1, "nothing is reflected, so nothing colours the light", {"error": 0.0})
    if pilot.gray:
        return Decision(1, "every surface is gray", {"error": 0.0})
    albedo = pilot.albedo
    spread = float((albedo[:, :3].amax(1) - albedo[:, :3].amin(1)).max())
    error = contraction(pilot, walks).scale * float(mean_below(walks.tint).sum().sqrt())
    evidence = {"albedo_spread": spread, "error": error, "budget": tolerance, "confidence": CONFIDENCE}
    differ = f"albedos differ by up to {spread:.2g} between channels, which changes the signal by up to"
    return Decision(3 if error > tolerance else 1, f"{differ} {percent(error)}", evidence)
