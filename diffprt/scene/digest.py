"""The name of a scene by its content, so that an asset knows what it was baked from."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import torch

from diffprt.scene.material import Material
from diffprt.scene.mesh import Mesh


def scene_digest(meshes: Sequence[Mesh], materials: Sequence[Material]) -> str:
    """SHA-256 as hexadecimal text, over geometry, materials and flags; names do not count, nor do BRDFs.

    Assets record the BRDFs that they were baked with in their settings.
    """
    digest = hashlib.sha256(b"diffprt scene 1")
    for mesh in meshes:
        digest.update(repr((mesh.material, mesh.occluder_only, mesh.ground, mesh.computed_normals)).encode())
        normals = None if mesh.computed_normals else mesh.normals
        for values in (mesh.positions, mesh.faces, normals, mesh.uv, mesh.colors):
            _update(digest, values)
    for material in materials:
        digest.update(b"lambert")
        _update(digest, material.albedo)
        _update(digest, material.albedo_texture)
        if material.transmission:
            digest.update(f"transmission {material.transmission!r}".encode())
    return digest.hexdigest()


def _update(digest: object, values: torch.Tensor | None) -> None:
    """Adds shape and little-endian bytes; -0 and 0 are the same."""
    if values is None:
        digest.update(b"none")
        return
    array = values.detach().cpu().numpy() + 0
    digest.update(f"{array.shape}{array.dtype.kind}".encode())
    digest.update(np.ascontiguousarray(array.astype(array.dtype.newbyteorder("<"))))
