"""What clustering costs: ours beside k-means of faiss, and the whole best method, in one run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch

from diffprt.compression import clusters_per_pass, encode, lbg, overdraw, squared_errors, super_clusters
from diffprt.compression.clusters.partition import canonical
from diffprt.compression.clusters.randomized_pca import principal_span
from diffprt.errors import InputError
from diffprt.scene import Scene, load_scene
from diffprt.study.overdraw.methods import ORIGINAL, cluster_energy, faiss_labels, has_peer
from diffprt.study.overdraw.signal import Signal, SignalSettings, load_signal
from diffprt.study.timing import Stopwatch, paired_ratio, spread

Say = Callable[[str], None]


def clustering_study(
    source: str | Path | Scene,
    output: str | Path,
    *,
    signal: str = "shadow",
    clusters: int = 256,
    components: int = 8,
    registers: int | None = 256,
    iterations: int = 20,
    rounds: int = 3,
    order: int = 6,
    rays: int = 1024,
    channels: int | None = None,
    seed: int = 0,
    say: Say = lambda text: None,
) -> dict:
    """Times k-means of both at equal iterations, in turns, then the method that `compress` uses when none is named.

    Ours is what every method begins with: the span of the signals, and LBG in it. Energies are of the whole signals.
    All times are from signals in memory to labels; those of the best method to means, components and weights.

    Args:
        source: a scene file, "builtin:NAME" or a scene with triangles.
        output: folder that keeps the baked signal.
        signal: as `SignalSettings.brdf`.
        clusters: M.
        components: P per cluster.
        registers: float4 registers that the best method forms passes for; None for no particular display.
        iterations: of k-means.
        rounds: in which the two take turns; each has its own seed.
        order, rays, channels: as in `SignalSettings`.
        seed: of rays and of the first round.
        say: is told what goes on.

    Returns:
        Plain numbers: `settings`, `notes`, `kmeans` (`ours` and `faiss` with spreads of `cpu_seconds`, `seconds` and
        `energy`, `cpu_ratio` and `energy_ratio` of ours to faiss within rounds; those of faiss None where it is not
        installed) and `best` (`method`, `cpu_seconds`, `seconds`, `timings`, and for it and for original CPCA
        `squared_error`, `overdraw` and `overdraw_super_clusters`, with their ratios).

    Raises:
        InputError: the scene has no triangles, or a value is out of range.
    """
    if rounds < 1 or iterations < 1:
        raise InputError(f"{rounds} rounds of {iterations} iterations: give 1 or more of each")
    found = load_signal(
        load_scene(source), SignalSettings(signal, order, rays, channels=channels, seed=seed), Path(output) / "signals"
    )
    if len(found.receivers.faces) == 0:
        raise InputError(f"scene {found.scene} has 0 faces, overdraw is of triangles: give a mesh")
    notes = []
    if not has_peer():
        notes.append("faiss is not installed, its part is left out: pip install faiss-cpu")
    kmeans = _kmeans(found.vectors.float().contiguous(), clusters, iterations, [seed + r for r in range(rounds)], say)
    say(f"the whole best method on {found.name}")
    return {
        "settings": {
            "scene": found.scene,
            "signal": signal,
            "size": list(found.vectors.shape),
            "clusters": clusters,
            "components": components,
            "registers": registers,
            "iterations": iterations,
            "rounds": rounds,
            "order": order,
            "rays": rays,
            "seed": seed,
            "threads": torch.get_num_threads(),
        },
        "notes": notes,
        "kmeans": kmeans,
        "best": _best(found, clusters, components, registers, seed),
    }


def _kmeans(vectors: torch.Tensor, clusters: int, iterations: int, seeds: list[int], say: Say) -> dict:
    def ours(seed: int) -> torch.Tensor:
        span = principal_span(vectors, seed=seed)
        return lbg(span.coordinates, clusters, seed=seed, iterations=iterations, tolerance=0.0).labels

    contenders = {"ours": ours}
    if has_peer():
        contenders["faiss"] = lambda seed: faiss_labels(vectors, clusters, seed=seed, iterations=iterations)
    runs: dict = {name: {"cpu_seconds": [], "seconds": [], "energy": []} for name in contenders}
    for number, seed in enumerate(seeds):
        say(f"k-means, round {number + 1} of {len(seeds)}")
        for name, work in contenders.items():
            watch = Stopwatch()
            labels = watch.time(lambda work=work, seed=seed: work(seed))
            runs[name]["cpu_seconds"].append(watch.cpu_seconds)
            runs[name]["seconds"].append(watch.seconds)
            runs[name]["energy"].append(cluster_energy(vectors, canonical(labels)[0]))
    result: dict = {"faiss": None, "cpu_ratio": None, "energy_ratio": None}
    result |= {name: {key: spread(values) for key, values in run.items()} for name, run in runs.items()}
    if "faiss" in runs:
        result["cpu_ratio"] = paired_ratio(runs["ours"]["cpu_seconds"], runs["faiss"]["cpu_seconds"])
        if min(runs["faiss"]["energy"]) > 0:
            result["energy_ratio"] = paired_ratio(runs["ours"]["energy"], runs["faiss"]["energy"])
    return result


def _best(signal: Signal, clusters: int, components: int, registers: int | None, seed: int) -> dict:
    faces, per_pass = signal.receivers.faces, None
    if registers is not None:
        per_pass = clusters_per_pass(registers, components, channels=signal.channels, outputs=signal.outputs)

    def encoded(method: str | None, per_pass: int | None):
        watch = Stopwatch()
        found = watch.time(
            lambda: encode(
                signal.vectors,
                clusters=clusters,
                components=components,
                method=method,
                positions=signal.receivers.positions,
                faces=faces,
                per_pass=per_pass,
                seed=seed,
            )
        )
        return found, watch

    def measured(found) -> dict:
        row = {
            "squared_error": float(squared_errors(signal.vectors, found).mean()),
            "overdraw": overdraw(found.labels, faces),
        }
        if per_pass is not None:
            row["overdraw_super_clusters"] = super_clusters(found.labels, faces, per_pass).overdraw
        return row

    found, watch = encoded(None, per_pass)
    row, original = measured(found), measured(encoded(ORIGINAL, None)[0])
    return {
        "method": found.method,
        "cpu_seconds": watch.cpu_seconds,
        "seconds": watch.seconds,
        "timings": found.timings,
        "coherence": found.counts["coherence"],
        **row,
        "original": original,
        "squared_error_ratio": row["squared_error"] / original["squared_error"] if original["squared_error"] else None,
        "overdraw_ratio": row["overdraw"] / original["overdraw"],
    }
