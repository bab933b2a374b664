"""What a picture takes while it is made, refused before memory runs out."""

from __future__ import annotations

from diffprt.errors import InputError
from diffprt.scene.camera import Camera
from diffprt.transfer.baking.estimate import available_memory

# Of one sample: its triangle, weights, place, normal, and colors before and after the background.
_SAMPLE_BYTES = 200
# Of a pixel that is kept, three floats.
_PICTURE_BYTES = 12
_GIB = 2**30
_LARGEST_SIDE = 16384


def check_picture(camera: Camera, samples: int, count: int = 1) -> None:
    """Refuses a picture whose samples a side are beyond what cameras take, or that would not fit into free memory.

    Args:
        samples: a side of each pixel.
        count: pictures that are kept.

    Raises:
        InputError: it is too large.
    """
    width, height = camera.width * samples, camera.height * samples
    size = f"a picture of {camera.width} x {camera.height} pixels with {samples} x {samples} samples"
    if max(width, height) > _LARGEST_SIDE:
        raise InputError(f"{size} has more than {_LARGEST_SIDE} a side: give a smaller size or fewer samples")
    needed = _SAMPLE_BYTES * width * height + (count - 1) * _PICTURE_BYTES * camera.width * camera.height
    free = available_memory()
    if needed > free:
        raise InputError(
            f"{size}{f', {count} times,' if count > 1 else ''} needs about {needed / _GIB:.2f} GiB and "
            f"{free / _GIB:.2f} GiB are free: give a smaller size, or fewer samples or pictures"
        )
