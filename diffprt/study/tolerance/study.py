"""Whether `tolerance` delivers: measured error, honesty of the estimates, and cost against the best fixed rays."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from diffprt.errors import InputError
from diffprt.options import takes
from diffprt.options.bake import BakeSettings
from diffprt.options.study import ToleranceOptions
from diffprt.scene import READERS, Scene, load_scene
from diffprt.study.rows import Rows, digest
from diffprt.study.tolerance.chart import tolerance_chart
from diffprt.study.tolerance.scenes import random_scene
from diffprt.study.tolerance.truth import Truth, fewest_rays
from diffprt.transfer import SamplingRate, bake, rays_for_tolerance
from diffprt.whole_file import make_folder

_FINER = 16
# The least that a tolerance may choose; the best fixed setting has the same floor.
_FEWEST = 32


@takes(ToleranceOptions)
def tolerance_study(sources: Iterable[str | Path | Scene], output: str | Path, asked: ToleranceOptions) -> dict:
    """Bakes with every tolerance and compares with at least 16 times the rays.

    Rows are kept in `rows.jsonl` under `output` as they are finished; repeated, the study goes on from there.

    Args:
        sources: scene files, "builtin:NAME" or scenes.
        output: folder for rows and chart.
        truth_rays: cap of a truth: beyond it, only as many receivers are compared as it allows.

    Returns:
        Plain numbers: `settings`, `notes`, `rows`, `summary`, `files`. Rows have `error`, `expected_error` and
        `estimated_error`, `rays`, `pilot_rays` (over all receivers), `best_rays`, and `cost`, all rays over those
        of the best fixed setting.

    Raises:
        InputError: nothing to do, or a value out of range.
    """
    if not asked.tolerances or not asked.bounces or asked.random < 0 or asked.truth_rays < 1:
        raise InputError(
            f"tolerances are {list(asked.tolerances)}, bounces {list(asked.bounces)}, random {asked.random}, "
            f"truth_rays {asked.truth_rays}: give at least one of the first two, and no negative number"
        )
    output = Path(output)
    make_folder(output)
    kept = Rows(output / "rows.jsonl")
    notes: list[str] = []
    rows: list[dict] = []
    for scene in _scenes(sources, asked.data, asked.random, asked.seed, notes):
        for count in asked.bounces:
            settings = BakeSettings(order=asked.order, bounces=count, seed=asked.seed)
            for row in _scene_rows(scene, settings, asked, kept):
                rows.append(row)
                asked.say(
                    f"{row['scene']}, {count} bounces, {row['tolerance']:g}: {row['rays']} rays leave "
                    f"{row['error']:.2g}, cost {row['cost']:.2f}"
                )
    if not rows:
        raise InputError("there is no scene: name one, or give a folder with meshes, or a number of random ones")
    chart = output / "tolerance.png"
    tolerance_chart(chart, rows)
    return {
        "settings": asked.settings("data", "random") | {"finer": _FINER},
        "notes": notes,
        "rows": rows,
        "summary": summary(rows),
        "files": {"chart": str(chart), "rows": str(kept.path)},
    }


def summary(rows: list[dict]) -> dict:
    """Shares of runs that met their tolerance, stayed within twice the best cost, and had honest estimates."""
    of = {name: np.array([row[name] for row in rows], dtype=np.float64) for name in _NUMBERS}
    estimates = {}
    for name in ("expected_error", "estimated_error"):
        measured = of["error"] > 0
        ratios = of[name][measured] / of["error"][measured]
        estimates[name] = {
            "share_at_least_measured": float((of[name] >= of["error"]).mean()),
            "median_ratio": float(np.median(ratios)) if measured.any() else 1.0,
        }
    return {
        "runs": len(rows),
        "share_met": float((of["error"] <= of["tolerance"]).mean()),
        "share_within_twice_best": float((of["cost"] <= 2).mean()),
        "median_cost": float(np.median(of["cost"])),
        "cost_95": float(np.quantile(of["cost"], 0.95)),
        "estimates": estimates,
    }


_NUMBERS = ("tolerance", "error", "cost", "expected_error", "estimated_error")


def _scenes(
    sources: Iterable[str | Path | Scene], data: str | Path | None, random: int, seed: int, notes: list[str]
) -> Iterator[Scene]:
    """One at a time, so that only one is in memory."""
    for source in sources:
        yield load_scene(source)
    for number in range(random):
        yield random_scene(seed + number)
    if data is None:
        return
    folder = Path(data)
    if not folder.is_dir():
        raise InputError(f"data folder {folder} does not exist: give a folder with meshes")
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in READERS:
            continue
        try:
            scene = Scene.load(path)
        except InputError as error:
            notes.append(f"{path.name} was skipped: {error}")
            continue
        yield scene


def _scene_rows(scene: Scene, settings: BakeSettings, asked: ToleranceOptions, kept: Rows) -> Iterator[dict]:
    """Rows of one scene and number of bounces; those that are kept already cost nothing."""
    tolerances = list(asked.tolerances)
    keys = {tolerance: _key(scene, settings, tolerance, asked) for tolerance in tolerances}
    missing = [tolerance for tolerance in tolerances if keys[tolerance] not in kept.rows]
    if missing:
        asked.say(f"{scene.name}, {settings.bounces} bounces: choosing rays and baking the truth")
        rates = {tolerance: rays_for_tolerance(scene, settings, tolerance) for tolerance in missing}
        rays = asked.finer_rays or _FINER * max(rate.rays for rate in rates.values())
        truth = Truth(scene, replace(settings, rays=rays), most_rays=asked.truth_rays)
        error_with = functools.cache(truth.error_with)
        for tolerance in missing:
            row = _row(scene, settings, tolerance, rates[tolerance], truth)
            row["best_rays"] = fewest_rays(error_with, tolerance, row["rays"], _FEWEST)
            row["cost"] = (row["rays"] + row["pilot_rays"] / row["receivers"]) / row["best_rays"]
            kept.add(keys[tolerance], row | {"truth_rays": rays})
    for tolerance in tolerances:
        yield kept.rows[keys[tolerance]]


def _row(scene: Scene, settings: BakeSettings, tolerance: float, rate: SamplingRate, truth: Truth) -> dict:
    """One bake as a user has it, with the rays that the tolerance chose."""
    options = {"order": settings.order, "bounces": settings.bounces, "seed": settings.seed, "rays": rate.rays}
    result = bake(scene, sampling=rate, **options)
    return {
        "scene": scene.name,
        "receivers": len(result.receivers),
        "inside": result.certificate.get("receivers_inside", 0),
        "bounces": settings.bounces,
        "tolerance": tolerance,
        "rays": rate.rays,
        "pilot_rays": rate.pilot_rays,
        "error": truth.error_of(result.diffuse),
        "expected_error": rate.expected_error,
        "estimated_error": result.certificate["estimated_error"],
        "truth_share": truth.share,
        "truth_reflection_rays": truth.reflection_rays,
    }


def _key(scene: Scene, settings: BakeSettings, tolerance: float, asked: ToleranceOptions) -> str:
    """What a row depends on; rays are what the run finds."""
    truth = {"truth_rays": asked.truth_rays, "finer_rays": asked.finer_rays}
    return digest([scene.name, scene.hash(), settings.as_dict() | truth | {"rays": None, "tolerance": tolerance}])
