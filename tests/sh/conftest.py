"""The dtypes and inputs that the tests of spherical harmonics share."""

from collections.abc import Callable

import pytest
import torch
from tolerances import TOLERANCE


@pytest.fixture(params=[torch.float32, torch.float64], ids=["float32", "float64"])
def dtype(request: pytest.FixtureRequest) -> torch.dtype:
    return request.param


@pytest.fixture
def tolerance(dtype: torch.dtype) -> float:
    return TOLERANCE[dtype]["harmonics"]


@pytest.fixture
def random() -> Callable[..., torch.Tensor]:
    """Standard normal float64 tensors, the same in every run."""
    generator = torch.Generator().manual_seed(20240607)
    return lambda *shape: torch.randn(*shape, dtype=torch.float64, generator=generator)


@pytest.fixture
def directions(random: Callable[..., torch.Tensor]) -> torch.Tensor:
    """Unit directions [206, 3] in float64: both signs of each axis, then random ones."""
    axes = torch.eye(3, dtype=torch.float64)
    return torch.cat([axes, -axes, torch.nn.functional.normalize(random(200, 3), dim=-1)])
