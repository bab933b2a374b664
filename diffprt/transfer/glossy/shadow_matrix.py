"""The thesis's shadow transfer matrices, for studies that cluster transferred incident light."""

from __future__ import annotations

import torch

from diffprt import sh
from diffprt.options.bake import BakeSettings
from diffprt.scene import Scene
from diffprt.sh.frames import frame_rotations, from_frames, tangent_frames
from diffprt.sh.product import product_matrix
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.glossy.visibility_matrix import UniformPattern, VisibilityTracer, visibility_order

_RECEIVERS_PER_CHUNK = 1024


def shadow_matrices(
    scene: Scene, *, order: int = 6, rays: int = 1024, cosine: bool = False, seed: int = 0
) -> torch.Tensor:
    """∫ V y_i y_j over each vertex's upper hemisphere, on the scene's axes.

    Args:
        scene: what occludes.
        order: SH bands.
        rays: rays per vertex, spread evenly, or by the cosine where that is included.
        cosine: whether cos θ is in the integral; the thesis has it in the BRDF.
        seed: turns every vertex's pattern.

    Returns:
        float32 [V, K, K], symmetric. No gradients: visibility is frozen.

    Raises:
        InputError: an option is out of range.

    Source: Chen 2005 (thesis), eq. 1.
    """
    settings = BakeSettings(order=order, rays=rays, bounces=0, seed=seed)
    surfaces = Surfaces.of(scene)
    receivers = surfaces.receivers
    mesh, pattern = surfaces.mesh(), surfaces.pattern(receivers, settings.rays, settings.seed)
    bands = visibility_order(order, order)
    tracer = VisibilityTracer(mesh, receivers, pattern if cosine else UniformPattern.of(pattern), bands)
    frames = tangent_frames(receivers.normals.double())
    matrices = torch.empty(len(receivers), sh.coefficient_count(order), sh.coefficient_count(order))
    for first in range(0, len(receivers), _RECEIVERS_PER_CHUNK):
        rows = range(first, min(first + _RECEIVERS_PER_CHUNK, len(receivers)))
        rotations = frame_rotations(frames[rows.start : rows.stop], bands)
        visibility, _ = tracer.trace(rows, rotations)
        matrices[rows.start : rows.stop] = product_matrix(from_frames(visibility, rotations), order, order)
    return matrices
