"""Eight bits with levels lent between components: closer than plain rounding, and stored as they are."""

import pytest
import torch

from diffprt.compression import cluster_pca, rounded
from diffprt.optimization.lattice import fine_weights, tilt


def blend(means, bases, weights, labels):
    return means[labels] + torch.einsum("vp,vpd->vd", weights, bases[labels])


@pytest.mark.parametrize("components", [1, 2, 5, 8])
def test_rounding_costs_less_with_lent_levels(components, generator):
    scale = 0.3 ** torch.arange(8)
    rows = torch.randn(900, 8, generator=generator) * scale + 1
    labels = torch.arange(900) % 3
    means, bases, weights = cluster_pca(rows, labels, 3, components)
    ideal = blend(means, bases, weights, labels)
    plain = blend(means, bases, rounded(weights, "uint8", ranges=labels), labels)
    tilted, pairs = tilt(bases, weights, labels)
    fine = fine_weights(rows, means, tilted, labels, pairs)
    found = blend(means, tilted, fine, labels)
    error, before = (float((x - ideal).square().sum()) for x in (found, plain))
    assert error <= before * 1.0001
    if components >= 5:
        assert error < before / 20, "steps differ by 0.3^4 and more, their product is what counts"
    assert torch.allclose(rounded(fine, "uint8", ranges=labels), fine, rtol=1e-5, atol=1e-6)


def test_predicted_error_of_one_pair(generator):
    wide, narrow = torch.rand(20000, 2, generator=generator).T
    rows = torch.stack([wide, narrow / 100], dim=1)
    labels = torch.zeros(20000, dtype=torch.int64)
    means, bases, weights = torch.zeros(1, 2), torch.eye(2)[None], rows.clone()
    tilted, pairs = tilt(bases, weights, labels)
    assert abs(float(pairs.neighbors[0, 0]) - 10) < 0.01
    error = blend(means, tilted, fine_weights(rows, means, tilted, labels, pairs), labels) - rows
    # s_i s_j / 12 each; the wide one's range grows by a tenth. At the ends of the narrow range half of the levels to
    # choose from are missing, for 8 % of these evenly spread values: their errors are up to twice as large.
    expected = 2 * (1.1 / 255) * (0.01 / 255) / 12
    assert 0.9 < float(error.square().sum(1).mean()) / expected < 1.6
    plain = (rows - rounded(rows, "uint8", ranges=labels)).square().sum(1).mean()
    assert float(error.square().sum(1).mean()) < float(plain) / 25


def test_constant_and_single_members_divide_by_nothing():
    rows = torch.tensor([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [5.0, 5.0, 5.0]])
    labels = torch.tensor([0, 0, 1])
    means, bases, weights = cluster_pca(rows, labels, 2, 2)
    tilted, pairs = tilt(bases, weights, labels)
    found = blend(means, tilted, fine_weights(rows, means, tilted, labels, pairs), labels)
    assert torch.allclose(found, rows)
