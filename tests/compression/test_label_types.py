"""Labels of any integer type are the same labels, wherever they are an index; other numbers are refused."""

from dataclasses import replace

import numpy as np
import pytest
import representations as kinds
import torch

from diffprt import compress, export, load, optimize, render, save, shade
from diffprt.compression import cluster_pca, dequantize, fit_subspaces, k_subspaces, overdraw, quantize, super_clusters
from diffprt.errors import InputError
from diffprt.optimization import make_references
from diffprt.scene import Camera

TYPES = (torch.uint8, torch.int8, torch.uint16, torch.int16, torch.int32, torch.int64)
EYE = (0.5, 1.0, 3.0)


@pytest.fixture(scope="module", params=["clustered_transfer", "clustered_glossy_transfer"])
def asset(request):
    return kinds.REPRESENTATIONS[request.param].make()


@pytest.mark.parametrize("dtype", TYPES, ids=str)
def test_assets_shade_render_decode_and_export_the_same(asset, dtype, tmp_path):
    light, camera = kinds.distant(kinds.ORDER)(1.0, 1.0), Camera.framing(asset.elements.positions, width=24, height=24)
    same = replace(asset, labels=asset.labels.to(dtype))
    assert torch.equal(shade(same, light, EYE), shade(asset, light, EYE))
    assert torch.equal(render(same, light, camera), render(asset, light, camera))
    assert torch.equal(same.decode().signal, asset.decode().signal)
    assert same.overdraw() == asset.overdraw() and same.nbytes == asset.nbytes
    pages = [tmp_path / "a", tmp_path / "b"]
    for one, page in zip((same, asset), pages, strict=True):
        export(one, page, lights={"light": light})
    assert (pages[0] / "index.html").read_bytes() == (pages[1] / "index.html").read_bytes()
    for one, file in zip((same, asset), (tmp_path / "a.prt", tmp_path / "b.prt"), strict=True):
        save(one, file)
    assert (tmp_path / "a.prt").read_bytes() == (tmp_path / "b.prt").read_bytes()
    assert torch.equal(load(tmp_path / "a.prt").labels, asset.labels)


def test_numpys_labels_too(asset):
    same = replace(asset, labels=asset.labels.numpy().astype(np.uint16))
    assert torch.equal(same.labels, asset.labels) and same.labels.dtype == torch.int64


@pytest.mark.parametrize("dtype", TYPES, ids=str)
def test_training_starts_from_the_same(dtype):
    plain = kinds.transfer()
    asset = compress(plain, clusters=6, components=2, weights_format="uint8")
    references = make_references(plain, [kinds.distant(kinds.ORDER)(1.0, 1.0)], 3, width=16, height=16)
    found = [
        optimize(replace(asset, labels=labels), references, target=plain, steps=2)
        for labels in (asset.labels.to(dtype), asset.labels)
    ]
    assert torch.equal(found[0].means, found[1].means) and torch.equal(found[0].weights, found[1].weights)


@pytest.mark.parametrize("dtype", TYPES, ids=str)
def test_functions_of_plain_labels_take_them(dtype):
    asset = compress(kinds.transfer(), clusters=6, components=2)
    labels, faces = asset.labels.to(dtype), asset.receivers.faces
    rows = kinds.transfer().signal.flatten(1)
    assert overdraw(labels, faces) == asset.overdraw()
    assert super_clusters(labels, faces, 2).overdraw == super_clusters(asset.labels, faces, 2).overdraw
    for one, other in zip(cluster_pca(rows, labels, 6, 2), cluster_pca(rows, asset.labels, 6, 2), strict=True):
        assert torch.equal(one, other)
    assert torch.equal(fit_subspaces(rows, labels, 6, 2).means, fit_subspaces(rows, asset.labels, 6, 2).means)
    assert torch.equal(k_subspaces(rows, labels, 2).labels, k_subspaces(rows, asset.labels, 2).labels)
    stored = quantize(asset.weights, "uint8", ranges=labels)
    assert torch.equal(dequantize(stored, ranges=labels), dequantize(stored, ranges=asset.labels))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda labels: labels.float(), "labels of dtype torch.float32: give whole numbers"),
        (lambda labels: labels > 0, "labels of dtype torch.bool"),
        (lambda labels: (labels * 0 + 250).to(torch.uint8), r"labels outside 0\.\.\d, from 250 to 250"),
        (lambda labels: (labels - 9).to(torch.int8), r"labels outside 0\.\.\d, from -9 to"),
        (lambda labels: labels[:, None].to(torch.uint8), r"labels of shape \(\d+, 1\): give one for each receiver"),
        (lambda labels: labels[1:].to(torch.uint8), "labels of shape"),
    ],
)
def test_other_labels_are_refused(asset, change, message):
    with pytest.raises(InputError, match=message) as caught:
        replace(asset, labels=change(asset.labels))
    assert "\n" not in str(caught.value)
