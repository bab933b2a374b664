"""What clustering costs: ours beside k-means of faiss, and the whole best method, in one run."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import torch

from diffprt.compression import encode, lbg, overdraw, squared_errors, super_clusters
from diffprt.compression.clusters.partition import canonical
from diffprt.compression.clusters.randomized_pca import principal_span
from diffprt.errors import InputError
from diffprt.options import takes
from diffprt.options.study import ClusteringOptions
from diffprt.scene import Scene, load_scene
from diffprt.study.overdraw.methods import ORIGINAL, cluster_energy, faiss_labels, has_peer
from diffprt.study.overdraw.signal import Signal, SignalSettings, load_signal
from diffprt.study.timing import Stopwatch, paired_ratio, spread


@takes(ClusteringOptions)
def clustering_study(source: str | Path | Scene, output: str | Path, asked: ClusteringOptions) -> dict:
    """Times k-means of both at equal iterations, in turns, then the method that `compress` uses when none is named.

    Ours is what every method begins with: the span of the signals, and LBG in it. Energies are of the whole signals.
    All times are from signals in memory to labels; those of the best method to means, components and weights.

    Args:
        source: a scene file, "builtin:NAME" or a scene with triangles.
        output: folder that keeps the baked signal.
        signal: as `SignalSettings.brdf`.
        registers: float4 registers that the best method forms passes for; None for no particular display.
        rounds: in which the two take turns; each has its own seed.
        order, rays, channels: as in `SignalSettings`.

    Returns:
        Plain numbers: `settings`, `notes`, `kmeans` (`ours` and `faiss` with spreads of `cpu_seconds`, `seconds` and
        `energy`, `cpu_ratio` and `energy_ratio` of ours to faiss within rounds; those of faiss None where it is not
        installed) and `best` (`method`, `cpu_seconds`, `seconds`, `timings`, and for it and for original CPCA
        `squared_error`, `overdraw` and `overdraw_super_clusters`, with their ratios).

    Raises:
        InputError: the scene has no triangles, or a value is out of range.
    """
    if asked.rounds < 1 or asked.iterations < 1:
        raise InputError(f"{asked.rounds} rounds of {asked.iterations} iterations: give 1 or more of each")
    found = load_signal(
        load_scene(source),
        SignalSettings(asked.signal, asked.order, asked.rays, channels=asked.channels, seed=asked.seed),
        Path(output) / "signals",
    )
    if len(found.receivers.faces) == 0:
        raise InputError(f"scene {found.scene} has 0 faces, overdraw is of triangles: give a mesh")
    notes = []
    if not has_peer():
        notes.append("faiss is not installed, its part is left out: pip install faiss-cpu")
    kmeans = _kmeans(found.vectors.float().contiguous(), asked)
    asked.say(f"the whole best method on {found.name}")
    return {
        "settings": {
            "scene": found.scene,
            "size": list(found.vectors.shape),
            "threads": torch.get_num_threads(),
            **asked.settings("channels"),
        },
        "notes": notes,
        "kmeans": kmeans,
        "best": _best(found, asked),
    }


def _kmeans(vectors: torch.Tensor, asked: ClusteringOptions) -> dict:
    clusters, iterations = asked.clusters, asked.iterations

    def ours(seed: int) -> torch.Tensor:
        span = principal_span(vectors, seed=seed)
        return lbg(span.coordinates, clusters, seed=seed, iterations=iterations, tolerance=0.0).labels

    contenders = {"ours": ours}
    if has_peer():
        contenders["faiss"] = lambda seed: faiss_labels(vectors, clusters, seed=seed, iterations=iterations)
    runs: dict = {name: {"cpu_seconds": [], "seconds": [], "energy": []} for name in contenders}
    for number in range(asked.rounds):
        asked.say(f"k-means, round {number + 1} of {asked.rounds}")
        for name, work in contenders.items():
            watch = Stopwatch()
            labels = watch.time(partial(work, asked.seed + number))
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


def _best(signal: Signal, asked: ClusteringOptions) -> dict:
    faces = signal.receivers.faces
    per_pass = None if asked.registers is None else signal.per_pass(asked.registers, asked.components)
    fixed = {"clusters": asked.clusters, "components": asked.components, "seed": asked.seed}
    mesh = {"positions": signal.receivers.positions, "faces": faces}

    def encoded(method: str | None, per_pass: int | None):
        watch = Stopwatch()
        return watch.time(lambda: encode(signal.vectors, method=method, per_pass=per_pass, **mesh, **fixed)), watch

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
