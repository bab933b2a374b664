"""A run that had improved when it was interrupted comes back to that state, whether or not it improves again."""

import math

import pytest
import torch
from safetensors.torch import load_file

from diffprt.errors import Interrupted
from diffprt.optimization import optimize


@pytest.fixture
def dark(small):
    """Too dark by nearly a third: a factor improves it, and overshoots at a high learning rate."""
    return small.with_tensors(means=0.7 * small.means, bases=0.7 * small.bases)


def held_out(report):
    return [entry["held_out"] for entry in report["history"]]


def interrupted(asset, references, path, after, pressed, **options):
    """What the checkpoint holds after some steps, and whether the run went on from one."""
    with pytest.raises(Interrupted, match=f"after {sum(after)} steps"):
        optimize(asset, references, **options, checkpoint=path, resume=path.exists(), track=pressed(after[-1]))
    return load_file(path)


def resumed(asset, references, path, **options):
    report: dict = {}
    return optimize(asset, references, **options, checkpoint=path, resume=True, report=report), report


@pytest.mark.parametrize("stops", [(6,), (5, 2)], ids=["once", "twice"])
def test_an_improvement_survives_though_nothing_improves_afterwards(dark, references, pressed, tmp_path, stops):
    options = {"parameters": ["exposure", "albedo"], "steps": 9, "learning_rate": 0.3}
    whole: dict = {}
    expected = optimize(dark, references, **options, report=whole)
    errors = held_out(whole)
    best = errors.index(min(errors))
    assert 0 < best < stops[0] and errors[best] < 0.7 * errors[0], "it had improved before it was interrupted"
    for number in range(len(stops)):
        kept = interrupted(dark, references, tmp_path / "run", stops[: number + 1], pressed, **options)
        assert not torch.equal(kept["best.exposure"], kept["leaf.exposure"]), "and had left the best state behind"
        assert not torch.equal(kept["best.albedo"], kept["leaf.albedo"])
    found, report = resumed(dark, references, tmp_path / "run", **options)
    assert held_out(report) == errors and report["errors"] == whole["errors"] and report["errors"]["improved"]
    assert report["exposure"] == whole["exposure"] == pytest.approx(math.exp(float(kept["best.exposure"])), rel=1e-6)
    assert torch.equal(found.receivers.albedo, expected.receivers.albedo)
    assert torch.equal(found.receivers.albedo, kept["best.albedo"].sigmoid())
    assert not torch.equal(found.receivers.albedo, dark.receivers.albedo)


def test_an_improvement_is_improved_on(bumpy_transfer, references, small, pressed, tmp_path):
    options = {"target": bumpy_transfer, "steps": 20, "learning_rate": 0.05}
    whole: dict = {}
    expected = optimize(small, references, **options, report=whole)
    errors = held_out(whole)
    assert min(errors[1:9]) < 0.999 * errors[0] and min(errors[9:]) < min(errors[:9]), "before, and again after"
    kept = interrupted(small, references, tmp_path / "run", (8,), pressed, **options)
    first = interrupted(small, references, tmp_path / "first", (1,), pressed, **options)
    assert not torch.equal(kept["best.means"], first["best.means"])
    found, report = resumed(small, references, tmp_path / "run", **options)
    assert held_out(report) == errors and report["errors"] == whole["errors"] and report["errors"]["improved"]
    for name in ("means", "bases", "weights"):
        assert torch.equal(getattr(found, name), getattr(expected, name)), name
    assert found.certificate == expected.certificate
