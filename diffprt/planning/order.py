"""How many SH bands are simulated."""

from __future__ import annotations

import math

import torch

from diffprt import sh
from diffprt.planning.confidence import CONFIDENCE, mean_above, mean_below
from diffprt.planning.decision import Decision, percent
from diffprt.planning.pilot import HIGHEST_ORDER, Walks
from diffprt.scene import Light

# Without a light to judge by: three bands hold 99.2 % of an open receiver's power, and its fourth is empty.
_OPEN_ORDER, _SHADOWED_ORDER = 3, 6


def decide_order(shadows: bool, walks: Walks | None, light: Light | None, tolerance: float) -> Decision:
    """The fewest bands beyond which the light changes shaded radiance by at most `tolerance`.

    With transfer of power t_l and light of power e_l in band l, and the light turned every way, the mean square
    of the radiance from that band is t_l e_l / (2 l + 1) (the addition theorem): for an open receiver that is
    the clamped cosine's factor squared (Ramamoorthi and Hanrahan 2001), and shadows and interreflection enter
    through the power that the walks measured.
    """
    cosine = sh.clamped_cosine(HIGHEST_ORDER).square()
    if light is None:
        order = _SHADOWED_ORDER if shadows else _OPEN_ORDER
        held = float(cosine[:order].sum()) / (2 * math.pi / 3)
        edges = ", and shadow edges need more" if shadows else ""
        reason = f"no light to judge by: {order} bands hold {100 * held:.1f} % of an open receiver's transfer{edges}"
        return Decision(order, reason, {"open_power_held": held})
    bands = light.order
    coefficients = light.coefficients.detach().double().cpu()
    energy = torch.zeros(bands, 3, dtype=torch.float64).index_add_(0, sh.band_of_index(bands), coefficients.square())
    if float(energy.sum()) == 0:
        return Decision(1, "the light is black", {"light_order": bands, "error": 0.0})
    power = cosine[None, :, None].expand(1, -1, 3) if walks is None else walks.power.expand(-1, -1, 3)
    shaded = (power[:, :bands] * energy).sum(2) / (2 * torch.arange(bands, dtype=torch.float64) + 1)
    errors = []
    for n in range(1, bands + 1):
        beyond, kept = float(mean_below(shaded[:, n:].sum(1))), float(mean_above(shaded[:, :n].sum(1)))
        errors.append(math.sqrt(beyond / (beyond + kept)) if n < bands and beyond > 0 else 0.0)
    order = next(n for n in range(1, bands + 1) if errors[n - 1] <= tolerance)
    evidence = {"light_order": bands, "error": errors[order - 1], "confidence": CONFIDENCE}
    evidence["error_one_less"] = errors[order - 2] if order > 1 else 1.0
    if order == bands and order > 1:
        reason = f"all that the light has: its last band alone changes shaded radiance by {percent(errors[-2])}"
    else:
        reason = f"the light's bands beyond change shaded radiance by {percent(errors[order - 1])}"
    return Decision(order, reason, evidence)
