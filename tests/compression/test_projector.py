"""Principal projection: the best subspace, with gradients that survive ties (hard case 16)."""

import pytest
import torch
from tolerances import FLOAT32, FLOAT64

from diffprt.compression import cluster_pca, principal_projection
from diffprt.errors import InputError
from diffprt.scene import builtin_scene
from diffprt.transfer.diffuse.direct import open_transfer


@pytest.mark.parametrize("components", [0, 1, 3, 7, 9])
def test_projection_is_that_of_cluster_pca(components, generator):
    vectors = torch.randn(30, 7, generator=generator, dtype=torch.float64)
    kept = min(components, 7)
    means, bases, weights = cluster_pca(vectors, torch.zeros(30, dtype=torch.int64), 1, kept)
    assert torch.allclose(
        principal_projection(vectors, components), means[0] + weights @ bases[0], atol=FLOAT64["twin"]
    )


def test_gradients_pass_gradcheck(generator):
    vectors = torch.randn(9, 5, generator=generator, dtype=torch.float64, requires_grad=True)
    members = torch.rand(9, generator=generator, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v, w: principal_projection(v, 2, members=w), (vectors, members))


def test_ties_on_one_side_of_the_cut_do_not_matter():
    """Variances 4, 4, 1, 1: two components are a projector with a derivative, though no eigenvector has one."""
    axes = torch.eye(4, dtype=torch.float64) * torch.tensor([2.0, 2, 1, 1])
    vectors = torch.cat([axes, -axes]).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: principal_projection(v, 2), vectors)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("components", range(10))
def test_gradients_of_a_sphere_are_finite(components, dtype):
    """Hard case 16: eigenvalues threefold, fivefold, ninefold, cut anywhere."""
    normals = builtin_scene("sphere", subdivisions=3).meshes[0].normals
    vectors = open_transfer(normals, 3).to(dtype).requires_grad_()
    loss = (principal_projection(vectors, components) - vectors).square().sum()
    loss.backward()
    assert bool(torch.isfinite(vectors.grad).all())
    frozen = vectors.detach() - principal_projection(vectors.detach(), components)
    # the best subspace does not move to first order, so it may as well be frozen
    # in float32, rounding over the smallest gap that is divided by is 3e-4 of the largest gradient
    assert torch.allclose(vectors.grad, 2 * frozen, atol=2e-3 if dtype == torch.float32 else 1e-7)


@pytest.mark.parametrize("vectors", [torch.ones(6, 4), torch.zeros(6, 4), torch.ones(1, 4)])
def test_identical_vectors_are_reproduced_with_finite_gradients(vectors):
    """Hard case 17."""
    vectors = vectors.clone().requires_grad_()
    projected = principal_projection(vectors, 2)
    assert torch.allclose(projected, vectors, atol=FLOAT32["rounding"])
    projected.square().sum().backward()
    assert bool(torch.isfinite(vectors.grad).all())


def test_bad_options_are_named():
    with pytest.raises(InputError, match="components is -1"):
        principal_projection(torch.rand(3, 2), -1)
    with pytest.raises(InputError, match="members weigh nothing"):
        principal_projection(torch.rand(3, 2), 1, members=torch.zeros(3))
