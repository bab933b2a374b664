"""Embree (through embreex) and Mitsuba as peers for visibility, each called in several batched ways.

Both are optional (`pip install "diffprt[study]"`). What was learned about calling them (embreex 4.4, Mitsuba
3.9): embreex traces single rays on one core and gains from near rays that follow each other, hardly from the
size of a batch. Mitsuba hands runs of 16 rays to Embree as packets, so it gains most where 16 neighbors in the
array share their origin and nearly their direction, from arrays that lie in memory; a launch per direction over
all receivers is several times slower, and its `coherent` flag slows it down.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version

import numpy as np
import torch

from diffprt.errors import InputError
from diffprt.kernels import default_threads
from diffprt.sh.frames import tangent_frames
from diffprt.study.mitsuba.scene import start_mitsuba
from diffprt.study.timing import Stopwatch
from diffprt.study.visibility.hemispheres import Hemispheres

# Counts blocked rays of every receiver, int64 [V], and times nothing but the tracing.
Way = Callable[[Stopwatch], np.ndarray]

# Rays that one launch of Mitsuba traces: enough for all cores, and the arrays stay below a gigabyte.
_WAVEFRONT = 1 << 24
_PACKET = 16
# Rays made at once for embreex, outside its time.
_STORED = 1 << 21


class Embree:
    """Embree's single-ray occlusion query, on one core.

    Raises:
        InputError: embreex is not installed.
    """

    def __init__(self, positions: torch.Tensor, faces: torch.Tensor) -> None:
        self.positions = positions.float().contiguous().numpy()
        self.faces = faces.to(torch.int32).contiguous().numpy()
        self._scene = self.attached()
        self.commit(self._scene)

    def attached(self) -> object:
        """A scene that holds the triangles, not yet built."""
        try:
            scenes, meshes = import_module("embreex.rtcore_scene"), import_module("embreex.mesh_construction")
        except ImportError as error:
            raise InputError('embreex is not installed: pip install "diffprt[study]"') from error
        scene = scenes.EmbreeScene(robust=False)
        meshes.TriangleMesh(scene, self.positions, self.faces)
        return scene

    @staticmethod
    def commit(scene: object) -> None:
        """Builds the structure, on all cores: embreex does it before the first ray."""
        scene.run(np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32), query="OCCLUDED")

    @staticmethod
    def version() -> dict:
        """Names and numbers for the report."""
        return {"embreex": version("embreex")}

    def ways(self, load: Hemispheres) -> dict[str, Way]:
        """Orders and batch sizes; without Embree's robust flag, which costs it about a fifth."""
        return {
            f"{order} order, batches of {size}": self._way(load, size, spiral=order == "spiral")
            for order in ("packet", "spiral")
            for size in (10_000, 100_000, 1_000_000)
        }

    def _way(self, load: Hemispheres, size: int, *, spiral: bool) -> Way:
        order = load.pattern.spiral[:, 2].argsort() if spiral else slice(None)
        step = max(1, _STORED // load.rays)

        def count(watch: Stopwatch) -> np.ndarray:
            counts = []
            for first in range(0, len(load), step):
                part = load.rows(slice(first, first + step))
                directions = part.directions()[:, order].reshape(-1, 3).contiguous().numpy()
                origins = part.origins.repeat_interleave(load.rays, dim=0).numpy()
                found = watch.time(lambda o=origins, d=directions: self._occluded(o, d, size))
                counts.append((found == 0).reshape(-1, load.rays).sum(1))
            return np.concatenate(counts)

        return count

    def _occluded(self, origins: np.ndarray, directions: np.ndarray, size: int) -> np.ndarray:
        """0 where something lies along the ray, else -1, int32 [D], in batches of `size` rays."""
        found = np.empty(len(origins), np.int32)
        for first in range(0, len(origins), size):
            batch = slice(first, first + size)
            found[batch] = self._scene.run(origins[batch], directions[batch], query="OCCLUDED")
        return found


class Mitsuba:
    """Mitsuba's LLVM variant, which traces packets with Embree on all cores.

    Raises:
        InputError: Mitsuba or LLVM is missing.
    """

    def __init__(self, positions: torch.Tensor, faces: torch.Tensor) -> None:
        self._mi, note = start_mitsuba()
        if not self._mi.variant().startswith("llvm"):
            raise InputError(note or f"Mitsuba runs its variant {self._mi.variant()}: start with llvm_ad_rgb")
        self._dr = import_module("drjit")
        self._dr.set_thread_count(default_threads())
        mesh = self._mi.Mesh("mesh", len(positions), len(faces))
        values = self._mi.traverse(mesh)
        values["vertex_positions"] = positions.float().reshape(-1).numpy()
        values["faces"] = faces.reshape(-1).numpy().astype(np.uint32)
        values.update()
        self._scene = self._mi.load_dict({"type": "scene", "mesh": mesh})

    def version(self) -> dict:
        """Names and numbers for the report."""
        return {"mitsuba": self._mi.__version__, "drjit": version("drjit"), "variant": self._mi.variant()}

    def ways(self, load: Hemispheres) -> dict[str, Way]:
        """Where the rays come from and how they are grouped; compiled by a first run outside any timing."""
        return {
            "rays in memory, packet order": self._stored(load),
            "rays in memory, packet order, coherent flag": self._stored(load, coherent=True),
            "rays made on the device, packet order": self._made(load),
            "one launch, each packet loops over its receiver": self._looped(load),
            "one launch per direction": self._launched(load),
        }

    def _vector(self, rows: torch.Tensor, kind: str) -> object:
        """Rows [N, 2 or 3] as an evaluated Dr.Jit vector."""
        vector = getattr(self._mi, kind)(np.ascontiguousarray(rows.numpy().T))
        self._dr.eval(vector)
        return vector

    def _hit(self, origins: object, directions: object, coherent: bool = False) -> object:
        """1 where something lies along the ray, else 0."""
        mi, dr = self._mi, self._dr
        blocked = self._scene.ray_test(mi.Ray3f(origins, directions), mi.Bool(coherent), True)
        return dr.select(blocked, mi.UInt32(1), mi.UInt32(0))

    def _count(self, watch: Stopwatch, launches: list[Callable[[], object]]) -> np.ndarray:
        """Runs launches that return counts per receiver, one after another, and waits for each."""

        def work() -> list:
            found = []
            for launch in launches:
                counts = launch()
                self._dr.eval(counts)
                self._dr.sync_thread()
                found.append(counts)
            return found

        return np.concatenate([np.array(counts) for counts in watch.time(work)]).astype(np.int64)

    def _parts(self, load: Hemispheres) -> list[Hemispheres]:
        step = max(1, _WAVEFRONT // load.rays)
        return [load.rows(slice(first, first + step)) for first in range(0, len(load), step)]

    def _stored(self, load: Hemispheres, *, coherent: bool = False) -> Way:
        stored: list = []

        def launch(origins: object, directions: object) -> object:
            return self._dr.block_sum(self._hit(origins, directions, coherent), load.rays)

        def count(watch: Stopwatch) -> np.ndarray:
            if not stored:
                for part in self._parts(load):
                    origins = self._vector(part.origins.repeat_interleave(load.rays, dim=0), "Point3f")
                    stored.append((origins, self._vector(part.directions().reshape(-1, 3), "Vector3f")))
            return self._count(watch, [lambda o=o, d=d: launch(o, d) for o, d in stored])

        return count

    def _tables(self, load: Hemispheres) -> tuple[object, list, object, object, object]:
        """Origins, frames, turns and shifts of receivers, and the spiral, on the device."""
        frames = tangent_frames(load.normals)
        columns = [self._vector(frames[:, :, k], "Vector3f") for k in range(3)]
        shift = self._mi.Float(load.pattern.ring_shift.numpy())
        origins, turns = self._vector(load.origins, "Point3f"), self._vector(load.pattern.rotation, "Vector2f")
        return origins, columns, turns, shift, self._vector(load.pattern.spiral, "Vector3f")

    def _direction(self, rays: int, frame: list, turn: object, shift: object, entry: object) -> object:
        """The direction of `transfer.sampling.hemisphere_directions` for one row `entry` of the spiral."""
        dr = self._dr
        square = (entry.z + shift) / rays
        radius = dr.sqrt(square)
        x = radius * (entry.x * turn.x - entry.y * turn.y)
        y = radius * (entry.x * turn.y + entry.y * turn.x)
        return frame[0] * x + frame[1] * y + frame[2] * dr.sqrt(dr.maximum(1 - square, 0))

    def _made(self, load: Hemispheres) -> Way:
        mi, dr, rays = self._mi, self._dr, load.rays
        parts = [(len(part), self._tables(part)) for part in self._parts(load)]

        def launch(receivers: int, tables: tuple) -> object:
            origins, frame, turn, shift, spiral = tables
            ray = dr.arange(mi.UInt32, receivers * rays)
            receiver = ray // rays
            frame, turn, shift, origin = (_gathered(dr, x, receiver) for x in (frame, turn, shift, origins))
            entry = dr.gather(mi.Vector3f, spiral, ray - receiver * rays)
            return dr.block_sum(self._hit(origin, self._direction(rays, frame, turn, shift, entry)), rays)

        return lambda watch: self._count(watch, [lambda n=n, t=t: launch(n, t) for n, t in parts])

    def _looped(self, load: Hemispheres) -> Way:
        mi, dr, rays = self._mi, self._dr, load.rays
        tables = self._tables(load)

        def launch() -> object:
            origins, frame, turn, shift, spiral = tables
            lane = dr.arange(mi.UInt32, len(load) * _PACKET)
            receiver = lane // _PACKET
            slot = lane - receiver * _PACKET
            frame, turn, shift, origin = (_gathered(dr, x, receiver) for x in (frame, turn, shift, origins))

            def step(first: object, blocked: object) -> tuple[object, object]:
                own = first + slot
                entry = dr.gather(mi.Vector3f, spiral, dr.minimum(own, rays - 1))
                hit = self._hit(origin, self._direction(rays, frame, turn, shift, entry))
                return first + _PACKET, blocked + dr.select(own < rays, hit, 0)

            start = (mi.UInt32(0), dr.zeros(mi.UInt32, len(load) * _PACKET))
            _, blocked = dr.while_loop(start, lambda first, blocked: first < rays, step)
            return dr.block_sum(blocked, _PACKET)

        return lambda watch: self._count(watch, [launch])

    def _launched(self, load: Hemispheres) -> Way:
        mi, dr, rays = self._mi, self._dr, load.rays
        tables = self._tables(load)

        def launch() -> object:
            origins, frame, turn, shift, spiral = tables
            blocked = dr.zeros(mi.UInt32, len(load))
            for k in range(rays):
                entry = dr.gather(mi.Vector3f, spiral, dr.opaque(mi.UInt32, k))
                blocked += self._hit(origins, self._direction(rays, frame, turn, shift, entry))
                dr.eval(blocked)
            return blocked

        return lambda watch: self._count(watch, [launch])


def _gathered(dr, source: object, index: object) -> object:
    """`source`, or every entry of a list, at `index`."""
    if isinstance(source, list):
        return [_gathered(dr, entry, index) for entry in source]
    return dr.gather(type(source), source, index)
