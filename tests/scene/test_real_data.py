"""Scans and probes that lie beside the checkout in development; left out elsewhere (see conftest)."""

from pathlib import Path

import pytest
import torch

from diffprt.scene import Environment, Scene

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"

# Vertices, faces, boundary edges, watertight: measured with trimesh, in the data's own README.
MESHES = {
    "bunny_35k": (34834, 69451, 223, False),
    "horse_20k": (20000, 39996, 0, True),
    "diplodocus_24k": (23982, 47960, 0, True),
    "armadillo_43k": (43243, 86482, 0, True),
    "nefertiti_35k": (35002, 70000, 0, True),
}


@pytest.mark.parametrize("name", MESHES)
def test_scans_load_as_they_are(name):
    scene = Scene.load(DATA / f"{name}.ply", up="z" if name == "horse_20k" else None)
    found = scene.defects
    assert (scene.vertex_count, scene.triangle_count, found.boundary_edges, found.watertight) == MESHES[name]
    assert found.components == 1 and found.flipped_faces == found.degenerate_faces == 0


def test_a_point_cloud_is_no_mesh():
    with pytest.raises(ValueError, match="95435 vertices and no faces"):
        Scene.load(DATA / "gargoyle_95k_points.ply")


# Mean luminance, and the peak's place as shares of width and height.
MAPS = {
    "grace_1024x512": (0.0147, 0.509, 0.252),
    "forest_slope_1024x512": (0.489, 0.614, 0.277),
    "rooitou_park_1024x512": (0.756, 0.600, 0.441),
}


@pytest.mark.parametrize("name", MAPS)
def test_probes_load_without_clamping(name):
    environment = Environment.load(DATA / f"{name}.hdr", bad_texels="refuse")
    luminance = environment.image @ torch.tensor([0.2126, 0.7152, 0.0722])
    mean, u, v = MAPS[name]
    assert float(environment.mean @ torch.tensor([0.2126, 0.7152, 0.0722])) == pytest.approx(mean, rel=0.01)
    row, column = divmod(int(luminance.argmax()), luminance.shape[1])
    assert ((column + 0.5) / luminance.shape[1], (row + 0.5) / luminance.shape[0]) == pytest.approx((u, v), abs=2e-3)
