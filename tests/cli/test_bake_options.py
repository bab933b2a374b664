"""Options of `diffprt bake` beyond the plain ones, and what `diffprt info` says of the result."""

import json

import pytest
import trimesh

from diffprt.cli.main import main
from diffprt.representation.files import load


def run(*arguments: str) -> None:
    """A command that succeeds."""
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    assert ended.value.code == 0


SMALL = ["--order", "2", "--rays", "64"]


def test_converged_with_filled_receivers(tmp_path, capsys):
    target, report = tmp_path / "a.prt", tmp_path / "a.json"
    run("bake", "builtin:cornell", *SMALL, "--bounces", "converged", "-o", str(target), "--json", str(report))
    counts = json.loads(report.read_text())["counts"]
    asset = load(target)
    assert counts["bounces"] == asset.settings["bounces"] > 2
    inside = asset.certificate["receivers_inside"]
    assert inside > 10 and f"{inside} receivers lie inside geometry, filled" in capsys.readouterr().out
    run("info", str(target))
    printed = capsys.readouterr().out
    assert f"mean openness: {float(asset.openness.double().mean()):.4f}" in printed
    assert f"receivers inside geometry: {inside}" in printed
    recomputed = tmp_path / "b.prt"
    run("bake", "builtin:cornell", *SMALL, "--bounces", "converged", "--operator", "recompute", "-o", str(recomputed))
    assert recomputed.read_bytes() == target.read_bytes()


def test_inside_receivers_may_stay_black(tmp_path):
    target = tmp_path / "a.prt"
    run("bake", "builtin:cornell", *SMALL, "--bounces", "0", "--no-fill-inside", "-o", str(target))
    asset = load(target)
    assert "receivers_inside" not in asset.certificate
    floor = asset.receivers.positions[:, 1] == 0
    assert float(asset.openness[floor].min()) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--bounces", "all"], "bounces is 'all': give 0 to 64, such as 2, or converged"),
        (["--bounces", "65"], "bounces is 65"),
        (["--operator", "fast"], "operator is 'fast'"),
        (["--rays", "1000000", "--hours", "0.0001"], "allow it with --hours 1"),
    ],
)
def test_refused(options, message, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["bake", "builtin:sphere", *options, "-o", str(tmp_path / "a.prt")])
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert message in error and len(error.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_recenter_moves_what_lies_far_out(tmp_path, capsys):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1e-3)
    path, target = tmp_path / "far.obj", str(tmp_path / "far.prt")
    rows = [f"v {x + 1e6:.12f} {y:.12f} {z:.12f}" for x, y, z in ball.vertices.tolist()]
    rows += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in ball.faces.tolist()]
    path.write_text("\n".join(rows))
    command = ["bake", str(path), *SMALL, "--bounces", "0", "-o", target]
    assert "--recenter" in refused(capsys, *command)
    run(*command, "--recenter")
    assert float(load(target).receivers.positions.abs().max()) == pytest.approx(1e-3, rel=1e-3)
    assert "--occluder" in refused(capsys, *command, "--recenter", "--occluder", str(path))


def refused(capsys, *arguments: str) -> str:
    """The one line with which a command refuses."""
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    line = capsys.readouterr().err.strip()
    assert ended.value.code == 2 and "\n" not in line
    return line
