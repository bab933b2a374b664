"""Scenes that need no file: known answers for tests, and a first picture for everyone."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from diffprt.errors import InputError
from diffprt.scene.ground import grid_faces
from diffprt.scene.icosphere import icosphere
from diffprt.scene.material import Material
from diffprt.scene.mesh import Mesh

_FINEST = 8
_WHITE, _RED, _GREEN = (0.725, 0.71, 0.68), (0.63, 0.065, 0.05), (0.14, 0.45, 0.091)

Built = tuple[tuple[Mesh, ...], tuple[Material, ...]]


def builtin_meshes(name: str, *, subdivisions: int | None = None, size: float | None = None) -> Built:
    """Meshes and materials of the built-in scene `name`; see `diffprt.scene.builtin_scene`."""
    if name not in _BUILDERS:
        raise InputError(f"built-in scene '{name}' is unknown: known are {', '.join(BUILTIN_SCENES)}")
    builder, default = _BUILDERS[name]
    subdivisions = default if subdivisions is None else subdivisions
    if not 0 <= subdivisions <= _FINEST:
        raise InputError(f"built-in scene '{name}' has subdivisions={subdivisions}: give 0 to {_FINEST}")
    if size is None:
        return builder(subdivisions)
    if name != "wall_and_floor" or not (size > 4 and np.isfinite(size)):
        raise InputError(f"built-in scene '{name}' has size={size:g}: only 'wall_and_floor' has one, above 4")
    return builder(subdivisions, size=size)


def _bunny(subdivisions: int) -> Built:
    """The rabbit of warp-lang's examples: 6,102 vertices, 12,200 triangles, Loop-subdivided."""
    from diffprt.scene.readers.usd import read_usd

    package = find_spec("warp")
    folder = Path(next(iter(package.submodule_search_locations or ()))) if package else Path()
    path = folder / "examples" / "assets" / "bunny.usd"
    if not path.is_file():
        raise InputError(f"built-in scene 'bunny' needs {path}: install warp-lang from PyPI, or load a mesh file")
    part = read_usd(path).parts[0]
    positions, faces = np.asarray(part.positions, dtype=np.float64)[: part.faces.max() + 1], part.faces
    positions, faces = _unsplit(positions, faces)
    if subdivisions:
        from trimesh.remesh import subdivide_loop

        positions, faces = subdivide_loop(positions, faces, iterations=subdivisions)
    return (Mesh.create(positions, faces, name="bunny"),), (Material(0.8, name="bunny"),)


def _unsplit(positions: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One vertex per position, in order: face-varying normals of the file would tear the surface."""
    _, first, inverse = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return positions[first[order]], rank[inverse.reshape(-1)][faces]


def _sphere(subdivisions: int) -> Built:
    """Unit icosphere of 10 * 4^n + 2 vertices with exact normals."""
    vertices, faces = icosphere(subdivisions)
    return (Mesh.create(vertices, faces, vertices, name="sphere"),), (Material(0.8, name="sphere"),)


def _bowl(subdivisions: int) -> Built:
    """Lower half of the unit sphere, open to +y, front side within; the rim lies at y = 0 exactly."""
    rings, sectors = 8 << subdivisions, 32 << subdivisions
    angle = np.arange(1, rings + 1) * (np.pi / 2 / rings)
    around = np.arange(sectors) * (2 * np.pi / sectors)
    sine, cosine = np.sin(angle), np.cos(angle)
    cosine[-1] = 0.0
    ring = np.stack(
        np.broadcast_arrays(sine[:, None] * np.cos(around), -cosine[:, None], sine[:, None] * np.sin(around)),
        axis=-1,
    ).reshape(-1, 3)
    positions = np.concatenate([[[0.0, -1.0, 0.0]], ring]) + 0.0
    i = np.arange(sectors)
    cap = np.stack([np.zeros_like(i), 1 + (i + 1) % sectors, 1 + i], axis=1)
    inner = 1 + np.arange(rings - 1)[:, None] * sectors
    a, b = (inner + i).reshape(-1), (inner + (i + 1) % sectors).reshape(-1)
    c, d = a + sectors, b + sectors
    faces = np.concatenate([cap, np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
    return (Mesh.create(positions, faces, -positions, name="bowl"),), (Material(0.8, name="bowl"),)


def _wall_and_floor(subdivisions: int, size: float = 1e4) -> Built:
    """A floor y = 0 (x >= 0) and a wall x = 0 (y >= 0) that share the z axis, both `size` large.

    The floor has a vertex at (1, 0, 0): from there the wall hides half the sky, up to about 1 / size.
    """
    cells = 2 << subdivisions
    near = np.linspace(0, 2, cells + 1)
    far = np.geomspace(2, size, 9)[1:]
    out = np.concatenate([near, far])
    along = np.concatenate([-far[::-1], np.linspace(-2, 2, 2 * cells + 1), far])
    a, b = np.meshgrid(out, along)
    zero = np.zeros_like(a)
    faces = grid_faces(len(along) - 1, len(out) - 1)
    floor = np.stack([a, zero, b], axis=-1).reshape(-1, 3)
    wall = np.stack([zero, a, b], axis=-1).reshape(-1, 3)
    meshes = (
        Mesh.create(floor, faces, np.broadcast_to([0.0, 1.0, 0.0], floor.shape), material=0, name="floor"),
        Mesh.create(wall, faces[:, [0, 2, 1]], np.broadcast_to([1.0, 0.0, 0.0], wall.shape), material=1, name="wall"),
    )
    return meshes, (Material(0.5, name="floor"), Material(0.5, name="wall"))


def _patch(
    corner: ArrayLike, along: ArrayLike, across: ArrayLike, cells: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A grid of cells² quads from `corner` over the edges `along` and `across`; it faces along x across."""
    corner, along, across = (np.asarray(x, dtype=np.float64) for x in (corner, along, across))
    step = np.linspace(0, 1, cells + 1)
    a, b = np.meshgrid(step, step)
    # The far edge is the sum itself, so that neighbours meet at equal coordinates.
    positions = (corner + a[..., None] * along + b[..., None] * across).reshape(-1, 3)
    normal = np.cross(along, across)
    normals = np.broadcast_to(normal / np.linalg.norm(normal), positions.shape)
    return positions, grid_faces(cells, cells)[:, [0, 2, 1]], normals


def _joined(patches: list[tuple[np.ndarray, np.ndarray, np.ndarray]], material: int, name: str) -> Mesh:
    offsets = np.cumsum([0] + [len(p) for p, _, _ in patches[:-1]])
    return Mesh.create(
        np.concatenate([p for p, _, _ in patches]),
        np.concatenate([f + o for (_, f, _), o in zip(patches, offsets, strict=True)]),
        np.concatenate([n for _, _, n in patches]),
        material=material,
        name=name,
    )


def _closed_box(subdivisions: int) -> Built:
    """The cube [-1, 1]³ seen from within: six walls, each with its own exact normals."""
    cells = 1 << subdivisions
    patches = [
        _patch((-1, -1, -1), (0, 0, 2), (2, 0, 0), cells),
        _patch((-1, 1, -1), (2, 0, 0), (0, 0, 2), cells),
        _patch((-1, -1, -1), (2, 0, 0), (0, 2, 0), cells),
        _patch((-1, -1, 1), (0, 2, 0), (2, 0, 0), cells),
        _patch((-1, -1, -1), (0, 2, 0), (0, 0, 2), cells),
        _patch((1, -1, -1), (0, 0, 2), (0, 2, 0), cells),
    ]
    return (_joined(patches, 0, "box"),), (Material(0.8, name="box"),)


def _block(center: tuple, half: float, height: float, degrees: float, cells: int, name: str) -> Mesh:
    """A block of the Cornell room on the floor, without its underside."""
    turn = np.radians(degrees)
    a = 2 * half * np.array([np.cos(turn), 0, -np.sin(turn)])
    b = 2 * half * np.array([np.sin(turn), 0, np.cos(turn)])
    up = np.array([0, height, 0])
    low = np.array([center[0], 0, center[1]]) - (a + b) / 2
    patches = [
        _patch(low, up, a, cells),
        _patch(low + a, up, b, cells),
        _patch(low + a + b, up, -a, cells),
        _patch(low + b, up, -b, cells),
        _patch(low + up, b, a, cells),
    ]
    return _joined(patches, 0, name)


def _cornell(subdivisions: int) -> Built:
    """A Cornell-like room [-1, 1] x [0, 2] x [-1, 1], open to +z, red on the left, green on the right."""
    cells = 1 << subdivisions
    meshes = (
        _joined([_patch((-1, 0, -1), (0, 0, 2), (2, 0, 0), cells)], 0, "floor"),
        _joined([_patch((-1, 2, -1), (2, 0, 0), (0, 0, 2), cells)], 0, "ceiling"),
        _joined([_patch((-1, 0, -1), (2, 0, 0), (0, 2, 0), cells)], 0, "back"),
        _joined([_patch((-1, 0, -1), (0, 2, 0), (0, 0, 2), cells)], 1, "left"),
        _joined([_patch((1, 0, -1), (0, 0, 2), (0, 2, 0), cells)], 2, "right"),
        _block((0.35, 0.3), 0.3, 0.6, -17, max(cells // 2, 1), "short block"),
        _block((-0.35, -0.3), 0.3, 1.2, 18, max(cells // 2, 1), "tall block"),
    )
    colors = (("white", _WHITE), ("red", _RED), ("green", _GREEN))
    return meshes, tuple(Material(color, name=name) for name, color in colors)


_BUILDERS = {
    "bunny": (_bunny, 1),
    "sphere": (_sphere, 4),
    "bowl": (_bowl, 3),
    "wall_and_floor": (_wall_and_floor, 3),
    "closed_box": (_closed_box, 4),
    "cornell": (_cornell, 4),
}
BUILTIN_SCENES = tuple(_BUILDERS)
