"""What one gradient step through a picture costs, and whether its direction is right: ours beside Mitsuba's `prb`.

Both take steps of gradient descent on ‖picture - reference‖² / ‖reference‖² of the same view of the same scene, in
turns. Everything that a step repeats is counted: shading or rendering, loss, gradient, update. What is done once (our
bake and rasterization, Mitsuba's scene and its first compilation) is reported beside it.

Ours works on one torch thread: a step is too short to be shared. Mitsuba has all cores.

Our gradient has no noise and is that of the baked transfer; Mitsuba's is that of the scene, with noise. The cosine
between the two is taken on the coefficients of the light, where the chain rule leads from Mitsuba's texels.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch

from diffprt import sh
from diffprt.compression import compress
from diffprt.errors import InputError
from diffprt.options import takes
from diffprt.options.study import GradientOptions
from diffprt.progress import timed
from diffprt.rendering import FrozenView
from diffprt.scene import Camera, Scene, builtin_environment, load_scene
from diffprt.study.gradient.mitsuba import MitsubaGradient
from diffprt.study.gradient.steps import gradient_steps
from diffprt.study.mitsuba.scene import path_trace
from diffprt.study.timing import Stopwatch, paired_ratio, spread
from diffprt.torch_threads import one_torch_thread
from diffprt.transfer import bake

# Rows of Mitsuba's map where gradients are compared, at which it describes the light to 2e-4.
_FINE_ROWS = 512
_REFERENCE_SAMPLES = 256
# A round repeats our steps for about this long.
_LEAST_SECONDS = 0.2


@takes(GradientOptions)
def gradient_study(source: str | Scene, asked: GradientOptions) -> dict:
    """Times gradient steps of a picture and compares gradients to the light.

    Args:
        source: a scene file, "builtin:NAME" or a scene.
        bounces: interreflections; Mitsuba's paths are as long, and once more without any.
        rows: rows of the environment map whose texels are optimized; it is twice as wide.
        truth_samples: Mitsuba's samples per pixel of each of `halves` gradients whose mean ours is compared with.

    Returns:
        Plain numbers: `settings`, `versions`, `counts`, `setup` [s], `seconds` of a step of each contender, `ratios`
        of Mitsuba's step over each of ours within a round, `cosine`.

    Raises:
        InputError: Mitsuba is missing, or an option is out of range.
    """
    least = {"rounds": 1, "samples": 1, "truth_samples": 1, "halves": 2, "rows": 2, "size": 8}
    for name, value in least.items():
        if (given := getattr(asked, name)) < value:
            raise InputError(f"{name} is {given}: give {value} or more")
    scene = source if isinstance(source, Scene) else load_scene(source)
    start, goal = (builtin_environment(name).project(asked.order, window="auto") for name in ("sky", "studio"))
    setup: dict[str, float] = {}

    def once(name: str, work: Callable[[], object]) -> object:
        asked.say(name)
        with timed(setup, name):
            return work()

    def peer(light, bounces: int, rows: int) -> MitsubaGradient:
        return MitsubaGradient(scene, camera, light, bounces=bounces, rows=rows)

    options = {"order": asked.order, "rays": asked.rays, "bounces": asked.bounces, "seed": asked.seed}
    transfer = once("bake", lambda: bake(scene, **options))
    camera = Camera.framing(transfer.receivers.positions, width=asked.size, height=asked.size)
    frozen = once("rasterize", lambda: FrozenView.of(transfer.receivers, camera))
    clustered = once("compress", lambda: compress(transfer, clusters=asked.clusters, components=asked.components))
    fine = once("build Mitsuba's scene", lambda: peer(start, asked.bounces, _FINE_ROWS))
    asked.say("path trace the reference")
    lit = peer(goal, asked.bounces, _FINE_ROWS)
    traced = path_trace(lit.mitsuba, lit.scene, bounces=asked.bounces, samples=_REFERENCE_SAMPLES, seed=asked.seed)
    picture = traced[..., :3].float() * frozen.mask[..., None]
    steps = gradient_steps(transfer, clustered, frozen, start, picture[frozen.mask], rows=asked.rows)
    peers = {"mitsuba": peer(start, asked.bounces, asked.rows), "mitsuba, direct light": peer(start, 0, asked.rows)}
    for name, one in peers.items():
        target = one.reference(picture)
        seeds = iter(range(asked.seed, asked.seed + asked.rounds + 2))
        step = partial(one.step, target, samples=asked.samples)
        steps[name] = lambda step=step, seeds=seeds: step(seed=next(seeds))
    with one_torch_thread():
        seconds = _race(steps, peers, asked.rounds, once)
    asked.say("compare gradients")
    (ours,) = gradient_steps(transfer, clustered, frozen, start, picture[frozen.mask], rows=asked.rows)["light"]()
    target = fine.reference(picture)
    theirs = [
        fine.to_bands(target, asked.order, samples=asked.truth_samples, seed=asked.seed + half)
        for half in range(asked.halves)
    ]
    return {
        "settings": {"scene": scene.name, **asked.settings()},
        "versions": fine.version,
        "counts": {
            "receivers": len(transfer.receivers),
            "receivers_in_sight": len(frozen.seen),
            "pixels_of_the_object": int(frozen.mask.sum()),
        },
        "setup": setup,
        "seconds": {name: spread(values) for name, values in seconds.items()},
        "ratios": {
            other: {name: paired_ratio(seconds[other], seconds[name]) for name in seconds if name not in peers}
            for other in peers
        },
        "cosine": compared(ours.double(), theirs),
    }


def _race(steps: dict, peers: dict, rounds: int, once: Callable) -> dict[str, list[float]]:
    """Seconds of a step of each contender in each round; the first steps, which compile, are set-up."""
    for name, step in steps.items():
        once(f"first step: {name}", step)
        step()
    seconds: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(rounds):
        for name, step in steps.items():
            watch, count = Stopwatch(), 0
            while count == 0 or (name not in peers and watch.seconds < _LEAST_SECONDS):
                watch.time(step)
                count += 1
            seconds[name].append(watch.seconds / count)
    return seconds


def compared(ours: torch.Tensor, theirs: list[torch.Tensor]) -> dict:
    """Cosine similarity of our gradient [K, 3] with the mean of independent noisy ones, of all bands and of each.

    `between_halves` is the least cosine between two of them: what noise leaves of 1.
    """
    mean = torch.stack(theirs).mean(0)
    band = sh.band_of_index(sh.order_of_count(len(ours)))

    def cosine(a: torch.Tensor, b: torch.Tensor) -> float:
        return float(torch.nn.functional.cosine_similarity(a.flatten(), b.flatten(), dim=0))

    return {
        "overall": cosine(ours, mean),
        "bands": [cosine(ours[band == l], mean[band == l]) for l in range(int(band.max()) + 1)],
        "share_of_bands": [float(mean[band == l].norm() / mean.norm()) for l in range(int(band.max()) + 1)],
        "length_ratio": float(ours.norm() / mean.norm()),
        "between_halves": min(cosine(a, b) for i, a in enumerate(theirs) for b in theirs[:i]),
    }
