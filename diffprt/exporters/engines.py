"""Light in the spherical harmonics of other engines, three bands: what each calls its nine coefficients.

They differ in sign (with Condon-Shortley, band 1 is -y, z, -x; without, y, z, x), in axes, in the order of rows, in
whether light or irradiance is meant, and in whether the constants of the basis are multiplied in. Scenes are taken to
have come in as glTF, by the way each engine imports that. `ENGINES` cites the engine's own source of each entry; the
tests evaluate that source's formula, and docs/display.md says how the numbers lie in memory and what multiplies them.
Kaolin, DirectXMath and D3DX take our coefficients as they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from diffprt.errors import InputError
from diffprt.scene import Light
from diffprt.sh.frames import frame_rotations

_ORDER = 3
# Of y_lm as a polynomial: y, z, x; xy, yz, 3z² - 1, xz, x² - y².
_CONSTANTS = (0.282094792, 0.488602512, 0.488602512, 0.488602512)
_CONSTANTS += (1.092548431, 1.092548431, 0.315391565, 1.092548431, 0.546274215)
# Clamped cosine over pi: 1, 2/3, 1/4.
_LAMBERT = (1.0,) + (2 / 3,) * 3 + (0.25,) * 5
_ODD = (1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0)


@dataclass(frozen=True)
class Convention:
    """How an engine stores light.

    Attributes:
        axes: rows are the engine's x, y and z on the scene's axes.
        scale: what our coefficients, on the engine's axes, are multiplied by, nine numbers.
        rows: which of them, at l (l + 1) + m, stands in each row.
    """

    axes: tuple[tuple[float, float, float], ...]
    scale: tuple[float, ...]
    rows: tuple[int, ...] = tuple(range(_ORDER**2))


def _product(*factors: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(math.prod(values) for values in zip(*factors, strict=True))


_SAME = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_MIRRORED_X = ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_MIRRORED_Z = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
_SWAPPED_YZ = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
# Irradiance over pi, the basis multiplied in, which leaves no sign to choose.
_FOLDED = _product(_ODD, _LAMBERT, _CONSTANTS)

ENGINES = {
    # 0.187: src/math/SphericalHarmonics3.js:119, lights_pars_begin.glsl.js:13-44, WebGLLights.js:279.
    "three.js": Convention(_SAME, _ODD),
    # 4: modules/lightmapper_rd/lm_compute.glsl; what is seen is albedo times the shader's sum, without 1/pi.
    "godot": Convention(_SAME, _product(_ODD, (1 / math.pi,) * 9)),
    # SHMath.h: CalcDiffuseTransfer, SHBasisFunction, and the dominant direction (-V3, -V1, V2).
    "unreal": Convention(_SWAPPED_YZ, (1.0,) * 9),
    # ProbePostProcessing.compute, HDRP SphericalHarmonics.cs, core SphericalHarmonics.hlsl; glTFast Jobs.cs:1066, 1204.
    "unity": Convention(_MIRRORED_X, _FOLDED),
    # IndirectLight.h, light_indirect.fs, CubemapSH.cpp.
    "filament": Convention(_SAME, _FOLDED),
    # 9, in left-handed scenes, its default: sphericalPolynomial.pure.js:40-72, 210, glTFLoader.pure.js:565-571.
    "babylon": Convention(_MIRRORED_X, _LAMBERT),
    # 9, in scenes with `useRightHandedSystem`: materialHelper.functions.js:778.
    "babylon-right-handed": Convention(_MIRRORED_Z, _LAMBERT),
    # EXT_lights_image_based, irradiance, as Babylon's loader reads it into a left-handed scene; the extension's text
    # leaves sign, pi and axes open: EXT_lights_image_based.pure.js:86, 99-102.
    "gltf": Convention(_MIRRORED_X, _product(_LAMBERT, (math.pi,) * 9)),
    # 2.22: lit/frag/ambient.js:20-29.
    "playcanvas": Convention(_SAME, _FOLDED, (0, 3, 1, 2, 7, 5, 4, 6, 8)),
}


def to_engine(light: Light | torch.Tensor, engine: str) -> torch.Tensor:
    """A light's first three bands as an engine stores them.

    Args:
        light: a `Light` of order 3 or more, or its coefficients [K, 3]; higher bands hardly matter to diffuse shading
            and are left out.
        engine: one of `ENGINES`.

    Returns:
        [9, 3], rows in the engine's order, columns red, green, blue. Gradients reach the light.

    Raises:
        InputError: an unknown engine, or a light of fewer than three bands.
    """
    coefficients = light.coefficients if isinstance(light, Light) else light
    if coefficients.dim() != 2 or len(coefficients) < _ORDER**2 or coefficients.shape[1] != 3:
        raise InputError(
            f"light has shape {list(coefficients.shape)}: give [K, 3] with K of 9 or more, project it with order=3"
        )
    convention = _convention(engine)
    turned = _to_axes(convention, coefficients) @ coefficients[: _ORDER**2]
    return (turned * coefficients.new_tensor(convention.scale)[:, None])[list(convention.rows)]


def from_engine(coefficients: torch.Tensor, engine: str) -> Light:
    """The light of nine coefficients [9, 3] that an engine stores; the inverse of `to_engine`.

    Raises:
        InputError: an unknown engine, or another shape.
    """
    if tuple(coefficients.shape) != (_ORDER**2, 3):
        raise InputError(f"coefficients have shape {list(coefficients.shape)}: give [9, 3]")
    convention = _convention(engine)
    ordered = coefficients[[convention.rows.index(k) for k in range(_ORDER**2)]]
    ours = ordered / coefficients.new_tensor(convention.scale)[:, None]
    return Light(_to_axes(convention, coefficients).T @ ours)


def _convention(engine: str) -> Convention:
    if engine not in ENGINES:
        raise InputError(f"engine '{engine}' is unknown: use one of {', '.join(ENGINES)}")
    return ENGINES[engine]


def _to_axes(convention: Convention, like: torch.Tensor) -> torch.Tensor:
    """D [9, 9] with f(F x) = Σ (D c)_k y_k(x), columns of F the engine's axes; mirrored axes are allowed.

    Its dtype and device are those of `like`.
    """
    columns = torch.tensor(convention.axes, dtype=torch.float64).T
    blocks = frame_rotations(columns[None], _ORDER)
    return torch.block_diag(*(block[0] for block in blocks)).to(like)
