"""The signals that the overdraw study clusters: baked once for each scene and BRDF, then read from disk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from diffprt import sh
from diffprt.brdf import parse_brdf
from diffprt.compression import clusters_per_pass
from diffprt.errors import InputError
from diffprt.scene import Scene
from diffprt.study.rows import digest, save_tensors
from diffprt.surface import Receivers, Surfaces
from diffprt.transfer import bake
from diffprt.transfer.baking.bake import bake_glossy
from diffprt.transfer.glossy.shadow_matrix import shadow_matrices

# A gray BRDF that three channels are asked of: what colors light has another shape than what does not.
_DIFFUSE, _SPECULAR = (0.4, 0.25, 0.15), 0.6
_OTHERS = ("diffuse", "shadow")


@dataclass(frozen=True)
class SignalSettings:
    """What a signal depends on beside the scene.

    Attributes:
        brdf: "NAME:parameter=value,...", for glossy transfer; "diffuse" for diffuse transfer; "shadow" for the
            thesis's matrices without BRDF (equation 1).
        order: SH bands of light, and of exit radiance.
        rays: per receiver.
        bounces: interreflections.
        channels: 1 or 3; as many as the BRDF has, without it. A gray BRDF gets a colored diffuse part for 3.
        seed: of rays.

    Raises:
        InputError: the BRDF is unknown, or has more channels than asked for.
    """

    brdf: str
    order: int = 6
    rays: int = 1024
    bounces: int = 0
    channels: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.channels not in (None, 1, 3):
            raise InputError(f"channels is {self.channels}: give 1 or 3")
        if self.brdf in _OTHERS:
            if self.channels == 3:
                raise InputError(f"signal '{self.brdf}' has 1 channel, 3 were asked for: give a BRDF")
            return
        brdf = parse_brdf(self.brdf)
        if self.channels == 1 and brdf.channels == 3:
            raise InputError(f"brdf '{self.brdf}' has 3 channels, 1 was asked for: leave out its colors")

    def key(self, scene: Scene) -> str:
        """Of the file that holds the signal."""
        return digest([scene.hash(), self.brdf, self.order, self.rays, self.bounces, self.channels, self.seed])

    def bake(self, scene: Scene) -> torch.Tensor:
        """The signal [V, C, K_out, K], K_out = 1 for diffuse transfer."""
        options = {"order": self.order, "rays": self.rays, "seed": self.seed}
        if self.brdf == "shadow":
            return shadow_matrices(scene, **options)[:, None]
        if self.brdf == "diffuse":
            return bake(scene, bounces=self.bounces, fill_inside=False, **options).diffuse[:, :1, None]
        with torch.no_grad():
            return bake_glossy(scene, self._brdf(), bounces=self.bounces, **options).glossy

    def _brdf(self):
        brdf = parse_brdf(self.brdf)
        if self.channels == 3 and brdf.channels == 1:
            brdf = replace(brdf, diffuse=_DIFFUSE, specular=_SPECULAR)
        return brdf


@dataclass(frozen=True)
class Signal:
    """What is clustered.

    Attributes:
        scene: name.
        settings: how it was made.
        values: float32 [V, C, K_out, K].
        receivers: where it lives.
    """

    scene: str
    settings: SignalSettings
    values: torch.Tensor
    receivers: Receivers

    @property
    def vectors(self) -> torch.Tensor:
        """[V, C K_out K], one row per receiver: clustering is joint over all of it."""
        return self.values.flatten(1)

    @property
    def outputs(self) -> int:
        """K_out, 1 for diffuse transfer."""
        return self.values.shape[2]

    @property
    def channels(self) -> int:
        """1 or 3."""
        return self.values.shape[1]

    def per_pass(self, registers: int, components: int) -> int:
        """Clusters that fit into the registers of a pass."""
        return clusters_per_pass(registers, components, channels=self.channels, outputs=self.outputs)

    @property
    def name(self) -> str:
        """Scene, BRDF and channels, for people."""
        return f"{self.scene}, {self.settings.brdf}" + (", RGB" if self.channels == 3 else "")


def load_signal(scene: Scene, settings: SignalSettings, folder: Path) -> Signal:
    """The signal, from `folder` where it lies there already, else baked and kept.

    Raises:
        InputError: an option is out of range.
    """
    path = folder / f"{settings.key(scene)}.safetensors"
    receivers = Surfaces.of(scene).receivers
    shape = (len(receivers), sh.coefficient_count(settings.order))
    try:
        values = load_file(path)["values"]
    except (OSError, SafetensorError, KeyError):  # none yet, or cut off by a kill
        values = settings.bake(scene).contiguous()
        save_tensors(path, {"values": values})
    if (values.shape[0], values.shape[3]) != shape:
        raise InputError(f"{path} holds a signal of shape {tuple(values.shape)}: remove the file")
    return Signal(scene.name, settings, values, receivers)
