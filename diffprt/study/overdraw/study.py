"""The 2005 thesis's tables 5.1 to 5.17 for any mesh: what less overdraw costs in error, and that it need not."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from diffprt.errors import InputError
from diffprt.options import takes
from diffprt.options.study import OverdrawOptions
from diffprt.scene import Light, Scene, load_scene
from diffprt.study.lights import named_light
from diffprt.study.overdraw.chart import overdraw_charts
from diffprt.study.overdraw.image import HeldOut
from diffprt.study.overdraw.methods import DEFAULT, ORIGINAL, PEER, Method, has_peer
from diffprt.study.overdraw.pictures import study_pictures
from diffprt.study.overdraw.row import overdraw_row
from diffprt.study.overdraw.signal import Signal, SignalSettings, load_signal
from diffprt.study.overdraw.summary import summary
from diffprt.study.rows import Rows, digest, save_tensors
from diffprt.surface import Surfaces
from diffprt.whole_file import make_folder

Say = Callable[[str], None]


@dataclass(frozen=True)
class _Cell:
    """A row that is to be."""

    scene: Scene
    signal: SignalSettings
    method: Method
    clusters: int


@takes(OverdrawOptions)
def overdraw_study(sources: Iterable[str | Path | Scene], output: str | Path, asked: OverdrawOptions) -> dict:
    """Clusters every signal with every method and sets error beside overdraw.

    Signals are kept under `output`/signals, rows in `output`/rows.jsonl as they are finished; repeated, the study
    goes on from there, and rows of other scenes or BRDFs join those that the folder has. Counts of clusters, then
    methods, come in the order given, so that a run that is cut short has the first of them for all scenes.

    Args:
        sources: scene files, "builtin:NAME" or scenes.
        brdfs: as `SignalSettings.brdf`.
        methods: as `Method.parse`.
        budgets: float4 registers that super-clusters must fit into.
        lights: "sky", "studio" or a map, for the image error.
        order, rays, bounces, channels: as in `SignalSettings`.
        minutes: no row is begun after these; None for no limit.

    Returns:
        Plain numbers: `settings`, `notes`, `rows`, `summary`, `files`; rows as of `overdraw_row`.

    Raises:
        InputError: nothing to do, or a value out of range.
    """
    begun = time.perf_counter()
    output = Path(output)
    make_folder(output)
    notes: list[str] = []
    methods = DEFAULT if asked.methods is None else asked.methods
    if PEER in methods and not has_peer():
        notes.append("faiss is not installed, its rows are left out: pip install faiss-cpu")
        methods = [method for method in methods if method != PEER]
    scenes = [load_scene(source) for source in sources]
    signals = [
        SignalSettings(brdf, asked.order, asked.rays, asked.bounces, asked.channels, asked.seed) for brdf in asked.brdfs
    ]
    ways = _ways(methods, asked.seed, asked.seeds)
    cells = [
        _Cell(scene, signal, way, count)
        for count in asked.clusters
        for way in ways
        for scene in scenes
        for signal in signals
    ]
    if not cells or asked.seeds < 1 or min(asked.clusters) < 1:
        raise InputError(
            f"{len(scenes)} scenes, {len(signals)} BRDFs, {len(ways)} methods, {asked.seeds} seeds, clusters "
            f"{list(asked.clusters)}: give at least one of each"
        )
    # Rows that may stand beside each other.
    study = digest([asked.components, list(asked.budgets), list(asked.lights), asked.order, asked.rays, asked.bounces])
    kept = Rows(output / "rows.jsonl")
    keys = [digest([study, cell.signal.key(cell.scene), *cell.method.as_list(), cell.clusters]) for cell in cells]
    waiting = [(key, cell) for key, cell in zip(keys, cells, strict=True) if key not in kept.rows]
    bench = _Bench(output / "signals", {Path(name).stem: named_light(name, asked.order) for name in asked.lights})
    for number, (key, cell) in enumerate(waiting):
        if asked.minutes is not None and time.perf_counter() - begun > 60 * asked.minutes:
            left = len(waiting) - number
            notes.append(f"{left} rows are left after {asked.minutes:g} minutes: repeat the command to go on")
            break
        signal, held_out = bench.of(cell)
        asked.say(f"{number + 1} of {len(waiting)}: {signal.name}, {cell.clusters} clusters, {cell.method}")
        sizes = {"clusters": cell.clusters, "components": asked.components, "budgets": tuple(asked.budgets)}
        row, maps = overdraw_row(signal, held_out, cell.method, **sizes)
        save_tensors(output / "maps" / f"{key}.safetensors", maps)
        kept.add(key, row | {"maps": key, "study": study})
    rows = [row for row in kept.rows.values() if row["study"] == study]
    charts = overdraw_charts(output, rows)
    pictures = _pictures(output, kept, cells, keys)
    return {
        "settings": asked.settings("minutes") | {"methods": list(methods)},
        "notes": notes,
        "rows": rows,
        "summary": summary(rows),
        "files": {"charts": charts, "pictures": pictures, "rows": str(kept.path)},
    }


class _Bench:
    """The signal at hand: only one is in memory."""

    def __init__(self, folder: Path, lights: dict[str, Light]) -> None:
        self._folder, self._lights = folder, lights
        self._key: str | None = None
        self._held: tuple[Signal, HeldOut] | None = None

    def of(self, cell: _Cell) -> tuple[Signal, HeldOut]:
        """Of a cell, baked where it is new."""
        key = cell.signal.key(cell.scene)
        if self._held is None or key != self._key:
            self._held = None
            signal = load_signal(cell.scene, cell.signal, self._folder)
            self._key, self._held = key, (signal, HeldOut(signal, self._lights))
        return self._held


def _ways(methods: Iterable[str], seed: int, seeds: int) -> list[Method]:
    """The methods as asked for, then original CPCA from its other starts."""
    ways = [Method.parse(method, seed) for method in methods]
    if any(way.name == ORIGINAL for way in ways):
        ways += [Method(ORIGINAL, seed=seed + further) for further in range(1, seeds)]
    return ways


def _pictures(output: Path, kept: Rows, cells: list[_Cell], keys: list[str]) -> list[str]:
    """Of every signal asked for, at the first number of clusters."""
    signals: dict[str, tuple[Scene, list[dict]]] = {}
    for key, cell in zip(keys, cells, strict=True):
        if cell.clusters == cells[0].clusters and key in kept.rows:
            signals.setdefault(cell.signal.key(cell.scene), (cell.scene, []))[1].append(kept.rows[key])
    written = [study_pictures(output, Surfaces.of(scene).receivers, rows) for scene, rows in signals.values()]
    return [path for path in written if path is not None]
