"""The expected image error: a quadratic form that equals what rendering measures."""

import torch
from scipy.sparse import csr_matrix

from diffprt.compression import light_prior
from diffprt.compression.clusters.components import blend
from diffprt.optimization import ImageNorm, TransferLoss, random_cameras, random_rotations
from diffprt.rendering import FrozenView, pixel_radiance
from diffprt.scene import Light


def test_the_norm_is_the_energy_of_pictures(bumpy_transfer):
    cameras = random_cameras(bumpy_transfer.receivers, 3, width=40, height=30)
    norm = ImageNorm.of(bumpy_transfer.receivers, cameras)
    views = [FrozenView.of(bumpy_transfer.receivers, camera) for camera in cameras]
    generator = torch.Generator().manual_seed(1)
    ratios = []
    for _ in range(3):
        values = torch.randn(len(bumpy_transfer.receivers), 2, generator=generator, dtype=torch.float64)
        drawn = sum(float(view.pixels(values[view.seen]).square().sum()) for view in views)
        # The unseen count a hundredth of the mean beside what is drawn.
        ratios.append((float(norm.squared(values)) - 0.01 * float(values.square().sum())) / drawn)
    assert max(ratios) / min(ratios) - 1 < 1e-6


def test_the_expected_error_is_the_mean_over_lights_turned_at_random(bumpy_transfer, small):
    camera = random_cameras(bumpy_transfer.receivers, 1, width=48, height=48, seed=2)[0]
    view = FrozenView.of(bumpy_transfer.receivers, camera)
    light = Light(torch.randn(16, 1, generator=torch.Generator().manual_seed(4)).expand(16, 3).contiguous())
    loss = TransferLoss(
        bumpy_transfer, ImageNorm.of(bumpy_transfer.receivers, [camera]), light_prior([light.coefficients])
    )
    error = energy = 0.0
    for turn in random_rotations(600, seed=5):
        turned = light.rotate(turn.float())
        truth = pixel_radiance(bumpy_transfer, turned, view)
        error += float((pixel_radiance(small, turned, view) - truth).square().sum())
        energy += float(truth.square().sum())
    # 600 turns leave about 3 % of noise, receivers out of sight 1 %.
    assert abs(float(loss(small)) / (error / energy) - 1) < 0.1


def test_the_gradient_of_the_norm(generator):
    matrix = torch.randn(7, 7, generator=generator, dtype=torch.float64)
    norm = ImageNorm.from_matrix(csr_matrix((matrix @ matrix.T).numpy()))
    values = torch.randn(7, 3, generator=generator, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(norm.squared, (values,))
    dense = (matrix @ matrix.T).float().double()
    assert torch.allclose(norm.squared(values), (values * (dense @ values)).sum())


def test_decoding_is_the_blend_of_each_cluster(small, generator):
    spread = torch.einsum("vp,vpck->vck", small.weights, small.bases[small.labels])
    assert torch.allclose(small.decode().diffuse, small.means[small.labels] + spread, atol=1e-6)
    labels = torch.tensor([2, 0, 2, 2, 0])
    weights = torch.randn(5, 2, generator=generator, dtype=torch.float64, requires_grad=True)
    for numbers in (4, 12):
        means = torch.randn(3, numbers, generator=generator, dtype=torch.float64, requires_grad=True)
        bases = torch.randn(3, 2, numbers, generator=generator, dtype=torch.float64, requires_grad=True)
        assert torch.autograd.gradcheck(lambda *leaves: blend(labels, *leaves), (weights, means, bases))
        assert torch.autograd.gradgradcheck(lambda *leaves: blend(labels, *leaves), (weights, means, bases))
