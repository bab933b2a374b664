"""Hard case 9: rows of the bounce operator are form factors."""

import itertools
import math

import pytest
import torch
from tolerances import FLOAT32

from diffprt.scene import Material, Mesh, Scene, builtin_scene
from diffprt.transfer import Transport, trace


def square(corner: tuple, along: tuple, across: tuple, cells: int = 16) -> tuple[torch.Tensor, torch.Tensor]:
    """Positions and faces of a unit square that faces along x across."""
    step = torch.linspace(0, 1, cells + 1)
    a, b = torch.meshgrid(step, step, indexing="ij")
    corner, along, across = (torch.tensor(x, dtype=torch.float32) for x in (corner, along, across))
    positions = corner + a.reshape(-1, 1) * along + b.reshape(-1, 1) * across
    i = (torch.arange(cells)[:, None] * (cells + 1) + torch.arange(cells)).reshape(-1)
    faces = torch.cat(
        [torch.stack([i, i + cells + 1, i + 1], 1), torch.stack([i + 1, i + cells + 1, i + cells + 2], 1)]
    )
    return positions, faces


def disk(height: float, up: bool, rings: int = 16, sectors: int = 96) -> tuple[torch.Tensor, torch.Tensor]:
    """Positions and faces of a disk about +y, of area pi exactly."""
    stretch = math.sqrt(2 * math.pi / sectors / math.sin(2 * math.pi / sectors))
    radius = torch.arange(1, rings + 1) / rings * stretch
    angle = torch.arange(sectors) * (2 * math.pi / sectors)
    ring = torch.stack([radius[:, None] * angle.cos(), torch.zeros(rings, sectors), radius[:, None] * angle.sin()], -1)
    positions = torch.cat([torch.zeros(1, 3), ring.reshape(-1, 3)]) + torch.tensor([0, height, 0])
    i = torch.arange(sectors)
    nxt = (i + 1) % sectors
    faces = [torch.stack([torch.zeros_like(i), 1 + nxt, 1 + i], 1)]
    for r in range(rings - 1):
        inner, outer = 1 + r * sectors, 1 + (r + 1) * sectors
        faces += [
            torch.stack([inner + i, inner + nxt, outer + i], 1),
            torch.stack([inner + nxt, outer + nxt, outer + i], 1),
        ]
    faces = torch.cat(faces)
    return positions, faces if up else faces[:, [0, 2, 1]]


def traced(*surfaces: tuple[torch.Tensor, torch.Tensor]) -> tuple[Transport, list[slice]]:
    meshes = tuple(Mesh.create(p, f) for p, f in surfaces)
    transport = trace(Scene(meshes, (Material(0.5),)), order=1, rays=4096, bounces=1)
    ends = torch.tensor([0, *(len(p) for p, _ in surfaces)]).cumsum(0).tolist()
    return transport, [slice(a, b) for a, b in itertools.pairwise(ends)]


def areas(transport: Transport) -> torch.Tensor:
    receivers = transport.receivers
    a, b, c = receivers.positions[receivers.faces].unbind(1)
    area = torch.linalg.cross(b - a, c - a).norm(dim=1) / 6
    return torch.zeros(len(receivers)).index_add_(0, receivers.faces.flatten(), area.repeat_interleave(3))


def form_factor(transport: Transport, one: slice, two: slice) -> float:
    """Share of what leaves `one` that arrives at `two`: the mean over `one` of the rows of G summed over `two`."""
    weight = areas(transport)[one]
    target = torch.zeros(len(transport.receivers))
    target[two] = 1
    return float((transport.operator.gather(target)[one] * weight).sum() / weight.sum())


# Along a shared edge the rows jump from what one side sees to a half: vertices integrate that to first order.
CASES = {
    "parallel squares": (
        square((0, 0, 0), (0, 0, 1), (1, 0, 0)),
        square((0, 1, 0), (1, 0, 0), (0, 0, 1)),
        0.199825,
        1e-3,
    ),
    "perpendicular squares": (
        square((0, 0, 0), (0, 0, 1), (1, 0, 0), 32),
        square((0, 0, 0), (0, 1, 0), (0, 0, 1), 32),
        0.200044,
        4e-3,
    ),
    "coaxial disks": (disk(0, True), disk(1, False), 0.381966, 2e-3),
}


@pytest.mark.parametrize("name", CASES)
def test_known_form_factors_and_reciprocity(name):
    one, two, expected, tolerance = CASES[name]
    transport, (first, second) = traced(one, two)
    forth, back = form_factor(transport, first, second), form_factor(transport, second, first)
    assert forth == pytest.approx(expected, abs=tolerance)
    # Both have unit (or equal) areas: A_1 F_12 = A_2 F_21.
    assert forth == pytest.approx(back, abs=tolerance)
    assert form_factor(transport, first, first) == 0


def test_reciprocity_of_unequal_areas():
    small, large = square((0.25, 0, 0.25), (0, 0, 0.5), (0.5, 0, 0)), square((0, 1, 0), (1, 0, 0), (0, 0, 1))
    transport, (first, second) = traced(small, large)
    assert 0.25 * form_factor(transport, first, second) == pytest.approx(
        float(areas(transport)[second].sum()) * form_factor(transport, second, first), rel=5e-3
    )


def test_rows_of_a_closed_room_sum_to_one():
    transport = trace(builtin_scene("closed_box", subdivisions=3), order=1, rays=512, bounces=1)
    sums = transport.operator.gather(torch.ones(len(transport.receivers), dtype=torch.float64))
    assert float((sums - 1).abs().max()) < FLOAT32["rounding"]
