"""Visibility beside its peers: agreement, complete reports, and tests that can fail."""

import json
import math

import pytest
import torch

from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh
from diffprt.scene import builtin_scene
from diffprt.study.timing import Stopwatch
from diffprt.study.visibility import peers
from diffprt.study.visibility import study as visibility
from diffprt.study.visibility.brute_force import brute_force_hits, edge_clearance
from diffprt.study.visibility.hemispheres import Hemispheres
from diffprt.study.visibility.rate_chart import rate_chart
from diffprt.study.visibility.structure import structure_row, subdivided
from diffprt.study.visibility.study import rate_row, visibility_study
from diffprt.study.visibility.watertight import brute_force_agreement, escaped_rays, points_inside, winding_number
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.diffuse.reference import closest_hits

ESCAPES = (
    "escaped_packets",
    "escaped_any_hit",
    "escaped_closest_hit",
    "escaped_aimed",
    "escaped_aimed_closest_hit",
)


@pytest.fixture(scope="module")
def surfaces() -> Surfaces:
    return Surfaces.of(builtin_scene("bunny", subdivisions=0))


@pytest.fixture(scope="module")
def mesh(surfaces) -> TriangleMesh:
    return TriangleMesh(surfaces.positions, surfaces.faces)


@pytest.fixture(scope="module")
def room() -> TriangleMesh:
    merged = builtin_scene("closed_box", subdivisions=2).merged()
    return TriangleMesh(merged.positions, merged.faces)


def test_every_way_of_embree_counts_what_ours_counts(peer, surfaces, mesh):
    peer("embreex.rtcore_scene")
    load = Hemispheres.drawn(surfaces, mesh.ray_offset(), 100, 200_000)
    embree = peers.Embree(surfaces.positions, surfaces.faces)
    ours = torch.from_numpy(visibility._ours(mesh, load, 1, Stopwatch()))
    assert 0.02 < float(ours.sum()) / load.total < 0.98
    ways = embree.ways(load)
    assert len(ways) >= 4
    for way in ways.values():
        watch = Stopwatch()
        assert int((torch.from_numpy(way(watch)) - ours).abs().sum()) <= 1e-4 * load.total
        assert watch.seconds > 0


def test_every_way_of_mitsuba_counts_what_ours_counts(surfaces, mesh):
    pytest.importorskip("mitsuba")
    load = Hemispheres.drawn(surfaces, mesh.ray_offset(), 100, 20_000)
    try:
        mitsuba = peers.Mitsuba(surfaces.positions, surfaces.faces)
    except InputError as error:
        pytest.skip(str(error))
    ours = torch.from_numpy(visibility._ours(mesh, load, 1, Stopwatch()))
    ways = mitsuba.ways(load)
    assert len(ways) >= 4
    for way in ways.values():
        assert int((torch.from_numpy(way(Stopwatch())) - ours).abs().sum()) <= 1e-4 * load.total


def test_a_row_has_every_field(peer, surfaces, mesh):
    peer("embreex.rtcore_scene")
    contenders = {"embreex": peers.Embree(surfaces.positions, surfaces.faces), "mitsuba": "not here"}
    row = rate_row(surfaces, mesh, contenders, 64, runs=3, seconds=0.01)
    assert set(row["contenders"]) == {"ours_one_core", "ours", "ours_with_sh", "embreex", "mitsuba"}
    fields = {frozenset(entry) for entry in row["contenders"].values()}
    assert len(fields) == 1
    for name, entry in row["contenders"].items():
        if name == "mitsuba":
            assert entry["skipped"] == "not here"
            assert entry["rate"] is None
            continue
        assert entry["skipped"] is None
        assert len(entry["seconds"]) == 3
        assert 0 < entry["rate"]["low"] <= entry["rate"]["median"] <= entry["rate"]["high"]
        assert entry["disagreement"] <= 1e-4
    assert row["contenders"]["embreex"]["way"] in row["contenders"]["embreex"]["ways"]
    assert row["ratios"]["mitsuba"] is None
    for name in ("embreex", "sh", "threads", "embreex_cpu", "sh_cpu", "threads_cpu"):
        assert len(row["ratios"][name]["runs"]) == 3
        assert row["ratios"][name]["median"] > 0


def test_without_peers_the_study_says_so(monkeypatch, tmp_path):
    def missing(*_arguments):
        raise InputError("nowhere to be found")

    monkeypatch.setattr(visibility, "_PEERS", {"embreex": missing, "mitsuba": missing})
    monkeypatch.setattr("diffprt.study.visibility.structure.Embree", missing)
    box = builtin_scene("closed_box", subdivisions=1)
    report = visibility_study(
        [box], tmp_path, rays=[33], runs=1, seconds=0.01, large=2000, test_rays=2000, brute_tests=1e6
    )
    json.dumps(report)
    (row,) = report["rows"]
    assert row["scene"] == "closed_box"
    assert row["blocked_share"] == 1
    assert {row["contenders"][name]["skipped"] for name in ("embreex", "mitsuba")} == {"nowhere to be found"}
    assert row["ratios"]["embreex"] is None and row["ratios"]["sh"]["median"] > 0
    (structure,) = report["structure"]
    assert structure["skipped"] == "nowhere to be found"
    assert structure["ratio"] is None and structure["bytes_per_triangle"] > 0
    (escape,) = report["escapes"]
    assert [escape[key] for key in ESCAPES] == [0] * len(ESCAPES)
    (brute,) = report["brute_force"]
    assert brute["rays"] == 2000
    assert brute["unexcused"] == 0
    assert (tmp_path / "visibility.png").stat().st_size > 10_000


def test_open_scenes_are_named_and_not_tested(tmp_path):
    row = visibility._escapes(builtin_scene("bowl", subdivisions=1), None, 10, 0)
    assert "boundary edges" in row["skipped"]


def test_impossible_options_are_refused(tmp_path):
    with pytest.raises(InputError, match="runs is 0"):
        visibility_study(["builtin:sphere"], tmp_path, runs=0)


def test_nothing_escapes_unless_there_is_a_hole(room):
    inside = points_inside(room, 32)
    assert inside.shape == (32, 3)
    assert float(inside.abs().max()) < 1
    whole = escaped_rays(room, inside, 20_000)
    assert whole["rays"] >= 20_000
    assert [whole[key] for key in ESCAPES] == [0] * len(ESCAPES)
    torn = escaped_rays(TriangleMesh(room.positions, room.faces[1:]), inside, 20_000)
    # One triangle of 192 is gone. Corners and edges that others share still stop what is aimed at them.
    assert all(torn[key] > 0 for key in ESCAPES[:3])


def test_winding_numbers_tell_inside_from_outside(room):
    sphere = builtin_scene("sphere", subdivisions=2).merged()
    assert winding_number(sphere.positions, sphere.faces, torch.tensor([0.1, 0.2, 0.3])) == pytest.approx(1)
    assert winding_number(sphere.positions, sphere.faces, torch.tensor([0.9, 0.9, 0.3])) == pytest.approx(0, abs=1e-9)
    assert winding_number(room.positions, room.faces, torch.zeros(3)) == pytest.approx(-1)


def test_brute_force_is_the_twin(surfaces, generator):
    low, high = surfaces.positions.amin(0), surfaces.positions.amax(0)
    origins = low + (high - low) * torch.rand(40, 3, generator=generator)
    directions = torch.randn(40, 3, generator=generator)
    distance, face = brute_force_hits(surfaces.positions, surfaces.faces, origins, directions)
    twin_distance, twin_face, _ = closest_hits(
        surfaces.positions.double(), surfaces.faces, origins.double(), directions.double()
    )
    assert torch.equal(face.long(), twin_face)
    assert 5 < int((face >= 0).sum()) < 40
    assert torch.allclose(distance, twin_distance, rtol=1e-9)


def test_brute_force_agrees_unless_the_mesh_differs(mesh):
    found = brute_force_agreement(mesh, 2000)
    assert 0.05 < found["hit_share"] < 0.95
    assert found["unexcused"] == 0
    # The hierarchy of one mesh under the triangles of another, which lacks some.
    mixed = TriangleMesh(mesh.positions, mesh.faces)
    mixed.faces = mesh.faces[: len(mesh.faces) // 2]
    assert brute_force_agreement(mixed, 100)["unexcused_visibility"] > 10


def test_edge_clearance():
    positions = torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    faces = torch.tensor([[0, 1, 2]])
    down = torch.tensor([0.0, 0.0, -2.0])

    def clearance(x: float, y: float, z: float = 1.0) -> float:
        return edge_clearance(positions, faces, torch.tensor([x, y, z]), down)

    assert clearance(0.4, 0.1) == pytest.approx(0.1)
    assert clearance(-0.3, -0.4) == pytest.approx(0.5)
    assert clearance(1.0, 1.0) == pytest.approx(math.sqrt(0.5))
    # Edges behind the origin are as far as the origin itself.
    assert clearance(0.4, 0.1, -1.0) == pytest.approx(math.hypot(0.1, 1.0))


def test_subdivision_keeps_surface_and_seams():
    ball = builtin_scene("sphere", subdivisions=1).merged()
    positions, faces = subdivided(ball.positions, ball.faces, 3)
    assert len(faces) == 9 * len(ball.faces)
    # Euler's formula on a closed surface without handles: every edge was shared.
    assert len(positions) == len(faces) // 2 + 2

    def areas(positions: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
        a, b, c = positions.double()[faces].unbind(1)
        return torch.linalg.cross(b - a, c - a).norm(dim=1) / 2

    assert float(areas(positions, faces).sum() / areas(ball.positions, ball.faces).sum()) == pytest.approx(1)
    assert float(areas(positions, faces).min()) > 0.05 * float(areas(ball.positions, ball.faces).min())


def test_structure_row_takes_the_scene_that_fits(peer):
    peer("embreex.rtcore_scene")
    scenes = [builtin_scene("sphere", subdivisions=2), builtin_scene("closed_box", subdivisions=1)]
    row = structure_row(scenes, 4 * scenes[0].triangle_count, runs=2)
    assert row["scene"] == "sphere"
    assert row["triangles"] == 4 * scenes[0].triangle_count
    assert len(row["ratio"]["runs"]) == 2
    assert row["embreex"]["seconds"]["median"] > 0


def test_small_scenes_are_traced_again_with_other_rays():
    box = Surfaces.of(builtin_scene("closed_box", subdivisions=0))
    load = Hemispheres.drawn(box, 1e-4, 16, 10 * 16 * len(box.receivers))
    count = len(box.receivers)
    assert len(load) == 10 * count
    directions = load.directions()
    assert float((directions[:count] - directions[count : 2 * count]).abs().max()) > 0.1
    above = (directions * load.normals[:, None]).sum(-1)
    assert float(above.min()) > 0


def test_the_chart_takes_rows_without_peers(tmp_path):
    rate = {"median": 2e6, "low": 1e6, "high": 3e6}
    ours, none = {"skipped": None, "rate": rate}, {"skipped": "missing", "rate": None}
    contenders = {"ours": ours, "ours_one_core": ours, "embreex": none, "mitsuba": none}
    rate_chart(
        tmp_path / "chart.png", [{"scene": "box", "rays_per_receiver": 8, "contenders": contenders}], title="one row"
    )
    assert (tmp_path / "chart.png").stat().st_size > 5000
