import math

import pytest
import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.scene.light import Light
from diffprt.scene.light_shapes import area_light, constant_light, directional_light, disc_light, sphere_light

DOUBLE = torch.float64
COLOR = (3.0, 2.0, 0.5)
QUAD = ((-1.0, 2.0, -1.0), (-1.0, 2.0, 1.0), (1.0, 2.0, 1.0), (1.0, 2.0, -1.0))  # faces up, +y
DOWN = QUAD[::-1]


def irradiance(light: Light, normal: tuple[float, float, float]) -> torch.Tensor:
    """Unshadowed irradiance at a normal, from the light's coefficients alone."""
    lit = sh.convolve(light.coefficients.double(), sh.clamped_cosine(light.order))
    return sh.evaluate(lit, torch.nn.functional.normalize(torch.tensor(normal, dtype=DOUBLE), dim=0))


LIGHTS = {
    "directional": lambda **options: directional_light((1, 2, -1), COLOR, 5, **options),
    "disc": lambda **options: disc_light((1, 2, -1), 0.3, COLOR, 5, **options),
    "sphere": lambda **options: sphere_light((1, 2, -1), 0.3, COLOR, 5, **options),
    "area": lambda **options: area_light(DOWN, COLOR, 5, **options),
    "constant": lambda **options: constant_light(COLOR, 5, **options),
}


@pytest.mark.parametrize("make", LIGHTS.values(), ids=LIGHTS.keys())
def test_every_light_has_its_color_and_dtype(make):
    single, double = make(), make(dtype=DOUBLE)
    assert isinstance(single, Light) and single.order == 5
    assert single.coefficients.dtype == torch.float32 and double.coefficients.dtype == DOUBLE
    assert torch.equal(single.coefficients, double.coefficients.float())
    gray = double.coefficients[:, :1] / COLOR[0]
    assert gray[0] > 0 and torch.allclose(double.coefficients, gray * torch.tensor(COLOR).double())


def test_directional_light_lights_a_facing_surface_with_its_irradiance():
    """In bands l <= 2: 1.0625 times the true maximum facing it, 0.0625 turned away, 0.09375 across."""
    light = directional_light((0, 0, 5), COLOR, 3, dtype=DOUBLE)
    for normal, factor in (((0, 0, 1), 1.0625), ((0, 0, -1), 0.0625), ((0, 1, 0), 0.09375)):
        assert irradiance(light, normal).tolist() == pytest.approx([factor * c for c in COLOR], abs=1e-12)


def test_small_disc_becomes_a_directional_light():
    direction = (0.3, 1.0, -0.2)
    sharp = directional_light(direction, COLOR, 10, dtype=DOUBLE).coefficients
    differences = []
    for half_angle in (0.02, 0.01):
        radiance = torch.tensor(COLOR).double() / (4 * math.pi * math.sin(half_angle / 2) ** 2)
        disc = disc_light(direction, half_angle, radiance, 10, dtype=DOUBLE).coefficients
        differences.append((disc - sharp).abs().max().item())
    assert differences[0] / differences[1] == pytest.approx(4, rel=0.01)  # second order in the angle
    assert differences[1] < 0.01


def test_full_disc_is_the_constant_light():
    disc = disc_light((1, 0, 0), math.pi, COLOR, 6, dtype=DOUBLE)
    assert torch.allclose(disc.coefficients, constant_light(COLOR, 6, dtype=DOUBLE).coefficients, atol=1e-14)


def test_constant_light_is_a_furnace():
    light = constant_light(COLOR, 4, dtype=DOUBLE)
    assert irradiance(light, (0.2, 0.5, -1)).tolist() == pytest.approx([math.pi * c for c in COLOR], rel=1e-13)
    assert light.radiance(torch.tensor([0.0, 1.0, 0.0]).double()).tolist() == pytest.approx(COLOR, rel=1e-13)


@pytest.mark.parametrize("height", [0.3001, 1.0, 40.0])
def test_sphere_light_follows_the_square_of_the_sine(height):
    """Exact irradiance of a ball on the normal is π (R/h)² times its radiance, at any distance."""
    light = sphere_light((2, 1 + height, 3), 0.3, 1.0, 10, at=(2, 1, 3), dtype=DOUBLE)
    angle = math.asin(0.3 / height)
    cosine_moment = light.coefficients[1, 0] / -math.sqrt(3 / (4 * math.pi))  # ∫ y over the disc: y_{1,-1} is -y
    assert cosine_moment.item() == pytest.approx(math.pi * math.sin(angle) ** 2, rel=1e-11)
    solid_angle = light.coefficients[0, 0] * math.sqrt(4 * math.pi)
    assert solid_angle.item() == pytest.approx(2 * math.pi * (1 - math.cos(angle)), rel=1e-10)


def test_area_light_against_brute_force():
    """A million points of a midpoint rule over the area: cosine / r² towards each."""
    at = torch.tensor([0.4, 0.1, -0.7], dtype=DOUBLE)
    steps = (torch.arange(1000, dtype=DOUBLE) + 0.5) / 500 - 1
    x, z = torch.meshgrid(steps, steps, indexing="ij")
    offset = torch.stack([x, torch.full_like(x, 2.0), z], dim=-1).reshape(-1, 3) - at
    distance = offset.norm(dim=-1)
    weights = offset[:, 1] / distance**3 * 4e-6
    expected = weights @ sh.basis(offset / distance[:, None], 4)
    light = area_light(DOWN, COLOR, 4, at=at, dtype=DOUBLE).coefficients
    assert torch.allclose(light, expected[:, None] * torch.tensor(COLOR).double(), atol=1e-6)


def test_area_light_form_factor():
    """A unit square at distance 1 with a corner on the normal: the textbook point-to-rectangle factor."""
    corners = [(0, 1, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)]
    light = area_light(corners, 1.0, 2, at=(0, 0, 0), dtype=DOUBLE, two_sided=True)
    r = 1 / math.sqrt(2)
    form_factor = 2 * r * math.atan(r) / (2 * math.pi)
    moment = light.coefficients[1, 0] / -math.sqrt(3 / (4 * math.pi))  # ∫ y
    assert moment.item() / math.pi == pytest.approx(form_factor, rel=1e-12)


def test_area_light_shines_from_its_front_only():
    below, above = (0.2, 0.0, 0.1), (0.2, 4.0, 0.1)
    assert area_light(DOWN, COLOR, 4, at=below).coefficients.abs().max() > 0.1
    assert (area_light(DOWN, COLOR, 4, at=above).coefficients == 0).all()
    assert (area_light(QUAD, COLOR, 4, at=below).coefficients == 0).all()
    front = area_light(DOWN, COLOR, 4, at=below).coefficients
    assert torch.equal(area_light(DOWN, COLOR, 4, at=below, two_sided=True).coefficients, front)
    assert torch.allclose(area_light(QUAD, COLOR, 4, at=below, two_sided=True).coefficients, front, atol=1e-6)


def test_scale_and_offset_change_nothing():
    reference = area_light(DOWN, COLOR, 5, dtype=DOUBLE).coefficients
    for scale, shift in ((1e-3, 0.0), (1e3, 0.0), (1.0, 1e4)):
        corners = torch.tensor(DOWN, dtype=DOUBLE) * scale + shift
        moved = area_light(corners, COLOR, 5, at=(shift, shift, shift), dtype=DOUBLE).coefficients
        assert torch.allclose(moved, reference, atol=1e-10)


def test_lights_turn_with_their_direction():
    turn = torch.linalg.qr(torch.tensor([[1.0, 2, 0], [0.5, -1, 3], [2, 1, 1]], dtype=DOUBLE))[0]
    direction = torch.tensor([0.3, 1.0, -0.2], dtype=DOUBLE)
    for make in (
        lambda d: directional_light(d, COLOR, 8, dtype=DOUBLE),
        lambda d: sphere_light(d, 0.4, COLOR, 8, dtype=DOUBLE),
    ):
        expected = make(turn @ direction).coefficients
        assert torch.allclose(make(direction).rotate(turn).coefficients, expected, atol=1e-12)


def test_gradients_reach_every_argument():
    def tensor(*values):
        return torch.tensor(values, dtype=DOUBLE, requires_grad=True)

    direction, color, at = tensor(0.3, 1.0, -0.2), tensor(1.0, 2.0, 3.0), tensor(0.1, -0.2, 0.3)
    angle, corners = torch.tensor(0.3, dtype=DOUBLE, requires_grad=True), tensor(*DOWN[:3])
    cases = [
        (lambda d, c: directional_light(d, c, 3, dtype=DOUBLE), (direction, color)),
        (lambda d, a, c: disc_light(d, a, c, 3, dtype=DOUBLE), (direction, angle, color)),
        (lambda d, r, c, p: sphere_light(d, r, c, 3, at=p, dtype=DOUBLE), (direction, angle, color, at)),
        (lambda q, c, p: area_light(q, c, 3, at=p, dtype=DOUBLE), (corners, color, at)),
        (lambda c: constant_light(c, 3, dtype=DOUBLE), (color,)),
    ]
    for make, inputs in cases:
        assert torch.autograd.gradcheck(lambda *x, make=make: make(*x).coefficients, inputs)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: directional_light((0, 0, 0), 1.0, 3), "direction of the light is zero"),
        (lambda: directional_light((0, math.nan, 1), 1.0, 3), "three finite numbers"),
        (lambda: directional_light((0, 1), 1.0, 3), "three finite numbers"),
        (lambda: directional_light((0, 1, 0), (1, -1, 1), 3), r"irradiance is \[1.0, -1.0, 1.0\]"),
        (lambda: directional_light((0, 1, 0), 1.0, 40), r"order 40 is outside 1\.\.10"),
        (lambda: constant_light(1.0, 40), r"order 40 is outside 1\.\.10"),
        (lambda: constant_light((1, 2), 3), r"radiance is \[1.0, 2.0\]"),
        (lambda: disc_light((0, 1, 0), 0.0, 1.0, 3), r"outside \(0, π\]"),
        (lambda: disc_light((0, 1, 0), 0.1, math.inf, 3), "finite and not negative"),
        (lambda: sphere_light((0, 1, 0), 1.0, 1.0, 3), "move `at` outside"),
        (lambda: sphere_light((0, 1, 0), -1.0, 1.0, 3), "radius -1: give a radius above 0"),
        (lambda: area_light(QUAD[:2], 1.0, 3), "at least 3 finite corners"),
        (lambda: area_light([(0, 1, 0), (1, 1, 0), (2, 1, 0)], 1.0, 3), "has no area"),
        (lambda: area_light([*QUAD[:3], (1, 2.5, -1)], 1.0, 3), "is not flat"),
        (lambda: area_light(QUAD, 1.0, 3, at=(5, 2, 0)), "in the plane of the area light"),
        (lambda: area_light(QUAD, -1.0, 3), "finite and not negative"),
    ],
)
def test_errors_are_one_clear_line(call, message):
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
