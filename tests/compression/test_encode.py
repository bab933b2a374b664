"""Any signal through every method: errors, bytes, formats, priors, and hard inputs."""

import pytest
import torch
from tolerances import FLOAT32

from diffprt.compression import METHODS, cluster_pca, encode, light_prior, overdraw, squared_errors
from diffprt.compression.clustering import cluster
from diffprt.errors import InputError


def rolling(size: int = 20, dtype=torch.float32) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A signal [V, 16] that rolls over a square: positions, faces, vectors."""
    y, x = torch.meshgrid(torch.linspace(0, 1, size), torch.linspace(0, 1, size), indexing="ij")
    positions = torch.stack([x, y, 0.2 * (6 * x).sin()], -1).reshape(-1, 3)
    corner = torch.arange(size * size).view(size, size)
    a, b, c, d = (t.reshape(-1) for t in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]))
    faces = torch.cat([torch.stack([a, b, c], 1), torch.stack([b, d, c], 1)])
    wave = torch.rand(3, 16, generator=torch.Generator().manual_seed(1)) * 9
    falling = torch.tensor([1.0 / (1 + k) for k in range(16)])
    return positions, faces, ((positions @ wave).sin() * falling).to(dtype)


def error(vectors, encoded, prior=None):
    return float(squared_errors(vectors, encoded, prior).mean())


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_every_method_is_the_best_fit_of_its_labels(method, dtype):
    positions, faces, vectors = rolling(dtype=dtype)
    encoded = encode(vectors, clusters=10, components=3, method=method, positions=positions, faces=faces)
    means, bases, weights = cluster_pca(vectors, encoded.labels, len(encoded.means), 3)
    assert torch.equal(encoded.bases, bases) and torch.equal(encoded.weights, weights)
    first = [int((encoded.labels == m).nonzero()[0]) for m in range(len(means))]
    assert first == sorted(first), "clusters are named in the order in which receivers meet them"
    again = encode(vectors, clusters=10, components=3, method=method, positions=positions, faces=faces)
    assert torch.equal(again.labels, encoded.labels)


def test_methods_do_what_they_are_for():
    positions, faces, vectors = rolling(28)
    found = {
        method: encode(vectors, clusters=16, components=3, method=method, positions=positions, faces=faces)
        for method in METHODS
    }
    errors = {method: error(vectors, encoded) for method, encoded in found.items()}
    drawn = {method: overdraw(encoded.labels, faces) for method, encoded in found.items()}
    assert errors["k-subspaces"] < 0.9 * errors["lbg"]
    for method in ("k-subspaces-potts", "k-subspaces-overdraw"):
        assert errors[method] < errors["lbg"]
        assert drawn[method] < min(drawn["k-subspaces"], drawn["lbg"])
    assert drawn["lbg-reclassified"] < drawn["lbg"]


def test_best_method_is_the_default():
    _, faces, vectors = rolling(10)
    assert encode(vectors, clusters=4, components=2, faces=faces).method == "k-subspaces-overdraw"
    assert encode(vectors, clusters=4, components=2).method == "k-subspaces"
    assert encode(vectors, clusters=4, components=2, faces=faces[:0]).method == "k-subspaces"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["identical", "zero", "few distinct", "one", "fewer than components"])
def test_hard_inputs_are_exact(method, kind, generator):
    """Hard case 17: error 0, no NaN, clusters beyond the distinct signals dropped and counted."""
    vectors = {
        "identical": torch.full((30, 9), 0.7),
        "zero": torch.zeros(30, 9),
        "few distinct": torch.randn(4, 9, generator=generator)[torch.arange(30) % 4],
        "one": torch.randn(1, 9, generator=generator),
        "fewer than components": torch.randn(4, 9, generator=generator),
    }[kind]
    positions = torch.rand(len(vectors), 3, generator=generator)
    faces = torch.randint(0, len(vectors), (40, 3), generator=generator)
    encoded = encode(vectors, clusters=8, components=5, method=method, positions=positions, faces=faces)
    assert all(bool(torch.isfinite(t).all()) for t in (encoded.means, encoded.bases, encoded.weights))
    assert error(vectors, encoded) < 1e-10
    distinct = len(vectors.unique(dim=0))
    assert len(encoded.means) <= distinct
    assert encoded.counts["clusters_dropped"] == 8 - len(encoded.means)


@pytest.mark.parametrize("bases_format", ["float32", "float16", "uint8"])
@pytest.mark.parametrize("weights_format", ["float32", "float16", "uint8"])
def test_formats_cost_their_bytes_and_little_error(weights_format, bases_format):
    _, _, vectors = rolling()
    full = encode(vectors, clusters=6, components=4)
    small = encode(vectors, clusters=6, components=4, weights_format=weights_format, bases_format=bases_format)
    count, numbers = len(vectors), 6 * 5 * 16
    weight_bytes = {"float32": 4 * 4 * count, "float16": 2 * 4 * count, "uint8": 4 * count + 8 * 6 * 4}
    base_bytes = {"float32": 4 * numbers, "float16": 2 * numbers, "uint8": numbers + 8 * 6 * 5}
    assert small.nbytes == weight_bytes[weights_format] + base_bytes[bases_format] + count
    assert torch.equal(full.labels, small.labels)
    scale = float(vectors.square().sum(1).mean())
    assert (
        error(vectors, small)
        <= error(vectors, full) * (1 + 1e-6) + (4e-5 if "uint8" in (weights_format, bases_format) else 1e-6) * scale
    )


def test_a_prior_moves_error_to_where_light_is_weak():
    _, _, vectors = rolling()
    vectors = vectors * torch.arange(1, 17)  # all entries alike, so that the prior decides
    prior = torch.tensor([8.0] * 4 + [0.05] * 12)
    plain = encode(vectors, clusters=6, components=2)
    weighed = encode(vectors, clusters=6, components=2, prior=prior)
    assert error(vectors, weighed, prior) < error(vectors, plain, prior)
    assert error(vectors, weighed) > error(vectors, plain)
    lengths = torch.einsum("mpd,mqd->mpq", weighed.bases, weighed.bases)
    assert torch.allclose(lengths, torch.eye(2).expand_as(lengths), atol=1e-4), "orthonormal, prior or not"


def test_a_flat_prior_changes_nothing():
    _, _, vectors = rolling()
    plain, flat = (encode(vectors, clusters=5, components=3, prior=p) for p in (None, torch.ones(16)))
    assert torch.equal(plain.labels, flat.labels)
    assert torch.allclose(plain.decode(), flat.decode(), atol=FLOAT32["twin"])


def test_prior_of_lights(generator):
    """Each light counts alike however bright, and a rotation does not matter: bands are averaged."""
    lights = [torch.randn(9, 3, generator=generator) for _ in range(3)]
    prior = light_prior(lights)
    assert float(prior.mean()) == pytest.approx(1.0)
    assert len(prior[1:4].unique()) == 1 and len(prior[4:].unique()) == 1
    assert torch.allclose(light_prior([lights[0] * 100, *lights[1:]]), prior)
    for bad, message in (
        ([], "0 lights"),
        ([lights[0], torch.ones(4, 3)], "same order"),
        ([torch.zeros(9, 3)], "black"),
    ):
        with pytest.raises(InputError, match=message):
            light_prior(bad)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "k-subspaces-overdraw"}, "needs triangles, these receivers have 0"),
        ({"method": "lbg-coherent"}, "needs positions"),
        ({"coherence": -1.0}, "coherence is -1"),
        ({"coherence": float("nan")}, "coherence is nan"),
        ({"slack": -0.1}, "slack is -0.1"),
        ({"weights_format": "int4"}, "weights_format is 'int4'"),
        ({"bases_format": "bits"}, "bases_format is 'bits'"),
        ({"start": "middle"}, "start 'middle'"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        encode(torch.rand(20, 4), **{"clusters": 3, "components": 2, **options})


def test_clustering_reports_what_it_used():
    positions, faces, vectors = rolling(12)
    options = {"clusters": 5, "components": 2, "positions": positions, "faces": faces}
    assert cluster(vectors, method="lbg", **options).coherence is None
    assert cluster(vectors, method="lbg-coherent", **options).coherence == 0.05
    assert cluster(vectors, method="k-subspaces-overdraw", coherence=0.4, **options).coherence == 0.4
    assert cluster(vectors, method="k-subspaces-overdraw", **options).coherence > 0
