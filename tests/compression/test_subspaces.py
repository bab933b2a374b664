"""Clusters around affine subspaces."""

import importlib
import itertools

import pytest
import torch
from tolerances import FLOAT32, FLOAT64

from diffprt.compression import Subspaces, cluster_pca, fit_subspaces, k_subspaces, lbg


def planted(generator, clusters=4, each=80, size=12, components=2, dtype=torch.float32):
    """Vectors in crossing planes through nearby points: means say little about which plane is whose."""
    planes = torch.linalg.qr(torch.randn(clusters, size, components, generator=generator, dtype=dtype))[0]
    labels = torch.arange(clusters).repeat_interleave(each)
    weights = 3 * torch.randn(clusters * each, components, generator=generator, dtype=dtype)
    offsets = 0.5 * torch.randn(clusters, size, generator=generator, dtype=dtype)
    return offsets[labels] + torch.einsum("vp,vdp->vd", weights, planes[labels]), labels


def total(vectors, labels, components):
    means, bases, weights = cluster_pca(vectors, labels, int(labels.max()) + 1, components)
    return float((vectors - means[labels] - torch.einsum("vp,vpd->vd", weights, bases[labels])).square().sum())


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-4), (torch.float64, 1e-12)])
@pytest.mark.parametrize("components", [0, 1, 3])
def test_residuals_are_squared_distances(components, dtype, tolerance, generator):
    """Twin: the difference itself, projected and subtracted."""
    vectors = torch.randn(40, 9, generator=generator, dtype=dtype)
    means = torch.randn(5, 9, generator=generator, dtype=dtype)
    bases = torch.linalg.qr(torch.randn(5, 9, components, generator=generator, dtype=dtype))[0].transpose(1, 2)
    away = vectors[:, None] - means
    inside = torch.einsum("vmd,mpd,mpe->vme", away, bases, bases)
    twin = (away - inside).square().sum(2)
    residuals = Subspaces(means, bases).residuals(vectors)
    assert torch.allclose(residuals, twin, atol=tolerance, rtol=tolerance)
    labels = torch.randint(0, 5, (40,), generator=generator)
    own = Subspaces(means, bases).own(vectors, labels)
    assert torch.allclose(own, twin.gather(1, labels[:, None])[:, 0], atol=tolerance, rtol=tolerance)


def test_residuals_pass_gradcheck(generator):
    inputs = [
        torch.randn(6, 5, generator=generator, dtype=torch.float64, requires_grad=True),
        torch.randn(3, 5, generator=generator, dtype=torch.float64, requires_grad=True),
        (0.3 * torch.randn(3, 2, 5, generator=generator, dtype=torch.float64)).requires_grad_(),
    ]
    assert torch.autograd.gradcheck(lambda v, m, b: Subspaces(m, b).residuals(v), inputs)


def test_iterated_fit_is_the_best_subspace(generator):
    vectors, labels = planted(generator, dtype=torch.float64)
    vectors = vectors + 0.1 * torch.randn(vectors.shape, generator=generator, dtype=torch.float64)
    fitted = fit_subspaces(vectors, labels, 4, 2, passes=20)
    means, bases, _ = cluster_pca(vectors, labels, 4, 2)
    assert torch.allclose(fitted.means, means, atol=FLOAT64["rounding"])
    projectors = [b.transpose(1, 2) @ b for b in (fitted.bases, bases)]
    assert torch.allclose(*projectors, atol=1e-9)


def test_fit_of_too_few_or_no_members_is_finite(generator):
    """Hard case 17: directions that members do not span are zero, an empty cluster is its mean 0."""
    vectors = torch.randn(3, 8, generator=generator)
    fitted = fit_subspaces(vectors, torch.zeros(3, dtype=torch.int64), 2, 5)
    assert bool(torch.isfinite(fitted.bases).all() and torch.isfinite(fitted.means).all())
    assert fitted.bases.norm(dim=2)[0].tolist() == pytest.approx([1, 1, 0, 0, 0], abs=1e-4)
    assert float(fitted.residuals(vectors)[:, 0].max()) < FLOAT32["twin"]


def test_planes_that_cross_are_told_apart(generator):
    """LBG cannot: their means are near each other. Subspaces find all of them from one of a few starts."""
    vectors, _ = planted(generator)
    starts = [lbg(vectors, 4, seed=seed).labels for seed in range(6)]
    errors = [total(vectors, k_subspaces(vectors, start, 2, tolerance=1e-6).labels, 2) for start in starts]
    before = [total(vectors, start, 2) for start in starts]
    assert all(after < 0.6 * start for after, start in zip(errors, before, strict=True))
    assert min(errors) < 0.1 * min(before)


def test_error_falls_with_every_round(generator):
    vectors = torch.randn(400, 10, generator=generator, dtype=torch.float64)
    start = lbg(vectors, 8).labels
    errors = [k_subspaces(vectors, start, 2, iterations=n, tolerance=0.0).error for n in range(1, 7)]
    assert all(later < earlier for earlier, later in itertools.pairwise(errors))


def test_blocks_are_runs_of_all_rows(generator, monkeypatch):
    vectors = torch.randn(100, 6, generator=generator)
    subspaces = Subspaces(torch.randn(7, 6, generator=generator), torch.zeros(7, 2, 6))
    monkeypatch.setattr(importlib.import_module("diffprt.compression.clusters.subspaces"), "_CELLS", 1)
    blocks = list(subspaces.blocks(vectors))
    assert len(blocks) == 7 and [rows.stop for rows, _ in blocks[:-1]] == [rows.start for rows, _ in blocks[1:]]
    whole = torch.cat([residual for _, residual in blocks])
    assert torch.allclose(whole, subspaces.residuals(vectors), atol=FLOAT32["twin"])
