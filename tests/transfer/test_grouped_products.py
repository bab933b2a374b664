"""Grouped products against loops."""

import torch

from diffprt.transfer.glossy.grouped_products import rows_times_matrices, sum_of_outer_products


def groups(random_counts=(0, 1, 2, 3, 5, 8, 0, 17)) -> torch.Tensor:
    index = torch.arange(len(random_counts)).repeat_interleave(torch.tensor(random_counts))
    return index[torch.randperm(len(index), generator=torch.Generator().manual_seed(0))]


def test_values(generator):
    group = groups()
    a = torch.randn(len(group), 4, dtype=torch.float64, generator=generator)
    b = torch.randn(len(group), 3, dtype=torch.float64, generator=generator)
    matrices = torch.randn(8, 4, 5, dtype=torch.float64, generator=generator)
    assert torch.allclose(rows_times_matrices(a, group, matrices), torch.einsum("na,nab->nb", a, matrices[group]))
    expected = torch.zeros(8, 4, 3, dtype=torch.float64).index_add(0, group, a[:, :, None] * b[:, None])
    assert torch.allclose(sum_of_outer_products(a, b, group, 8), expected)


def test_nothing_gives_zero():
    none = torch.zeros(0, dtype=torch.int64)
    assert rows_times_matrices(torch.zeros(0, 4), none, torch.zeros(2, 4, 5)).shape == (0, 5)
    assert torch.equal(sum_of_outer_products(torch.zeros(0, 4), torch.zeros(0, 3), none, 2), torch.zeros(2, 4, 3))


def test_gradients(generator):
    group = groups((1, 3, 2))
    a, b, matrices = (
        torch.randn(*shape, dtype=torch.float64, generator=generator, requires_grad=True)
        for shape in ((6, 2), (6, 3), (3, 2, 3))
    )
    assert torch.autograd.gradcheck(lambda x, m: rows_times_matrices(x, group, m), (a, matrices))
    assert torch.autograd.gradcheck(lambda x, y: sum_of_outer_products(x, y, group, 3), (a, b))
