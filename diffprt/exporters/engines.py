"""Light in the spherical harmonics of other engines, three bands: what each calls its nine coefficients.

All order them l (l + 1) + m, as `diffprt.sh` does. They differ in sign (with Condon-Shortley, band 1 is -y, z, -x;
without, y, z, x), in axes, in whether light or irradiance is meant, and in whether the constants of the basis are
multiplied in. Scenes are taken to have come in as glTF, by the way each engine imports that.

| engine | coefficients of | sign | constants | axes: ours x, y, z are its |
|---|---|---|---|---|
| three.js | radiance | without | apart | x, y, z |
| Godot | radiance / pi | without | apart | x, y, z |
| Unreal | radiance | with | apart | x, z, y |
| Unity | irradiance / pi | any | multiplied in | -x, y, z |
| Filament | irradiance / pi | any | multiplied in | x, y, z |

Sources: three.js, `LightProbe.sh` (src/math/SphericalHarmonics3.js: getAt, getIrradianceAt). Godot, lightmap captures
(scene_forward_clustered.glsl: ambient light is E of the coefficients, and is multiplied by albedo without 1/pi).
Unreal, `FSHVectorRGB3` (SHMath.h: SHBasisFunction, CalcDiffuseTransfer; glTF axes of GLTFExporter's ConvertVector).
Unity, `SphericalHarmonicsL2` (manual, "Light Probes: technical information"; unity_SHAr is c3, c1, c2, c0 - c6 and
unity_SHBr c4, c5, 3 c6, c7, the form of Sloan 2008, appendix A10; glTFast turns x around). Filament,
`IndirectLight::Builder::irradiance(bands, sh)` (IndirectLight.h: sh = L A C / pi).
Not checked in the engines themselves: Godot's scale is inferred from that shader, Unity's axes are from memory.
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
    """

    axes: tuple[tuple[float, float, float], ...]
    scale: tuple[float, ...]


def _product(*factors: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(math.prod(values) for values in zip(*factors, strict=True))


_SAME = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_MIRRORED_X = ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_SWAPPED_YZ = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))

ENGINES = {
    "three.js": Convention(_SAME, _ODD),
    "godot": Convention(_SAME, _product(_ODD, (1 / math.pi,) * 9)),
    "unreal": Convention(_SWAPPED_YZ, (1.0,) * 9),
    "unity": Convention(_MIRRORED_X, _product(_ODD, _LAMBERT, _CONSTANTS)),
    "filament": Convention(_SAME, _product(_ODD, _LAMBERT, _CONSTANTS)),
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
    turned = _to_axes(convention, coefficients.dtype) @ coefficients[: _ORDER**2]
    return turned * torch.tensor(convention.scale, dtype=coefficients.dtype)[:, None]


def from_engine(coefficients: torch.Tensor, engine: str) -> Light:
    """The light of nine coefficients [9, 3] that an engine stores; the inverse of `to_engine`.

    Raises:
        InputError: an unknown engine, or another shape.
    """
    if tuple(coefficients.shape) != (_ORDER**2, 3):
        raise InputError(f"coefficients have shape {list(coefficients.shape)}: give [9, 3]")
    convention = _convention(engine)
    ours = coefficients / torch.tensor(convention.scale, dtype=coefficients.dtype)[:, None]
    return Light(_to_axes(convention, coefficients.dtype).T @ ours)


def _convention(engine: str) -> Convention:
    if engine not in ENGINES:
        raise InputError(f"engine '{engine}' is unknown: use one of {', '.join(ENGINES)}")
    return ENGINES[engine]


def _to_axes(convention: Convention, dtype: torch.dtype) -> torch.Tensor:
    """D [9, 9] with f(F x) = Σ (D c)_k y_k(x), columns of F the engine's axes; mirrored axes are allowed."""
    columns = torch.tensor(convention.axes, dtype=torch.float64).T
    blocks = frame_rotations(columns[None], _ORDER)
    return torch.block_diag(*(block[0] for block in blocks)).to(dtype)
