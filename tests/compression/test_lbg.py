"""LBG: its starts, its end, and the coordinates that it works in."""

import itertools
import math

import pytest
import torch
from tolerances import FLOAT32

from diffprt.compression import STARTS, fit_subspaces, k_subspaces, lbg
from diffprt.compression.clusters.partition import canonical, member_means, nearest
from diffprt.compression.clusters.randomized_pca import principal_span
from diffprt.compression.methods.lbg import fill_empty
from diffprt.errors import InputError


def energy(vectors, labels):
    means = member_means(vectors, labels, int(labels.max()) + 1)
    return float((vectors - means[labels]).square().sum())


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_every_vector_ends_with_its_nearest_center(start, dtype, generator):
    vectors = torch.randn(600, 5, generator=generator, dtype=dtype)
    partition = lbg(vectors, 20, start=start, seed=2, iterations=100, tolerance=0.0)
    distance = torch.cdist(vectors, partition.centers, compute_mode="donot_use_mm_for_euclid_dist")
    assert torch.equal(distance.argmin(1), partition.labels)
    assert len(partition.centers) == 20 and int(torch.bincount(partition.labels).min()) > 0
    assert partition.energy == pytest.approx(float(distance.amin(1).square().sum()), rel=1e-5)


def test_energy_falls_with_every_round(generator):
    vectors = torch.randn(500, 8, generator=generator)
    energies = [lbg(vectors, 12, seed=3, iterations=n, tolerance=0.0).energy for n in range(1, 8)]
    assert all(later < earlier for earlier, later in itertools.pairwise(energies))


def test_converged_ratio_stops_it(generator):
    """Equation 5: rounds go on until the gain is a small share of the energy before."""
    vectors = torch.randn(500, 8, generator=generator)
    loose = lbg(vectors, 12, tolerance=0.05, iterations=100)
    tight = lbg(vectors, 12, tolerance=1e-6, iterations=100)
    assert 2 <= loose.iterations < tight.iterations < 100
    assert tight.energy < loose.energy


def test_hyper_box_start_leaves_no_cluster_empty(generator):
    """In many dimensions nearly every point of the box is far from all vectors: null cluster avoidance fills them."""
    vectors = torch.randn(400, 60, generator=generator)
    partition = lbg(vectors, 32, start="hyper-box", iterations=40)
    assert int(torch.bincount(partition.labels, minlength=32).min()) > 0
    assert partition.energy < 1.1 * lbg(vectors, 32, iterations=40).energy


def test_dividing_the_fullest_cluster_lowers_the_energy(generator):
    vectors = torch.randn(90, 4, generator=generator)
    labels = torch.cat([torch.zeros(60, dtype=torch.int64), torch.full((30,), 2)])
    divided = fill_empty(vectors, labels, 3)
    assert torch.equal(divided[60:], labels[60:]), "the smaller cluster is left alone"
    assert set(divided[:60].tolist()) == {0, 1}
    assert energy(vectors, divided) < energy(vectors, canonical(labels)[0])


def test_identical_vectors_cannot_be_divided():
    assert torch.equal(fill_empty(torch.ones(5, 3), torch.zeros(5, dtype=torch.int64), 4), torch.zeros(5).long())


@pytest.mark.parametrize("start", STARTS)
def test_no_more_clusters_than_distinct_vectors(start, generator):
    """Hard case 17."""
    distinct = torch.randn(5, 9, generator=generator)
    partition = lbg(distinct[torch.arange(60) % 5], 32, start=start)
    assert len(partition.centers) == 5
    assert partition.energy == pytest.approx(0.0, abs=1e-9)


def test_distances_by_products_are_distances(generator):
    vectors, centers = torch.randn(300, 40, generator=generator), torch.randn(17, 40, generator=generator)
    labels, squared = nearest(vectors, centers)
    distance = torch.cdist(vectors.double(), centers.double())
    assert torch.equal(labels, distance.argmin(1))
    assert torch.allclose(squared.double(), distance.amin(1).square(), rtol=FLOAT32["twin"])


def test_names_follow_the_first_member():
    labels, names = canonical(torch.tensor([7, 7, 2, 9, 2]))
    assert labels.tolist() == [0, 0, 1, 2, 1] and names.tolist() == [7, 2, 9]


def test_start_is_named():
    with pytest.raises(InputError, match="start 'middle' is unknown"):
        lbg(torch.rand(4, 2), 2, start="middle")


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_span_keeps_distances_up_to_what_it_leaves_out(dtype, generator):
    """Signals of 40 directions in 600 dimensions: coordinates are few, and distances stay."""
    falling = torch.tensor([1.0 / (1 + i) for i in range(40)], dtype=dtype)
    hidden = torch.randn(700, 40, generator=generator, dtype=dtype) * falling
    vectors = hidden @ torch.linalg.qr(torch.randn(600, 40, generator=generator, dtype=dtype))[0].T + 3
    span = principal_span(vectors, remainder=1e-3)
    assert span.coordinates.shape[1] < 40 and 0 <= span.remainder <= 1e-3
    centered = vectors - vectors.mean(0)
    left = (centered - span.coordinates @ span.axes).square().sum() / centered.square().sum()
    assert float(left) == pytest.approx(span.remainder, rel=1e-2, abs=1e-6)
    variances = span.coordinates.square().sum(0)
    assert bool((variances[1:] <= variances[:-1] * (1 + 1e-4)).all())
    values = torch.linalg.svdvals(centered).square()
    kept = float(values[: span.coordinates.shape[1]].sum() / values.sum())
    assert 1 - span.remainder == pytest.approx(kept, abs=1e-4), "no other directions would hold more"


def test_clusters_found_in_the_span_are_clusters_of_the_signals(generator):
    """The same start and rounds, of 700 dimensions and of the span: labels and the signals' own energy agree."""
    centers = torch.randn(16, 700, generator=generator)
    vectors = centers[torch.randint(0, 16, (2000,), generator=generator)]
    noise = torch.randn(2000, 30, generator=generator) @ torch.randn(30, 700, generator=generator)
    vectors = vectors + 0.15 * noise + 0.02 * torch.randn(2000, 700, generator=generator)
    span = principal_span(vectors, remainder=2e-3)
    assert span.coordinates.shape[1] < 64
    inside, whole = (lbg(rows, 16, seed=1).labels for rows in (span.coordinates, vectors))
    assert energy(vectors, inside) == pytest.approx(energy(vectors, whole), rel=5e-3)
    assert float((inside == whole).double().mean()) >= 0.98


def test_subspaces_found_in_the_span_are_subspaces_of_the_signals(generator):
    vectors = torch.randn(1500, 24, generator=generator) @ torch.randn(24, 500, generator=generator)
    vectors = vectors + 0.02 * torch.randn(1500, 500, generator=generator)
    start = lbg(vectors, 6).labels
    errors = []
    for rows in (principal_span(vectors).coordinates, vectors):
        labels = k_subspaces(rows, start, 4, iterations=12, tolerance=0.0).labels
        fitted = fit_subspaces(vectors, labels, 6, 4, passes=12)
        errors.append(float(fitted.own(vectors, labels).double().mean()))
    assert errors[0] == pytest.approx(errors[1], rel=5e-3)


def test_span_of_few_dimensions_is_the_signal_itself(generator):
    vectors = torch.randn(50, 36, generator=generator)
    span = principal_span(vectors)
    assert span.remainder == 0.0
    assert torch.equal(span.coordinates, vectors - vectors.mean(0))


def test_span_of_identical_vectors_is_finite():
    span = principal_span(torch.full((20, 400), math.pi))
    assert bool(torch.isfinite(span.coordinates).all()) and span.remainder == 0.0
