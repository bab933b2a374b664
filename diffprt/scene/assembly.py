"""From the parts of a file to checked meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diffprt.scene.checks import DefectReport, check_mesh
from diffprt.scene.material import Material
from diffprt.scene.mesh import Mesh
from diffprt.scene.readers.parts import Parts
from diffprt.scene.resolution import offset_remark


def assembled(
    parts: Parts, *, name: str, non_finite: str = "refuse", winding: str = "repair"
) -> tuple[tuple[Mesh, ...], tuple[Material, ...], DefectReport]:
    """Meshes after the documented repairs, their materials, and the sum of the reports.

    Parts without faces are left out beside others, with a remark. `name` is the scene's, for messages; other options
    are as in `diffprt.scene.checks`.
    """
    meshes, reports, notes = [], [], list(parts.notes)
    for part in parts.parts:
        if len(part.faces) == 0 and len(parts.parts) > 1:
            notes.append(f"mesh '{part.name}' has no faces: left out")
            continue
        positions, faces, normals, report = check_mesh(
            part.positions, part.faces, part.normals, name=part.name, non_finite=non_finite, winding=winding
        )
        colors = part.colors
        if colors is not None:
            colors = np.asarray(colors, dtype=np.float32)
            outside = int((~((colors >= 0) & (colors <= 1))).any(axis=1).sum())
            if outside:
                notes.append(f"mesh '{part.name}' has {outside} vertex colours outside [0, 1]: moved to the nearest")
                colors = np.nan_to_num(colors).clip(0, 1)
        uv = part.uv
        if uv is not None and not np.isfinite(uv).all():
            notes.append(f"mesh '{part.name}' has {(~np.isfinite(uv)).any(axis=1).sum()} non-finite uv: set to 0")
            uv = np.where(np.isfinite(uv), uv, 0)
        meshes.append(
            Mesh.create(positions, faces, normals, uv=uv, colors=colors, material=part.material, name=part.name)
        )
        reports.append(report)
    corners = [extreme for mesh in meshes for extreme in (mesh.positions.amin(0), mesh.positions.amax(0))]
    if remark := offset_remark(np.min(corners, axis=0), np.max(corners, axis=0), name):
        notes.append(remark)
    total = reports[0]
    for report in reports[1:]:
        total = total + report
    return tuple(meshes), tuple(parts.materials), replace(total, notes=tuple(notes))
