"""From a scene and a tolerance to a plan."""

from __future__ import annotations

import math
from numbers import Integral, Real

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.options.bake import CONVERGED
from diffprt.planning.bounces import decide_bounces, decide_channels
from diffprt.planning.decision import Decision, Plan
from diffprt.planning.open_proof import OpenProof, prove_open
from diffprt.planning.order import decide_order
from diffprt.planning.pilot import HIGHEST_ORDER, MOST_BOUNCES, Pilot
from diffprt.planning.shadows import decide_shadows
from diffprt.scene import Environment, Light, Scene
from diffprt.surface.receivers import Receivers
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces
from diffprt.torch_threads import one_torch_thread


def plan(
    scene: Scene,
    tolerance: float = 0.01,
    *,
    light: Light | Environment | None = None,
    shadows: bool | None = None,
    bounces: int | str | None = None,
    channels: int | None = None,
    order: int | None = None,
) -> Plan:
    """Decides what a bake of `scene` simulates, with evidence and reasons.

    Args:
        scene: what will be baked.
        tolerance: relative error that all that is left out may have, in (0, 1]; measure in `diffprt.planning`.
        light: the light that the scene will be seen under, for the order; a light is taken to have no bands
            beyond its own, an environment is projected at order 10.
        shadows, bounces, channels, order: asked for, in place of the plan's own choice; its evidence is kept.

    Returns:
        `Plan`; the same for the same input, on any number of threads. It carries no gradient.

    Raises:
        InputError: an argument out of range, shadows=False with bounces, or a scene without triangles or receivers.
    """
    _check(tolerance, shadows, bounces, channels, order)
    if isinstance(light, Environment):
        light = light.project(HIGHEST_ORDER)
    surfaces = Surfaces.of(scene)
    sides = Sides.of(surfaces.receivers)
    proof = _openness(surfaces, surfaces.receivers if sides is None else sides.traced)
    with one_torch_thread():
        pilot = None if proof.proved else Pilot(surfaces, sides)
        walks = None if pilot is None else pilot.walk()
        shadow = decide_shadows(proof, pilot, walks, tolerance).overridden(shadows)
    share = tolerance if pilot is None or pilot.gray else tolerance / 2
    bounce = decide_bounces(shadow.value, pilot, walks, share).overridden(bounces)
    channel = decide_channels(bounce.value if pilot else 0, pilot, walks, share).overridden(channels)
    band = decide_order(shadow.value, walks, light, tolerance).overridden(order)
    vector = Decision("vector", "every surface is diffuse: what leaves it does not depend on the view")
    asked = {"shadows": shadows, "bounces": bounces, "channels": channels, "order": order}
    overridden = tuple(name for name, value in asked.items() if value is not None)
    return Plan(shadow, bounce, channel, band, vector, float(tolerance), overridden)


def _openness(surfaces: Surfaces, receivers: Receivers) -> OpenProof:
    """The proof for `receivers`: those of the surfaces, and behind them backs of translucent ones."""
    backs = slice(len(surfaces.receivers), None)
    normals = torch.zeros_like(surfaces.positions)
    normals[surfaces.receives] = surfaces.receivers.normals
    points = torch.cat([surfaces.positions, receivers.positions[backs]])
    normals = torch.cat([normals, receivers.normals[backs]])
    receives = torch.cat([surfaces.receives, torch.ones(len(receivers), dtype=torch.bool)[backs]])
    return prove_open(*(t.numpy() for t in (points, normals, surfaces.faces, receives)))


def _check(tolerance: object, shadows: object, bounces: object, channels: object, order: object) -> None:
    """Refuses what no plan can be made from."""
    number = isinstance(tolerance, Real) and not isinstance(tolerance, bool)
    if not number or not math.isfinite(tolerance) or not 0 < tolerance <= 1:
        raise InputError(f"tolerance is {tolerance}: give a relative error in (0, 1], such as 0.01")
    if shadows is not None and not isinstance(shadows, bool):
        raise InputError(f"shadows is {shadows}: give True or False, or leave it out to have it decided")
    if bounces not in (None, CONVERGED) and not (_whole(bounces) and 0 <= bounces <= MOST_BOUNCES):
        raise InputError(
            f"bounces is {bounces}: give 0 to {MOST_BOUNCES} or '{CONVERGED}', or leave it out to have it decided"
        )
    if channels is not None and not (_whole(channels) and channels in (1, 3)):
        raise InputError(f"channels is {channels}: give 1 or 3, or leave it out to have it decided")
    if order is not None:
        sh.check_order(order)
    if shadows is False and bounces:
        raise InputError(f"shadows is False and bounces is {bounces}: without shadows nothing is traced, drop one")


def _whole(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)
