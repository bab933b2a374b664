"""The tolerance study: its arithmetic, its truth, its scenes, and that it goes on where it stopped."""

import itertools
import json
import math

import pytest
import torch

from diffprt.cli import main
from diffprt.errors import InputError
from diffprt.options.bake import BakeSettings
from diffprt.scene import builtin_scene
from diffprt.study.tolerance import study as tolerance
from diffprt.study.tolerance.chart import tolerance_chart
from diffprt.study.tolerance.scenes import random_scene
from diffprt.study.tolerance.study import summary, tolerance_study
from diffprt.study.tolerance.truth import Truth, fewest_rays
from diffprt.transfer import bake

QUICK = {"tolerances": (0.1, 0.05), "bounces": (0, 1), "order": 3, "truth_rays": 200_000}


@pytest.mark.parametrize("exponent", [0.5, 0.75, 1.0])
@pytest.mark.parametrize("start", [32, 400, 100_000])
def test_fewest_rays_of_a_power_law(exponent, start):
    tried = []

    def error_at(rays: int) -> float:
        tried.append(rays)
        return 2.0 * rays**-exponent

    tolerance = 2.0 * 777.0**-exponent
    assert fewest_rays(error_at, tolerance, start, 32) == pytest.approx(777, rel=1e-6)
    assert len(set(tried)) == len(tried) < 14


def test_fewest_rays_at_the_ends():
    assert fewest_rays(lambda rays: 0.0, 0.01, 512, 32) == 32
    step = fewest_rays(lambda rays: 0.0 if rays >= 500 else 1.0, 0.01, 2000, 32)
    assert 500 / 1.25 <= step <= 500 * 1.25


def test_fewest_rays_between_measured_ones():
    """A curve that is no power law: the answer is bracketed within a quarter."""
    found = fewest_rays(lambda rays: 1 / math.log(rays) ** 3, 1 / math.log(300) ** 3, 64, 32)
    assert found == pytest.approx(300, rel=0.01)


@pytest.mark.parametrize("bounces", [0, 2])
def test_truth_is_a_finer_bake(bumpy, bounces):
    settings = BakeSettings(order=3, bounces=bounces, rays=2048)
    truth = Truth(bumpy, settings, most_rays=1 << 30)
    assert truth.share == 1
    assert truth.reflection_rays == (2048 if bounces else 0)
    fine = bake(bumpy, order=3, bounces=bounces, rays=2048, seed=3).diffuse
    rough = bake(bumpy, order=3, bounces=bounces, rays=32, seed=3).diffuse
    assert 0 < truth.error_of(fine) < 0.005 < 0.02 < truth.error_of(rough)
    # A signal that is a tenth too large is a tenth off.
    assert truth.error_of(1.1 * truth.signal) == pytest.approx(0.1, rel=1e-6)


def test_truth_of_some_receivers_stands_for_all(bumpy):
    settings = BakeSettings(order=3, bounces=1, rays=2048)
    whole = Truth(bumpy, settings, most_rays=1 << 30)
    part = Truth(bumpy, settings, most_rays=2048 * len(bumpy.meshes[0].positions) // 2)
    assert part.share == pytest.approx(0.5, abs=0.01)
    assert 100 < part.reflection_rays < 2048
    rough = bake(bumpy, order=3, bounces=1, rays=64).diffuse
    assert part.error_of(rough) == pytest.approx(whole.error_of(rough), rel=0.1)


def test_truth_of_a_room_without_light():
    box = builtin_scene("closed_box", subdivisions=1)
    truth = Truth(box, BakeSettings(order=2, bounces=1, rays=64), most_rays=1 << 30)
    assert truth.error_of(torch.zeros(len(truth.pick), 1, 4)) == 0
    assert truth.error_of(torch.ones(len(truth.pick), 1, 4)) == math.inf


def test_random_scenes_come_from_their_seed():
    scenes = [random_scene(seed) for seed in range(6)]
    assert scenes[3].hash() == random_scene(3).hash()
    assert len({scene.hash() for scene in scenes}) == 6
    assert len({len(scene.meshes) for scene in scenes}) > 2
    for scene in scenes:
        assert 100 < scene.vertex_count < 60_000
        assert bool(torch.isfinite(scene.merged().positions).all())
    assert {any(mesh.ground for mesh in scene.meshes) for scene in scenes} == {True, False}


def rows_of(*values: tuple[float, float, float, float]) -> list[dict]:
    names = ("error", "cost", "expected_error", "estimated_error")
    return [
        {"tolerance": 0.01, "bounces": 0, "scene": f"s{i}"} | dict(zip(names, v, strict=True))
        for i, v in enumerate(values)
    ]


def test_summary_counts():
    rows = rows_of(
        (0.008, 1.0, 0.010, 0.006), (0.012, 1.5, 0.006, 0.012), (0.0, 3.0, 0.0, 0.0), (0.01, 1.25, 0.02, 0.02)
    )
    found = summary(rows)
    assert found["runs"] == 4
    assert found["share_met"] == 0.75
    assert found["share_within_twice_best"] == 0.75
    assert found["median_cost"] == pytest.approx(1.375)
    assert 1.5 < found["cost_95"] < 3.0
    assert found["estimates"]["expected_error"]["share_at_least_measured"] == 0.75
    assert found["estimates"]["estimated_error"]["share_at_least_measured"] == 0.75
    assert found["estimates"]["expected_error"]["median_ratio"] == pytest.approx(1.25)


def test_study_goes_on_where_it_stopped(bumpy, tmp_path, monkeypatch):
    first = tolerance_study([bumpy], tmp_path, **QUICK)
    json.dumps(first)
    assert len(first["rows"]) == 4
    for row in first["rows"]:
        assert 0 < row["error"] < 1.3 * row["tolerance"]
        assert row["best_rays"] >= 32
        assert row["truth_rays"] >= 16 * row["rays"]
        spent = row["rays"] * row["receivers"] + row["pilot_rays"]
        assert row["cost"] == pytest.approx(spent / (row["best_rays"] * row["receivers"]))
    chart = tmp_path / "tolerance.png"
    assert chart.stat().st_size > 10_000

    baked = []

    def counted(*arguments, **options):
        baked.append(options)
        return bake(*arguments, **options)

    monkeypatch.setattr(tolerance, "bake", counted)
    again = tolerance_study([bumpy], tmp_path, **QUICK)
    assert not baked
    assert again["rows"] == first["rows"]

    # Killed while it wrote its last row: that one is made again, to the same figures.
    kept = tmp_path / "rows.jsonl"
    kept.write_text(kept.read_text()[:-40])
    repaired = tolerance_study([bumpy], tmp_path, **QUICK)
    assert baked and {options["bounces"] for options in baked} == {1}
    for ours, theirs in zip(repaired["rows"], first["rows"], strict=True):
        same = ("scene", "bounces", "tolerance", "rays", "pilot_rays", "expected_error", "estimated_error")
        assert all(ours[name] == theirs[name] for name in same)
    assert tolerance_study([bumpy], tmp_path, **QUICK)["rows"] == repaired["rows"]


def test_folder_of_data(bumpy, tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    (folder / "notes.txt").write_text("no mesh")
    (folder / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    corners = [" ".join(map(str, p)) for p in itertools.product((0, 1), repeat=3)]
    box = ["1 3 4", "1 4 2", "5 6 8", "5 8 7", "1 2 6", "1 6 5", "3 7 8", "3 8 4", "1 5 7", "1 7 3", "2 4 8", "2 8 6"]
    (folder / "box.obj").write_text("\n".join([f"v {c}" for c in corners] + [f"f {f}" for f in box]) + "\n")
    options = QUICK | {"tolerances": (0.1,), "bounces": (0,)}
    report = tolerance_study([], tmp_path / "out", data=folder, **options)
    (row,) = report["rows"]
    assert (row["scene"], row["rays"], row["error"]) == ("box", 32, 0.0)
    (note,) = report["notes"]
    assert "points.obj was skipped" in note


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerances": ()}, "give at least one"),
        ({"random": -1}, "random -1"),
        ({"data": "/nowhere/at/all"}, "does not exist"),
        ({}, "there is no scene"),
    ],
)
def test_impossible_options_are_refused(tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        tolerance_study([], tmp_path, **(QUICK | options))


def test_chart_takes_one_run_and_none_without_light(tmp_path):
    tolerance_chart(tmp_path / "chart.png", rows_of((0.0, 1.1, 0.0, 0.0)))
    assert (tmp_path / "chart.png").stat().st_size > 5000


def test_command(tmp_path, capsys):
    report = tmp_path / "report.json"
    options = ["--random", "0", "--tolerance", "0.1", "--bounces", "0", "--order", "2"]
    with pytest.raises(SystemExit) as ended:
        main(["study", "tolerance", "builtin:sphere", *options, "-o", str(tmp_path), "--json", str(report)])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert "met: 100.0 % of 1 runs" in text
    content = json.loads(report.read_text())
    assert content["command"] == "study tolerance"
    assert content["rows"][0]["scene"] == "sphere"
    assert content["summary"]["median_cost"] < 1.2
