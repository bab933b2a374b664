import math

import pytest
import torch
from tolerances import FLOAT32, FLOAT64

from diffprt import sh
from diffprt.errors import InputError

SQUARE = torch.tensor([[-1.0, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=torch.float64)


def cube_faces() -> list[torch.Tensor]:
    """The six faces of the cube about the origin, as turned copies of one."""
    third = torch.tensor([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]], dtype=torch.float64)
    return [sign * SQUARE @ turn.T for sign in (1, -1) for turn in (torch.eye(3).double(), third, third @ third)]


def by_quadrature(corner: torch.Tensor, side: torch.Tensor, other: torch.Tensor, order: int) -> torch.Tensor:
    """A parallelogram by product Gauss nodes over its area, ∫ y cosine / r² dA."""
    nodes, weights = sh.sphere_quadrature(120)
    nodes, weights = (nodes[::121, 2] + 1) / 2, weights[::121] * 121 / (4 * math.pi)
    points = corner + nodes[:, None, None] * side + nodes[None, :, None] * other
    distance = points.norm(dim=-1)
    normal = torch.linalg.cross(side, other)
    density = (points @ normal).abs() / distance**3 * weights[:, None] * weights
    return torch.einsum("ab,abk->k", density, sh.basis(points / distance[..., None], order))


@pytest.mark.parametrize("order", [1, 2, 4, 10])
def test_against_quadrature_over_the_area(order, dtype, tolerance):
    corner, side, other = torch.tensor([[0.4, -0.3, 1.2], [0.9, 0.2, 0.1], [-0.3, 1.1, 0.4]], dtype=torch.float64)
    polygon = torch.stack([corner, corner + side, corner + side + other, corner + other])
    values = sh.project_polygon(polygon.to(dtype), order)
    assert values.dtype == dtype
    assert (values.double() - by_quadrature(corner, side, other, order)).abs().max() < tolerance


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_cube_around_the_viewpoint_is_the_whole_sphere(scale):
    """Six faces seen from inside close up: a constant function, whatever the viewpoint."""
    viewpoint = torch.tensor([0.3, -0.9, 0.5], dtype=torch.float64)
    total = sum(sh.project_polygon(scale * (face - viewpoint), 10) for face in cube_faces())
    assert total[0].item() == pytest.approx(math.sqrt(4 * math.pi), rel=1e-13)
    assert total[1:].abs().max() < FLOAT64["rounding"]


def test_one_cube_face_has_a_sixth_of_the_sphere_and_its_symmetry():
    values = sh.project_polygon(SQUARE, 5)
    assert values[0].item() * math.sqrt(4 * math.pi) == pytest.approx(4 * math.pi / 6, rel=1e-14)
    # Fourfold about z and mirrored in x: only m = 0 and m = 4 are left.
    allowed = {l * (l + 1) for l in range(5)} | {4 * 5 + 4}
    assert all(abs(v) < 1e-14 for i, v in enumerate(values.tolist()) if i not in allowed)


def test_non_convex_polygon_is_the_sum_of_its_parts():
    def flat(points):
        return torch.tensor([[x, y, 1.5] for x, y in points], dtype=torch.float64)

    shape = flat([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)])
    parts = [flat([(0, 0), (2, 0), (2, 1), (0, 1)]), flat([(0, 1), (1, 1), (1, 2), (0, 2)])]
    for start in range(6):  # the fan of the solid angle may start at the notch
        turned = sh.project_polygon(shape.roll(start, 0), 7)
        assert torch.allclose(turned, sum(sh.project_polygon(part, 7) for part in parts), atol=1e-13)


def test_winding_and_distance_do_not_matter():
    reference = sh.project_polygon(SQUARE, 6)
    assert torch.allclose(sh.project_polygon(SQUARE.flip(0), 6), reference, atol=1e-14)
    assert torch.allclose(sh.project_polygon(SQUARE * 7, 6), reference, atol=1e-14)
    divided = torch.cat([SQUARE[:1], (SQUARE[:1] + SQUARE[1:2]) / 2, SQUARE[1:], SQUARE[:1]])  # one corner twice
    assert torch.allclose(sh.project_polygon(divided, 6), reference, atol=1e-14)


def test_many_corners_become_a_cap():
    """A regular polygon differs from the disc about it by O(1/N²)."""
    errors = []
    for count in (100, 200):
        angle = 2 * math.pi * torch.arange(count, dtype=torch.float64) / count
        ring = math.tan(0.6) * torch.stack([angle.cos(), angle.sin(), angle * 0 + 1 / math.tan(0.6)], dim=-1)
        lobe = sh.rotate_zonal(sh.cap(0.6, 8), torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64))
        errors.append((sh.project_polygon(ring, 8) - lobe).abs().max().item())
    assert errors[0] < 1e-3 and errors[0] / errors[1] == pytest.approx(4, rel=0.01)


def test_tiny_polygon_is_a_point_of_its_solid_angle():
    face = torch.tensor([0.0, 0, 1]) + SQUARE * torch.tensor([1e-4, 1e-4, 0])
    values = sh.project_polygon(face, 10) / 4e-8
    assert torch.allclose(values, sh.basis(torch.tensor([0.0, 0, 1]).double(), 10), atol=FLOAT32["rounding"])


def test_hemisphere_in_the_limit():
    """A huge plane fills the half space, which has sqrt(pi), sqrt(3 pi)/2 and 0 in bands 0, 1 and 2."""
    values = sh.project_polygon(SQUARE * torch.tensor([1e8, 1e8, 1.0]), 3)
    assert values[[0, 2, 6]].tolist() == pytest.approx([math.sqrt(math.pi), math.sqrt(3 * math.pi) / 2, 0], abs=1e-7)


@pytest.mark.parametrize("order", [1, 4])
def test_gradients(order):
    corners = (SQUARE[:3] + torch.tensor([0.1, 0.2, 0.3])).requires_grad_()
    assert torch.autograd.gradcheck(lambda c: sh.project_polygon(c, order), corners)


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        (SQUARE[:2], r"\[2, 3\]"),
        (SQUARE.long(), "int64"),
        (SQUARE * torch.tensor([[0.0], [1], [1], [1]]), "at the origin"),
    ],
)
def test_errors(corners, message):
    with pytest.raises(InputError, match=message):
        sh.project_polygon(corners, 3)
