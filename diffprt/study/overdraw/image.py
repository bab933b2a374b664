"""What an error of clustered transfer looks like: exit radiance under lights and views that clustering never saw."""

from __future__ import annotations

from collections.abc import Callable

import torch

from diffprt import sh
from diffprt.scene import Camera, Light
from diffprt.sh.frames import tangent_frames
from diffprt.study.overdraw.signal import Signal

_AZIMUTHS = (20.0, 110.0, 200.0, 290.0)
_ROWS = 4096


class HeldOut:
    """Pictures of a signal, as radiance at its receivers.

    Args:
        signal: the reference; "shadow" signals have no exit radiance, and then there are no views.
        lights: by name.
        azimuths: of the views [degrees], each framing the whole.
    """

    def __init__(self, signal: Signal, lights: dict[str, Light], azimuths: tuple[float, ...] = _AZIMUTHS) -> None:
        self._signal, self._lights = signal, lights
        self._views = [] if signal.settings.brdf == "shadow" else [self._view(azimuth) for azimuth in azimuths]
        self._reference = self.radiance(lambda rows: signal.values[rows].flatten(1))

    def radiance(self, decode: Callable[[slice], torch.Tensor]) -> torch.Tensor:
        """Radiance [L, W, V, 3] in every light and view; 0 for receivers that face away.

        Args:
            decode: rows [R, D] of the signal.
        """
        count = len(self._signal.receivers)
        found = torch.zeros(len(self._lights), len(self._views), count, 3)
        for first in range(0, count if self._views else 0, _ROWS):
            rows = slice(first, min(first + _ROWS, count))
            values = decode(rows).unflatten(1, self._signal.values.shape[1:])
            for light, name in enumerate(self._lights):
                coefficients = self._lights[name].coefficients.to(values.dtype)
                leaving = torch.einsum("vcok,kr->vorc", values, coefficients)
                # one channel answers to all three of the light, three each to their own
                leaving = leaving.diagonal(dim1=2, dim2=3) if values.shape[1] == 3 else leaving[..., 0]
                for view, (basis, _) in enumerate(self._views):
                    found[light, view, rows] = torch.einsum("vo,voc->vc", basis[rows], leaving)
        for view, (_, facing) in enumerate(self._views):
            found[:, view, ~facing] = 0
        return found

    def errors(self, decode: Callable[[slice], torch.Tensor]) -> dict[str, float]:
        """Relative root mean square error of radiance for each light, over all views and receivers that face them."""
        if not self._views:
            return {}
        squared = (self.radiance(decode) - self._reference).double().square().sum(dim=(1, 2, 3))
        scale = self._reference.double().square().sum(dim=(1, 2, 3)).clamp_min(1e-300)
        return dict(zip(self._lights, (squared / scale).sqrt().tolist(), strict=True))

    def _view(self, azimuth: float) -> tuple[torch.Tensor, torch.Tensor]:
        """Exit basis [V, K_out] of every receiver towards a camera, and which of them face it."""
        receivers = self._signal.receivers
        eye = torch.tensor(Camera.framing(receivers.positions, azimuth=azimuth).eye, dtype=receivers.positions.dtype)
        outward = torch.nn.functional.normalize(eye - receivers.positions, dim=-1)
        facing = (outward * receivers.normals).sum(1) > 0
        if self._signal.outputs == 1:
            return torch.ones(len(receivers), 1), facing
        local = torch.einsum("vij,vi->vj", tangent_frames(receivers.normals), outward)
        return sh.basis(local, sh.order_of_count(self._signal.outputs)).float(), facing
