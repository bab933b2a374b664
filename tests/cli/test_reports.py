"""Reports: docs/report.schema.json holds for every command, and `--json -` is one document whatever happens."""

import json
import subprocess
import sys
from functools import partial
from pathlib import Path

import jsonschema
import pytest
from command_line import run

from diffprt.cli import outputs
from diffprt.demo import run_demo
from diffprt.scene import builtin_scene

# The schema lies in docs/, which no wheel has.
pytestmark = pytest.mark.checkout
DOCUMENT = Path(__file__).parents[2] / "docs" / "report.schema.json"
SCHEMA = json.loads(DOCUMENT.read_text("utf-8")) if DOCUMENT.exists() else {}
VALID = jsonschema.Draft202012Validator(SCHEMA)
TRIANGLES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
FEW = "--order 1 --rays 16 --bounces 0"

pytestmark = pytest.mark.checkout


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reports")
    (folder / "a.obj").write_text(TRIANGLES)
    (folder / "b.obj").write_text(TRIANGLES)
    assert run("bake", folder / "a.obj", *FEW.split(), "-o", folder / "a.prt") == 0
    assert run("bake", "builtin:sphere", "--order", 2, "--rays", 16, "--bounces", 0, "-o", folder / "s.prt") == 0
    assert run("compress", folder / "s.prt", "--clusters", 4, "--components", 1, "-o", folder / "c.prt") == 0
    views = ("--reference-set", 3, "--size", 24, "--samples", 1, "--lights", "sky")
    assert run("render", folder / "s.prt", *views, "-o", folder / "views") == 0
    assert run("render", folder / "s.prt", *views, "--no-turn", "-o", folder / "one") == 0
    return folder


COMMANDS = {
    "doctor": "",
    "demo": "-o {out}/demo --order 2 --rays 16 --bounces 0",
    "plan": "{p}/a.obj",
    "bake": "{p}/a.obj " + FEW + " -o {out}/a.prt",
    "bake (dry)": "{p}/a.obj " + FEW + " --dry-run",
    "bake (batch)": "{p}/a.obj {p}/b.obj {p}/gone.obj " + FEW + " -o {out}",
    "compress": "{p}/a.prt --clusters 2 --components 1 -o {out}/a.prt",
    "render": "{p}/a.prt --size 8 -o {out}/a.png",
    "render (set)": "{p}/a.prt --reference-set 2 --size 8 -o {out}/views",
    "optimize": "{p}/c.prt --references {p}/views --steps 1 -o {out}/a.prt",
    "export": "{p}/a.prt --light sky -o {out}/page",
    "info": "{p}/a.prt",
    "invert light": "{p}/s.prt --references {p}/one -o {out}/a.exr",
    "invert albedo": "{p}/s.prt --references {p}/views -o {out}/a.prt",
    "invert joint": "{p}/s.prt --references {p}/views -o {out}/a.prt",
}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_report_is_one_valid_document_on_standard_output(name, place, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("diffprt.demo.builtin_scene", lambda name: builtin_scene("sphere", subdivisions=1))
    monkeypatch.setattr("diffprt.demo.run_demo", partial(run_demo, size=16))
    words = name.partition(" (")[0]
    status = run(*words.split(), *COMMANDS[name].format(p=place, out=tmp_path).split(), "--json", "-")
    said = capsys.readouterr()
    report = json.loads(said.out, parse_constant=pytest.fail)
    VALID.validate(report)
    assert report["command"] == words and report["version"] == outputs.REPORT_VERSION
    assert status == (1 if "batch" in name else 0) and "error" not in report, said.err
    assert said.err, "what people read is on standard error"


def test_a_failure_is_one_document_too(place, tmp_path, capsys):
    for arguments in (
        ("info", tmp_path / "gone.prt"),
        ("bake", place / "a.obj", "--rays", "many"),
        ("study", "overdraw", "--rays", -1),
        ("invert", "light"),
        ("bakes",),
    ):
        assert run(*arguments, "--json", "-") == 2
        said = capsys.readouterr()
        report = json.loads(said.out)
        VALID.validate(report)
        assert report["error"]["status"] == 2 and said.err.count("\n") == 1
        assert report["command"] == " ".join(str(a) for a in arguments[: 1 + (arguments[0] in ("study", "invert"))])


def test_a_process_writes_nothing_else_to_standard_output(place):
    command = [sys.executable, "-m", "diffprt", "info", str(place / "a.prt"), "--json=-"]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert ended.returncode == 0 and json.loads(ended.stdout)["type"] == "transfer" and "tensor" in ended.stderr


def test_what_is_not_finite_is_null(tmp_path):
    file = tmp_path / "r.json"
    outputs.write_report(file, "info", {"counts": {"a": float("inf"), "b": [float("nan"), 1.5]}})
    assert json.loads(file.read_text(), parse_constant=pytest.fail)["counts"] == {"a": None, "b": [None, 1.5]}


@pytest.mark.parametrize(
    "change",
    [
        {"version": 2},
        {"command": "bakes"},
        {"machine": {}},
        {"timings": {"total": -1}},
        {"outputs": {"asset": "a.prt"}},
        {"error": {"message": "", "status": 0}},
    ],
)
def test_the_schema_refuses_what_is_wrong(change, place, tmp_path):
    file = tmp_path / "r.json"
    assert run("bake", place / "a.obj", *FEW.split(), "-o", tmp_path / "a.prt", "--json", file) == 0
    report = json.loads(file.read_text())
    assert VALID.is_valid(report) and not VALID.is_valid(report | change)


def test_the_schema_knows_every_command():
    from diffprt.cli.main import COMMANDS as MAIN
    from diffprt.cli.study import COMMANDS as STUDIES

    named = SCHEMA["oneOf"][2]["properties"]["command"]["enum"]
    wanted = [*MAIN, *(f"study {name}" for name in STUDIES), "invert light", "invert albedo", "invert joint"]
    assert sorted(named) == sorted(set(wanted) - {"study", "invert"})


def test_a_report_that_cannot_be_written_is_refused_before_work(place, tmp_path, capsys):
    for file in (tmp_path, "/dev/null", tmp_path / "a.obj" / "r.json"):
        (tmp_path / "a.obj").write_text("in the way")
        assert run("render", place / "a.prt", "-o", tmp_path / "never.png", "--json", file) == 2
        assert "--json" in capsys.readouterr().err and not (tmp_path / "never.png").exists()


def test_exit_codes_are_in_the_help(capsys):
    assert run("--help") == 0
    text = " ".join(capsys.readouterr().out.split())
    assert all(said in text for said in ("1 part of a batch failed", "2 a mistake", "130 interrupted"))
