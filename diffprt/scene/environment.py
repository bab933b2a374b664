"""Environment maps: distant light as an image of all directions."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.images import read_image
from diffprt.scene.light import Light
from diffprt.scene.probe import PROBES, equirect_from_probe
from diffprt.scene.srgb import linear_from_srgb

_ENCODED = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_BAD_TEXELS = ("report", "zero", "refuse")
_REC709 = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True)
class Environment:
    """Radiance from every direction, equirectangular (conventions: `diffprt.sh`).

    Attributes:
        image: float32 [H, 2 H, 3], linear radiance [W/m²/sr]; may carry gradients.
        name: for messages and files.
        report: what loading found, plain numbers: texels, negative, nan, infinite, alpha_dropped, gray.

    Raises:
        InputError: an image of another shape, or with NaN or infinite texels.
    """

    image: torch.Tensor
    name: str = "environment"
    report: dict = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        shape = tuple(self.image.shape)
        if len(shape) != 3 or shape[2] != 3 or shape[0] == 0 or not self.image.is_floating_point():
            raise InputError(f"environment '{self.name}' has shape {shape}: give floating-point [H, W, 3]")
        _check_ratio(shape[0], shape[1], self.name)
        if not bool(torch.isfinite(self.image.detach()).all()):
            count = int((~torch.isfinite(self.image.detach())).any(dim=-1).sum())
            raise InputError(
                f"environment '{self.name}' has {count} texels that are not finite: set them, "
                "or load the file with bad_texels='zero'"
            )

    @staticmethod
    def load(path: str | Path, *, bad_texels: str = "report", projection: str = "equirect") -> Environment:
        """Loads an environment map.

        Args:
            path: .hdr or .exr in linear radiance, or .png, .jpg, .tif in sRGB (made linear). One channel is
                gray; alpha is dropped.
            bad_texels: negative channels, NaN and infinities become 0 and their counts are in `report`;
                "report" also warns, "zero" does not, "refuse" raises.
            projection: "equirect" (twice as wide as high), "angular" (Debevec's light probe) or
                "mirror_ball" (a photographed mirror ball), both square with the centre along -z.

        Raises:
            InputError: a missing or damaged file, another shape, an unknown option, refused texels.
        """
        path = Path(path)
        if bad_texels not in _BAD_TEXELS:
            raise InputError(f"environment {path} has bad_texels='{bad_texels}': give {', '.join(_BAD_TEXELS)}")
        if projection != "equirect" and projection not in PROBES:
            raise InputError(f"environment {path} has projection='{projection}': give equirect, {', '.join(PROBES)}")
        pixels = read_image(path)
        height, width, channels = pixels.shape
        image, report = _checked_texels(pixels[..., :3] if channels >= 3 else pixels[..., :1].expand(-1, -1, 3))
        report |= {"gray": channels < 3, "alpha_dropped": channels in (2, 4)}
        bad = {key: report[key] for key in ("negative", "nan", "infinite") if report[key]}
        if bad:
            found = ", ".join(f"{count} {key}" for key, count in bad.items())
            if bad_texels == "refuse":
                raise InputError(f"environment {path} has bad texels ({found}): repair it, or pass bad_texels='zero'")
            if bad_texels == "report":
                warnings.warn(f"environment {path} has bad texels ({found}): set to 0", stacklevel=2)
        if path.suffix.lower() in _ENCODED:
            image = linear_from_srgb(image)
        if projection == "equirect":
            _check_ratio(height, width, str(path))
        else:
            image = equirect_from_probe(image, projection, name=str(path))
        return Environment(image.contiguous(), path.stem, report)

    def project(self, order: int, *, window: str = "none") -> Light:
        """The map as spherical harmonics.

        Args:
            order: number of bands, 1..10; K = order².
            window: "none", "hann", "lanczos" or "auto", against negative lobes.

        Returns:
            A light whose report says, for luminance: `energy_captured` (share of the squared radiance that
            the bands hold, before the window), `minimum` and `negative_fraction` (share of the sphere) of
            what is left, and the window's own entries. Gradients reach the image.
        """
        plain = sh.project_map(self.image, order)
        coefficients, cost = sh.apply_window(plain, window)
        with torch.no_grad():
            weight = torch.tensor(_REC709, dtype=torch.float64)
            luminance = self.image.detach().double().cpu() @ weight
            rows = sh.row_weights(*luminance.shape)
            total = float((luminance.square().sum(dim=1) * rows).sum())
            held = float((plain.detach().double().cpu() @ weight).square().sum())
            shown = sh.render_map(coefficients.detach().double().cpu() @ weight[:, None], 64, 128)[..., 0]
            area = sh.row_weights(64, 128)[:, None].expand(64, 128)
            report = {
                "environment": self.name,
                "order": order,
                "energy_captured": held / total if total > 0 else 1.0,
                "minimum": float(shown.min()),
                "maximum": float(shown.max()),
                "negative_fraction": float(area[shown < 0].sum() / area.sum()),
            }
        return Light(coefficients, cost | report)

    @property
    def mean(self) -> torch.Tensor:
        """Mean radiance over the sphere [3], by solid angle."""
        rows = sh.row_weights(*self.image.shape[:2]).to(self.image)
        return torch.einsum("hwc,h->c", self.image, rows) / (4 * torch.pi)


def _check_ratio(height: int, width: int, name: str) -> None:
    if width != 2 * height:
        probe = " (or is it a light probe? pass projection='angular')" if width == height else ""
        raise InputError(
            f"environment '{name}' is {width} x {height}, an equirectangular map is twice as wide as high: "
            f"resample it to {width} x {max(width // 2, 1)}{probe}"
        )


def _checked_texels(image: torch.Tensor) -> tuple[torch.Tensor, dict]:
    """Bad channels set to 0, and the number of texels of each kind; one that is two kinds counts twice."""
    nan, infinite, negative = torch.isnan(image), torch.isinf(image), image < 0
    report = {
        "texels": image.shape[0] * image.shape[1],
        "negative": int((negative & ~infinite).any(dim=-1).sum()),
        "nan": int(nan.any(dim=-1).sum()),
        "infinite": int(infinite.any(dim=-1).sum()),
    }
    return torch.where(nan | infinite | negative, torch.zeros_like(image), image), report
