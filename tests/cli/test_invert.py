"""`diffprt invert`: from a folder of pictures to a light, an albedo or both, and one line for every mistake."""

import json

import pytest
import torch

from diffprt.cli.main import main
from diffprt.images import read_image, write_image
from diffprt.optimization import Reference, References, save_references
from diffprt.rendering import render
from diffprt.representation.files import load, save
from diffprt.scene import Camera, Environment, builtin_environment
from diffprt.transfer import Transfer


@pytest.fixture(scope="module")
def folder(tmp_path_factory, bumpy_transfer):
    """An asset, and references under one light and under two."""
    path = tmp_path_factory.mktemp("invert")
    positions = bumpy_transfer.receivers.positions
    painted = (0.5 + 0.3 * positions.clamp(-1, 1)).clamp(0, 1)
    shown = Transfer(bumpy_transfer.diffuse, bumpy_transfer.receivers.with_albedo(painted))
    save(bumpy_transfer, path / "asset.prt")
    entries = {}
    for name in ("sky", "studio"):
        light = builtin_environment(name).project(4, window="auto")
        cameras = [Camera.framing(positions, azimuth=a, elevation=20, width=48, height=48) for a in (0, 120, 240)]
        for kind, asset in (("plain", bumpy_transfer), ("painted", shown)):
            pictures = [render(asset, light, camera, samples=2).detach() for camera in cameras]
            entries[kind, name] = [Reference(p, c, light.coefficients) for p, c in zip(pictures, cameras, strict=True)]
    save_references(References(tuple(entries["plain", "studio"])), path / "plain")
    save_references(References(tuple(entries["painted", "sky"] + entries["painted", "studio"])), path / "painted")
    torch.save(painted, path / "painted.pt")
    return path


def invert(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["invert", *map(str, arguments)])
    return ended.value.code


def test_a_light_is_written_as_a_map(folder, capsys):
    out, report = folder / "light.exr", folder / "light.json"
    options = ("--references", folder / "plain", "-o", out, "--json", report)
    assert invert("light", folder / "asset.prt", *options) == 0
    assert "observable" in capsys.readouterr().out
    found = Environment(torch.as_tensor(read_image(out))).project(4).coefficients
    truth = builtin_environment("studio").project(4, window="auto").coefficients
    # The map has 128 rows, over which the light is sampled at the centers.
    assert float((found - truth).norm() / truth.norm()) < 0.01
    assert json.loads(report.read_text())["light"]["observable"] == [True] * 4


def test_an_albedo_is_written_into_the_asset(folder, capsys):
    out = folder / "albedo.prt"
    assert invert("albedo", folder / "asset.prt", "--references", folder / "painted", "-o", out) == 0
    assert "told by pixels" in capsys.readouterr().out
    truth = torch.load(folder / "painted.pt")
    off = (load(out).receivers.albedo - truth).norm(dim=1) / truth.norm(dim=1)
    assert float(off.median()) < 0.02


def test_both_are_written(folder, capsys):
    out, report = folder / "joint.prt", folder / "joint.json"
    options = ("--references", folder / "painted", "-o", out, "--json", report)
    assert invert("joint", folder / "asset.prt", *options) == 0
    assert (folder / "joint_light0.exr").is_file() and (folder / "joint_light1.exr").is_file()
    assert json.loads(report.read_text())["mismatch"] < 0.05
    assert load(out).receivers.albedo.mean() == pytest.approx(0.5, abs=0.1)


def test_mistakes_are_one_line(folder, capsys):
    broken = folder / "broken"
    save_references(
        References(
            (Reference(torch.ones(8, 8, 3), Camera((0, 0, 5), (0, 0, 0), width=8, height=8), torch.ones(16, 3)),)
        ),
        broken,
    )
    image = torch.ones(8, 8, 3)
    image[2, 2] = float("nan")
    write_image(broken / "0000.exr", image)
    cases = [
        (("light", folder / "asset.prt", "--references", folder / "plain", "-o", "x.png"), "give a .exr file"),
        (("light", folder / "asset.prt", "--references", folder / "none"), "has no references.json"),
        (("light", folder / "asset.prt", "--references", broken), "not finite"),
        (("light", folder / "asset.prt", "--references", folder / "painted"), "several lights"),
        (("joint", folder / "asset.prt", "--references", folder / "plain"), "one light and an albedo"),
    ]
    for arguments, message in cases:
        assert invert(*arguments) == 2
        said = capsys.readouterr().err
        assert message in said and said.count("\n") == 1
