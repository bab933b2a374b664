"""A baked, a compressed asset and references of them, small enough to train in a second."""

import pytest

from diffprt.compression import compress
from diffprt.optimization import make_references
from diffprt.scene import builtin_environment


@pytest.fixture(scope="session")
def lights():
    return [builtin_environment(name).project(4) for name in ("sky", "studio")]


@pytest.fixture(scope="session")
def references(bumpy_transfer, lights):
    return make_references(bumpy_transfer, lights, 10, width=48, height=40, seed=3)


@pytest.fixture(scope="session")
def small(bumpy_transfer):
    return compress(bumpy_transfer, clusters=6, components=3, method="lbg")
