"""Soft labels: from good labels to better ones, never to worse."""

import pytest
import torch

from diffprt.compression import compress, soft_assignment
from diffprt.compression.methods.geometry_coherence import NearestMembers
from diffprt.compression.methods.starts import unit_box
from diffprt.errors import InputError
from diffprt.optimization import ImageNorm, TransferLoss, optimize, random_cameras
from diffprt.optimization.soft_labels import expected_distance, relabeled, soft_labels


def test_two_planes_that_cross_are_told_apart(generator):
    """Points on two lines through one point: means cannot separate them, subspaces can."""
    along = torch.randn(400, 1, generator=generator)
    first = torch.arange(400) % 2 == 0
    directions = torch.where(first[:, None], torch.tensor([[1.0, 0.2, 0.0]]), torch.tensor([[-0.2, 1.0, 0.0]]))
    rows = along * directions + 0.01 * torch.randn(400, 3, generator=generator)
    wrong = first.long()
    flipped = torch.rand(400, generator=generator) < 0.25
    wrong = torch.where(flipped, 1 - wrong, wrong)
    none = torch.zeros(0, 3, dtype=torch.int64)
    found = soft_labels(rows, wrong, none, torch.ones(400), components=1, steps=60)
    agree = float((found == first.long()).float().mean())
    assert max(agree, 1 - agree) > 0.9


def test_labels_improve_at_no_more_overdraw(bumpy_transfer, references):
    small = compress(bumpy_transfer, clusters=6, components=3, method="lbg")
    norm = ImageNorm.of(bumpy_transfer.receivers, random_cameras(bumpy_transfer.receivers, 12))
    loss = TransferLoss(bumpy_transfer, norm, torch.ones(16))
    found = relabeled(small, loss)
    assert float(loss(found)) < 0.95 * float(loss(small)) and found.overdraw() <= small.overdraw()
    again = relabeled(found, loss, overdraw=3.0)
    assert again.overdraw() < found.overdraw(), "a high price on overdraw lowers it"
    report: dict = {}
    names = ["means", "bases", "weights", "labels"]
    best = optimize(small, references, target=bumpy_transfer, parameters=names, steps=30, report=report)
    without: dict = {}
    optimize(small, references, target=bumpy_transfer, steps=30, report=without)
    assert not torch.equal(best.labels, small.labels) and best.overdraw() <= small.overdraw()
    assert report["errors"]["after"] < without["errors"]["after"]


def _away(asset) -> float:
    """Mean distance to the nearest other member of the own cluster in the unit box, by all pairs."""
    points = unit_box(asset.receivers.positions)
    pairs = torch.cdist(points, points).fill_diagonal_(torch.inf)
    return float(pairs.masked_fill(asset.labels[:, None] != asset.labels, torch.inf).amin(1).clamp_max(1).mean())


def test_gradients_of_coherence(generator):
    """Equation 9 over a soft assignment, from the errors on, against finite differences in float64."""
    places = NearestMembers.of(torch.rand(14, 3, generator=generator), width=0.2, neighbors=6, itself=False)
    errors = torch.rand(14, 3, generator=generator, dtype=torch.float64, requires_grad=True)
    alpha = 0.7

    def energy(errors: torch.Tensor) -> torch.Tensor:
        assignment = soft_assignment(errors, 0.5)
        return (assignment * errors).sum(1).mean() + alpha * expected_distance(assignment, places)

    assert torch.autograd.gradcheck(energy, errors)


def test_distance_of_hard_labels_is_that_to_the_nearest_other_member(generator):
    points = torch.rand(60, 3, generator=generator, dtype=torch.float64)
    labels = torch.arange(60) % 3
    places = NearestMembers.of(points, width=1e-3, neighbors=59, itself=False)
    found = expected_distance(torch.nn.functional.one_hot(labels, 3).double(), places)
    pairs = torch.cdist(points, points).fill_diagonal_(torch.inf)
    brute = pairs.masked_fill(labels[:, None] != labels, torch.inf).amin(1)
    assert abs(float(found - brute.mean())) < 5e-3


def test_a_weight_of_coherence_draws_members_together(bumpy_transfer):
    """The nearest other member comes nearer, at a lower sum of error and weighed distance than any labels before."""
    small = compress(bumpy_transfer, clusters=24, components=2, method="lbg")
    cameras = random_cameras(bumpy_transfer.receivers, 12)
    loss = TransferLoss(bumpy_transfer, ImageNorm.of(bumpy_transfer.receivers, cameras), torch.ones(16))
    before = float(loss(small))
    plain, near = relabeled(small, loss), relabeled(small, loss, coherence=20.0)
    sums = [float(loss(asset)) / before + 20.0 * _away(asset) for asset in (small, plain, near)]
    assert _away(near) < min(_away(small), _away(plain))
    assert sums[2] < min(sums[:2]) and near.overdraw() <= small.overdraw()


def test_coherence_is_a_loss_of_labels(bumpy_transfer, references, small):
    options = {"target": bumpy_transfer, "steps": 5, "loss": "transfer + 0.05*coherence"}
    with pytest.raises(InputError, match="loss 'coherence' is of labels, which are not trained"):
        optimize(small, references, **options)
    with pytest.raises(InputError, match="nothing that compares"):
        optimize(small, references, loss={"coherence": 1.0})
    names = ["means", "bases", "weights", "labels"]
    best = optimize(small, references, parameters=names, **options)
    assert best.settings["optimize"]["loss"] == {"transfer": 1.0, "coherence": 0.05}
    assert not torch.equal(best.labels, small.labels)
