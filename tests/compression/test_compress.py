"""Clustered PCA: hard cases 16 to 19, and the plain method's own laws."""

import math

import pytest
import torch
from tolerances import FLOAT64

from diffprt.compression import ClusteredTransfer, cluster_pca, compress, lbg
from diffprt.errors import InputError
from diffprt.scene import builtin_scene
from diffprt.shading import shade
from diffprt.surface import Receivers
from diffprt.transfer import Transfer
from diffprt.transfer.diffuse.direct import open_transfer


def transfer_of(vectors: torch.Tensor, channels: int = 1) -> Transfer:
    """A transfer whose signal is `vectors` [V, C K], at arbitrary receivers."""
    points = torch.rand(len(vectors), 3, generator=torch.Generator().manual_seed(3))
    receivers = Receivers.points(points, torch.tensor([[0.0, 0.0, 1.0]]).expand(len(vectors), 3), 0.5)
    return Transfer(vectors.reshape(len(vectors), channels, -1), receivers)


@pytest.fixture(scope="module")
def sphere() -> Transfer:
    mesh = builtin_scene("sphere", subdivisions=5).meshes[0]
    signal = open_transfer(mesh.normals, 3).float()[:, None]
    return Transfer(signal, Receivers(mesh.positions, mesh.normals, torch.full_like(mesh.positions, 0.5), mesh.faces))


def test_eigenvalues_of_an_unoccluded_sphere(sphere):
    """Hard case 16: 0.349066 three times, 0.0490874 five times."""
    vectors = sphere.diffuse.reshape(len(sphere.receivers), -1).double()
    values = torch.linalg.eigvalsh(torch.cov(vectors.T, correction=0)).flip(0)
    assert values[:3].tolist() == pytest.approx([0.349066] * 3, rel=2e-3)
    assert values[3:8].tolist() == pytest.approx([0.0490874] * 5, rel=2e-3)
    compressed = compress(sphere, clusters=1, components=8)
    assert compressed.certificate["compression_squared_error"] < 1e-10
    three = compress(sphere, clusters=1, components=3)
    assert three.certificate["compression_squared_error"] == pytest.approx(5 * 0.0490874, rel=2e-3)


@pytest.mark.parametrize("components", range(0, 10))
def test_gradients_are_finite_at_ties(sphere, components):
    """Hard case 16: means, bases and weights are the parameters, so no eigenvalue gap is divided by."""
    c = compress(sphere, clusters=2, components=min(components, 9))
    parameters = [t.clone().requires_grad_() for t in (c.means, c.bases, c.weights)]
    decoded = ClusteredTransfer(c.labels, *parameters, c.receivers).decode().diffuse
    (decoded - sphere.diffuse).square().sum().backward()
    for parameter in parameters:
        assert parameter.numel() == 0 or bool(torch.isfinite(parameter.grad).all())


def test_decode_passes_gradcheck(generator):
    labels = torch.tensor([0, 1, 1, 0])
    receivers = Receivers.points(torch.rand(4, 3), torch.tensor([[0.0, 1.0, 0.0]]).expand(4, 3))
    shapes = [(2, 3, 4), (2, 2, 3, 4), (4, 2)]
    inputs = [torch.randn(s, dtype=torch.float64, generator=generator, requires_grad=True) for s in shapes]
    light = torch.randn(4, 3, dtype=torch.float64, generator=generator, requires_grad=True)

    def decoded(*parameters):
        return ClusteredTransfer(labels, *parameters, receivers).decode().diffuse

    def shaded(light, *parameters):
        return shade(ClusteredTransfer(labels, *parameters, receivers), light)

    assert torch.autograd.gradcheck(decoded, inputs)
    assert torch.autograd.gradcheck(shaded, [light, *inputs])


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-5)])
@pytest.mark.parametrize("channels", [1, 3])
def test_dotting_with_the_light_first_changes_nothing(dtype, tolerance, channels, generator):
    """Hard case 19: sum of w (B . L) is (sum of w B) . L."""
    count, clusters, components, order = 500, 7, 5, 4
    asset = ClusteredTransfer(
        torch.randint(0, clusters, (count,), generator=generator),
        torch.randn(clusters, channels, order**2, dtype=dtype, generator=generator),
        torch.randn(clusters, components, channels, order**2, dtype=dtype, generator=generator),
        torch.randn(count, components, dtype=dtype, generator=generator),
        Receivers.points(torch.rand(count, 3), torch.tensor([[0.0, 1.0, 0.0]]).expand(count, 3)),
    )
    light = torch.randn(order**2, 3, dtype=dtype, generator=generator)
    direct, decoded = shade(asset, light), shade(asset.decode(), light)
    assert float((direct - decoded).abs().max()) < tolerance * float(decoded.square().mean().sqrt())


def test_identical_vectors_need_one_cluster_and_have_no_error():
    """Hard case 17."""
    report: dict = {}
    compressed = compress(transfer_of(torch.ones(50, 9)), clusters=8, components=4, report=report)
    assert compressed.clusters == 1 and report["counts"]["clusters_dropped"] == 7
    assert compressed.certificate["compression_squared_error"] == 0.0
    assert bool(torch.isfinite(compressed.bases).all()) and float(compressed.weights.abs().max()) == 0.0


def test_more_clusters_than_distinct_vectors_are_dropped(generator):
    """Hard case 17."""
    distinct = torch.randn(5, 9, generator=generator)
    compressed = compress(transfer_of(distinct[torch.arange(60) % 5]), clusters=32, components=2)
    assert compressed.clusters == 5
    assert compressed.certificate["compression_squared_error"] < 1e-10


def test_fewer_members_than_components_are_exact(generator):
    """Hard case 17: three vectors span two directions; the other bases are zero, not NaN."""
    compressed = compress(transfer_of(torch.randn(3, 16, generator=generator)), clusters=1, components=8)
    assert compressed.certificate["compression_squared_error"] < 1e-10
    lengths = compressed.bases[0].reshape(8, -1).norm(dim=1)
    assert lengths.tolist() == pytest.approx([1, 1, 0, 0, 0, 0, 0, 0], abs=1e-5)


@pytest.mark.parametrize("members", [5, 40])
def test_components_are_the_best_subspace(members, generator):
    """The error is the sum of the eigenvalues left out, both for few and for many members."""
    vectors = torch.randn(members, 16, generator=generator, dtype=torch.float64)
    means, bases, weights = cluster_pca(vectors, torch.zeros(members, dtype=torch.int64), 1, 3)
    error = (vectors - means[0] - weights @ bases[0]).square().sum()
    values = torch.linalg.svdvals(vectors - vectors.mean(0)).square()
    assert float(error) == pytest.approx(float(values[3:].sum()), rel=FLOAT64["twin"])
    assert torch.allclose(bases[0] @ bases[0].T, torch.eye(3, dtype=torch.float64), atol=FLOAT64["rounding"])


def test_more_clusters_and_components_never_hurt_much(bumpy_transfer):
    errors = {
        (m, p): compress(bumpy_transfer, clusters=m, components=p, method="lbg").certificate[
            "compression_squared_error"
        ]
        for m in (4, 16, 64)
        for p in (0, 2, 8)
    }
    for m in (4, 16, 64):
        assert errors[m, 0] > errors[m, 2] > errors[m, 8]
    assert errors[4, 2] > errors[16, 2] > errors[64, 2]


def test_certificate_is_what_decoding_shows(bumpy_transfer):
    compressed = compress(bumpy_transfer, clusters=16, components=4)
    difference = (compressed.decode().diffuse - bumpy_transfer.diffuse).double()
    squared = float(difference.square().sum(dim=(1, 2)).mean())
    assert compressed.certificate["compression_squared_error"] == pytest.approx(squared, rel=1e-4)
    energy = float(bumpy_transfer.diffuse.double().square().sum(dim=(1, 2)).mean())
    assert compressed.certificate["compression_relative"] == pytest.approx(math.sqrt(squared / energy), rel=1e-4)


def test_one_seed_one_result_and_bytes_are_counted(bumpy_transfer):
    """Hard case 18."""
    one, two = (compress(bumpy_transfer, clusters=16, components=4, seed=5) for _ in range(2))
    for name in ("labels", "means", "bases", "weights"):
        assert torch.equal(getattr(one, name), getattr(two, name))
    largest = one.bases.reshape(-1, one.bases[0, 0].numel())
    largest = largest.gather(1, largest.abs().argmax(1, keepdim=True))
    assert float(largest.min()) >= 0
    count, size = len(one.receivers), one.means[0].numel()
    assert one.nbytes == 4 * (16 * size + 16 * 4 * size + count * 4) + count
    assert one.nbytes < bumpy_transfer.nbytes / 3


def test_lbg_reaches_a_fixed_point_near_the_best_known(generator):
    """Four tight groups: found exactly; every vector sits with its nearest center."""
    centers = torch.tensor([[0.0, 0], [10, 0], [0, 10], [10, 10]])
    vectors = centers[torch.arange(400) % 4] + 0.1 * torch.randn(400, 2, generator=generator)
    partition = lbg(vectors, 4, seed=1)
    assert len(partition.centers) == 4
    assert torch.bincount(partition.labels).tolist() == [100] * 4
    distance = torch.cdist(vectors, partition.centers, compute_mode="donot_use_mm_for_euclid_dist")
    assert torch.equal(distance.argmin(1), partition.labels)
    assert partition.energy == pytest.approx(float(distance.amin(1).square().sum()), rel=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"clusters": 0}, "clusters is 0"),
        ({"components": -1}, "components is -1"),
        ({"components": 10_000}, "components is 10000"),
        ({"method": "magic"}, "method 'magic'"),
        ({"iterations": 0}, "iterations is 0"),
    ],
)
def test_options_out_of_range_are_named(bumpy_transfer, options, message):
    with pytest.raises(InputError, match=message):
        compress(bumpy_transfer, **options)
