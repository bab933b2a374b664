"""The file: what is in it, what the report says of it, and what cannot be exported."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest
import torch

from diffprt.compression import ClusteredTransfer
from diffprt.errors import InputError
from diffprt.exporters import export, pack
from diffprt.surface import Receivers
from diffprt.transfer import Transfer

SOURCES = files("diffprt.exporters.web") / "page"


def manifest_of(page: str) -> dict:
    return json.loads(re.search(r'id="manifest">(.*?)</script>', page, re.DOTALL)[1])


def test_report_accounts_for_every_byte(clustered, tmp_path) -> None:
    report = export(clustered, tmp_path / "new" / "folder")
    path = tmp_path / "new" / "folder" / "index.html"
    assert report["path"] == str(path)
    assert report["bytes"] == path.stat().st_size == sum(report["parts"].values())
    signal = sum(array.nbytes for array in pack(clustered).signal.values())
    assert 200 < report["parts"]["signal"] < 0.6 * signal * 4 / 3
    assert 200 < report["parts"]["geometry"] < 0.4 * sum(a.nbytes for a in pack(clustered).geometry.values()) * 4 / 3
    assert report["left_out"] == []
    assert report["parts"]["page"] < 150_000
    assert [entry.name for entry in path.parent.iterdir()] == ["index.html"], "a temporary file was left"


def test_same_asset_gives_same_bytes_and_replaces_the_old_page(clustered, tmp_path) -> None:
    first = Path(export(clustered, tmp_path)["path"]).read_bytes()
    assert Path(export(clustered, tmp_path)["path"]).read_bytes() == first
    assert Path(export(clustered, tmp_path, title="x")["path"]).read_bytes() != first


def test_every_source_is_in_the_page_and_nothing_is_outside(clustered, plain, tmp_path) -> None:
    pages = [Path(export(asset, tmp_path)["path"]).read_text() for asset in (clustered, plain)]
    sources = list(SOURCES.iterdir())
    assert len(sources) > 15
    for source in sources:
        # Whatever its imports and includes became, its first comment or rule is there.
        first = next(line for line in source.read_text().splitlines() if line and not line.startswith("#version"))
        assert any(first in page for page in pages), source.name
    for page in pages:
        assert not re.search(r"https?://|#include|\{\{|^import |^export ", page, re.MULTILINE)
        assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", page)


def test_text_from_outside_cannot_leave_its_place(clustered, synthetic, tmp_path) -> None:
    hostile = '</script><img src=x onerror="alert(1)"> {{script}}'
    light = synthetic.random_light(clustered.order, 1)
    page = Path(export(clustered, tmp_path, title=hostile, lights={hostile: light})["path"]).read_text()
    assert "<img src=x" not in page
    manifest = manifest_of(page)
    assert manifest["title"] == hostile
    assert manifest["lights"][0]["name"] == hostile
    assert manifest["certificate"]["note"] == "a </script> & a NaN"
    assert torch.equal(torch.tensor(manifest["lights"][0]["coefficients"]).view(-1, 3), light.coefficients)


def test_signals_under_training_and_in_double_precision_export(plain, tmp_path) -> None:
    double = plain.with_signal(plain.diffuse.double().requires_grad_())
    export(double, tmp_path / "a")
    export(plain, tmp_path / "b")
    assert (tmp_path / "a" / "index.html").read_bytes() == (tmp_path / "b" / "index.html").read_bytes()


def test_uniform_albedo_is_stored_once(plain, tmp_path) -> None:
    grey = replace(plain.receivers, albedo=torch.full_like(plain.receivers.albedo, 0.5))
    page = Path(export(replace(plain, receivers=grey), tmp_path)["path"]).read_text()
    assert manifest_of(page)["arrays"]["albedo"]["rows"] == 1


@pytest.mark.parametrize(("clusters", "dtype"), [(256, "uint8"), (257, "uint16"), (65537, "uint32")])
def test_labels_take_the_least_room(clusters, dtype, plain) -> None:
    count = len(plain.receivers)
    labels = torch.arange(count) * (clusters - 1) // (count - 1)
    signal = torch.zeros(clusters, 1, 1)
    asset = ClusteredTransfer(labels, signal, signal[:, None], torch.zeros(count, 1), plain.receivers)
    packed = pack(asset).signal["labels"]
    assert packed.dtype == dtype
    assert packed.tolist() == labels.tolist()


def test_mistakes_are_told_in_one_line(plain, synthetic, tmp_path) -> None:
    occupied = tmp_path / "file"
    occupied.write_text("")
    taken = tmp_path / "taken" / "index.html"
    taken.mkdir(parents=True)
    (taken / "inside").write_text("")
    bare = Transfer(plain.diffuse[:2], Receivers.points(torch.rand(2, 3), torch.rand(2, 3)))
    wrong = {"a": synthetic.random_light(6, 1)}
    cases = [
        (plain, occupied, {}, "cannot be made"),
        (plain, taken.parent, {}, "cannot be written"),
        (bare, tmp_path, {}, "no faces"),
        (plain, tmp_path, {"lights": wrong}, "transfer has 16 SH coefficients, light has 36"),
        (plain, tmp_path, {"lights": {}}, "lights are empty"),
        (plain, tmp_path, {"curve": "filmic"}, "linear, reinhard, aces"),
        (plain, tmp_path, {"exposure": 0.0}, "positive"),
        (torch.zeros(3), tmp_path, {}, "give a Transfer or ClusteredTransfer"),
    ]
    for asset, directory, options, words in cases:
        with pytest.raises(InputError, match=words) as caught:
            export(asset, directory, **options)
        assert "\n" not in str(caught.value)
    assert not list(tmp_path.rglob(".index*")), "a temporary file was left"
