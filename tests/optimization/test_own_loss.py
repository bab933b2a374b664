"""A function as loss: trained on, named in the report, told from another of its name when a run is resumed."""

import functools
import json

import pytest
import torch

from diffprt import load, save
from diffprt.errors import InputError, Interrupted
from diffprt.optimization import IMAGE_LOSSES, optimize


def squared(image, reference):
    return (image - reference).square().sum() / reference.square().sum()


def only_inside(image, reference, mask):
    assert mask.dtype == torch.bool and not bool(image[~mask].any()) and not bool(reference[~mask].any())
    return (image - reference)[mask].square().mean()


def exposed(image, reference, *, exposure):
    return ((image - reference) * exposure).abs().mean()


def by_place(a, b, seen, factor):
    return ((a - b) * factor)[seen].square().mean()


EXPOSED = {"parameters": ["exposure"], "steps": 8, "learning_rate": 0.3}


@pytest.fixture
def dark(small):
    """Too dark by nearly a third: one factor improves it."""
    return small.with_tensors(means=0.7 * small.means, bases=0.7 * small.bases)


OWN = {
    "two pictures": (squared, "squared"),
    "mask": (only_inside, "only_inside"),
    "exposure by name": (exposed, "exposed"),
    "by place": (by_place, "by_place"),
    "lambda": (lambda image, reference: (image - reference).abs().mean(), "<lambda>"),
    "module": (torch.nn.L1Loss(), "torch.nn.modules.loss.L1Loss"),
    "function of torch's": (torch.nn.functional.mse_loss, "torch.nn.functional.mse_loss"),
    "partial": (functools.partial(torch.nn.functional.huber_loss, delta=0.5), "torch.nn.functional.huber_loss"),
    "one of ours": (IMAGE_LOSSES["image"], "diffprt.optimization.losses.relative_squared"),
}


@pytest.mark.parametrize("case", OWN)
def test_it_is_trained_on_and_named_in_report_and_file(references, dark, tmp_path, case):
    function, name = OWN[case]
    report: dict = {}
    found = optimize(dark, references, loss=function, **EXPOSED, report=report)
    ((shown, weight),) = report["settings"]["loss"].items()
    assert shown.endswith(name) and weight == 1.0
    assert report["errors"]["improved"] and report["errors"]["after"] < 0.8 * report["errors"]["before"]
    json.dumps(report)
    save(found, tmp_path / "a.prt")
    assert load(tmp_path / "a.prt").settings["optimize"]["loss"] == report["settings"]["loss"]


def test_it_is_the_loss_of_that_arithmetic(references, dark):
    """Ours by name and ours as a function train to the same bits, a user's same formula to rounding."""
    reports = [{}, {}, {}]
    for loss, report in zip(("image", OWN["one of ours"][0], squared), reports, strict=True):
        optimize(dark, references, loss=loss, **EXPOSED, report=report)
    assert reports[0]["exposure"] == reports[1]["exposure"] == pytest.approx(reports[2]["exposure"], rel=1e-5)
    assert [entry["loss"] for entry in reports[0]["history"]] == [entry["loss"] for entry in reports[1]["history"]]


def test_functions_and_names_are_weighed_together(bumpy_transfer, references, small):
    report: dict = {}
    terms = {"transfer": 1.0, squared: 0.5, OWN["lambda"][0]: 0.1, (lambda a, b: (a - b).square().mean()): 2}
    optimize(small, references, target=bumpy_transfer, loss=terms, steps=2, report=report)
    assert list(report["settings"]["loss"].values()) == [1.0, 0.5, 0.1, 2]
    assert sum("<lambda>" in name for name in report["settings"]["loss"]) == 2


def test_a_loss_below_zero_does_not_diverge(references, small):
    report: dict = {}
    optimize(small, references, loss=lambda a, b: squared(a, b) - 5e-3, steps=10, report=report)
    assert report["errors"]["ended"] == "steps"


@pytest.mark.parametrize("kind", ["closure", "module"])
def test_a_checkpoint_of_another_function_of_the_name_is_refused(references, dark, tmp_path, pressed, kind):
    def made(factor):
        if kind == "module":
            return torch.nn.HuberLoss(delta=factor)
        return lambda image, reference: factor * squared(image, reference)

    path, whole, report = tmp_path / "run", {}, {}
    optimize(dark, references, loss=made(0.05), **EXPOSED, report=whole)
    with pytest.raises(Interrupted):
        optimize(dark, references, loss=made(0.05), **EXPOSED, checkpoint=path, track=pressed(3))
    with pytest.raises(InputError, match="another asset, references, loss or settings"):
        optimize(dark, references, loss=made(0.02), **EXPOSED, checkpoint=path, resume=True)
    optimize(dark, references, loss=made(0.05), **EXPOSED, checkpoint=path, resume=True, report=report)
    assert report["errors"] == whole["errors"] and report["exposure"] == whole["exposure"] > 1.1


@pytest.mark.parametrize(
    ("loss", "message"),
    [
        (lambda image: image.mean(), "takes image: write it as loss"),
        (lambda a, b, c, d, e: a.mean(), "takes a, b, c, d, e: write it"),
        (lambda a, b, *, scale: a.mean(), "takes a, b, scale"),
        (lambda a, b: 0.5, "gave a float: return a tensor"),
        (lambda a, b: (a - b).square(), r"of shape \(40, 48, 3\): return one number"),
        (lambda a, b: (a - b).detach().square().mean(), "has no gradient to the picture"),
        (torch.nn.L1Loss, "give names, such as"),
        (5, "loss is 5: give names"),
        ({squared: -1.0}, "squared' has weight -1"),
        ({squared: "much"}, "has weight much"),
        ({"squared": 1.0}, "loss 'squared' is unknown: use one of image.*or give a function"),
    ],
)
def test_what_is_no_loss_is_refused_in_one_line(references, small, loss, message):
    with pytest.raises(InputError, match=message) as caught:
        optimize(small, references, loss=loss, steps=2)
    assert "\n" not in str(caught.value)
