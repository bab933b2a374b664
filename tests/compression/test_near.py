"""Errors in near clusters: those of all clusters where it matters."""

import importlib

import pytest
import torch
from tolerances import FLOAT32

from diffprt.compression import Subspaces, fit_subspaces, lbg
from diffprt.compression.clusters.near import NearErrors, near_clusters
from diffprt.compression.overdraw.corners import Corners


@pytest.fixture
def clustered(generator):
    """600 vectors around 48 places, and the planes that fit them."""
    centers = 3 * torch.randn(48, 10, generator=generator)
    labels = torch.randint(0, 48, (600,), generator=generator)
    vectors = centers[labels] + torch.randn(600, 10, generator=generator)
    labels = lbg(vectors, 48).labels
    return vectors, labels, fit_subspaces(vectors, labels, 48, 2)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-4), (torch.float64, 1e-12)])
def test_errors_are_residuals(clustered, dtype, tolerance):
    """Twin: residuals to all subspaces, gathered."""
    vectors, labels, subspaces = clustered
    vectors, subspaces = vectors.to(dtype), Subspaces(subspaces.means.to(dtype), subspaces.bases.to(dtype))
    near = near_clusters(subspaces, vectors, labels)
    found = NearErrors.of(subspaces, vectors, labels, near)
    twin = subspaces.residuals(vectors)
    assert torch.allclose(found.errors, twin.gather(1, near[labels]), atol=tolerance, rtol=tolerance)
    dense = found.of_all(torch.arange(5))
    finite = torch.isfinite(dense)
    assert finite.sum(1).tolist() == [near.shape[1]] * 5
    assert torch.allclose(dense[finite], twin[:5][finite], atol=tolerance, rtol=tolerance)


def test_the_nearest_of_all_is_among_the_near(clustered, monkeypatch):
    """With 16 of 48 clusters asked, nearly all vectors find the best of all, and the others one hardly worse."""
    vectors, labels, subspaces = clustered
    monkeypatch.setattr(importlib.import_module("diffprt.compression.clusters.near"), "_NEAR", 16)
    chosen, errors = NearErrors.of(subspaces, vectors, labels, near_clusters(subspaces, vectors, labels)).nearest()
    best = subspaces.residuals(vectors).min(1)
    assert float((chosen == best.indices).double().mean()) > 0.97
    assert float(errors.mean()) < 1.01 * float(best.values.mean())


def test_few_clusters_are_all_near(clustered):
    vectors, _, _ = clustered
    labels = lbg(vectors, 6).labels
    subspaces = fit_subspaces(vectors, labels, 6, 2)
    near = near_clusters(subspaces, vectors, labels)
    assert torch.equal(near, torch.arange(6).expand(6, 6))
    chosen, errors = NearErrors.of(subspaces, vectors, labels, near).nearest()
    best = subspaces.residuals(vectors).min(1)
    assert torch.equal(chosen, best.indices) and torch.allclose(errors, best.values, atol=1e-4)


def test_what_shares_a_triangle_is_near(clustered, generator):
    """However far the signal; and each cluster is near itself."""
    vectors, labels, subspaces = clustered
    faces = torch.randint(0, 600, (60, 3), generator=generator)
    near = near_clusters(subspaces, vectors, labels, Corners.of(faces, 600))
    for face in labels[faces].tolist():
        assert all(other in near[own].tolist() for own in face for other in face)
    assert all(own in row for own, row in enumerate(near.tolist()))


def test_of_some_units_only(clustered):
    vectors, labels, subspaces = clustered
    near = near_clusters(subspaces, vectors, labels)
    units = torch.tensor([3, 40, 41])
    some, every = (NearErrors.of(subspaces, vectors, labels, near, asked).errors for asked in (units, None))
    assert torch.allclose(some[units], every[units], atol=FLOAT32["twin"])
    assert int(torch.isfinite(some).any(1).sum()) == 3


def test_near_is_the_same_in_blocks(clustered, monkeypatch):
    vectors, labels, subspaces = clustered
    whole = near_clusters(subspaces, vectors, labels).sort(1).values
    monkeypatch.setattr(importlib.import_module("diffprt.compression.clusters.near"), "_CELLS", 1)
    assert torch.equal(near_clusters(subspaces, vectors, labels).sort(1).values, whole)


def test_empty_clusters_are_finite():
    """Hard case 17: clusters without members ask for nothing."""
    vectors, labels = torch.eye(4), torch.zeros(4, dtype=torch.int64)
    subspaces = fit_subspaces(vectors, labels, 40, 2)
    chosen, errors = NearErrors.of(subspaces, vectors, labels, near_clusters(subspaces, vectors, labels)).nearest()
    assert bool(torch.isfinite(errors).all()) and bool((chosen >= 0).all())
