"""`diffprt render --reference-set` and `diffprt optimize`, as their users type them."""

import json
import random
import signal
from contextlib import contextmanager

import pytest
from command_line import run

from diffprt.cli.parsing import parse_bytes
from diffprt.compression import compress
from diffprt.errors import InputError
from diffprt.lock import lock_file, locked
from diffprt.optimization import load_references, optimize
from diffprt.representation.files import load, save


@pytest.fixture(scope="module")
def folder(tmp_path_factory, bumpy_transfer):
    """An asset, a compressed one and references."""
    place = tmp_path_factory.mktemp("optimize")
    save(bumpy_transfer, place / "whole.prt")
    save(compress(bumpy_transfer, clusters=6, components=3), place / "small.prt")
    options = ("--reference-set", 8, "--lights", "sky,studio", "--size", "40x32", "--seed", 3, "--samples", 1)
    assert run("render", place / "whole.prt", *options, "-o", place / "views") == 0
    return place


def test_a_reference_set_is_made(folder):
    found = load_references(folder / "views")
    assert len(found) == 8 and found.entries[0].image.shape == (32, 40, 3)
    assert len(list((folder / "views").glob("*.exr"))) == 8


def test_an_asset_is_optimized_with_a_report(folder, tmp_path, capsys):
    out, report = tmp_path / "better.prt", tmp_path / "report.json"
    given = ("--references", folder / "views", "--target", folder / "whole.prt", "--bytes", "40KB")
    assert run("optimize", folder / "small.prt", *given, "--steps", 20, "-o", out, "--json", report) == 0
    found = json.loads(report.read_text())
    assert found["command"] == "optimize" and found["timings"]["optimize"] > 0
    assert found["errors"]["after"] <= found["errors"]["before"] and len(found["history"]) > 5
    assert 35_000 < out.stat().st_size <= 40_000 and load(out).components > 3
    assert "held-out pictures" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) and not (tmp_path / "better.prt.checkpoint").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--learning-rate", 50), "learning_rate is 50"),
        (("--bytes", "lots"), "bytes is 'lots'"),
        (("--bytes", "20KB"), "give target"),
        (("--loss", "3*wonder"), "loss 'wonder' is unknown"),
        (("--parameters", "means,gloss"), "gloss"),
        (("-o", "better.txt"), "give a .prt file"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(folder, tmp_path, capsys, arguments, message):
    out = () if "-o" in arguments else ("-o", tmp_path / "out.prt")
    assert run("optimize", folder / "small.prt", "--references", folder / "views", *out, *arguments) == 2
    text = capsys.readouterr().err
    assert message in text and text.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_set_needs_a_folder_and_uncompressed_transfer(folder, tmp_path, capsys):
    assert run("render", folder / "whole.prt", "--reference-set", 2, "-o", tmp_path / "views.png") == 2
    assert "give a folder" in capsys.readouterr().err
    assert run("render", folder / "small.prt", "--reference-set", 2, "-o", tmp_path / "views") == 2
    assert "compressed" in capsys.readouterr().err


@pytest.mark.parametrize(("text", "count"), [("2MB", 2_000_000), ("1.5 kb", 1500), ("700", 700), ("3G", 3_000_000_000)])
def test_bytes_are_read(text, count):
    assert parse_bytes(text) == count


@pytest.mark.parametrize("text", ["", "MB", "-3", "2TB", "1..2MB", "0"])
def test_bad_bytes_are_named(text):
    with pytest.raises(InputError, match="give a size"):
        parse_bytes(text)


def test_a_harmed_checkpoint_is_refused_in_one_line(folder, tmp_path, capsys):
    """Hard case 45: whatever bit was flipped, and wherever it was cut; the file stays."""
    kept = tmp_path / "kept"
    asset, views = load(folder / "small.prt"), load_references(folder / "views")

    @contextmanager
    def stop(text, total, done=0):
        yield lambda: signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        optimize(asset, views, steps=3, checkpoint=kept, track=stop)
    whole, where = kept.read_bytes(), random.Random(0)
    given = ("--references", folder / "views", "--steps", 3, "--checkpoint", kept, "--resume", "-o", tmp_path / "o.prt")
    harmed = [whole[:size] for size in (0, 7, 100, len(whole) - 1)] + [whole + b" ", b"[" * 1000]
    for end in (60, 200, len(whole)):
        content = bytearray(whole)
        content[where.randrange(end)] ^= 1 << where.randrange(8)
        harmed.append(bytes(content))
    for content in harmed:
        kept.write_bytes(content)
        assert run("optimize", folder / "small.prt", *given) == 2
        said = capsys.readouterr().err
        assert f"checkpoint {kept} is damaged or not one: delete it" in said and said.count("\n") == 1
        assert kept.read_bytes() == content
    kept.write_bytes(whole)
    for held in (kept, tmp_path / "o.prt"):
        with locked(held, lock_file(held)):
            assert run("optimize", folder / "small.prt", *given) == 2
        assert f"{held} is being written by another run" in capsys.readouterr().err
    assert run("optimize", folder / "small.prt", *given) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["o.prt"]
