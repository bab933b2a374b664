"""The first view of an exported page: the object fills it, and the sky behind is below white."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image

from diffprt import bake
from diffprt.cli import main
from diffprt.representation import files as assets
from diffprt.scene import Camera, builtin_scene


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """An asset on a ground, its file, and the page that `diffprt export` makes of it."""
    folder = tmp_path_factory.mktemp("view")
    scene = builtin_scene("sphere", subdivisions=3).with_ground(resolution=12)
    asset = bake(scene, order=4, rays=128, bounces=0)
    assets.save(asset, folder / "ball.prt")
    run("export", folder / "ball.prt", "-o", folder / "page", "--json", folder / "export.json")
    return asset, folder


def run(*words) -> None:
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    assert ended.value.code == 0


def manifest_of(path) -> dict:
    return json.loads(re.search(r'id="manifest"[^>]*>(.*?)</script>', path.read_text(), re.S)[1])


def camera_of(manifest: dict, width: int, height: int) -> Camera:
    eye, target, up = (tuple(manifest["camera"][name]) for name in ("eye", "target", "up"))
    return Camera(eye, target, up, manifest["camera"]["fov"], width, height)


@pytest.mark.parametrize("size", [(160, 100), (96, 96), (80, 130)])
def test_the_object_fills_more_than_half_of_the_page(size, exported, open_page):
    asset, folder = exported
    page = open_page(folder / "page" / "index.html")
    page.call("resize", *size)
    page.call("setBackground", [0.0, 0.0, 0.0])
    _, mask = page.pixels()
    # The authored square lies whole in the picture.
    camera = camera_of(manifest_of(folder / "page" / "index.html"), *size)
    slope = max(1.0, size[1] / size[0])
    fov = 2 * torch.tensor(camera.fov / 2).deg2rad().tan().mul(slope).atan().rad2deg()
    camera = replace(camera, fov=float(fov))
    assert (torch.from_numpy(mask) == asset.elements.view(camera).mask).float().mean() > 0.99
    view, corners = camera.view(), asset.elements.subject.double()
    local = corners @ view[:3, :3].T + view[:3, 3]
    flat = local[:, :2] / -local[:, 2:] * torch.tensor([camera.projection(1, 2)[i, i] for i in (0, 1)])
    assert float(flat.abs().max()) <= 1.0
    assert float((flat.amax(0) - flat.amin(0)).max()) / 2 > 0.5


def test_the_sky_of_the_page_is_below_white(exported, open_page):
    page = open_page(exported[1] / "page" / "index.html")
    page.call("resize", 96, 64)
    for light in ("1", "2"):
        page.tab.keyboard.press(light)
        for turn in range(0, 360, 90):
            page.tab.evaluate(f"""() => {{
              const c = Math.cos({turn} * Math.PI / 180), s = Math.sin({turn} * Math.PI / 180);
              diffprt.setLightRotation([c, 0, s, 0, 1, 0, -s, 0, c]);
            }}""")
            shown, mask = page.pixels()
            assert (~mask).any() and shown[~mask].max() < 1.0


def test_render_and_export_have_the_same_light_window_camera_and_exposure(exported, open_page):
    _, folder = exported
    run("render", folder / "ball.prt", "-o", folder / "ball.png", "--size", "96", "--samples", "1",
        "--background", "light", "--json", folder / "render.json")  # fmt: skip
    reports = [json.loads((folder / f"{name}.json").read_text()) for name in ("render", "export")]
    assert reports[0]["settings"]["window"] == reports[1]["lights"]["sky"]["window"]
    assert 0 <= reports[0]["errors"]["negative_radiance_clipped"] < 1
    assert 0 <= reports[1]["lights"]["sky"]["negative_radiance_clipped"] < 1
    page = open_page(folder / "page" / "index.html")
    page.call("resize", 96, 96)
    shown, _ = page.pixels()
    picture = torch.from_numpy(np.asarray(Image.open(folder / "ball.png").convert("RGB")) / 255.0)
    assert (picture - torch.from_numpy(shown)).abs().mean() < 4e-3


def test_target_distance_and_field_of_view_are_those_of_the_first_view(exported):
    _, folder = exported
    view = ("--target", "0.5,0,0.25", "--distance", "7", "--fov", "20", "--azimuth", "0", "--elevation", "0")
    run("export", folder / "ball.prt", "-o", folder / "near", "--light", "sky", *view)
    camera = manifest_of(folder / "near" / "index.html")["camera"]
    assert camera["target"] == [0.5, 0.0, 0.25] and camera["fov"] == 20.0
    assert camera["eye"] == pytest.approx([0.5, 0.0, 7.25])


@pytest.mark.parametrize("command", ["render", "export"])
@pytest.mark.parametrize(
    "option", [("--target", "1,nan,0"), ("--target", "1,2"), ("--distance", "inf"), ("--distance", "0"),
               ("--fov", "nan"), ("--azimuth", "inf"), ("--elevation", "nan"), ("--fov", "180")], ids=" ".join,
)  # fmt: skip
def test_views_that_are_none_are_refused_in_one_line(command, option, exported, capsys):
    _, folder = exported
    output = folder / ("no.png" if command == "render" else "no")
    with pytest.raises(SystemExit) as ended:
        main([command, str(folder / "ball.prt"), "-o", str(output), *option])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.count("\n") == 1 and ": give" in said
    assert not output.exists()
