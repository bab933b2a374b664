"""Visibility beside its peers: rays per second, build time, and whether every ray finds what it should.

All contenders get the same rays above the horizon of the same receivers, and take turns within each round, so
that a machine with other work slows all of them; ratios are taken within rounds. A peer is first tried in every
batched way it has (`peers`), and its fastest way runs in the rounds.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh, default_threads, run_chunks
from diffprt.kernels.hemispheres import HemisphereTracer, count_blocked
from diffprt.options import takes
from diffprt.options.study import VisibilityOptions
from diffprt.scene import Scene, load_scene
from diffprt.study.timing import Stopwatch, paired_ratio, spread
from diffprt.study.visibility.hemispheres import Hemispheres
from diffprt.study.visibility.peers import Embree, Mitsuba
from diffprt.study.visibility.rate_chart import rate_chart
from diffprt.study.visibility.structure import structure_row
from diffprt.study.visibility.watertight import brute_force_agreement, escaped_rays, points_inside
from diffprt.surface.surfaces import Surfaces
from diffprt.whole_file import make_folder

Say = Callable[[str], None]

_ORDER = 6
_PEERS = {"embreex": Embree, "mitsuba": Mitsuba}
# Rays on which the ways of a peer are tried; large enough that Mitsuba's launches are not all overhead.
_PILOT_RAYS = 1 << 22
_MOST_RAYS = 1 << 26


@takes(VisibilityOptions)
def visibility_study(sources: list[str | Path | Scene], output: str | Path, asked: VisibilityOptions) -> dict:
    """Measures visibility against Embree and Mitsuba.

    Args:
        sources: scene files, "builtin:NAME" or scenes.
        output: folder for the chart.
        rays: rays per receiver, one row of the table each.
        runs: rounds, of which medians and quartiles are reported.
        test_rays: rays of the escape test and of the comparison with brute force.
        brute_tests: most triangle tests of brute force per scene, which may lower its number of rays.

    Returns:
        Plain numbers: `settings`, `versions`, `notes`, `rows` (rates), `structure`, `escapes`, `brute_force`,
        `files`.
        What a missing peer would have filled is None, and its `skipped` says why.
    """
    if asked.runs < 1 or not asked.rays or min(asked.rays) < 1 or not asked.seconds > 0:
        raise InputError(
            f"runs is {asked.runs}, rays {list(asked.rays)} and seconds {asked.seconds}: give 1 or more, and above 0"
        )
    output = Path(output)
    make_folder(output)
    scenes = [load_scene(source) for source in sources]
    report: dict = {
        "settings": {
            **asked.settings("large"),
            "scenes": [scene.name for scene in scenes],
            "sh_order": _ORDER,
            "directions": "cosine-distributed over the hemisphere of each receiver, in packet order",
        },
        "versions": {"processor": _processor()},
        "rows": [],
        "structure": [],
        "escapes": [],
        "brute_force": [],
    }
    for scene in scenes:
        surfaces = Surfaces.of(scene)
        mesh = surfaces.mesh()
        peers: dict = {}
        for name, make in _PEERS.items():
            try:
                peers[name] = make(surfaces.positions, surfaces.faces)
                report["versions"] |= peers[name].version()
            except InputError as error:
                peers[name] = str(error)
                asked.say(f"{name} is left out: {error}")
        for count in asked.rays:
            asked.say(f"{scene.name}, {count} rays per receiver")
            row = rate_row(
                surfaces, mesh, peers, count, runs=asked.runs, seconds=asked.seconds, seed=asked.seed, say=asked.say
            )
            report["rows"].append({"scene": scene.name, **row})
        asked.say(f"{scene.name}: rays that may escape, and brute force")
        report["escapes"].append({"scene": scene.name, **_escapes(scene, mesh, asked.test_rays, asked.seed)})
        limit = max(1, min(asked.test_rays, int(asked.brute_tests / len(mesh.faces))))
        found = brute_force_agreement(mesh, limit, seed=asked.seed)
        report["brute_force"].append({"scene": scene.name, "triangles": len(mesh.faces), **found})
    if asked.large > 0:
        asked.say(f"structure over about {asked.large} triangles")
        report["structure"].append(structure_row(scenes, asked.large, runs=asked.runs))
    report["notes"] = _notes(report["rows"])
    chart = output / "visibility.png"
    rate_chart(chart, report["rows"], title=_title(report))
    return report | {"files": {"chart": str(chart)}}


def rate_row(
    surfaces: Surfaces,
    mesh: TriangleMesh,
    peers: dict,
    rays: int,
    *,
    runs: int = 5,
    seconds: float = 1.0,
    seed: int = 0,
    say: Say = lambda text: None,
) -> dict:
    """One scene and ray count: rates of all contenders, ratios within rounds, and agreement.

    Args:
        peers: `Embree` and `Mitsuba` under "embreex" and "mitsuba", or why they are missing.

    Returns:
        Plain numbers. `contenders`: rates [rays/s] (median, quartiles, runs), the same per second of CPU time,
        the cores that it had (CPU time over wall time), the way of a peer and the trial rates of all its ways,
        and `disagreement`: the share of all rays by which its blocked counts differ from ours. `ratios` (None
        without the peer): `embreex` on one core, `mitsuba` on all, `sh` time with SH sums over time without,
        `threads` all cores over one; `*_cpu` are the same by CPU time.
    """
    threads = default_threads()
    offset = mesh.ray_offset()
    load = _sized(surfaces, mesh, offset, rays, seconds, seed)
    work: dict[str, Callable[[Stopwatch], np.ndarray]] = {
        "ours_one_core": lambda watch: _ours(mesh, load, 1, watch),
        "ours": lambda watch: _ours(mesh, load, threads, watch),
        "ours_with_sh": _with_sh(mesh, load),
    }
    entries = {
        "ours_one_core": _entry(1),
        "ours": _entry(threads),
        "ours_with_sh": _entry(1, way=f"SH sums of order {_ORDER}"),
        **{name: _entry(1 if name == "embreex" else threads) for name in _PEERS},
    }
    for name, peer in peers.items():
        if isinstance(peer, str):
            entries[name]["skipped"] = peer
            continue
        say(f"  trying the ways of {name}")
        entries[name] |= _fastest_way(peer, load)
        work[name] = peer.ways(load)[entries[name]["way"]]
    counts = {name: run(Stopwatch()) for name, run in work.items()}  # also warms up
    wall: dict[str, list] = {name: [] for name in work}
    cpu: dict[str, list] = {name: [] for name in work}
    busy = []
    for number in range(runs):
        say(f"  round {number + 1} of {runs}, {load.total} rays each")
        busy.append(os.getloadavg()[0] if hasattr(os, "getloadavg") else None)
        # Every other round goes backwards, so that nobody always follows the same neighbor.
        for name in list(work)[:: 1 if number % 2 == 0 else -1]:
            watch = Stopwatch()
            work[name](watch)
            wall[name].append(watch.seconds)
            cpu[name].append(max(watch.cpu_seconds, 1e-9))
    ours = counts["ours"]
    for name in work:
        entries[name] |= {
            "rate": spread([load.total / t for t in wall[name]]),
            "rate_per_cpu_second": spread([load.total / t for t in cpu[name]]),
            "seconds": wall[name],
            "cores_had": float(np.median(np.divide(cpu[name], wall[name]))),
            "disagreement": float(np.abs(counts[name] - ours).sum() / load.total),
        }
    pairs = {
        "embreex": ("embreex", "ours_one_core"),
        "mitsuba": ("mitsuba", "ours"),
        "sh": ("ours_with_sh", "ours_one_core"),
        "threads": ("ours_one_core", "ours"),
    }
    ratios: dict = {}
    for key, (above, below) in pairs.items():
        known = above in work
        ratios[key] = paired_ratio(wall[above], wall[below]) if known else None
        ratios[f"{key}_cpu"] = paired_ratio(cpu[above], cpu[below]) if known else None
    return {
        "triangles": len(mesh.faces),
        "receivers": len(surfaces.receivers),
        "receivers_timed": len(load),  # more than there are where a small scene is traced several times over
        "rays_per_receiver": rays,
        "rays_timed": load.total,
        "blocked_share": float(ours.sum() / load.total),
        "structure_bytes_per_triangle": mesh.nbytes / len(mesh.faces),
        "load_average": busy,
        "contenders": entries,
        "ratios": ratios,
    }


def _entry(threads: int, way: str = "") -> dict:
    """A contender before it ran; every field is there, also where a peer is missing."""
    empty = dict.fromkeys(("rate", "rate_per_cpu_second", "seconds", "cores_had", "disagreement", "skipped"))
    return {"threads": threads, "way": way, "ways": {}, **empty}


def _sized(surfaces: Surfaces, mesh: TriangleMesh, offset: float, rays: int, seconds: float, seed: int) -> Hemispheres:
    """Receivers enough that ours on all cores, mostly the shortest timing, takes `seconds`."""
    pilot = Hemispheres.drawn(surfaces, offset, rays, _PILOT_RAYS, seed=seed)
    watch = Stopwatch()
    _ours(mesh, pilot.part(1), default_threads(), watch)
    watch = Stopwatch()
    _ours(mesh, pilot, default_threads(), watch)
    wanted = min(_MOST_RAYS, int(1.2 * seconds * pilot.total / watch.seconds))
    return Hemispheres.drawn(surfaces, offset, rays, wanted, seed=seed)


def _ours(mesh: TriangleMesh, load: Hemispheres, threads: int, watch: Stopwatch) -> np.ndarray:
    """Blocked rays of every receiver, int64 [V]."""
    found = watch.time(lambda: count_blocked(mesh, load.origins, load.normals, load.pattern, threads=threads))
    return found.numpy().astype(np.int64)


def _with_sh(mesh: TriangleMesh, load: Hemispheres) -> Callable[[Stopwatch], np.ndarray]:
    """The same on one core with the sums of the SH basis that a bake wants."""
    tables = tuple(table.contiguous() for table in sh.recurrence_tables(_ORDER, torch.float32))
    step = max(1, (1 << 20) // load.rays)

    def trace() -> np.ndarray:
        tracer = HemisphereTracer(mesh, load.origins, load.normals, load.pattern, _ORDER, tables)
        counts = np.empty(len(load), np.int64)

        def part(first: int) -> None:
            rows = range(first, min(first + step, len(load)))
            counts[rows.start : rows.stop] = tracer.trace(rows, hits=False)[3].numpy()

        for _ in run_chunks(part, range(0, len(load), step), threads=1):
            pass
        return counts

    return lambda watch: watch.time(trace)


def _fastest_way(peer: Embree | Mitsuba, load: Hemispheres) -> dict:
    """Tries every way on some of the rays, each after a warm-up, best of two."""
    pilot = load.part(_PILOT_RAYS)
    rates = {}
    for name, run in peer.ways(pilot).items():
        best = 0.0
        for number in range(3):
            watch = Stopwatch()
            run(watch)
            best = max(best, pilot.total / watch.seconds) if number else 0.0
        rates[name] = best
    return {"way": max(rates, key=rates.get), "ways": rates}


def _escapes(scene: Scene, mesh: TriangleMesh, rays: int, seed: int) -> dict:
    """The escape test of a watertight scene, or why there is none."""
    if not scene.defects.watertight:
        return {"skipped": f"open: {scene.defects.boundary_edges} boundary edges"}
    return {"skipped": None, **escaped_rays(mesh, points_inside(mesh, seed=seed), rays, seed=seed)}


def _notes(rows: list[dict]) -> list[str]:
    """What spoils the figures: other work that took cores away."""
    starved = [row for row in rows if row["contenders"]["ours"]["cores_had"] < 0.85 * default_threads()]
    if not starved:
        return []
    had = min(row["contenders"]["ours"]["cores_had"] for row in starved)
    return [
        f"in {len(starved)} of {len(rows)} rows other work left less than the {default_threads()} cores, down to "
        f"{had:.1f}: scaling says nothing there, and ratios by CPU time (in --json) are the better ones"
    ]


def _title(report: dict) -> str:
    versions = report["versions"]
    peers = [f"{name} {versions[name]}" for name in ("embreex", "mitsuba") if name in versions]
    machine = (
        f"{versions['processor']}, {default_threads()} cores, median and quartiles of {report['settings']['runs']} runs"
    )
    return f"{machine}\n{', '.join(peers) or 'no peers'}"


def _processor() -> str:
    """The processor's name, where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
