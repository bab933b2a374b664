"""How an asset is looked at: what `diffprt render` and the first view of a page have in common."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

# How bands are weighed so that a light rings less; "picture" is whichever of the fixed ones errs least in the picture.
PICTURE_WINDOW = "picture"
WINDOWS = (PICTURE_WINDOW, "none", "lanczos", "hann", "auto")
# Lights shown without any named, the first one first.
LIGHTS = ("sky", "studio")


def _option(default: object, text: str) -> Any:
    return field(default=default, metadata={"help": text})


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """Camera and light, as a command takes them.

    Attributes:
        window: of the light, by name.
        azimuth, elevation: of the camera.
        target: what the camera looks at, "x,y,z" in scene units; without it, the middle of the object.
        distance: of the camera from the target, scene units; without it, as far as all of the object is seen.
        fov: vertical field of view [degrees].
    """

    window: str = _option(
        PICTURE_WINDOW, "picture (of none, lanczos and hann the one with the least error), one of these, or auto."
    )
    azimuth: float = _option(25.0, "Camera, degrees around +y from +z.")
    elevation: float = _option(15.0, "Camera, degrees above the horizon.")
    target: str | None = _option(None, "Camera looks at x,y,z.  [default: the middle of the object]")
    distance: float | None = _option(None, "Camera to target, scene units.  [default: all of the object is seen]")
    fov: float = _option(35.0, "Vertical field of view, degrees.")
