"""What shines on an asset."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.scene.light import Light


@dataclass(frozen=True)
class PointLight:
    """A small lamp.

    Attributes:
        position: float [3], scene units.
        intensity: float [3], linear RGB [W/sr].
    """

    position: torch.Tensor
    intensity: torch.Tensor


@dataclass(frozen=True)
class Lighting:
    """Any combination of lights; a representation takes what it knows and refuses the rest by name.

    Attributes:
        distant: the same from every point of the scene.
        local: lamps inside the scene.
        groups: intensities by the name of a group of lights that the asset was solved with, numbers or [3].
    """

    distant: Light | torch.Tensor | None = None
    local: tuple[PointLight, ...] = ()
    groups: Mapping[str, float | torch.Tensor] = field(default_factory=dict)

    @staticmethod
    def of(lighting: LightingLike) -> Lighting:
        """A light, its coefficients [K, 3], or intensities of groups, as lighting."""
        if isinstance(lighting, Lighting):
            return lighting
        return Lighting(groups=lighting) if isinstance(lighting, Mapping) else Lighting(lighting)

    def needs(self, *parts: str, of: str) -> Lighting:
        """Itself; raises InputError where anything but `parts` shines, or nothing does."""
        given = [name for name in ("distant", "local", "groups") if _present(getattr(self, name))]
        other = [name for name in given if name not in parts]
        if other or not given:
            found = f"{', '.join(other)} light" if other else "no light"
            raise InputError(f"a {of} was given {found}: it answers to {' and '.join(parts)} light")
        return self

    def coefficients(self, order: int, of: str) -> torch.Tensor:
        """The coefficients [K, 3] of distant light alone.

        Raises:
            InputError: there is other light, or it has another order, or not three colors.
        """
        light = self.needs("distant", of=of).distant
        coefficients = light.coefficients if isinstance(light, Light) else light
        if not isinstance(coefficients, torch.Tensor):
            raise InputError(
                f"light is a {type(light).__name__}: give a Light, such as environment.project({order}), or its "
                "coefficients"
            )
        if coefficients.dim() != 2 or coefficients.shape[1] != 3:
            raise InputError(
                f"light has shape {list(coefficients.shape)}: give SH coefficients of RGB, [{order**2}, 3]"
            )
        if len(coefficients) != order**2:
            raise InputError(
                f"transfer has {order**2} SH coefficients, light has {len(coefficients)}: "
                f"project the light with order={order}, or bake with order={sh.order_of_count(len(coefficients))}"
            )
        return coefficients


LightingLike = Light | torch.Tensor | Mapping[str, "float | torch.Tensor"] | Lighting
LightsLike = LightingLike | Sequence[LightingLike]


def each_of(lights: LightsLike) -> tuple[Sequence[LightingLike], bool]:
    """The lights of a list, or of coefficients [B, K, 3], and that they are a batch; or the one light that is given.

    Raises:
        InputError: the batch is empty.
    """
    if isinstance(lights, torch.Tensor):
        each, batch = (lights.unbind(), True) if lights.dim() == 3 else ([lights], False)
    else:
        each, batch = (lights, True) if isinstance(lights, list | tuple) else ([lights], False)
    if not each:
        raise InputError("the batch of lights is empty: give one light or more")
    return each, batch  # pyright: ignore[reportReturnType]  a light is no sequence


def stacked_coefficients(lights: Sequence[LightingLike], order: int, of: str) -> torch.Tensor:
    """The coefficients [B, K, 3] of distant lights; raises InputError as `Lighting.coefficients`, with the number of
    the light."""
    found = []
    for number, light in enumerate(lights, 1):
        try:
            found.append(Lighting.of(light).coefficients(order, of))
        except InputError as error:
            raise InputError(f"light {number} of {len(lights)}: {error}") from None
    dtype = functools.reduce(torch.promote_types, (coefficients.dtype for coefficients in found))
    return torch.stack([coefficients.to(dtype) for coefficients in found])


def _present(part: object) -> bool:
    return part is not None and not (isinstance(part, tuple | Mapping) and not part)
