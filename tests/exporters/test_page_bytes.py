"""`export(bytes=)`: the page keeps the budget, uses it, and says what it left out."""

import re

import pytest

from diffprt.cli import main
from diffprt.compression import compress
from diffprt.errors import InputError
from diffprt.exporters import export
from diffprt.representation.files import save


@pytest.fixture(scope="module")
def clustered(bumpy_transfer):
    return compress(bumpy_transfer, clusters=12, components=20, method="lbg", iterations=8)


def test_components_are_left_out_to_fit(clustered, bumpy_transfer, tmp_path):
    whole = export(clustered, tmp_path)["bytes"]
    assert export(clustered, tmp_path, bytes=whole)["left_out"] == []
    for size in (whole - 1, whole - 15_000):
        report = export(clustered, tmp_path, bytes=size)
        assert size - 6_000 < (tmp_path / "index.html").stat().st_size == report["bytes"] <= size
        (left_out,) = report["left_out"]
        assert re.fullmatch(r"\d+ of 20 components: the signal moves by [\d.]+ %", left_out)
    report = export(clustered, tmp_path, bytes=whole, uncompressed=bumpy_transfer)
    assert report["bytes"] <= whole and any("uncompressed transfer" in text for text in report["left_out"])


def test_plain_transfer_is_compressed_on_the_way(bumpy_transfer, tmp_path):
    whole = export(bumpy_transfer, tmp_path)["bytes"]
    size = whole - 45_000
    report = export(bumpy_transfer, tmp_path, bytes=size)
    assert size - 8_000 < (tmp_path / "index.html").stat().st_size == report["bytes"] <= size
    assert re.search(r"compressed on the way to \d+ clusters x \d+ components, error [\d.]+ %", report["left_out"][0])


@pytest.mark.parametrize("made", ["clustered", "bumpy_transfer"])
def test_the_least_that_is_named_is_the_least(request, made, tmp_path):
    asset = request.getfixturevalue(made)
    with pytest.raises(InputError, match="bytes is 1000, the least page takes") as caught:
        export(asset, tmp_path / "page", bytes=1000)
    least = int(re.search(r"takes (\d+)", str(caught.value))[1])
    assert not (tmp_path / "page").exists()
    assert export(asset, tmp_path / "page", bytes=least)["bytes"] == least
    with pytest.raises(InputError, match=f"the least page takes {least}"):
        export(asset, tmp_path / "page", bytes=least - 1)


def test_the_command_says_what_sizes_are_of(clustered, tmp_path, capsys):
    save(clustered, tmp_path / "a.prt", geometry=16)
    with pytest.raises(SystemExit) as ended:
        main(["export", str(tmp_path / "a.prt"), "--bytes", "0.25MB", "-o", str(tmp_path / "page"), "--glb"])
    text = capsys.readouterr().out
    assert ended.value.code == 0 and (tmp_path / "page" / "index.html").stat().st_size <= 250_000
    assert re.search(r"index\.html: page [\d.]+ KB \(geometry [\d.]+ KB, signal [\d.]+ KB, viewer [\d.]+ KB\)", text)
    assert re.search(r"scene\.glb: file [\d.]+ KB", text)
