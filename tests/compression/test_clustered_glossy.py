"""Clustered glossy transfer: what compression keeps, its error and bytes, and gradients through decoding."""

import pytest
import torch

from diffprt.brdf import GGX
from diffprt.compression import (
    ClusteredGlossyTransfer,
    clusters_per_pass,
    compress,
    light_prior,
    overdraw,
    super_clusters,
)
from diffprt.errors import InputError
from diffprt.surface import Receivers
from diffprt.transfer import GlossyTransfer, bake_glossy

SHAPES = {1: (1, 9, 4), 3: (3, 9, 4)}  # C, K_out, K


@pytest.fixture(scope="module")
def baked(bumpy) -> GlossyTransfer:
    return bake_glossy(bumpy, GGX(0.4, specular=0.8), order=3, order_out=4, rays=64, bounces=0)


def points(count: int) -> Receivers:
    generator = torch.Generator().manual_seed(4)
    return Receivers.points(torch.rand(count, 3, generator=generator), torch.randn(count, 3, generator=generator))


def random_asset(channels: int, dtype: torch.dtype = torch.float64, components: int = 2) -> ClusteredGlossyTransfer:
    generator = torch.Generator().manual_seed(7)
    shape = SHAPES[channels]
    return ClusteredGlossyTransfer(
        torch.tensor([0, 2, 1, 0, 2, 2]),
        torch.randn(3, *shape, dtype=dtype, generator=generator),
        torch.randn(3, components, *shape, dtype=dtype, generator=generator),
        torch.randn(6, components, dtype=dtype, generator=generator),
        points(6),
    )


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("components", [0, 2])
def test_decoding_is_mean_plus_weighted_components(channels, components):
    """The plain twin: one receiver and component at a time."""
    asset = random_asset(channels, components=components)
    decoded = asset.decode()
    assert isinstance(decoded, GlossyTransfer) and (decoded.order, decoded.order_out) == (2, 3)
    assert (asset.order, asset.order_out, asset.channels) == (2, 3, channels)
    assert (asset.clusters, asset.components) == (3, components)
    assert torch.equal(asset.frames, decoded.frames)
    for v, m in enumerate(asset.labels.tolist()):
        expected = asset.means[m].clone()
        for p in range(components):
            expected += asset.weights[v, p] * asset.bases[m, p]
        assert torch.allclose(decoded.glossy[v], expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("channels", [1, 3])
def test_gradients_reach_means_bases_and_weights(channels):
    asset = random_asset(channels)
    parameters = [t.clone().requires_grad_() for t in (asset.means, asset.bases, asset.weights)]

    def decoded(*parameters):
        return ClusteredGlossyTransfer(asset.labels, *parameters, asset.receivers).decode().glossy

    assert torch.autograd.gradcheck(decoded, parameters)


@pytest.mark.parametrize("channels", [1, 3])
def test_signals_of_few_subspaces_are_kept_exactly(channels, generator):
    """Three affine subspaces of two directions: three clusters of two components leave nothing."""
    shape = SHAPES[channels]
    means = 20 * torch.randn(3, *shape, generator=generator)
    bases = torch.randn(3, 2, *shape, generator=generator)
    labels = torch.arange(60) % 3
    weights = torch.randn(60, 2, generator=generator)
    signal = means[labels] + torch.einsum("vp,vp...->v...", weights, bases[labels])
    compressed = compress(GlossyTransfer(signal, points(60)), clusters=3, components=2)
    assert isinstance(compressed, ClusteredGlossyTransfer) and compressed.channels == channels
    assert torch.equal(compressed.labels, labels)
    assert compressed.certificate["compression_relative"] < 1e-6
    assert torch.allclose(compressed.decode().glossy, signal, atol=1e-4)


def test_certificate_is_what_decoding_shows(baked):
    report: dict = {}
    compressed = compress(baked, clusters=12, components=4, report=report)
    squared = (compressed.decode().glossy - baked.glossy).double().square().sum((1, 2, 3))
    energy = float(baked.glossy.double().square().sum((1, 2, 3)).mean())
    certificate = compressed.certificate
    assert certificate["compression_squared_error"] == pytest.approx(float(squared.mean()), rel=1e-4)
    assert certificate["compression_relative"] == pytest.approx((float(squared.mean()) / energy) ** 0.5, rel=1e-4)
    assert certificate["compression_worst"] == pytest.approx((float(squared.max()) / energy) ** 0.5, rel=1e-4)
    assert 0 < certificate["compression_relative"] < 0.3
    assert certificate["noise_relative"] == baked.certificate["noise_relative"]
    assert compressed.settings["brdf"] == baked.settings["brdf"] and compressed.scene_hash == baked.scene_hash
    assert report["counts"]["bytes_before"] == baked.nbytes
    assert compressed.overdraw() == report["counts"]["overdraw"] == overdraw(compressed.labels, baked.receivers.faces)


@pytest.mark.parametrize(
    ("weights_format", "bases_format", "bits"),
    [("float32", "float32", (4, 4)), ("uint8", "float16", (1, 2)), ("float16", "uint8", (2, 1))],
)
def test_bytes_are_counted_exactly(baked, weights_format, bases_format, bits):
    compressed = compress(baked, clusters=8, components=3, weights_format=weights_format, bases_format=bases_format)
    count, size, clusters = len(baked.receivers), baked.glossy[0].numel(), compressed.clusters
    expected = count + bits[0] * count * 3 + bits[1] * clusters * 4 * size
    expected += 8 * clusters * 3 * (weights_format == "uint8") + 8 * clusters * 4 * (bases_format == "uint8")
    assert compressed.nbytes == expected < baked.nbytes / 3


def test_registers_count_every_exit_coefficient(baked):
    """A cluster takes K_out x (P + 1) x C / 4 of them."""
    report: dict = {}
    compressed = compress(baked, clusters=20, components=3, registers=64, report=report)
    per_pass = clusters_per_pass(64, 3, outputs=16)
    assert per_pass == 4
    grouped = super_clusters(compressed.labels, baked.receivers.faces, per_pass)
    assert report["counts"]["passes"] == grouped.passes == -(-compressed.clusters // 4)
    assert report["counts"]["overdraw_super_clusters"] == grouped.overdraw < report["counts"]["overdraw"]
    with pytest.raises(InputError, match="a register budget of 15 float4 holds no cluster, which needs 16"):
        compress(baked, clusters=20, components=3, registers=15)


def test_prior_weighs_what_lights_show(baked, generator):
    """Summed over lights that are one coefficient each, of the prior's power, the error of exit radiance is the
    weighted error; and clusters made for it have less of it."""
    bands = torch.tensor([0, 1, 1, 1, 2, 2, 2, 2, 2])
    prior = light_prior([torch.randn(9, 3, generator=generator) * 4.0 ** -bands[:, None] for _ in range(4)])
    report: dict = {}
    weighed = compress(baked, clusters=8, components=2, method="k-subspaces", prior=prior, report=report)
    plain = compress(baked, clusters=8, components=2, method="k-subspaces")

    def shown(asset: ClusteredGlossyTransfer) -> float:
        total = 0.0
        for k in range(9):
            light = torch.zeros(9, 3)
            light[k] = prior[k].sqrt()
            total += float((asset.exit_radiance(light) - baked.exit_radiance(light))[:, 0].square().sum(1).mean())
        return total

    assert shown(weighed) == pytest.approx(report["errors"]["compression_squared_error_weighted"], rel=1e-3)
    assert shown(weighed) < shown(plain)
    assert weighed.settings["compress"]["prior"] == pytest.approx(prior.tolist())


def test_one_seed_one_result(baked):
    one, two = (compress(baked, clusters=8, components=3, seed=3) for _ in range(2))
    for name in ("labels", "means", "bases", "weights"):
        assert torch.equal(getattr(one, name), getattr(two, name))


def test_identical_signals_need_one_cluster(generator):
    """Hard case 17."""
    signal = torch.randn(1, *SHAPES[3], generator=generator).expand(40, -1, -1, -1)
    report: dict = {}
    compressed = compress(GlossyTransfer(signal, points(40)), clusters=5, components=2, report=report)
    assert compressed.clusters == 1 and report["counts"]["clusters_dropped"] == 4
    assert compressed.certificate["compression_squared_error"] < 1e-10
    assert bool(torch.isfinite(compressed.decode().glossy).all())


def test_compressing_again_is_refused(baked):
    compressed = compress(baked, clusters=2, components=1)
    with pytest.raises(InputError, match="already compressed, to 2 clusters x 1 components"):
        compress(compressed)
    assert compress(compressed.decode(), clusters=2, components=1).certificate["compression_relative"] < 1e-5
    with pytest.raises(InputError, match="a Receivers cannot be compressed"):
        compress(baked.receivers)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"means": torch.zeros(3, 9, 4)}, r"means of shape \(3, 9, 4\).*give \[M, C, K_out, K\]"),
        ({"bases": torch.zeros(3, 2, 9, 4)}, r"bases of shape \(3, 2, 9, 4\).*\[M, P, C, K_out, K\]"),
        ({"bases": torch.zeros(2, 2, 1, 9, 4, dtype=torch.float64)}, r"bases of shape \(2, 2, 1, 9, 4\)"),
        ({"weights": torch.zeros(6, 3, dtype=torch.float64)}, r"weights of shape \(6, 3\): give \(6, 2\)"),
        ({"weights": torch.zeros(6, 2)}, "torch.float32, torch.float64: give one dtype"),
        ({"labels": torch.tensor([0, 1, 2, 3, 0, 0])}, r"labels outside 0\.\.2"),
        ({"labels": torch.tensor([0, 1, 2, -1, 0, 0])}, r"labels outside 0\.\.2"),
        ({"bases_format": "int4"}, "bases_format is 'int4'"),
    ],
)
def test_what_does_not_belong_together_is_named(change, message):
    asset = random_asset(1)
    parts = {name: getattr(asset, name) for name in ("labels", "means", "bases", "weights", "receivers")}
    with pytest.raises(InputError, match=message):
        ClusteredGlossyTransfer(**{**parts, **change})
    with pytest.raises(InputError, match="2 channels"):
        ClusteredGlossyTransfer(
            asset.labels,
            asset.means.expand(-1, 2, -1, -1),
            asset.bases.expand(-1, -1, 2, -1, -1),
            asset.weights,
            asset.receivers,
        )
    with pytest.raises(InputError, match="order"):
        ClusteredGlossyTransfer(
            asset.labels, asset.means[:, :, :-1], asset.bases[:, :, :, :-1], asset.weights, asset.receivers
        )
