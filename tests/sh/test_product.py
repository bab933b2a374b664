"""Products of functions, and rotation into many frames."""

import pytest
import torch
from tolerances import FLOAT64

from diffprt import sh
from diffprt.errors import InputError
from diffprt.sh.frames import frame_rotations, from_frames, rows_from_frames, tangent_frames, to_frames
from diffprt.sh.product import multiply, product_matrix, triple_products


def test_products_are_products_of_values(random, directions, dtype, tolerance):
    a, b, d = random(16).to(dtype), random(9).to(dtype), directions.to(dtype)
    values = sh.evaluate(multiply(a, b, 6), d)
    # Products of sums of 16 and 9 terms: ten times the tolerance for values of order 1.
    assert torch.allclose(values, sh.evaluate(a, d) * sh.evaluate(b, d), atol=10 * tolerance)


def test_multiplying_by_one_is_the_identity():
    one = torch.zeros(9, dtype=torch.float64)
    one[0] = (4 * torch.pi) ** 0.5
    assert torch.allclose(product_matrix(one, 4, 4), torch.eye(16, dtype=torch.float64), atol=FLOAT64["rounding"])


def test_matrix_depends_on_the_bands_it_claims(random):
    f = random(3, 81)
    matrix = product_matrix(f, 3, 4)
    assert torch.equal(matrix, product_matrix(f[:, :36], 3, 4))
    assert not torch.allclose(matrix, product_matrix(f[:, :25], 3, 4))
    assert torch.allclose(matrix[:, :, :9], matrix[:, :, :9].transpose(1, 2), atol=FLOAT64["rounding"])


def test_integrals_are_sparse_and_symmetric():
    table = triple_products(4, 4, 7)
    assert torch.allclose(table, table.transpose(0, 1), atol=1e-14)
    assert float((table != 0).double().mean()) < 0.12
    with pytest.raises(InputError, match="outside 1"):
        triple_products(4, 0, 7)


def test_gradients_of_products(random):
    inputs = random(2, 9).requires_grad_(), random(2, 4).requires_grad_()
    assert torch.autograd.gradcheck(lambda a, b: multiply(a, b, 4), inputs)
    assert torch.autograd.gradcheck(lambda a: product_matrix(a, 2, 3), inputs[:1])


def test_frames_agree_with_rotation(random, dtype, tolerance):
    normals = torch.nn.functional.normalize(random(5, 3), dim=-1).to(dtype)
    frames = tangent_frames(normals)
    rotations = frame_rotations(frames, 6)
    c = random(5, 36).to(dtype)
    expected = torch.stack([sh.rotate(x, f.T) for x, f in zip(c, frames, strict=True)])
    turned = to_frames(c, rotations)
    assert torch.allclose(turned, expected, atol=20 * tolerance)
    assert torch.allclose(from_frames(turned, rotations), c, atol=20 * tolerance)
    matrices = random(5, 2, 36).to(dtype)
    acted = (rows_from_frames(matrices, rotations) @ c[..., None])[..., 0]
    assert torch.allclose(acted, (matrices @ turned[..., None])[..., 0], atol=100 * tolerance)
    with pytest.raises(InputError, match="give floating-point"):
        frame_rotations(torch.eye(3), 4)
