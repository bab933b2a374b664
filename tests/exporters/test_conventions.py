"""Light as other engines store it: each engine's own formula, on its own axes, gives the same irradiance."""

from __future__ import annotations

import math

import pytest
import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.exporters import ENGINES, from_engine, to_engine
from diffprt.scene import Light


def three_irradiance(c, x, y, z):
    """SphericalHarmonics3.getIrradianceAt."""
    return (
        0.886227 * c[0]
        + 2 * 0.511664 * (c[1] * y + c[2] * z + c[3] * x)
        + 2 * 0.429043 * (c[4] * x * y + c[5] * y * z + c[7] * x * z)
        + c[6] * (0.743125 * z * z - 0.247708)
        + 0.429043 * c[8] * (x * x - y * y)
    )


def godot_ambient(c, x, y, z):
    """scene_forward_clustered.glsl; albedo times this is what is seen, so it stands for irradiance over pi."""
    return math.pi * (
        0.886227 * c[0]
        + 1.023327 * (c[1] * y + c[2] * z + c[3] * x)
        + 0.858086 * (c[4] * x * y + c[5] * y * z + c[7] * x * z)
        + 0.247708 * c[6] * (3 * z * z - 1)
        + 0.429043 * c[8] * (x * x - y * y)
    )


def unreal_irradiance(c, x, y, z):
    """CalcDiffuseTransfer times SHBasisFunction, both of SHMath.h."""
    band1 = -0.488603 * (c[1] * y + c[3] * x) + 0.488603 * c[2] * z
    band2 = 1.092548 * (c[4] * x * y - c[5] * y * z - c[7] * x * z)
    band2 = band2 + 0.315392 * c[6] * (3 * z * z - 1) + 0.546274 * c[8] * (x * x - y * y)
    return math.pi * (0.282095 * c[0] + 2 / 3 * band1 + band2 / 4)


def unity_irradiance(c, x, y, z):
    """ShadeSH9 with unity_SHAr (c3, c1, c2, c0 - c6), unity_SHBr (c4, c5, 3 c6, c7) and unity_SHC c8."""
    linear = c[3] * x + c[1] * y + c[2] * z + c[0] - c[6]
    quadratic = c[4] * x * y + c[5] * y * z + 3 * c[6] * z * z + c[7] * z * x
    return math.pi * (linear + quadratic + c[8] * (x * x - y * y))


def filament_irradiance(c, x, y, z):
    """Irradiance_SphericalHarmonics of filament's light_indirect.fs, times the pi that its coefficients lack."""
    band1 = c[1] * y + c[2] * z + c[3] * x
    band2 = c[4] * y * x + c[5] * y * z + c[6] * (3 * z * z - 1) + c[7] * z * x + c[8] * (x * x - y * y)
    return math.pi * (c[0] + band1 + band2)


# The engine's x, y, z of a direction that came in by glTF, and its formula.
FORMULAS = {
    "three.js": (lambda d: d, three_irradiance),
    "godot": (lambda d: d, godot_ambient),
    "unreal": (lambda d: (d[0], d[2], d[1]), unreal_irradiance),
    "unity": (lambda d: (-d[0], d[1], d[2]), unity_irradiance),
    "filament": (lambda d: d, filament_irradiance),
}


@pytest.mark.parametrize("engine", FORMULAS)
def test_irradiance_is_the_same_everywhere(engine, generator) -> None:
    light = torch.randn(9, 3, generator=generator, dtype=torch.float64)
    normals = torch.nn.functional.normalize(torch.randn(50, 3, generator=generator, dtype=torch.float64), dim=1)
    cosine = sh.rotate_zonal(sh.clamped_cosine(3), normals)
    stored = to_engine(light, engine)
    axes, formula = FORMULAS[engine]
    for normal, expected in zip(normals.tolist(), cosine @ light, strict=True):
        # The engines print six digits of their constants.
        torch.testing.assert_close(formula(stored, *axes(normal)), expected, rtol=0, atol=2e-5)


def test_every_engine_has_a_formula_here() -> None:
    assert set(FORMULAS) == set(ENGINES)


@pytest.mark.parametrize("engine", ENGINES)
def test_there_and_back(engine, generator) -> None:
    light = torch.randn(9, 3, generator=generator, dtype=torch.float64)
    back = from_engine(to_engine(light, engine), engine)
    torch.testing.assert_close(back.coefficients, light, rtol=0, atol=1e-12)
    more = torch.cat([light, torch.randn(7, 3, generator=generator, dtype=torch.float64)])
    torch.testing.assert_close(to_engine(Light(more), engine), to_engine(light, engine))


def test_uniform_light_is_what_each_says_it_is() -> None:
    """Radiance 1 from everywhere: irradiance pi."""
    light = torch.zeros(9, 3)
    light[0] = math.sqrt(4 * math.pi)
    first = {engine: float(to_engine(light, engine)[0, 0]) for engine in ENGINES}
    root = math.sqrt(4 * math.pi)
    assert first == pytest.approx(
        {"three.js": root, "godot": root / math.pi, "unreal": root, "unity": 1.0, "filament": 1.0}
    )


def test_mistakes_are_told() -> None:
    with pytest.raises(InputError, match=r"use one of three.js, godot, unreal"):
        to_engine(torch.zeros(9, 3), "unigine")
    with pytest.raises(InputError, match=r"shape \[4, 3\]: give \[K, 3\] with K of 9 or more"):
        to_engine(torch.zeros(4, 3), "unity")
    with pytest.raises(InputError, match=r"give \[9, 3\]"):
        from_engine(torch.zeros(16, 3), "unity")
