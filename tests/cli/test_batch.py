"""Several inputs in one command: what is written, what is said, and how it ends."""

import json
import time

import pytest
from command_line import run

from diffprt.cli import batch
from diffprt.representation.files import load

TRIANGLES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
FEW = ("--order", 1, "--rays", 16, "--bounces", 0)


@pytest.fixture
def scenes(tmp_path):
    for name in ("a", "b", "c"):
        (tmp_path / f"{name}.obj").write_text(TRIANGLES)
    (tmp_path / "page.glb").write_text("<!DOCTYPE html><html></html>")
    return tmp_path


def test_one_failure_does_not_stop_the_others(scenes, capsys):
    given = [scenes / name for name in ("a.obj", "page.glb", "gone.obj", "c.obj")]
    out, report = scenes / "out", scenes / "all.json"
    assert run("bake", *given, *FEW, "-o", out, "--json", report) == 1
    said = capsys.readouterr()
    assert sorted(p.name for p in out.iterdir()) == ["a.prt", "c.prt"] and load(out / "c.prt").order == 1
    first, second = said.err.splitlines()
    assert "page.glb" in first and "web page" in first and "gone.obj" in second and "does not exist" in second
    assert "4 inputs, 2 done, 2 failed" in said.out
    made = json.loads(report.read_text())
    assert [row["status"] for row in made["batch"]] == ["done", "failed", "failed", "done"]
    assert made["counts"]["failed"] == 2 and made["batch"][0]["report"]["outputs"]["asset"] == str(out / "a.prt")
    assert made["batch"][1]["error"] == first.removeprefix("diffprt: ")


def test_a_fault_in_one_does_not_stop_the_others(scenes, capsys, monkeypatch):
    from diffprt.scene import Scene

    loaded = Scene.load

    def faulty(path, **options):
        if str(path).endswith("a.obj"):
            raise ZeroDivisionError("by 0")
        return loaded(path, **options)

    monkeypatch.setattr(Scene, "load", staticmethod(faulty))
    assert run("bake", scenes / "a.obj", scenes / "b.obj", *FEW, "-o", scenes / "out") == 1
    assert "a fault of diffprt: ZeroDivisionError" in capsys.readouterr().err and (scenes / "out" / "b.prt").exists()


def test_each_has_a_report_in_a_folder(scenes):
    reports = scenes / "reports"
    assert run("bake", scenes / "a.obj", scenes / "b.obj", *FEW, "-o", scenes / "out", "--json", reports) == 0
    assert sorted(p.name for p in reports.iterdir()) == ["a.json", "b.json"]
    assert json.loads((reports / "b.json").read_text())["outputs"]["asset"].endswith("b.prt")


@pytest.mark.parametrize("folder", ["made", "made/", "new/"])
def test_one_scene_may_go_into_a_folder(scenes, folder):
    (scenes / "made").mkdir()
    assert run("bake", scenes / "a.obj", *FEW, "-o", f"{scenes}/{folder}") == 0
    assert (scenes / folder / "a.prt").exists()


def test_names_that_meet_are_refused_before_any_work(scenes, capsys):
    (scenes / "sub").mkdir()
    (scenes / "sub" / "A.obj").write_text(TRIANGLES)
    out = scenes / "out"
    for twice in ((scenes / "a.obj", scenes / "sub" / "A.obj"), (scenes / "a.obj", scenes / "a.obj")):
        assert run("bake", *twice, *FEW, "-o", out) == 2
        said = capsys.readouterr().err
        assert "would both be written" in said and all(str(path) in said for path in twice)
    assert not out.exists()


def test_what_no_batch_can_be_is_refused_before_any_work(scenes, capsys):
    a, b = scenes / "a.obj", scenes / "b.obj"
    assert run("bake", a, b, *FEW) == 2 and "give a folder with -o" in capsys.readouterr().err
    assert run("bake", a, b, *FEW, "-o", scenes / "one.prt") == 2 and "is one file" in capsys.readouterr().err
    assert run("bake", scenes / "*.glb", *FEW, "-o", scenes / "x.prt") == 2
    assert "pattern that no file fits" in capsys.readouterr().err
    assert run("bake", scenes, *FEW, "-o", scenes / "x.prt") == 2 and "is a folder" in capsys.readouterr().err
    assert not list(scenes.glob("*.prt"))


def test_assets_are_compressed_in_one_command_and_never_over_themselves(scenes, capsys):
    out = scenes / "out"
    assert run("bake", scenes / "a.obj", scenes / "b.obj", *FEW, "-o", out) == 0
    few = ("--clusters", 2, "--components", 1)
    assert run("compress", out / "a.prt", out / "b.prt", *few, "-o", scenes / "small") == 0
    assert load(scenes / "small" / "b.prt").compressed
    assert run("compress", out / "a.prt", out / "b.prt", *few, "-o", out) == 2
    assert "which is read: give another name" in capsys.readouterr().err and not load(out / "a.prt").compressed


def test_ctrl_c_keeps_what_is_finished(scenes, capsys, monkeypatch):
    from diffprt.scene import Scene

    loaded = Scene.load

    def interrupted(path, **options):
        if str(path).endswith("b.obj"):
            raise KeyboardInterrupt
        return loaded(path, **options)

    monkeypatch.setattr(Scene, "load", staticmethod(interrupted))
    given = [scenes / name for name in ("a.obj", "b.obj", "c.obj")]
    report = scenes / "all.json"
    assert run("bake", *given, *FEW, "-o", scenes / "out", "--json", report) == 130
    assert [p.name for p in (scenes / "out").iterdir()] == ["a.prt"]
    assert "1 of 3 inputs are finished and kept" in capsys.readouterr().err
    made = json.loads(report.read_text())
    assert [row["status"] for row in made["batch"]] == ["done", "interrupted", "not begun"]


def test_a_batch_starts_once(scenes, monkeypatch):
    """What is loaded for the first input is there for the second."""
    todo = batch.items([str(scenes / "a.obj"), str(scenes / "b.obj")], str(scenes / "out"), ".prt")
    begun = []
    batch.run_batch("bake", todo, None, lambda item: begun.append(time.perf_counter()) or {})
    assert len(begun) == 2 and begun[1] - begun[0] < 1
