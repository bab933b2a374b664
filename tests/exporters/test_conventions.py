"""Light as other engines store it: each engine's own formula, on its own axes, gives the same irradiance."""

from __future__ import annotations

import math

import numpy as np
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


# preScaleForRendering multiplies by these, computeEnvironmentIrradiance of harmonicsFunctions.fx sums.
BABYLON = [math.sqrt(n / math.pi) for n in (1 / 4, 3 / 4, 3 / 4, 3 / 4, 15 / 4, 15 / 4, 5 / 16, 15 / 4, 15 / 16)]
BABYLON = [-value if k in (1, 3, 5, 7) else value for k, value in enumerate(BABYLON)]


def babylon_radiance(c, x, y, z):
    """What a white Lambertian surface sends out, times pi."""
    c = [scale * row for scale, row in zip(BABYLON, c, strict=True)]
    band1 = c[1] * y + c[2] * z + c[3] * x
    band2 = c[4] * y * x + c[5] * y * z + c[6] * (3 * z * z - 1) + c[7] * z * x + c[8] * (x * x - y * y)
    return math.pi * (c[0] + band1 + band2)


def gltf_irradiance(c, x, y, z):
    """EXT_lights_image_based of Babylon's loader: intensity 1, convertIrradianceToLambertianRadiance, and the above."""
    return babylon_radiance(c / math.pi, x, y, z)


def playcanvas_ambient(c, x, y, z):
    """addAmbient of lit/frag/ambient.js, times pi."""
    band1 = c[1] * x + c[2] * y + c[3] * z
    band2 = c[4] * x * z + c[5] * z * y + c[6] * y * x + c[7] * (3 * z * z - 1) + c[8] * (x * x - y * y)
    return math.pi * (c[0] + band1 + band2)


# The engine's x, y, z of a direction that came in by glTF, and its formula.
FORMULAS = {
    "three.js": (lambda d: d, three_irradiance),
    "godot": (lambda d: d, godot_ambient),
    "unreal": (lambda d: (d[0], d[2], d[1]), unreal_irradiance),
    "unity": (lambda d: (-d[0], d[1], d[2]), unity_irradiance),
    "filament": (lambda d: d, filament_irradiance),
    "babylon": (lambda d: (-d[0], d[1], d[2]), babylon_radiance),
    "babylon-right-handed": (lambda d: (d[0], d[1], -d[2]), babylon_radiance),
    "gltf": (lambda d: (-d[0], d[1], d[2]), gltf_irradiance),
    "playcanvas": (lambda d: d, playcanvas_ambient),
}


@pytest.fixture(scope="module")
def asymmetric() -> torch.Tensor:
    """A soft sun, a colored lobe beside it and a sky that is brighter above, [9, 3]."""
    towards = torch.nn.functional.normalize(
        torch.tensor([[0.5, 0.7, 0.4], [-0.8, 0.1, 0.3], [0.1, 1.0, -0.2]], dtype=torch.float64), dim=1
    )
    band = torch.arange(3, dtype=torch.float64)
    zonal = [torch.exp(-s * band * (band + 1)) * torch.sqrt((2 * band + 1) / (4 * math.pi)) for s in (0.05, 0.1, 0.4)]
    colors = torch.tensor([[5.0, 4.5, 3.8], [2.0, 0.3, 0.1], [1.0, 1.6, 3.0]], dtype=torch.float64)
    lobes = [sh.rotate_zonal(z, d[None])[0] for z, d in zip(zonal, towards, strict=True)]
    return sum(lobe[:, None] * color for lobe, color in zip(lobes, colors, strict=True))


def quadrature_irradiance(light: torch.Tensor, normals: torch.Tensor) -> torch.Tensor:
    """The integral of radiance times cosine over each normal's hemisphere, [N, 3]: exact for radiance of 3 bands."""
    nodes, weights = (torch.from_numpy(values) for values in np.polynomial.legendre.leggauss(8))
    u, weight = (nodes + 1) / 2, weights / 2
    angle = 2 * math.pi * torch.arange(16, dtype=torch.float64) / 16
    side = torch.sqrt(1 - u**2)
    local = torch.stack([side[:, None] * angle.cos(), side[:, None] * angle.sin(), u[:, None].expand(-1, 16)], dim=-1)
    cosine = (u * weight)[:, None].expand(-1, 16) * 2 * math.pi / 16
    helper = torch.eye(3, dtype=torch.float64)[normals.abs().argmin(1)]
    tangent = torch.nn.functional.normalize(torch.linalg.cross(helper, normals), dim=1)
    frame = torch.stack([tangent, torch.linalg.cross(normals, tangent), normals], dim=1)
    radiance = sh.basis(torch.einsum("uai,nij->nuaj", local, frame), 3) @ light
    return (radiance * cosine[..., None]).sum((1, 2))


def relative_rms(engine: str, stored: torch.Tensor, normals: torch.Tensor, expected: torch.Tensor) -> float:
    axes, formula = FORMULAS[engine]
    found = torch.stack([formula(stored, *axes(normal)) for normal in normals.tolist()])
    return float((found - expected).square().mean().sqrt() / expected.square().mean().sqrt())


@pytest.fixture(scope="module")
def normals() -> torch.Tensor:
    drawn = torch.randn(400, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return torch.nn.functional.normalize(drawn, dim=1)


@pytest.mark.parametrize("engine", FORMULAS)
def test_irradiance_is_that_of_quadrature(engine, asymmetric, normals) -> None:
    """And what is no light of ours is told from it: another sign, other axes, a pi too many."""
    expected = quadrature_irradiance(asymmetric, normals)
    stored = to_engine(asymmetric, engine)
    assert relative_rms(engine, stored, normals, expected) <= 1e-6
    band_one = [ENGINES[engine].rows.index(k) for k in (1, 2, 3)]
    for row in band_one:
        flipped = stored.clone()
        flipped[row] *= -1
        assert relative_rms(engine, flipped, normals, expected) > 0.05
    for axis in range(3):
        mirrored = normals.clone()
        mirrored[:, axis] *= -1
        assert relative_rms(engine, stored, mirrored, expected) > 0.05
    assert relative_rms(engine, math.pi * stored, normals, expected) == pytest.approx(math.pi - 1, rel=1e-5)


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


def test_handedness_of_the_scene_matters(asymmetric, normals) -> None:
    expected = quadrature_irradiance(asymmetric, normals)
    for written, read in [("babylon", "babylon-right-handed"), ("babylon-right-handed", "babylon")]:
        assert relative_rms(read, to_engine(asymmetric, written), normals, expected) > 0.3


def test_every_engine_has_a_formula_here() -> None:
    assert set(FORMULAS) == set(ENGINES)


@pytest.mark.parametrize("engine", ENGINES)
def test_there_and_back(engine, generator) -> None:
    light = torch.randn(9, 3, generator=generator, dtype=torch.float64)
    back = from_engine(to_engine(light, engine), engine)
    torch.testing.assert_close(back.coefficients, light, rtol=0, atol=1e-12)
    more = torch.cat([light, torch.randn(7, 3, generator=generator, dtype=torch.float64)])
    torch.testing.assert_close(to_engine(Light(more), engine), to_engine(light, engine))
    torch.testing.assert_close(from_engine(to_engine(more, engine), engine).coefficients, light, rtol=0, atol=1e-12)


def test_uniform_light_is_what_each_says_it_is() -> None:
    """Radiance 1 from everywhere: irradiance pi."""
    light = torch.zeros(9, 3)
    light[0] = math.sqrt(4 * math.pi)
    first = {engine: float(to_engine(light, engine)[0, 0]) for engine in ENGINES}
    root = math.sqrt(4 * math.pi)
    assert first == pytest.approx(
        {
            **{"three.js": root, "godot": root / math.pi, "unreal": root, "unity": 1.0, "filament": 1.0},
            **{"babylon": root, "babylon-right-handed": root, "gltf": math.pi * root, "playcanvas": 1.0},
        }
    )


def test_mistakes_are_told() -> None:
    with pytest.raises(InputError, match=r"use one of three.js, godot, unreal"):
        to_engine(torch.zeros(9, 3), "unigine")
    with pytest.raises(InputError, match=r"shape \[4, 3\]: give \[K, 3\] with K of 9 or more"):
        to_engine(torch.zeros(4, 3), "unity")
    with pytest.raises(InputError, match=r"give \[9, 3\]"):
        from_engine(torch.zeros(16, 3), "unity")
