"""Overdraw, hard and expected, and the super-clusters that lower it."""

import itertools

import pytest
import torch

from diffprt.compression import (
    SELECTIONS,
    clusters_per_pass,
    draws,
    expected_error,
    expected_overdraw,
    overdraw,
    soft_assignment,
    super_clusters,
)
from diffprt.errors import InputError

FACES = torch.tensor([[0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 5]])


def strip(count: int) -> torch.Tensor:
    """Triangles of a strip of `count` vertices."""
    first = torch.arange(count - 2)
    return torch.stack([first, first + 1, first + 2], 1)


def test_triangles_are_drawn_once_per_label():
    labels = torch.tensor([0, 0, 0, 1, 2, 1])
    assert draws(labels, FACES).tolist() == [1, 2, 3, 2]
    assert overdraw(labels, FACES) == 2.0


def test_overdraw_needs_triangles():
    with pytest.raises(InputError, match="0 faces"):
        overdraw(torch.zeros(3, dtype=torch.int64), torch.zeros(0, 3, dtype=torch.int64))
    with pytest.raises(InputError, match="0 faces"):
        expected_overdraw(torch.ones(3, 1), torch.zeros(0, 3, dtype=torch.int64))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_expected_overdraw_of_hard_labels_is_equation_8(dtype, generator):
    labels = torch.randint(0, 4, (60,), generator=generator)
    faces = torch.randint(0, 60, (100, 3), generator=generator)
    hard = torch.nn.functional.one_hot(labels, 4).to(dtype)
    assert float(expected_overdraw(hard, faces)) == pytest.approx(overdraw(labels, faces), rel=1e-6)


def test_expected_overdraw_is_the_mean_over_all_labelings(generator):
    assignment = torch.rand(4, 3, generator=generator, dtype=torch.float64)
    assignment = assignment / assignment.sum(1, keepdim=True)
    faces = torch.tensor([[0, 1, 2], [1, 2, 3]])
    mean = 0.0
    for labels in itertools.product(range(3), repeat=4):
        chance = float(torch.stack([assignment[v, m] for v, m in enumerate(labels)]).prod())
        mean += chance * overdraw(torch.tensor(labels), faces)
    assert float(expected_overdraw(assignment, faces)) == pytest.approx(mean, rel=1e-12)


def test_soft_terms_pass_gradcheck(generator):
    errors = torch.rand(6, 4, generator=generator, dtype=torch.float64, requires_grad=True)

    def losses(errors):
        assignment = soft_assignment(errors, 0.3)
        return expected_overdraw(assignment, FACES), expected_error(assignment, errors)

    assert torch.autograd.gradcheck(losses, errors)


def test_cold_assignment_is_hard(generator):
    errors = torch.rand(50, 6, generator=generator)
    cold = soft_assignment(errors, 1e-6)
    assert torch.equal(cold.argmax(1), errors.argmin(1))
    assert float(cold.amax(1).min()) > 0.99
    with pytest.raises(InputError, match="temperature is 0"):
        soft_assignment(errors, 0)


def test_registers_of_the_thesis():
    """Section 4.1: 81 float4 registers for a glossy cluster of order 6 with 8 components, so 3 fit into 256."""
    assert clusters_per_pass(256, 8, outputs=36) == 3
    assert clusters_per_pass(81, 8, outputs=36) == 1
    assert clusters_per_pass(256, 8) == 113
    assert clusters_per_pass(256, 8, channels=3, outputs=36) == 1
    with pytest.raises(InputError, match="a register budget of 80 float4 holds no cluster, which needs 81"):
        clusters_per_pass(80, 8, outputs=36)


@pytest.mark.parametrize("selection", SELECTIONS)
@pytest.mark.parametrize("per_pass", [1, 2, 3, 5, 100])
def test_groups_fit_and_never_draw_more(selection, per_pass, generator):
    labels = torch.randint(0, 11, (200,), generator=generator).sort().values
    labels = torch.cat([torch.arange(11), labels])
    faces = strip(len(labels))
    found = super_clusters(labels, faces, per_pass, selection=selection)
    assert int(torch.bincount(found.groups).max()) <= per_pass
    assert found.passes == -(-11 // per_pass) == len(found.groups.unique())
    assert found.overdraw == overdraw(found.groups[labels], faces) <= overdraw(labels, faces)
    if per_pass == 1:
        assert found.overdraw == overdraw(labels, faces)
    if per_pass == 100:
        assert found.overdraw == 1.0


def test_search_finds_the_best_pairs_that_greedy_misses():
    """A chain of clusters, 0 - 1 - 2 - 3, most shared in the middle: greedy takes the middle and strands the ends."""
    labels = torch.tensor([0, 0, 1, 1, 2, 2, 3, 3])
    outer, middle = [[0, 1, 2]] * 5 + [[4, 5, 6]] * 5, [[2, 3, 4]] * 6
    faces = torch.tensor(outer + middle)
    labels = torch.cat([labels, torch.tensor([1, 1])])
    greedy = super_clusters(labels, faces, 2, selection="greedy")
    found = super_clusters(labels, faces, 2, selection="search")
    assert greedy.overdraw == 1 + 10 / 16
    assert found.overdraw == 1 + 6 / 16
    assert found.groups[0] == found.groups[1] and found.groups[2] == found.groups[3]


def test_search_is_near_the_best_of_all_groupings(generator):
    """Brute force over the 15 ways to pair six clusters, on random triangles."""
    for _ in range(10):
        labels = torch.cat([torch.arange(6), torch.randint(0, 6, (30,), generator=generator)])
        faces = torch.randint(0, 36, (40, 3), generator=generator)
        best = min(
            overdraw(torch.tensor(groups)[labels], faces)
            for groups in itertools.product(range(3), repeat=6)
            if sorted(groups) == [0, 0, 1, 1, 2, 2]
        )
        greedy = super_clusters(labels, faces, 2, selection="greedy").overdraw
        found = super_clusters(labels, faces, 2).overdraw
        assert best <= found <= greedy
        assert found - best <= 0.051


def test_super_cluster_options_are_named():
    labels = torch.tensor([0, 1, 2, 0, 1, 2])
    with pytest.raises(InputError, match="selection 'magic' is unknown"):
        super_clusters(labels, FACES, 2, selection="magic")
    with pytest.raises(InputError, match="per_pass is 0"):
        super_clusters(labels, FACES, 0)
