"""Training: it lowers the error of pictures never seen, stops as it should, and resumes as if nothing had happened."""

import dataclasses
import re

import pytest
import torch

from diffprt.compression import compress
from diffprt.errors import InputError, Interrupted
from diffprt.optimization import (
    ImageNorm,
    Reference,
    References,
    TransferLoss,
    make_references,
    optimize,
    random_cameras,
    random_lights,
)
from diffprt.optimization.training import trainer as trainers
from diffprt.rendering import render
from diffprt.representation.files import load, save


def test_with_the_target_held_out_pictures_improve(bumpy_transfer, references, small):
    report: dict = {}
    better = optimize(small, references, target=bumpy_transfer, steps=60, report=report)
    errors = report["errors"]
    assert errors["improved"] and errors["after"] < 0.97 * errors["before"]
    assert type(better) is type(small) and torch.equal(better.labels, small.labels)
    assert better.certificate["optimized_image_relative"] == errors["after"]
    assert better.settings["optimize"]["seed"] == 0
    history = [entry["held_out"] for entry in report["history"]]
    assert min(history) == pytest.approx(errors["after"], rel=1e-4) and history[0] == pytest.approx(
        errors["before"], rel=1e-5
    )
    gram = better.bases.flatten(2) @ better.bases.flatten(2).transpose(1, 2)
    assert torch.allclose(gram, torch.eye(3).expand_as(gram), atol=1e-5)
    assert not better.means.requires_grad


def test_pictures_alone_teach_what_the_bake_never_saw(bumpy_transfer, lights, small):
    """References twice as bright: exposure finds the factor; means and bases reach it as well."""
    many = make_references(bumpy_transfer, lights, 64, width=20, height=16)
    bright = References(tuple(dataclasses.replace(e, image=2 * e.image) for e in many))
    report: dict = {}
    optimize(bumpy_transfer, bright, parameters=["exposure"], steps=120, learning_rate=0.3, report=report)
    assert report["exposure"] == pytest.approx(2.0, rel=1e-3)
    assert report["errors"]["after"] < 1e-3 < 0.4 < report["errors"]["before"]
    optimize(small, bright, steps=100, report=report)
    assert report["errors"]["after"] < 0.85 * report["errors"]["before"], "64 lights settle 3 x 16 coefficients"


@pytest.mark.parametrize(("name", "held_out"), [("albedo", 0.2), ("light", 0.3), ("diffuse", 0.0)])
def test_every_parameter_can_be_trained(bumpy_transfer, lights, name, held_out):
    """Held-out pictures are of other lights, or of other views where the one light is trained. Transfer without
    clusters learns only what it is shown."""
    receivers = bumpy_transfer.receivers
    cameras = random_cameras(receivers, 8, width=48, height=40)
    turned = random_lights(lights[:1], 8)
    shown = [lights[0] if name == "light" else light for light in turned]
    pairs = list(zip(cameras, shown, strict=True))
    made = [Reference(render(bumpy_transfer, light, camera), camera, light.coefficients) for camera, light in pairs]
    start = bumpy_transfer
    if name == "light":
        made = [dataclasses.replace(entry, light=turned[0].coefficients) for entry in made]
    else:
        albedo = (receivers.albedo * 0.7 + 0.1).contiguous()
        start = dataclasses.replace(start, receivers=dataclasses.replace(receivers, albedo=albedo))
    options = {"steps": 100, "learning_rate": 0.3, "held_out": held_out}
    report: dict = {}
    found = optimize(start, References(tuple(made)), parameters=[name], **options, report=report)
    assert report["errors"]["after"] < 0.5 * report["errors"]["before"]
    if name == "albedo":
        assert not torch.equal(found.receivers.albedo, albedo)
    if name == "light":
        assert torch.tensor(report["lights"]).shape == (1, 16, 3)


@pytest.mark.parametrize("loss", ["log", "display", "psnr", "ssim", "total-variation", "image + 0.1*ssim"])
def test_every_loss_has_gradients(references, small, loss):
    report: dict = {}
    dark = dataclasses.replace(small, means=0.7 * small.means)
    optimize(dark, references, loss=loss, steps=4, learning_rate=0.3, report=report)
    assert report["counts"]["steps"] == 4 and report["history"][-1]["held_out"] != report["history"][0]["held_out"]


def test_a_budget_is_kept_and_used(bumpy_transfer, references, small, tmp_path):
    size = save(small, tmp_path / "small.prt")
    report: dict = {}
    # Geometry as it is, so that as many components fit as the same signal bytes hold.
    fitted = optimize(small, references, target=bumpy_transfer, bytes=size, geometry=32, steps=20, report=report)
    assert 0.9 * size < save(fitted, tmp_path / "a.prt") <= size and fitted.receivers.bits == 32
    assert fitted.weights_format == "uint8" and fitted.components > small.components
    plain = compress(
        bumpy_transfer,
        clusters=6,
        components=fitted.components,
        method="lbg",
        weights_format="uint8",
        bases_format=fitted.bases_format,
    )
    assert plain.nbytes == fitted.nbytes
    cameras = random_cameras(bumpy_transfer.receivers, 12, seed=9)
    expected = TransferLoss(
        bumpy_transfer,
        ImageNorm.of(bumpy_transfer.receivers, cameras),
        torch.tensor(fitted.settings["optimize"]["prior"]),
    )
    assert float(expected(fitted)) < 0.97 * float(expected(plain)), "same clusters and components"
    save(fitted, tmp_path / "a.prt")
    assert torch.allclose(load(tmp_path / "a.prt").decode().diffuse, fitted.decode().diffuse, atol=1e-5)
    tight = optimize(small, references, target=bumpy_transfer, bytes=size // 2, steps=20, report=report)
    assert save(tight, tmp_path / "b.prt") <= size // 2
    assert report["errors"]["after"] <= report["errors"]["closed_form"]


def test_nothing_worse_is_returned(bumpy_transfer, references):
    report: dict = {}
    same = optimize(bumpy_transfer, references, steps=5, report=report)
    assert same is bumpy_transfer and not report["errors"]["improved"]
    assert "did not fall" in report["notes"][0]


def test_divergence_keeps_the_best_state(references, small, monkeypatch):
    monkeypatch.setattr(trainers, "_SMOOTHING", 0.0)
    report: dict = {}
    found = optimize(small, references, steps=200, learning_rate=1.0, batch=1, parameters=["light"], report=report)
    assert report["errors"]["ended"] == "diverged" and report["counts"]["steps"] < 200
    assert any("diverged" in note for note in report["notes"])
    assert report["errors"]["after"] <= report["errors"]["before"] and torch.isfinite(found.means).all()


@pytest.mark.parametrize("after", [1, 9])
def test_interrupted_at_any_step_it_resumes_to_the_same_bits(
    bumpy_transfer, references, small, tmp_path, pressed, after
):
    options = {"target": bumpy_transfer, "loss": "transfer + 0.1*image", "steps": 16, "seed": 2}
    whole_report: dict = {}
    whole = optimize(small, references, **options, report=whole_report)
    path = tmp_path / "run"
    with pytest.raises(Interrupted, match=f"after {after} steps") as stopped:
        optimize(small, references, **options, checkpoint=path, track=pressed(after))
    assert "\n" not in str(stopped.value) and path.exists()
    with pytest.raises(InputError, match="exists"):
        optimize(small, references, **options, checkpoint=path)
    with pytest.raises(InputError, match="is of a run with another"):
        optimize(small, references, **(options | {"seed": 3}), checkpoint=path, resume=True)
    report: dict = {}
    found = optimize(small, references, **options, checkpoint=path, resume=True, report=report)
    for name in ("means", "bases", "weights"):
        assert torch.equal(getattr(found, name), getattr(whole, name)), name
    held = [[entry["held_out"] for entry in r["history"]] for r in (whole_report, report)]
    assert held[0] == held[1]
    assert path.exists(), "until the result is saved, nothing else holds it"


def test_seconds_and_tolerance_end_a_run(bumpy_transfer, references, small):
    report: dict = {}
    optimize(small, references, target=bumpy_transfer, seconds=0.5, report=report)
    assert report["errors"]["ended"] in ("seconds", "stalled") and report["timings"]["optimize"] < 5
    error = report["errors"]["before"]
    optimize(small, references, target=bumpy_transfer, tolerance=0.99 * error, report=report)
    assert report["errors"]["ended"] == "tolerance" and report["errors"]["after"] <= 0.99 * error


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"learning_rate": 1e3}, "learning_rate is 1000"),
        ({"learning_rate": float("nan")}, "learning_rate is nan"),
        ({"steps": 0}, "steps is 0"),
        ({"seconds": -1.0}, "seconds is -1"),
        ({"tolerance": 2.0}, "tolerance is 2"),
        ({"batch": 0}, "batch is 0"),
        ({"held_out": 1.0}, "held_out is 1"),
        ({"loss": "beauty"}, "loss 'beauty' is unknown"),
        ({"loss": "overdraw"}, "nothing that compares"),
        ({"loss": {"image": -1.0}}, "weight -1"),
        ({"loss": "transfer"}, "needs the uncompressed transfer"),
        ({"parameters": ["gloss"]}, "parameters are gloss"),
        ({"parameters": ["diffuse"]}, "has no diffuse"),
        ({"bytes": 10_000}, "give target"),
        ({"resume": True}, "give checkpoint"),
        ({"prior": torch.zeros(16)}, "not above 0"),
    ],
)
def test_bad_options_are_named(references, small, options, message):
    with pytest.raises(InputError, match=message) as found:
        optimize(small, references, **options)
    assert "\n" not in str(found.value)


def test_a_target_of_another_mesh_or_a_compressed_one_is_refused(bumpy_transfer, references, small):
    with pytest.raises(InputError, match="compressed"):
        optimize(small, references, target=small)
    other = bumpy_transfer.with_signal(bumpy_transfer.diffuse[:, :1])
    with pytest.raises(InputError, match="the target's signal"):
        optimize(small, references, target=other)
    with pytest.raises(InputError, match="one component of 6 clusters"):
        optimize(small, references, target=bumpy_transfer, bytes=1000)


@pytest.mark.parametrize("share", [0.75, 0.9, 1.5])
def test_the_written_file_keeps_the_bytes(bumpy_transfer, references, small, tmp_path, share):
    size = int(share * save(small, tmp_path / "small.prt"))
    report: dict = {}
    found = optimize(small, references, target=bumpy_transfer, bytes=size, steps=3, report=report)
    assert 0.93 * size < save(found, tmp_path / "a.prt") <= size
    assert found.receivers.bits == (16 if share < 1 else 32), "nothing is given up where the error is small already"
    assert ("geometry_displacement" in found.certificate) == (share < 1)
    assert report["dropped"] == ([] if found.openness is not None else ["openness", "bent_normals"])


def test_the_least_that_is_named_is_the_least(bumpy_transfer, references, small, tmp_path):
    run = {"target": bumpy_transfer, "steps": 2}
    with pytest.raises(InputError, match="bytes is 5000, the least file takes") as caught:
        optimize(small, references, bytes=5000, **run)
    least = int(re.search(r"takes (\d+)", str(caught.value))[1])
    assert least - 300 < save(optimize(small, references, bytes=least, **run), tmp_path / "a.prt") <= least
    with pytest.raises(InputError, match=f"the least file takes {least} "):
        optimize(small, references, bytes=least - 1, **run)


def test_geometry_in_sixteen_bits_on_request(references, small, tmp_path):
    found = optimize(small, references, geometry=16, steps=3)
    save(found, tmp_path / "a.prt")
    assert found.receivers.bits == load(tmp_path / "a.prt").receivers.bits == 16
    with pytest.raises(InputError, match="geometry is 24"):
        optimize(small, references, geometry=24, steps=3)
