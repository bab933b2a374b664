"""What the command line loads before it works, and what `info` says of files that it does not know."""

import json
import subprocess
import sys

import numpy as np
import pytest
import safetensors.numpy

from diffprt.cli import main
from diffprt.cli.main import COMMANDS
from diffprt.representation.header import read_header

HEAVY = ("torch", "warp", "numpy", "scipy", "rich", "trimesh", "matplotlib", "pxr", "kornia")
HEADER = {
    "version": 1,
    "type": "surfels",
    "scene_hash": "ab",
    "settings": {"radius": 0.5},
    "plan": {},
    "certificate": {},
    "conventions": {"sh": "ours"},
}


def loaded(*commands: list[str]) -> dict[str, list[str]]:
    """Runs commands in one fresh process; which of `HEAVY` are loaded after each."""
    program = f"""
import contextlib, io, json, sys
from diffprt.cli import main
found = {{}}
for command in {list(commands)}:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            main(command)
        except SystemExit as ended:
            code = ended.code
    found[" ".join(command)] = [code, [name for name in {HEAVY} if name in sys.modules]]
print(json.dumps(found))
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_help_and_mistyped_options_load_nothing_heavy():
    asked = [["--help"], ["--version"], *([name, "--help"] for name in COMMANDS)]
    mistyped = [["bakes"], ["--ryas"], *([name, "--ryas", "3"] for name in COMMANDS)]
    found = loaded(*asked, *mistyped)
    assert len(found) == 2 * len(COMMANDS) + 4
    assert found == {" ".join(c): [0, []] for c in asked} | {" ".join(c): [2, []] for c in mistyped}


def written(path, header, **tensors):
    safetensors.numpy.save_file(tensors or {"radii": np.ones(3, np.float16)}, path, {"diffprt": json.dumps(header)})
    return path


def test_info_describes_a_file_of_an_unknown_type_without_torch(tmp_path, capsys):
    openness = np.array([0.25, 0.75], np.float32)
    file = written(tmp_path / "a.prt", HEADER, radii=np.ones((2, 4), np.float16), openness=openness)
    ((code, heavy),) = loaded(["info", str(file)]).values()
    assert code == 0 and "torch" not in heavy and "warp" not in heavy
    with pytest.raises(SystemExit):
        main(["info", str(file)])
    text = capsys.readouterr().out
    for told in ("surfels, version 1", "radii", "2x4", "F16", '{"radius": 0.5}', "mean openness: 0.5000", "ours"):
        assert told in text


def nested(depth: int) -> list:
    value: list = []
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize(
    "change",
    [
        {"settings": nested(40)},
        {"settings": {"a": nested(900)}},
        {"plan": []},
        {"type": ["transfer"]},
        {"type": "a\nb\x1b[2J"},
        {"scene_hash": None},
        {"version": {}},
    ],
)
def test_hostile_headers_are_one_line(change, tmp_path, capsys):
    file = written(tmp_path / "a.prt", HEADER | change)
    for report in ([], ["--json", str(tmp_path / "r.json")]):
        with pytest.raises(SystemExit) as ended:
            main(["info", str(file), *report])
        said = capsys.readouterr()
        assert ended.value.code == 2 and said.out == "" and said.err.count("\n") == 1, said


def test_odd_entries_do_not_stop_info(tmp_path, capsys):
    file = written(tmp_path / "a.prt", HEADER | {"certificate": {"receivers_inside": "many"}}, openness=np.ones((0, 3)))
    assert read_header(file)["tensors"]["openness"]["shape"] == [0, 3]
    with pytest.raises(SystemExit) as ended:
        main(["info", str(file), "--json", str(tmp_path / "r.json")])
    assert ended.value.code == 0 and "many" in capsys.readouterr().out


def test_shells_can_complete(monkeypatch, capsys):
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", "diffprt re")
    monkeypatch.setenv("_DIFFPRT_COMPLETE", "complete_zsh")
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 0 and "render" in capsys.readouterr().out
