"""`diffprt render --lights`: a picture under each light, named after it, of one exposure, or none at all."""

import json
from pathlib import Path

import pytest
import representations as kinds
import torch
from command_line import run

from diffprt import save
from diffprt.cli.light_sequence import light_names, picture_files
from diffprt.errors import InputError
from diffprt.images import read_image, write_image
from diffprt.rendering import auto_exposure

DAY = {"2 dawn": 0.2, "10 noon": 3.0, "21 dusk": 0.05}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Assets, and maps of a day."""
    folder = tmp_path_factory.mktemp("sequence")
    for name in ("transfer", "clustered_transfer", "glossy_transfer"):
        save(kinds.REPRESENTATIONS[name].make(), folder / f"{name}.prt")
    (folder / "day").mkdir()
    for name, level in DAY.items():
        up = torch.linspace(2, 0.1, 16)[:, None, None] * torch.tensor([1.0, 0.9, 0.8]) * level
        write_image(folder / "day" / f"{name}.hdr", up.expand(16, 32, 3).contiguous())
    (folder / "day" / "notes.txt").write_text("not a map")
    (folder / "day" / "._2 dawn.hdr").write_text("what a Mac leaves")
    return folder


def drawn(place, tmp_path, *options, asset="clustered_transfer"):
    report = tmp_path / "report.json"
    status = run("render", place / f"{asset}.prt", "--size", 24, "--samples", 1, "--json", report, *options)
    return status, json.loads(report.read_text()) if report.exists() else None


def test_a_folder_in_order_at_one_exposure(place, tmp_path):
    status, report = drawn(place, tmp_path, "--lights", place / "day", "-o", tmp_path / "out")
    assert status == 0
    files = [tmp_path / "out" / f"{name}.png" for name in DAY]
    assert [Path(entry["image"]) for entry in report["pictures"]] == files
    assert sorted((tmp_path / "out").iterdir()) == sorted(files)
    assert report["settings"]["lights"] == [str(place / "day" / f"{name}.hdr") for name in DAY]
    assert [e["errors"]["light"]["environment"] for e in report["pictures"]] == list(DAY)
    means = [float(read_image(file)[8:16, 8:16].mean()) for file in files]
    assert means[1] > means[0] > means[2], "noon is brighter than dawn: no exposure of its own evens them out"
    levels = [entry["mean_radiance"] / level for entry, level in zip(report["pictures"], DAY.values(), strict=True)]
    assert levels == pytest.approx([levels[0]] * 3, rel=0.02)


@pytest.mark.parametrize("asset", ["clustered_transfer", "glossy_transfer"])
def test_each_is_the_picture_of_its_light_alone(place, tmp_path, asset):
    maps = [place / "day" / "10 noon.hdr", place / "day" / "2 dawn.hdr", "constant"]
    turned = ("--light-azimuth", 40, "--background", "light", "--azimuth", 70)
    lights = ",".join(map(str, maps))
    status, report = drawn(
        place, tmp_path, "--lights", lights, *turned, "-o", tmp_path / "{index}_{light}.exr", asset=asset
    )
    assert status == 0
    images = []
    for index, (source, entry) in enumerate(zip(maps, report["pictures"], strict=True)):
        file = tmp_path / f"{index}_{Path(source).stem}.exr"
        assert entry["image"] == str(file) and entry["light"] == str(source)
        alone = tmp_path / "alone.exr"
        assert drawn(place, tmp_path, "--light", source, *turned, "-o", alone, asset=asset)[0] == 0
        images.append(read_image(file))
        assert torch.allclose(images[-1], read_image(alone), rtol=1e-5, atol=1e-5)
    assert report["settings"]["exposure"] != pytest.approx(auto_exposure(images[0], images[0].sum(-1) > 0), rel=1e-2)


def test_names_that_repeat_are_numbered_and_exposure_may_be_given(place, tmp_path):
    status, report = drawn(
        place, tmp_path, "--lights", "sky, builtin:sky,studio", "--exposure", 0.5, "-o", tmp_path / "out"
    )
    assert status == 0 and report["settings"]["exposure"] == 0.5
    assert [Path(e["image"]).name for e in report["pictures"]] == ["sky.png", "sky_2.png", "studio.png"]
    one, two, other = (read_image(Path(e["image"])) for e in report["pictures"])
    assert torch.equal(one, two) and not torch.equal(one, other)


def test_without_an_output_the_folder_is_render(place, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("render", place / "transfer.prt", "--size", 16, "--lights", "constant") == 0
    assert list(tmp_path.rglob("*.png")) == [tmp_path / "render" / "constant.png"]


@pytest.mark.parametrize("bad", ["broken.hdr", "missing.hdr"])
def test_a_broken_map_is_refused_before_any_picture(place, tmp_path, capsys, bad):
    (tmp_path / "broken.hdr").write_bytes(b"#?RADIANCE\nnothing else")
    lights = f"{place / 'day' / '2 dawn.hdr'},sky,{tmp_path / bad}"
    status, report = drawn(place, tmp_path, "--lights", lights, "-o", tmp_path / "out")
    message = capsys.readouterr().err
    assert status == 2 and report is None and bad in message and message.count("\n") == 1
    assert not list(tmp_path.rglob("*.png"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--lights", "sky,", "-o", "out"), "'sky,' has an empty name"),
        (("--lights", "sky", "--light", "studio"), "--light and --lights were given together"),
        (("--lights", "sky,studio", "-o", "a.png"), "a.png is one file"),
        (("--lights", "sky,studio", "-o", "{name}.png"), "braces around other words than light and index"),
        (("--lights", "sky,studio", "-o", "{light.png"), "braces"),
        (("--lights", "sky,studio", "-o", "{light}.jpg"), "ending '.jpg'"),
        (("--lights", "sky,studio", "-o", "{light[0]}.png"), "is the same for several lights"),
        (("--lights", "."), "has no maps"),
    ],
)
def test_mistakes_are_one_line(place, tmp_path, capsys, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    status, report = drawn(place, tmp_path, *options)
    error = capsys.readouterr().err
    assert status == 2 and report is None and message in error and error.count("\n") == 1
    assert not list(tmp_path.rglob("*.*g"))


def test_names_of_lights_and_files(place, tmp_path, monkeypatch):
    monkeypatch.chdir(place)
    assert light_names("sky,day") == ["sky", *(str(Path("day") / f"{name}.hdr") for name in DAY)]
    odd = tmp_path / "a,b.hdr"
    odd.touch()
    assert light_names(str(odd)) == [str(odd)]
    assert picture_files(Path("x/{index:03d}.exr"), ["sky", "b/c.hdr"]) == [Path("x/000.exr"), Path("x/001.exr")]
    assert picture_files(None, ["a/Day.hdr", "b/day.hdr"]) == [Path("render/Day.png"), Path("render/day_2.png")]
    with pytest.raises(InputError, match="one file"):
        picture_files(Path("a.v2"), ["sky"])


def test_reference_sets_take_the_same_lights(place, tmp_path):
    folder = tmp_path / "views"
    asset = place / "transfer.prt"
    assert run("render", asset, "--reference-set", 3, "--lights", place / "day", "--size", 16, "-o", folder) == 0
    assert len(json.loads((folder / "references.json").read_text())["references"]) == 3
