"""Reference sets: what is written comes back, and what cannot be of an asset is refused in one line."""

import dataclasses
import json

import pytest
import torch

from diffprt.errors import InputError
from diffprt.images import read_image
from diffprt.optimization import References, load_references, make_references, random_rotations, save_references
from diffprt.optimization.references.checks import check_references
from diffprt.rendering import picture
from diffprt.scene import builtin_environment


def test_a_set_comes_back_as_it_was_written(references, tmp_path):
    save_references(references, tmp_path / "set")
    found = load_references(tmp_path / "set")
    assert len(found) == 10 and found.order == 4 and found.bounds == references.bounds
    assert found.scene_hash == references.scene_hash != ""
    for one, other in zip(references, found, strict=True):
        assert torch.equal(one.image, other.image) and torch.equal(one.light, other.light)
        assert one.camera == other.camera


def test_png_is_srgb_and_is_decoded(references, tmp_path):
    dim = References(tuple(dataclasses.replace(e, image=e.image / e.image.max()) for e in references.entries[:1]))
    save_references(dim, tmp_path, format="png")
    found = load_references(tmp_path).entries[0].image
    assert float((found - dim.entries[0].image.clamp(0, 1)).abs().max()) < 0.01
    encoded = read_image(tmp_path / "0000.png")
    assert float(encoded.mean()) > 1.2 * float(found.mean()), "the file itself is display-encoded"


def test_made_pictures_are_those_of_the_asset(bumpy_transfer, references):
    views = check_references(bumpy_transfer, references)
    for entry, view in zip(references, views, strict=True):
        assert torch.allclose(picture(bumpy_transfer, entry.light, view), entry.image, atol=1e-6)
    assert len({entry.camera for entry in references}) == 10
    assert len({entry.light.numpy().tobytes() for entry in references}) == 10


def test_pixels_are_averaged_as_the_set_says(bumpy_transfer, lights):
    fine = make_references(bumpy_transfer, lights, 2, width=32, height=32, samples=3)
    (view, _) = check_references(bumpy_transfer, fine)
    assert view.samples == fine.samples == 3
    assert torch.allclose(picture(bumpy_transfer, fine.entries[0].light, view), fine.entries[0].image, atol=1e-5)


def test_rotations_are_rotations_and_uniform():
    turns = random_rotations(4000, seed=1)
    identity = torch.eye(3, dtype=torch.float64)
    assert torch.allclose(turns @ turns.transpose(1, 2), identity.expand_as(turns), atol=1e-12)
    assert torch.allclose(torch.linalg.det(turns), torch.ones(4000, dtype=torch.float64), atol=1e-12)
    # Every entry has mean 0 and mean square 1/3; 4000 samples leave about 0.016.
    assert float(turns.mean(0).abs().max()) < 0.05
    assert float((turns.square().mean(0) - 1 / 3).abs().max()) < 0.03


def test_held_out_lights_are_never_trained_on(references):
    shared = References(references.entries + tuple(dataclasses.replace(e, image=e.image * 2) for e in references))
    trained, held = shared.split(0.3, seed=5)
    assert len(held) == 6 and sorted(trained + held) == list(range(20))
    bytes_of = [light.numpy().tobytes() for light in shared.lights]
    assert not {bytes_of[i] for i in trained} & {bytes_of[i] for i in held}
    one_light = References(tuple(dataclasses.replace(e, light=references.lights[0]) for e in references))
    trained, held = one_light.split(0.2)
    assert len(held) == 2 and len(trained) == 8, "cameras are held out where there is one light"


def nan(entry):
    image = entry.image.clone()
    image[3, 4] = torch.nan
    return dataclasses.replace(entry, image=image)


def black(entry):
    return dataclasses.replace(entry, image=torch.zeros_like(entry.image))


def away(entry):
    eye, target = entry.camera.eye, entry.camera.target
    turned = tuple(2 * e - t for e, t in zip(eye, target, strict=True))
    return dataclasses.replace(entry, camera=dataclasses.replace(entry.camera, target=turned))


def shifted(entry):
    return dataclasses.replace(entry, image=entry.image.roll(14, dims=1))


def other_order(entry):
    light = builtin_environment("sky").project(3).coefficients
    return dataclasses.replace(entry, light=light)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (nan, "1 pixels that are not finite"),
        (black, "black everywhere"),
        (away, "sees none"),
        (shifted, "overlaps with the asset by"),
        (other_order, "lights of order 3, the asset has order 4"),
    ],
)
def test_what_cannot_be_of_the_asset_is_named(bumpy_transfer, references, change, message):
    changed = References((change(references.entries[0]),))
    with pytest.raises(InputError, match=message) as found:
        check_references(bumpy_transfer, changed)
    assert "\n" not in str(found.value)


def test_another_scene_is_refused(bumpy_transfer, references):
    other = dataclasses.replace(references, scene_hash="0" * 64)
    with pytest.raises(InputError, match="references are of scene 000000000000"):
        check_references(bumpy_transfer, other)
    moved = dataclasses.replace(references, scene_hash="", bounds=((0.0,) * 3, (1.0,) * 3))
    with pytest.raises(InputError, match="another scene or scale"):
        check_references(bumpy_transfer, moved)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "references.json").unlink(), "has no references.json"),
        (lambda folder: (folder / "references.json").write_text("{"), "is damaged"),
        (lambda folder: edit(folder, version=7), "version 7"),
        (lambda folder: edit(folder, references=[]), "lists 0 pictures"),
        (lambda folder: edit_first(folder, image="../0000.exr"), "outside its folder"),
        (lambda folder: edit_first(folder, light=[[float("nan")] * 3] * 16), "not finite"),
        (lambda folder: edit_first(folder, light=[[1.0, 1.0]] * 16), "give coefficients"),
        (lambda folder: edit_camera(folder, width=50), "its camera 50 x 40"),
        (lambda folder: edit_camera(folder, fov=float("inf")), "finite numbers"),
        (lambda folder: (folder / "0000.exr").unlink(), "does not exist"),
    ],
)
def test_damaged_sets_are_named(references, tmp_path, damage, message):
    save_references(References(references.entries[:1]), tmp_path)
    damage(tmp_path)
    with pytest.raises(InputError, match=message):
        load_references(tmp_path)


def edit(folder, **values):
    file = folder / "references.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


def edit_first(folder, **values):
    first = json.loads((folder / "references.json").read_text())["references"][0]
    edit(folder, references=[first | values])


def edit_camera(folder, **values):
    first = json.loads((folder / "references.json").read_text())["references"][0]
    edit_first(folder, camera=first["camera"] | values)


def test_a_set_of_compressed_transfer_is_refused(small, lights):
    with pytest.raises(InputError, match="compressed"):
        make_references(small, lights, 2)
    with pytest.raises(InputError, match="0 pictures"):
        make_references(small.decode(), lights, 0)
