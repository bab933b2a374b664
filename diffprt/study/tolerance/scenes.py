"""Random scenes: solids of random kinds, numbers, places and albedos, from a seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from trimesh.creation import box, cylinder, icosphere, torus

from diffprt.scene import Material, Mesh, Scene

_MOST_SOLIDS = 5
_GROUND_SHARE = 0.5

Solid = tuple[np.ndarray, np.ndarray]


def random_scene(seed: int) -> Scene:
    """One to five solids that may overlap, on a ground in half of all scenes; some hundred to 25 thousand receivers.

    Args:
        seed: the same seed gives the same scene.
    """
    draw = np.random.default_rng(seed)
    count = int(draw.integers(1, _MOST_SOLIDS + 1))
    meshes, materials = [], []
    for index in range(count):
        kind = _SOLIDS[draw.integers(len(_SOLIDS))]
        positions, faces = kind(draw)
        spread = 1.2 * count ** (1 / 3) - 1.0
        place = draw.uniform(-spread, spread, 3)
        positions = draw.uniform(0.4, 1.0) * positions @ _turn(draw).T + place
        name = f"{kind.__name__.strip('_')} {index}"
        meshes.append(Mesh.create(positions, faces, material=index, name=name))
        materials.append(Material(tuple(draw.uniform(0.05, 0.9, 3)), name=name))
    scene = Scene(tuple(meshes), tuple(materials), name=f"random {seed}")
    if draw.random() < _GROUND_SHARE:
        scene = scene.with_ground(resolution=int(draw.integers(16, 65)), albedo=float(draw.uniform(0.1, 0.8)))
    return scene


def _sphere(draw: np.random.Generator) -> Solid:
    ball = icosphere(subdivisions=int(draw.integers(3, 5)))
    return ball.vertices, ball.faces


def _blob(draw: np.random.Generator) -> Solid:
    """A sphere dented by a few waves."""
    ball = icosphere(subdivisions=int(draw.integers(4, 6)))
    return ball.vertices * (1 + 0.2 * _waves(draw, ball.vertices, count=3, frequency=6.0)), ball.faces


def _rough(draw: np.random.Generator) -> Solid:
    """A sphere under noise of five octaves: pits that see little."""
    ball = icosphere(subdivisions=5)
    noise = sum(_waves(draw, ball.vertices, count=4, frequency=3.0 * 2**k) / 2**k for k in range(5))
    return ball.vertices * (1 + 0.12 * noise), ball.faces


def _box(draw: np.random.Generator) -> Solid:
    return _divided(box(extents=draw.uniform(0.5, 1.6, 3)), draw)


def _slab(draw: np.random.Generator) -> Solid:
    return _divided(box(extents=(draw.uniform(1.0, 2.5), draw.uniform(0.03, 0.1), draw.uniform(1.0, 2.5))), draw)


def _ring(draw: np.random.Generator) -> Solid:
    made = torus(1.0, draw.uniform(0.15, 0.45), major_sections=64, minor_sections=32)
    return made.vertices, made.faces


def _pillar(draw: np.random.Generator) -> Solid:
    return _divided(cylinder(draw.uniform(0.1, 0.4), draw.uniform(1.0, 2.5), sections=24), draw)


_SOLIDS: tuple[Callable[[np.random.Generator], Solid], ...] = (_sphere, _blob, _rough, _box, _slab, _ring, _pillar)


def _divided(solid: object, draw: np.random.Generator) -> Solid:
    """Edges cut until they are short enough to carry shadows."""
    made = solid.subdivide_to_size(draw.uniform(0.08, 0.2), max_iter=12)
    made.merge_vertices()
    return made.vertices, made.faces


def _waves(draw: np.random.Generator, points: np.ndarray, *, count: int, frequency: float) -> np.ndarray:
    """Mean of `count` random plane waves at points [N, 3], as a factor [N, 1]."""
    waves = draw.normal(scale=frequency / 2, size=(count, 3))
    phases = draw.uniform(0, 2 * np.pi, count)
    return np.sin(points @ waves.T + phases).sum(1, keepdims=True) / count**0.5


def _turn(draw: np.random.Generator) -> np.ndarray:
    """A random rotation [3, 3]: the axes of a Gaussian matrix, right-handed."""
    axes, _ = np.linalg.qr(draw.normal(size=(3, 3)))
    return axes * np.sign(np.linalg.det(axes))
