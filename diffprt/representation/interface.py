"""The one interface of assets: every room from shading on works through it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar, NoReturn, Self

import torch

from diffprt.errors import InputError
from diffprt.representation.elements import Elements
from diffprt.representation.lighting import LightingLike
from diffprt.representation.lit import Lit
from diffprt.representation.metric import Metric
from diffprt.representation.moving import moved
from diffprt.representation.provenance import Provenance
from diffprt.representation.spec import Spec
from diffprt.representation.view import Samples


class Representation(ABC):
    """What a baked asset is. A kind is a frozen dataclass with the tensors of its `spec`, `provenance` and elements.

    A kind says what its tensors are (`spec`), what pixels see (`elements`) and how light turns it into coefficients
    (`lit`). Saving, loading, describing, shading, drawing, frozen views and training follow from these.

    Attributes:
        kinds: those that are defined so far, by name.
        name: one word, the same in file header, page and report.
        description: of the signal, for the file's conventions.
        spec: its tensors beside those of its elements.
        elements_type: of its elements.
        compressed: whether `decode` gives another, larger asset.
        elements: what carries the signal and is seen.
        provenance: how it was made.
    """

    kinds: ClassVar[dict[str, type[Representation]]] = {}
    __dataclass_fields__: ClassVar[dict]
    name: ClassVar[str]
    description: ClassVar[str]
    spec: ClassVar[Spec]
    elements_type: ClassVar[type[Elements]]
    compressed: ClassVar[bool] = False
    elements: Elements
    provenance: Provenance

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "name" in cls.__dict__:
            Representation.kinds[cls.name] = cls

    # What every kind defines.

    @abstractmethod
    def lit(self, lighting: LightingLike, *, albedo: torch.Tensor | None = None) -> Lit:
        """The asset under lights.

        Args:
            lighting: a `Light`, its coefficients [K, 3], intensities by group, or a `Lighting` of several.
            albedo: [E, 3] in place of the elements' own, of kinds that leave it out of their signal.

        Raises:
            InputError: light that this kind does not answer to, or of another order; an albedo that plays no part.
        """

    # What follows, and may be refined.

    def radiance(
        self, lighting: LightingLike, eye: torch.Tensor | None, *, albedo: torch.Tensor | None = None
    ) -> torch.Tensor:
        """What each element sends towards `eye` ([3] or [E, 3]; None where nobody looks), [E, 3]; see `shade`."""
        lit = self.lit(lighting, albedo=albedo)
        own = torch.arange(len(self.elements), device=lit.coefficients.device)[:, None]
        places = (values.to(lit.coefficients) for values in (self.elements.positions, self.elements.normals))
        return lit.towards(Samples(own, lit.coefficients.new_ones(len(own), 1), *places), eye)

    def lit_each(self, lightings: Sequence[LightingLike], *, albedo: torch.Tensor | None = None) -> Lit:
        """The asset under each of B lights: coefficients [E, 3 B, ...], the colors of each light in turn."""
        each = [self.lit(lighting, albedo=albedo) for lighting in lightings]
        return Lit(torch.cat([lit.coefficients for lit in each], dim=1), each[0].basis)

    def radiance_each(
        self, lightings: Sequence[LightingLike], eye: torch.Tensor | None, *, albedo: torch.Tensor | None = None
    ) -> torch.Tensor:
        """What each element sends towards `eye` under each of B lights, [B, E, 3]; see `radiance`."""
        return torch.stack([self.radiance(lighting, eye, albedo=albedo) for lighting in lightings])

    @property
    def order(self) -> int | None:
        """SH bands of the distant light that it takes; None where the light is inside."""
        return None

    def with_elements(self, elements: Elements, **tensors: torch.Tensor) -> Self:
        """The asset on other elements, with those of its tensors that go with them."""
        return replace(self, elements=elements, **tensors)  # type: ignore[type-var]

    def with_tensors(self, **tensors: torch.Tensor) -> Self:
        """With some tensors of the spec replaced; the certificate no longer holds and is dropped."""
        return replace(self, provenance=self.provenance.uncertified(), **tensors)  # type: ignore[type-var]

    def labeled(self, provenance: Provenance) -> Self:
        """The same asset of another provenance."""
        return replace(self, provenance=provenance)  # type: ignore[type-var]

    def picked(self, rows: torch.Tensor) -> Self:
        """The asset at the elements `rows`, int64 [S], alone: it can be lit, not drawn. Gradients pass through."""
        per_element = (name for name, tensor in self.spec.items() if tensor.per_element)
        found = {name: value[rows] for name in per_element if (value := getattr(self, name, None)) is not None}
        return self.with_elements(self.elements.picked(rows), **found)

    def to(self, target: torch.device | torch.dtype | str) -> Self:
        """On another device; a dtype changes those tensors alone whose spec admits it."""
        fixed = (name for name, tensor in self.spec.items() if str(target).removeprefix("torch.") not in tensor.dtypes)
        return moved(self.with_elements(self.elements.to(target)), target, frozenset(fixed))

    def stored(self) -> dict[str, torch.Tensor]:
        """Its tensors as a file holds them."""
        return {name: value for name in self.spec if (value := getattr(self, name)) is not None}

    @classmethod
    def restored(cls, tensors: dict[str, torch.Tensor], elements: Elements, provenance: Provenance) -> Self:
        """The asset that `stored` made `tensors` of.

        Raises:
            InputError: they do not belong together.
        """
        return cls(**tensors, elements=elements, provenance=provenance)  # pyright: ignore[reportCallIssue]

    @property
    def trainable(self) -> tuple[str, ...]:
        """Names of the tensors that gradients may reach."""
        return tuple(name for name, tensor in self.spec.items() if tensor.trainable)

    @property
    def nbytes(self) -> int:
        """Bytes of the signal alone."""
        return sum(value.numel() * value.element_size() for value in (getattr(self, name) for name in self.trainable))

    @property
    def settings(self) -> dict:
        """The options it was made with."""
        return self.provenance.settings

    @property
    def plan(self) -> dict:
        """Which effects were simulated, and why."""
        return self.provenance.plan

    @property
    def certificate(self) -> dict:
        """Measured error of the signal."""
        return self.provenance.certificate

    @property
    def scene_hash(self) -> str:
        """SHA-256 of the scene it was baked from."""
        return self.provenance.scene_hash

    # Capabilities: a kind that has one overrides it, all others refuse by name.

    @property
    def signal(self) -> torch.Tensor:
        """The signal [E, ..., K], linear in radiance, as compression and transfer losses take it."""
        self.refuse("has no signal to compress or compare with", "give what bake or bake_glossy made")

    def decode(self) -> Representation:
        """The uncompressed asset that it stands for: itself, unless it is compressed."""
        return self

    @property
    def signal_shape(self) -> tuple[int, ...]:
        """Of one element's signal."""
        return tuple(self.signal.shape[1:])

    @property
    def counts(self) -> dict:
        """What reports say of it beside its sizes."""
        return {}

    def check_albedo(self) -> None:
        """Raises InputError where the albedo of its elements plays no part in `lit`."""
        self.refuse("has its colors inside", "leave albedo out")

    def metric(self, prior: torch.Tensor) -> Metric:
        """Coordinates of its trainable tensors in which squared distance is about the error of radiance, for lights of
        mean square `prior` [K]; as they are, where a kind knows none."""
        return Metric()

    def refuse(self, what: str, remedy: str) -> NoReturn:
        """Raises InputError: "a Kind `what`: `remedy`"."""
        raise InputError(f"a {type(self).__name__} {what}: {remedy}")
