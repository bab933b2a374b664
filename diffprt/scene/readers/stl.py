"""STL through trimesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from trimesh.exchange.stl import load_stl

from diffprt.scene.normals import position_groups
from diffprt.scene.readers.parts import Part, Parts


def read_stl(path: Path) -> Parts:
    """Reads an STL file: corners at exactly the same position become one vertex, in order of first appearance."""
    with path.open("rb") as file:
        loaded = load_stl(file)
    parts = loaded["geometry"].items() if "geometry" in loaded else [(path.stem, loaded)]
    result = Parts()
    for name, solid in parts:
        corners = np.asarray(solid["vertices"], dtype=np.float32)
        groups = position_groups(corners)
        kept = np.unique(groups)
        faces = np.searchsorted(kept, groups)[np.asarray(solid["faces"], dtype=np.int64)]
        result.parts.append(Part(positions=corners[kept], faces=faces, material=-1, name=str(name)))
    return result
