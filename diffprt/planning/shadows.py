"""Whether shadows are simulated."""

from __future__ import annotations

import math

from diffprt.planning.confidence import CONFIDENCE, share_below
from diffprt.planning.decision import Decision, percent
from diffprt.planning.open_proof import OpenProof
from diffprt.planning.pilot import Pilot, Walks

_OPEN_POWER = 2 * math.pi / 3
# Share of the open receiver's power in two bands; the share in one is less, but there light cannot grow.
_TWO_BANDS = 0.875


def decide_shadows(proof: OpenProof, pilot: Pilot | None, walks: Walks | None, tolerance: float) -> Decision:
    """Off when proved needless, or when a bound on all that they change is below `tolerance`.

    The million single rays of the bound are sent only where the walks leave a chance that it will do.
    """
    if proof.proved:
        return Decision(
            False,
            "proved: the whole scene lies below the tangent plane of every receiver",
            {"proved": True, "error": 0.0, "rise": proof.rise, "hull_corners": proof.hull_corners},
        )
    albedo = float(pilot.albedo.max())
    evidence = {"proved": False, "rise": proof.rise, "rays": walks.count, "hits": walks.hits}
    evidence["hit_fraction"] = walks.hits / walks.count
    expected = error_without(evidence["hit_fraction"], albedo)
    if expected > tolerance:
        reason = f"{percent(evidence['hit_fraction'])} of {walks.count:,} pilot rays were blocked"
        return Decision(True, reason, evidence | {"error": expected})
    rays, hits = pilot.single_hits()
    bound = error_without(share_below(hits, rays), albedo)
    evidence |= {"rays": rays, "hits": hits, "hit_fraction": hits / rays, "hit_fraction_bound": share_below(hits, rays)}
    evidence |= {"error": bound, "confidence": CONFIDENCE}
    effect = f"changes at most {percent(bound)}" if math.isfinite(bound) else "may change anything at albedo 1"
    reason = f"{hits:,} of {rays:,} pilot rays were blocked: leaving shadows out {effect}"
    return Decision(bound > tolerance, reason, evidence)


def error_without(hit_fraction: float, albedo: float) -> float:
    """Bound on the relative error of leaving out shadows and every bounce; infinite where there is none.

    With h the cosine-weighted share of blocked directions, what is blocked has at most the power
    int_blocked cos² <= pi h. What is reflected instead has at most the power (2 pi / 3) (a / (1 - a))² h: each of
    its terms is a mean of open receivers' transfer over the hits, and hits weigh h_v <= sqrt(h_v). Both are
    non-negative functions of direction, so their difference has at most the sum of their powers, at any order.
    The full signal is at least the open receiver's less that difference, of which two bands hold 87.5 %; in one
    band, where transfer is a share of light that never exceeds 1, the relative error is h_v.
    """
    if hit_fraction == 0:
        return 0.0
    if albedo >= 1:
        return math.inf
    difference = math.sqrt(hit_fraction * (math.pi + _OPEN_POWER * (albedo / (1 - albedo)) ** 2))
    rest = math.sqrt(_TWO_BANDS * _OPEN_POWER) - difference
    return difference / rest if rest > 0 else math.inf
