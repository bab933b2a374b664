"""Geometry in 16 bits: what it moves, what it saves, and files that pretend to have it."""

import numpy as np
import pytest
import safetensors
import torch
from hostile import hostile
from representations import REPRESENTATIONS

from diffprt.errors import InputError
from diffprt.representation.file_size import size_in_file
from diffprt.representation.files import load, read_header, save
from diffprt.surface import Receivers
from diffprt.surface.octahedral import octahedral, unfolded

KINDS = [name for name in REPRESENTATIONS if name != "face_colors"]


@pytest.mark.parametrize("kind", REPRESENTATIONS)
def test_sizes_of_files_are_foretold_to_the_byte(kind, tmp_path):
    asset = REPRESENTATIONS[kind].make()
    assert save(asset, tmp_path / "a.prt") == size_in_file(asset) == (tmp_path / "a.prt").stat().st_size


@pytest.mark.parametrize("kind", KINDS)
def test_sixteen_bits_come_back_as_usual_receivers(kind, tmp_path):
    asset = REPRESENTATIONS[kind].make()
    before = save(asset, tmp_path / "a.prt")
    after = save(asset, tmp_path / "b.prt", geometry=16)
    back, own = load(tmp_path / "b.prt").elements, asset.elements
    assert before - after > 0.6 * (len(own) * 36 + len(own.faces) * 12) - 600
    assert back.bits == 16 and back.positions.dtype == back.normals.dtype == back.albedo.dtype == torch.float32
    side = own.positions.amax(0) - own.positions.amin(0)
    assert bool(((back.positions - own.positions).abs() <= 0.5001 * side / 65535).all())
    assert float((back.normals - own.normals).norm(dim=1).max()) < 7e-5
    assert torch.equal(back.faces, own.faces) and torch.equal(back.albedo, own.albedo)
    certificate = read_header(tmp_path / "b.prt")["certificate"]
    moved = (back.positions.double() - own.positions.double()).norm(dim=1).max()
    assert certificate["geometry_displacement"] == pytest.approx(float(moved))
    assert certificate["geometry_displacement_relative"] == pytest.approx(float(moved / side.double().norm()), rel=1e-5)
    assert 0 < certificate["geometry_normals_degrees"] < 0.004
    again = load(tmp_path / "b.prt")
    assert save(again, tmp_path / "c.prt") == size_in_file(again) == after
    assert (tmp_path / "b.prt").read_bytes() == (tmp_path / "c.prt").read_bytes(), "rounded once"
    assert torch.equal(load(tmp_path / "a.prt").elements.positions, own.positions), "and 32 bits as they were"


def test_the_signal_is_untouched_and_an_albedo_that_varies_is_kept(bumpy_transfer, tmp_path):
    albedo = torch.rand(len(bumpy_transfer.receivers), 3, generator=torch.Generator().manual_seed(0))
    asset = bumpy_transfer.with_elements(bumpy_transfer.receivers.with_albedo(albedo))
    save(asset, tmp_path / "a.prt", geometry=16)
    back = load(tmp_path / "a.prt")
    assert torch.equal(back.diffuse, asset.diffuse)
    assert float((back.receivers.albedo - albedo).abs().max()) <= 0.5001 / 65535
    with safetensors.safe_open(tmp_path / "a.prt", framework="pt") as file:
        assert file.get_tensor("faces").dtype == torch.uint16 and file.get_tensor("normals").shape[1] == 2


@pytest.mark.parametrize("far", [0.0, 1e4, -3e6])
def test_meshes_anywhere_are_rounded_once(far, generator):
    positions = torch.rand(500, 3, generator=generator) * torch.tensor([1.0, 1e-3, 0.0]) + far
    points = Receivers.points(positions, torch.randn(500, 3, generator=generator), 0.5)
    once = points.in_bits(16)
    assert torch.equal(Receivers.restored(once.stored()).positions, once.positions)
    assert torch.equal(Receivers.restored(once.stored()).normals, once.normals)
    assert once.in_bits(32).stored()["positions"].dtype == torch.float32


def test_octahedral_codes_survive_on_every_axis_and_edge(generator):
    edges = torch.cartesian_prod(*[torch.tensor([-1.0, -1e-9, 0.0, 1e-9, 1.0])] * 3)
    edges = edges[edges.norm(dim=1) > 0]
    normals = torch.nn.functional.normalize(torch.cat([edges, torch.randn(5000, 3, generator=generator)]), dim=1)
    codes = octahedral(normals.numpy())
    back = unfolded(codes)
    # Some edges have two codes; what they stand for is the same.
    assert np.array_equal(unfolded(octahedral(back)), back)
    assert float(np.linalg.norm(back - normals.numpy(), axis=1).max()) < 7e-5
    assert np.array_equal(back[:, 2] < 0, normals[:, 2].numpy() < 0), "which chooses a glossy vertex's axes"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h, t: t.pop("positions_box"), "of shape|of dtype"),
        (lambda h, t: t.update(positions=t["positions"].float()), "positions of dtype"),
        (lambda h, t: t.update(normals=torch.zeros(len(t["positions"]), 3).to(torch.uint16)), "normals of shape"),
        (lambda h, t: t.update(albedo=torch.zeros(2, 3)), "albedo has 2 rows"),
        (lambda h, t: t.update(albedo=torch.zeros(1, 3).to(torch.uint16)), "albedo has 1 rows"),
        (lambda h, t: t.update(albedo_box=torch.zeros(2, 3)), "albedo has 1 rows"),
        (lambda h, t: t["positions_box"].__setitem__((0, 0), float("nan")), "non-finite positions_box"),
        (lambda h, t: t.update(faces=torch.full_like(t["faces"], 60000)), "outside"),
    ],
)
def test_hostile_geometry_is_refused(bumpy_transfer, tmp_path, change, message):
    save(bumpy_transfer, tmp_path / "a.prt", geometry=16)
    hostile(tmp_path / "a.prt", change)
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path / "a.prt")
    assert "\n" not in str(caught.value)


def test_what_has_no_such_form_says_so(bumpy_transfer, tmp_path):
    with pytest.raises(InputError, match="Faces have no geometry in 16 bits"):
        save(REPRESENTATIONS["face_colors"].make(), tmp_path / "a.prt", geometry=16)
    with pytest.raises(InputError, match="geometry is 8: give 32, or 16"):
        save(bumpy_transfer, tmp_path / "a.prt", geometry=8)
    assert not list(tmp_path.iterdir())
