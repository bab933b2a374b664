"""Asset files: what was saved comes back, and damaged or hostile files do no harm (hard case 32)."""

import json
import re
import struct
from dataclasses import replace
from pathlib import Path

import pytest
import safetensors.torch
import torch
from hostile import hostile

from diffprt.brdf import GGX, brdf_of
from diffprt.compression import ClusteredGlossyTransfer, ClusteredTransfer, compress
from diffprt.errors import InputError
from diffprt.representation.files import load, read_header, save
from diffprt.representation.registry import HOMES, kind_of
from diffprt.transfer import GlossyTransfer, Transfer, bake_glossy


@pytest.fixture(scope="module")
def compressed(bumpy_transfer) -> ClusteredTransfer:
    return compress(bumpy_transfer, clusters=9, components=3)


@pytest.fixture(scope="module")
def glossy(bumpy) -> GlossyTransfer:
    brdf = GGX(0.4, diffuse=(0.3, 0.2, 0.1), specular=0.6)
    return bake_glossy(bumpy, brdf, order=2, order_out=3, rays=32, bounces=1, bounce_rays=32)


@pytest.fixture(scope="module")
def clustered_glossy(glossy) -> ClusteredGlossyTransfer:
    assert glossy.channels == 3
    return compress(glossy, clusters=9, components=3)


@pytest.mark.parametrize("made", ["bumpy_transfer", "compressed", "glossy", "clustered_glossy"])
def test_round_trip(request, made, tmp_path):
    asset = request.getfixturevalue(made)
    size = save(asset, tmp_path / "a.prt")
    assert size == (tmp_path / "a.prt").stat().st_size
    back = load(tmp_path / "a.prt")
    assert type(back) is type(asset)
    for name in (name for name, tensor in asset.spec.items() if not tensor.optional):
        assert torch.equal(getattr(back, name), getattr(asset, name))
    for name in ("positions", "normals", "albedo", "faces"):
        assert torch.equal(getattr(back.receivers, name), getattr(asset.receivers, name))
    for name in ("settings", "certificate", "plan", "scene_hash"):
        assert getattr(back, name) == getattr(asset, name)
    save(back, tmp_path / "b.prt")
    assert (tmp_path / "a.prt").read_bytes() == (tmp_path / "b.prt").read_bytes()
    assert [p.name for p in tmp_path.iterdir() if "partial" in p.name] == []


def test_glossy_assets_know_their_brdf(glossy, tmp_path):
    save(glossy, tmp_path / "a.prt")
    (described,) = load(tmp_path / "a.prt").settings["brdf"]
    directions = torch.nn.functional.normalize(torch.rand(2, 20, 3) + 0.1, dim=-1)
    expected = GGX(0.4, diffuse=(0.3, 0.2, 0.1), specular=0.6).evaluate(*directions)
    assert torch.allclose(brdf_of(described).evaluate(*directions), expected)
    assert read_header(tmp_path / "a.prt")["conventions"]["transfer"].startswith("light on the scene's axes to exit")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h, t: t.update(glossy=t["glossy"][:-1]), "glossy of shape"),
        (lambda h, t: t.update(glossy=t["glossy"][:, :, :-1]), "order"),
        (lambda h, t: t.update(glossy=t["glossy"][0]), "glossy of shape"),
        (lambda h, t: t.update(glossy=t["glossy"].half()), "glossy of dtype"),
        (lambda h, t: t["glossy"].__setitem__((0, 0, 0, 0), float("inf")), "non-finite glossy"),
        (lambda h, t: t.update(openness=torch.zeros(len(t["glossy"]))), "wanted"),
        (lambda h, t: h.update(type="transfer"), "wanted"),
    ],
)
def test_hostile_glossy_assets_are_refused(glossy, tmp_path, change, message):
    save(glossy, tmp_path / "a.prt")
    hostile(tmp_path / "a.prt", change)
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path / "a.prt")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h, t: t.update(means=t["means"][:, :, :-1], bases=t["bases"][:, :, :, :-1]), "order"),
        (lambda h, t: t.update(means=t["means"][:, :, 0]), "means of shape"),
        (lambda h, t: t.update(means=t["means"].long()), "means of dtype"),
        (lambda h, t: t.update(bases=t["bases"][:-1]), "beside bases of"),
        (lambda h, t: t.update(bases=t["bases"][0]), "bases of shape"),
        (lambda h, t: t.update(weights=t["weights"][:, :-1]), "weights of shape"),
        (lambda h, t: t["bases"].__setitem__((0, 0, 0, 0, 0), float("nan")), "non-finite bases"),
        (lambda h, t: t["labels"].fill_(200), "labels outside"),
        (lambda h, t: t.update(labels=t["labels"][:0]), "labels of shape"),
        (lambda h, t: t.update(labels=t["labels"][:0], weights=t["weights"].byte()), "labels of shape"),
        (lambda h, t: t.update(weights=t["weights"].byte()), "ranges of weights"),
        (lambda h, t: t.update(glossy=torch.zeros(1)), "wanted"),
        (lambda h, t: t.update(openness=torch.zeros(len(t["labels"]))), "wanted"),
        (lambda h, t: t.pop("bases"), "wanted"),
        (lambda h, t: h.update(type="clustered_transfer"), "of shape"),
        (lambda h, t: h.update(type="glossy_transfer"), "wanted"),
    ],
)
def test_hostile_clustered_glossy_assets_are_refused(clustered_glossy, tmp_path, change, message):
    save(clustered_glossy, tmp_path / "a.prt")
    hostile(tmp_path / "a.prt", change)
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path / "a.prt")
    assert str(tmp_path / "a.prt") in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.checkout
def test_documents_list_every_tensor():
    """docs/assets.md names each kind with its tensors and those of its elements, and no others."""
    page = Path(__file__).resolve().parents[2] / "docs" / "assets.md"
    header, _, rest = page.read_text("utf-8").partition("## Tensors")
    (types,) = re.findall(r"^\| `type` \| (.*) \|$", header, re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", types)) == set(HOMES)
    table = rest.partition("## ")[0]
    rows = re.findall(r"^\| (`[^|]*`) \|[^|]*\|[^|]*\| ([^|]*) \|$", table, re.MULTILINE)
    listed = {kind: set() for kind in HOMES}
    for names, kinds in rows:
        for kind in HOMES:
            if kinds.startswith("all") or f"`{kind}`" in kinds:
                listed[kind] |= set(re.findall(r"`(\w+)`", names))
    kinds = {name: kind_of(name) for name in HOMES}
    assert listed == {name: set(kind.elements_type.spec) | set(kind.spec) for name, kind in kinds.items()}


def test_tensors_that_share_memory_are_saved_apart(bumpy_transfer, tmp_path):
    normals = bumpy_transfer.receivers.normals
    shared = replace(bumpy_transfer, bent_normals=normals)
    save(shared, tmp_path / "a.prt")
    save(replace(bumpy_transfer, bent_normals=normals.clone()), tmp_path / "b.prt")
    assert (tmp_path / "a.prt").read_bytes() == (tmp_path / "b.prt").read_bytes()
    assert torch.equal(load(tmp_path / "a.prt").bent_normals, normals)


@pytest.mark.parametrize("clusters", [200, 300])
def test_labels_take_as_few_bytes_as_they_can(clusters, bumpy_transfer, tmp_path):
    asset = compress(bumpy_transfer, clusters=clusters, components=1, iterations=2)
    save(asset, tmp_path / "a.prt")
    dtype = read_header(tmp_path / "a.prt")["tensors"]["labels"]["dtype"]
    assert dtype == ("U8" if asset.clusters <= 256 else "U16")
    assert torch.equal(load(tmp_path / "a.prt").labels, asset.labels)


def test_float64_signals_survive(bumpy_transfer, tmp_path):
    asset = bumpy_transfer.with_signal(bumpy_transfer.diffuse.double())
    save(asset, tmp_path / "a.prt")
    assert torch.equal(load(tmp_path / "a.prt").diffuse, asset.diffuse)


@pytest.mark.parametrize("number_format", ["float32", "float16", "uint8"])
def test_means_alone_survive(glossy, tmp_path, number_format):
    """No components: empty bases and weights."""
    asset = compress(glossy, clusters=5, components=0, weights_format=number_format, bases_format=number_format)
    save(asset, tmp_path / "a.prt")
    again = load(tmp_path / "a.prt")
    assert again.components == 0 and again.nbytes == asset.nbytes
    assert torch.allclose(again.decode().glossy, asset.decode().glossy, rtol=0, atol=1e-6)


def test_float64_signals_with_weights_in_few_bits_survive(glossy, tmp_path):
    double = compress(glossy.with_signal(glossy.glossy.double()), clusters=4, components=2, weights_format="float16")
    save(double, tmp_path / "a.prt")
    again = load(tmp_path / "a.prt")
    assert torch.equal(again.means, double.means) and torch.equal(again.weights, double.weights)
    assert torch.equal(again.decode().glossy, double.decode().glossy)


def test_no_timing_is_saved_and_the_header_is_sorted(bumpy_transfer, tmp_path):
    save(bumpy_transfer, tmp_path / "a.prt")
    header = read_header(tmp_path / "a.prt")
    assert "timings" not in json.dumps(header) and header["version"] == 1
    raw = (tmp_path / "a.prt").read_bytes()
    length = struct.unpack("<Q", raw[:8])[0]
    text = json.loads(raw[8 : 8 + length])["__metadata__"]["diffprt"]
    assert text == json.dumps(json.loads(text), sort_keys=True)


@pytest.mark.parametrize("kind", ["compressed", "clustered_glossy"])
def test_every_truncation_is_one_clear_error(request, kind, tmp_path):
    save(request.getfixturevalue(kind), tmp_path / "a.prt")
    data = (tmp_path / "a.prt").read_bytes()
    for keep in [0, 1, 7, 8, 9, 100, 1000, len(data) // 2, len(data) - 1]:
        (tmp_path / "t.prt").write_bytes(data[:keep])
        with pytest.raises(InputError, match="is damaged") as caught:
            load(tmp_path / "t.prt")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["compressed", "clustered_glossy"])
def test_flipped_bytes_never_crash(request, kind, tmp_path):
    save(request.getfixturevalue(kind), tmp_path / "a.prt")
    data = bytearray((tmp_path / "a.prt").read_bytes())
    generator = torch.Generator().manual_seed(0)
    refused = 0
    for _ in range(200):
        at = int(torch.randint(0, 1500, (1,), generator=generator))
        changed = bytearray(data)
        changed[at] ^= 1 << int(torch.randint(0, 8, (1,), generator=generator))
        (tmp_path / "t.prt").write_bytes(changed)
        try:
            load(tmp_path / "t.prt")
        except InputError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 100


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h, t: h.update(version=99), "version 99"),
        (lambda h, t: h.update(type="pickle"), "'pickle' is no kind of asset known here"),
        (lambda h, t: h.pop("settings"), "damaged header"),
        (lambda h, t: t.pop("weights"), "wanted"),
        (lambda h, t: t.update(extra=torch.zeros(1)), "wanted"),
        (lambda h, t: t.update(weights=torch.zeros(3)), "weights of shape"),
        (lambda h, t: t.update(weights=t["weights"][:-1]), "weights of shape"),
        (lambda h, t: t.update(weights=t["weights"].long()), "weights of dtype"),
        (lambda h, t: t["means"].__setitem__((0, 0, 0), float("nan")), "non-finite means"),
        (lambda h, t: t["labels"].fill_(255), "labels outside"),
        (lambda h, t: t["faces"].__setitem__((0, 0), 10**9), "outside"),
        (lambda h, t: t["faces"].__setitem__((0, 0), -1), "outside"),
        (lambda h, t: t.update(normals=t["normals"][:-1]), "normals of shape"),
        (lambda h, t: t.update(means=t["means"][..., :-1], bases=t["bases"][..., :-1]), "order"),
    ],
)
def test_hostile_assets_are_refused(compressed, tmp_path, change, message):
    save(compressed, tmp_path / "a.prt")
    hostile(tmp_path / "a.prt", change)
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path / "a.prt")
    assert str(tmp_path / "a.prt") in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("bases_format", ["float32", "float16", "uint8"])
@pytest.mark.parametrize("weights_format", ["float16", "uint8"])
@pytest.mark.parametrize("signal", ["bumpy_transfer", "glossy"])
def test_few_bits_survive_the_file(request, signal, tmp_path, weights_format, bases_format):
    baked = request.getfixturevalue(signal)
    asset = compress(baked, clusters=5, components=3, weights_format=weights_format, bases_format=bases_format)
    size = save(asset, tmp_path / "a.prt")
    again = load(tmp_path / "a.prt")
    assert (again.weights_format, again.bases_format, again.nbytes) == (weights_format, bases_format, asset.nbytes)
    for name in ("means", "bases", "weights"):
        wanted = getattr(asset, name)
        assert float((getattr(again, name) - wanted).abs().max()) <= 2e-7 * float(wanted.abs().max())
    plain = save(compress(baked, clusters=5, components=3), tmp_path / "b.prt")
    assert size < plain
    if "uint8" in (weights_format, bases_format):
        name = "weights_steps" if weights_format == "uint8" else "bases_steps"
        hostile(tmp_path / "a.prt", lambda h, t: t.update({name: t[name][:-1]}))
        with pytest.raises(InputError, match=r"the ranges of .* do not belong"):
            load(tmp_path / "a.prt")


def test_other_files_are_refused(tmp_path):
    for name, content in {"a.prt": b"hello", "b.prt": b"\x80\x04pickle", "c.prt": b""}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match="damaged or not an asset"):
            load(tmp_path / name)
    safetensors.torch.save_file({"x": torch.zeros(1)}, tmp_path / "d.prt")
    with pytest.raises(InputError, match="no diffprt header"):
        load(tmp_path / "d.prt")
    with pytest.raises(InputError, match="does not exist"):
        load(tmp_path / "missing.prt")
    with pytest.raises(InputError, match="does not exist"):
        load(tmp_path)


def test_saving_where_it_cannot_be_leaves_nothing(bumpy_transfer, tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        save(bumpy_transfer, tmp_path / "no" / "such" / "a.prt")
    (tmp_path / "folder.prt").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        save(bumpy_transfer, tmp_path / "folder.prt")
    assert [p.name for p in tmp_path.iterdir()] == ["folder.prt"]
    with pytest.raises(InputError, match="a dict cannot be saved"):
        save({}, tmp_path / "a.prt")


def test_an_existing_asset_survives_a_failed_load(bumpy_transfer, tmp_path):
    save(bumpy_transfer, tmp_path / "a.prt")
    before = (tmp_path / "a.prt").read_bytes()
    assert isinstance(load(tmp_path / "a.prt"), Transfer)
    assert (tmp_path / "a.prt").read_bytes() == before
