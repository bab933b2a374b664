"""Soft labels: from good labels to better ones, never to worse."""

import torch

from diffprt.compression import compress
from diffprt.optimization import ImageNorm, TransferLoss, optimize, random_cameras
from diffprt.optimization.soft_labels import relabeled, soft_labels


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
