"""Mitsuba's gradient of a picture with respect to the light around it, by path replay backpropagation.

Mitsuba differentiates to the texels of its environment map (`prb`: Vicini, Speierer and Jakob, "Path Replay
Backpropagation", SIGGRAPH 2021). The map is a linear function of our coefficients, texel = Y(direction)ᵀ L, so
Y g_texels is its gradient with respect to them. As Mitsuba 3.9 keeps it, the map has one more column on either side,
a copy of the column at the other border; the gradient arrives at the columns that they copy.
"""

from __future__ import annotations

from importlib import import_module

import numpy as np
import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.scene import Camera, Light, Scene
from diffprt.study.mitsuba.scene import mitsuba_directions, mitsuba_map, mitsuba_scene, start_mitsuba

# Samples per pixel of one replay: what a 256 x 256 picture holds in memory at once.
_AT_ONCE = 64


class MitsubaGradient:
    """A scene under a light, and the gradient of ‖picture - reference‖² / ‖reference‖² to its texels.

    Args:
        light: what the map of `rows` rows shows; no lower than 0 anywhere.
        bounces: interreflections of paths; Russian roulette is off.

    Raises:
        InputError: Mitsuba is missing or has no variant with gradients.
    """

    def __init__(self, scene: Scene, camera: Camera, light: Light, *, bounces: int, rows: int) -> None:
        self.mitsuba, note = start_mitsuba()
        if "_ad_" not in self.mitsuba.variant():
            raise InputError(f"gradients need Mitsuba's llvm_ad_rgb, it runs {self.mitsuba.variant()}: {note}")
        self._dr = import_module("drjit")
        self._camera, self._rows = camera, rows
        self.scene = mitsuba_scene(self.mitsuba, scene, light, camera)
        self._parameters = self.mitsuba.traverse(self.scene)
        self._texels = self._tensor(mitsuba_map(light, rows))
        depth = {"max_depth": bounces + 2, "rr_depth": bounces + 3, "hide_emitters": True}
        self._integrator = self.mitsuba.load_dict({"type": "prb", **depth})

    @property
    def version(self) -> dict:
        """Names for the report."""
        return {"mitsuba": self.mitsuba.__version__, "variant": self.mitsuba.variant()}

    def _tensor(self, texels: torch.Tensor) -> object:
        padded = torch.cat([texels[:, -1:], texels, texels[:, :1]], dim=1)
        return self.mitsuba.TensorXf(padded.contiguous().numpy())

    def reference(self, picture: torch.Tensor) -> object:
        """`picture` [H, W, 3] on Mitsuba's side."""
        return self.mitsuba.TensorXf(picture.float().contiguous().numpy())

    def step(self, reference: object, *, samples: int, seed: int, rate: float = 0.0) -> object:
        """One step of gradient descent on the texels; its gradient, evaluated.

        Counts what every step repeats: the emitter's tables, rendering, loss, replay, update.
        """
        dr, texels = self._dr, self._texels
        dr.enable_grad(texels)
        self._parameters["light.data"] = texels
        self._parameters.update()
        picture = self.mitsuba.render(self.scene, self._parameters, integrator=self._integrator, spp=samples, seed=seed)
        loss = dr.sum(dr.square(picture[:, :, :3] - reference), axis=None)
        dr.backward(loss / dr.sum(dr.square(reference), axis=None))
        gradient = dr.grad(texels)
        self._texels = dr.detach(texels) - rate * gradient
        dr.eval(gradient, self._texels)
        dr.sync_thread()
        return gradient

    def to_bands(self, reference: object, order: int, *, samples: int, seed: int) -> torch.Tensor:
        """Gradient with respect to SH coefficients, float64 [K, 3], the mean over `samples` per pixel."""
        passes = max(1, samples // _AT_ONCE)
        share = samples // passes
        total = np.zeros((self._rows, 2 * self._rows + 2, 3))
        for index in range(passes):
            gradient = self.step(reference, samples=share, seed=seed * passes + index)
            total += np.array(gradient, dtype=np.float64) / passes
        directions = mitsuba_directions(self._rows)
        inner = torch.from_numpy(total[:, 1:-1])
        return torch.einsum("hwk,hwc->kc", sh.basis(directions, order), inner)
