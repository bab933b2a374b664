"""What tests of several rooms share: kernels compiled once, small scenes, and peers that CI may not skip."""

import importlib
import os
import pkgutil

import pytest
import torch
import warp

import diffprt.kernels
from diffprt.scene import Scene, builtin_scene
from diffprt.transfer import Transfer, bake

KERNEL_MODULES = (
    *(f"diffprt.kernels.{module.name}" for module in pkgutil.iter_modules(diffprt.kernels.__path__)),
    "diffprt.study.visibility.brute_force",
)


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config) -> None:
    """Before several workers start: every kernel is compiled once, and each worker is given one core of torch's."""
    if hasattr(config, "workerinput") or not getattr(config.option, "numprocesses", None):
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    for name in KERNEL_MODULES:
        module = importlib.import_module(name)
        kernels = [value for value in vars(module).values() if isinstance(value, warp.Kernel)]
        diffprt.kernels.compile_kernels(*(kernel for kernel in kernels if kernel.module.name == name))


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
