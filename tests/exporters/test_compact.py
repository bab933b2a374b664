"""Arrays in few bytes: what comes back of them, by a reader of its own, and how few they are."""

from __future__ import annotations

import base64
import zlib

import numpy as np
import pytest

from diffprt.exporters.web.compact import compact


def read(stored) -> np.ndarray:
    """The numbers of an array, as page/payload.js finds them."""
    form = stored.form
    planes = np.frombuffer(zlib.decompress(base64.b64decode(stored.text)), np.uint8)
    size = np.dtype(form["code"]).itemsize
    codes = planes.reshape(size, form["width"], form["rows"]).transpose(2, 1, 0).copy()
    codes = codes.view(np.dtype(form["code"]).newbyteorder("<"))[..., 0]
    if form.get("differences"):
        codes = np.cumsum(codes, axis=0, dtype=form["code"])
    if form["as"] == "numbers":
        return codes
    if form["as"] == "half":
        return codes.view(np.float16).astype(np.float64) * form["scale"]
    if form["as"] == "fixed":
        return codes * np.array(form["step"]) + np.array(form["offset"])
    z, x = (codes.astype(np.float64) / 32767 - 1).T
    y = 1 - abs(z) - abs(x)
    folded = y < 0
    z, x = (
        np.where(folded, (1 - abs(x)) * np.where(z < 0, -1, 1), z),
        np.where(folded, (1 - abs(z)) * np.where(x < 0, -1, 1), x),
    )
    vectors = np.stack([x, y, z], axis=1)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def directions() -> np.ndarray:
    """Random ones, the axes and diagonals, and many within rounding of the plane z = 0 and of the fold y = 0."""
    random = np.random.default_rng(1).normal(size=(4000, 3))
    flat = random[:1500] * [1, 1, 1e-7]
    fold = random[:1500] * [1, 1e-7, 1]
    thin = random[:500] * [1, 1e-7, 1e-8]
    exact = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1]), -1).reshape(-1, 3)
    every = np.concatenate([random, flat, fold, thin, exact[np.abs(exact).sum(1) > 0]])
    return (every / np.linalg.norm(every, axis=1, keepdims=True)).astype(np.float32)


def test_normals_keep_their_direction_and_the_sign_of_z() -> None:
    normals = directions()
    back = read(compact("normals", normals))
    assert np.linalg.norm(back - normals, axis=1).max() < 2e-4
    # What chooses a vertex's axes: never lost. A float32 of the page rounds no small number to zero.
    assert ((back[:, 2] < 0) == (normals[:, 2] < 0)).all()


def test_positions_are_fixed_point() -> None:
    positions = (np.random.default_rng(2).normal(size=(500, 3)) * [1, 100, 0] + [0, 1e4, 3]).astype(np.float32)
    back = read(compact("positions", positions))
    extent = np.ptp(positions.astype(np.float64), axis=0)
    assert (abs(back - positions).max(axis=0) <= extent / 65535 / 2 * 1.001 + 1e-12).all()
    assert (back[:, 2] == 3).all()


@pytest.mark.parametrize("size", [1e-30, 1e-6, 1.0, 1e20])
def test_signals_are_half_floats_of_any_size(size) -> None:
    signal = (np.random.default_rng(3).normal(size=(300, 2, 9)) * size).astype(np.float32)
    back = read(compact("means", signal)).reshape(signal.shape)
    assert (abs(back - signal) <= 2**-11 * abs(signal) + 1e-8 * size).all()
    assert (read(compact("means", np.zeros((2, 3), np.float32))) == 0).all()


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "uint32"])
def test_whole_numbers_are_exact(dtype) -> None:
    numbers = np.random.default_rng(4).integers(0, np.iinfo(dtype).max, size=(999, 3), endpoint=True).astype(dtype)
    for name in ("indices", "passes"):
        assert (read(compact(name, numbers)) == numbers).all()


def test_an_empty_signal_is_kept() -> None:
    assert read(compact("weights", np.zeros((7, 0), np.float32))).shape == (7, 0)


def test_a_mesh_takes_a_few_bytes_a_triangle(plain) -> None:
    faces = plain.receivers.faces.numpy().astype(np.uint32)
    assert len(compact("indices", faces).text) < 0.1 * faces.nbytes
