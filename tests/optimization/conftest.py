"""A baked, a compressed asset and references of them, small enough to train in a second."""

import os
import signal

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


class Stop:
    """Progress that presses Ctrl-C after some steps."""

    def __init__(self, after):
        self.left = after

    def __call__(self, text, total):
        return self

    def __enter__(self):
        return self.advance

    def __exit__(self, *error):
        return False

    def advance(self):
        self.left -= 1
        if self.left == 0:
            os.kill(os.getpid(), signal.SIGINT)


@pytest.fixture
def pressed():
    """Ctrl-C after so many steps, given as `track`."""
    return Stop
