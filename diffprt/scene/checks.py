"""Defects of a mesh: what is repaired, what is reported, what is refused."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from diffprt.errors import InputError
from diffprt.scene.normals import position_groups, smooth_normals
from diffprt.scene.resolution import unresolved_faces
from diffprt.scene.winding import Topology, flipped, inward_components, topology

SLIVER_ANGLE = 1.0
_ZERO_HEIGHT = 1e-9

POLICY = {
    "non_finite_vertices": "refused; with non_finite='drop' moved to the centroid, their faces dropped",
    "out_of_range_indices": "refused",
    "unresolved_faces": "kept (edges of less than 4 steps of 32-bit coordinates); refused where they are most",
    "degenerate_faces": "dropped (a repeated corner, or no area)",
    "duplicate_faces": "dropped after the first (the same three vertices, any winding)",
    "coincident_faces": "kept (other vertices at the same three positions); they occlude like one",
    "sliver_faces": f"kept (an angle below {SLIVER_ANGLE:g} degree)",
    "unreferenced_vertices": "kept, with normal +y where the file gives none",
    "coincident_vertices": "kept; seams share one computed normal",
    "non_manifold_edges": "kept (more than two faces); winding is not compared across them",
    "boundary_edges": "kept; an open sheet keeps its winding",
    "inconsistent_edges": "repaired: each connected piece follows its majority",
    "flipped_faces": "turned over by the two winding repairs",
    "inward_components": "turned over: closed pieces that were inside out; use winding='keep' for rooms",
    "cavities": "kept: closed pieces facing inward inside another",
    "unorientable_components": "kept: one-sided pieces have no consistent winding",
    "opposed_normals": "kept: normals of the file that point away from every face of their vertex",
    "replaced_normals": "computed: normals of the file that were zero or not finite",
    "components": "counted: pieces joined through edges",
}

# Findings that winding="keep" leaves alone.
_WINDING = ("inconsistent_edges", "inward_components")


@dataclass(frozen=True)
class DefectReport:
    """Counts of what is wrong, or merely noteworthy, in the meshes of a scene. `POLICY` says what is done.

    `watertight` holds when every edge of every mesh has exactly two faces; coincident vertices count as one
    where that closes a seam. `winding` is "keep" when winding was only looked at.
    `notes` are remarks of the loader, in words.
    """

    vertices: int = 0
    faces: int = 0
    components: int = 0
    non_finite_vertices: int = 0
    out_of_range_indices: int = 0
    unresolved_faces: int = 0
    degenerate_faces: int = 0
    duplicate_faces: int = 0
    coincident_faces: int = 0
    sliver_faces: int = 0
    unreferenced_vertices: int = 0
    coincident_vertices: int = 0
    non_manifold_edges: int = 0
    boundary_edges: int = 0
    inconsistent_edges: int = 0
    flipped_faces: int = 0
    inward_components: int = 0
    cavities: int = 0
    unorientable_components: int = 0
    opposed_normals: int = 0
    replaced_normals: int = 0
    watertight: bool = True
    winding: str = "repair"
    notes: tuple[str, ...] = ()

    @property
    def policy(self) -> dict[str, str]:
        """What is done about each kind of defect."""
        return dict(POLICY)

    def as_dict(self) -> dict:
        """Plain numbers for `--json` reports."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "notes"} | {"notes": list(self.notes)}

    def lines(self) -> list[str]:
        """The findings in words, one a line, each with what was done; empty when there are none."""
        found = [name for name in POLICY if name != "components" and getattr(self, name)]
        done = POLICY | (dict.fromkeys(_WINDING, "kept, as asked") if self.winding == "keep" else {})
        found = [f"{getattr(self, name)} {name.replace('_', ' ')}: {done[name]}" for name in found]
        return found + list(self.notes)

    def __add__(self, other: DefectReport) -> DefectReport:
        sums = {f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)}
        sums["watertight"] = self.watertight and other.watertight
        sums["winding"] = self.winding if self.winding == other.winding else "mixed"
        return DefectReport(**sums)


def check_mesh(
    positions: np.ndarray,
    faces: np.ndarray,
    normals: np.ndarray | None,
    *,
    name: str,
    non_finite: str = "refuse",
    winding: str = "repair",
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, DefectReport]:
    """Repairs a mesh by the documented policy. Vertices are never removed and never reordered.

    Args:
        positions: float [V, 3].
        faces: int [F, 3].
        normals: float [V, 3] or None.
        name: of the mesh, for messages.
        non_finite: "refuse" or "drop".
        winding: "repair", or "keep" to report only.

    Returns:
        positions float32, faces int64, normals (None stays None) and the report.

    Raises:
        InputError: no vertices, no faces (also none left), non-finite vertices, indices out of range, coordinates
            too large for the size of the faces.
    """
    if non_finite not in ("refuse", "drop") or winding not in ("repair", "keep"):
        raise InputError(
            f"mesh '{name}' is loaded with non_finite='{non_finite}', winding='{winding}': "
            "give 'refuse' or 'drop', and 'repair' or 'keep'"
        )
    exact, faces = np.array(positions, dtype=np.float64), np.array(faces, dtype=np.int64)
    with np.errstate(over="ignore"):
        positions = exact.astype(np.float32)
    if len(positions) == 0 or len(faces) == 0:
        raise InputError(
            f"mesh '{name}' has {len(positions)} vertices and {len(faces)} faces: give a mesh with triangles"
        )
    found = {"vertices": len(positions), "faces": len(faces), "winding": winding}
    outside = ((faces < 0) | (faces >= len(positions))).sum()
    if outside:
        raise InputError(
            f"mesh '{name}' has {outside} out-of-range indices ({faces.min()}..{faces.max()}, wanted "
            f"0..{len(positions) - 1}): repair the file"
        )
    broken = np.asarray(~np.isfinite(positions).all(axis=1))
    found["non_finite_vertices"] = int(broken.sum())
    if broken.any():
        if non_finite == "refuse":
            raise InputError(
                f"mesh '{name}' has {broken.sum()} non-finite vertices (first: {np.argmax(broken)}): "
                'repair the file, or load with non_finite="drop"'
            )
        faces = faces[~broken[faces].any(axis=1)]
        whole = positions[~broken].astype(np.float64)
        positions[broken] = whole.mean(axis=0) if len(whole) else 0
    found["unresolved_faces"], lost = unresolved_faces(exact, faces)
    if lost:
        raise InputError(f"mesh '{name}' has {lost}")

    degenerate, sliver = _thin_faces(positions, faces)
    found |= {"degenerate_faces": int(degenerate.sum()), "sliver_faces": int(sliver.sum())}
    faces = faces[~degenerate]
    repeated = _repeated_rows(faces)
    found["duplicate_faces"] = int(repeated.sum())
    faces = faces[~repeated]
    if len(faces) == 0:
        raise InputError(f"mesh '{name}' has no face left of {found['faces']}: all are degenerate, repair the file")

    groups = position_groups(positions)
    grouped = groups[faces]
    found["coincident_vertices"] = int((groups != np.arange(len(groups))).sum())
    found["unreferenced_vertices"] = int(len(positions) - len(np.unique(faces)))
    found["coincident_faces"] = int(_repeated_rows(grouped).sum())
    surface = topology(faces)
    if surface.boundary_edges:
        # Seams open a surface that is closed; but joining what is closed already could pinch it.
        surface = topology(grouped)
    found |= _surface_counts(surface)
    turn = _turned(positions, faces, surface, found)
    if winding == "repair":
        faces = flipped(faces, turn)
        found["flipped_faces"] = int(turn.sum())
    if normals is not None:
        normals = _checked_normals(positions, faces, np.array(normals, dtype=np.float32), turn, winding, found)
    return positions, faces, normals, DefectReport(**found)


def _thin_faces(positions: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces without area, and slivers (smallest angle below SLIVER_ANGLE); both free of scale."""
    corners = positions.astype(np.float64)[faces]
    lengths = np.sort(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2), axis=1)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    degenerate = doubled <= _ZERO_HEIGHT * lengths[:, 2] ** 2
    # sin of the smallest angle = twice the area over the product of the two longer sides.
    sliver = ~degenerate & (doubled < np.sin(np.radians(SLIVER_ANGLE)) * lengths[:, 1] * lengths[:, 2])
    return degenerate, sliver


def _repeated_rows(faces: np.ndarray) -> np.ndarray:
    """Faces whose vertex set came earlier, bool [F]."""
    sets = np.sort(faces, axis=1)
    order = np.lexsort((sets[:, 2], sets[:, 1], sets[:, 0]))
    ordered = sets[order]
    repeated = np.zeros(len(faces), dtype=bool)
    repeated[order[1:]] = (ordered[1:] == ordered[:-1]).all(axis=1)
    return repeated


def _surface_counts(surface: Topology) -> dict:
    return {
        "components": surface.component_count,
        "non_manifold_edges": surface.non_manifold_edges,
        "boundary_edges": surface.boundary_edges,
        "inconsistent_edges": surface.inconsistent_edges,
        "unorientable_components": int((~surface.orientable).sum()),
        "watertight": surface.non_manifold_edges == 0 and surface.boundary_edges == 0,
    }


def _turned(positions: np.ndarray, faces: np.ndarray, surface: Topology, found: dict) -> np.ndarray:
    """Faces to turn over, bool [F]: first agreement within each piece, then inside-out closed pieces."""
    inside_out, cavities = inward_components(positions, flipped(faces, surface.flip), surface)
    found |= {"inward_components": int(inside_out.sum()), "cavities": int(cavities.sum())}
    return surface.flip ^ inside_out[surface.component]


def _checked_normals(
    positions: np.ndarray, faces: np.ndarray, normals: np.ndarray, turn: np.ndarray, winding: str, found: dict
) -> np.ndarray:
    """Unit normals that agree with the repaired winding where it was repaired."""
    computed = smooth_normals(positions, faces)
    lengths = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = (normals / lengths).astype(np.float32)
    missing = ~np.isfinite(normals).all(axis=1) | ~(lengths[:, 0] > 1e-12)
    normals[missing] = computed[missing]
    against = (normals * computed).sum(axis=1) < 0
    if winding == "repair":
        turned = np.zeros(len(positions), dtype=bool)
        turned[faces[turn]] = True
        normals[turned & against] *= -1
        against &= ~turned
    referenced = np.zeros(len(positions), dtype=bool)
    referenced[faces] = True
    sides = (positions[faces[:, i]].astype(np.float64) - positions[faces[:, 0]] for i in (1, 2))
    face_normals = np.cross(next(sides), next(sides))
    for corner in range(3):
        agrees = np.einsum("fi,fi->f", face_normals, normals[faces[:, corner]]) > 0
        against[faces[agrees, corner]] = False
    found["replaced_normals"] = int((missing & referenced).sum())
    found["opposed_normals"] = int((against & referenced).sum())
    return normals
