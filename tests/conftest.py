"""What tests of several rooms share: small scenes, and peers that CI may not skip."""

import importlib
import os

import pytest
import torch

from diffprt.scene import Scene, builtin_scene
from diffprt.transfer import Transfer, bake


def bumpy_sphere(subdivisions: int = 3, bump: float = 0.3) -> Scene:
    """A closed surface with dents: partly shadowed nearly everywhere."""
    ball = builtin_scene("sphere", subdivisions=subdivisions).meshes[0]
    p = ball.positions.double()
    scale = 1 + bump * (5 * p[:, :1]).sin() * (7 * p[:, 1:2]).sin() * (6 * p[:, 2:]).sin()
    return Scene.from_mesh((p * scale).float(), ball.faces, albedo=(0.7, 0.5, 0.3), name="bumpy sphere")


@pytest.fixture(scope="session")
def bumpy() -> Scene:
    return bumpy_sphere()


@pytest.fixture(scope="session")
def bumpy_transfer(bumpy) -> Transfer:
    return bake(bumpy, order=4, rays=128, bounces=1)


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(20261122)


@pytest.fixture
def peer():
    """Imports an optional peer; skips without it, unless CI forbids that."""

    def load(name: str):
        if os.environ.get("DIFFPRT_REQUIRE_PEERS") == "1":
            return importlib.import_module(name)
        return pytest.importorskip(name)

    return load
