"""The hierarchy: boxes hold what they should, every triangle is there once, depth is bounded."""

import itertools

import pytest
import torch

from diffprt.kernels import TriangleMesh
from diffprt.kernels.binary_tree import LEAF_TRIANGLES
from diffprt.kernels.bvh import DEEPEST, Bvh
from diffprt.kernels.launch import start
from diffprt.scene import builtin_scene
from diffprt.transfer.diffuse.reference import closest_hits


def soup(count: int, generator: torch.Generator, size: float = 0.05) -> tuple[torch.Tensor, torch.Tensor]:
    centers = torch.rand(count, 1, 3, generator=generator)
    positions = (centers + size * torch.randn(count, 3, 3, generator=generator)).reshape(-1, 3)
    return positions, torch.arange(3 * count, dtype=torch.int32).reshape(-1, 3)


def check(bvh: Bvh, positions: torch.Tensor, faces: torch.Tensor) -> int:
    """Walks the whole tree; its depth."""
    assert torch.equal(bvh.face_of.sort().values.long(), torch.arange(len(faces)))
    corners = bvh.triangles[:, :, :3].transpose(1, 2)
    assert torch.equal(corners, positions[faces.long()][bvh.face_of.long()])
    low, high = bvh.quads[:, :12].view(-1, 3, 4), bvh.quads[:, 12:24].view(-1, 3, 4)
    children = bvh.quads[:, 24:28].contiguous().view(torch.int32).tolist()
    orders = bvh.quads[:, 28:30].contiguous().view(torch.uint8)
    shifts = torch.tensor([0, 2, 4, 6])
    assert torch.equal((orders[..., None] >> shifts & 3).sort(-1).values, torch.arange(4).expand(len(orders), 8, 4))
    seen, deepest, stack = 0, 0, [(0, 0, None)]
    firsts = []
    while stack:
        node, depth, bounds = stack.pop()
        deepest = max(deepest, depth)
        seen += 1
        for k, child in enumerate(children[node]):
            least, most = low[node, :, k], high[node, :, k]
            if child == 0:
                assert bool((least == 3e38).all())
                continue
            if bounds is not None:
                assert bool((least >= bounds[0]).all() and (most <= bounds[1]).all())
            if child > 0:
                stack.append((child, depth + 1, (least, most)))
                continue
            first, count = ~child >> 3, ~child & 7
            assert 1 <= count <= LEAF_TRIANGLES
            points = corners[first : first + count].reshape(-1, 3)
            assert bool((points >= least).all() and (points <= most).all())
            firsts.append((first, count))
    assert seen == len(bvh.quads)
    firsts.sort()
    assert firsts[0][0] == 0 and sum(n for _, n in firsts) == len(faces)
    assert all(a + n == b for (a, n), (b, _) in itertools.pairwise(firsts))
    return deepest


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 17, 1000, 30_000])
def test_tree_holds_every_triangle_once(count, generator):
    start()
    positions, faces = soup(count, generator)
    bvh = Bvh.build(positions, faces)
    assert check(bvh, positions, faces) < 40
    assert count < 100 or bvh.nbytes / count < 150


def test_any_thread_count_gives_the_same_tree(generator):
    start()
    positions, faces = soup(20_000, generator)
    one, five = Bvh.build(positions, faces, threads=1), Bvh.build(positions, faces, threads=5)
    for name in ("quads", "triangles", "face_of"):
        a, b = (getattr(x, name).contiguous().view(torch.int32) for x in (one, five))
        assert torch.equal(a, b)


@pytest.mark.parametrize("kind", ["identical", "line", "growing", "flat"])
def test_degenerate_inputs_keep_a_bounded_depth(kind, generator):
    """Sizes that grow without end would make a heuristic tree as deep as it has triangles."""
    start()
    positions, faces = soup(3000, generator)
    if kind == "identical":
        positions = positions[:3].repeat(3000, 1)
    elif kind == "line":
        positions[:, 1:] = 0
    elif kind == "flat":
        positions[:, 2] = 0.5
    else:
        positions *= (1.03 ** torch.arange(3000).repeat_interleave(3))[:, None].clamp(max=1e30)
    bvh = Bvh.build(positions, faces)
    assert check(bvh, positions, faces) < DEEPEST


def test_closest_hits_match_brute_force_on_a_soup(generator):
    """Triangles that cross each other, seen from both sides; differences lie within 1e-6 of an edge."""
    positions, faces = soup(400, generator, 0.2)
    mesh = TriangleMesh(positions, faces)
    origins = torch.rand(20_000, 3, generator=generator)
    directions = torch.nn.functional.normalize(torch.randn(20_000, 3, generator=generator), dim=1)
    distance, face, weights = mesh.closest_hits(origins, directions)
    twin = [torch.cat(parts) for parts in zip(*(
        closest_hits(positions.double(), faces.long(), o.double(), d.double())
        for o, d in zip(origins.split(2000), directions.split(2000), strict=True)
    ), strict=True)]  # fmt: skip
    same = face == twin[1]
    assert float(same.float().mean()) > 0.999
    edge = torch.minimum(weights.amin(1), twin[2].amin(1).float())
    close = (distance - twin[0]).abs() < 1e-5
    assert bool(((edge < 1e-4) | close)[~same].all())
    hit = same & (face >= 0)
    assert int(hit.sum()) > 10_000
    assert float((distance - twin[0])[hit].abs().max()) < 1e-4
    assert torch.equal(mesh.occluded(origins, directions)[same], (face >= 0)[same])


@pytest.mark.parametrize(("positions", "faces", "message"), [
    (torch.zeros(3, 3), torch.zeros(0, 3, dtype=torch.int32), "without triangles"),
    (torch.full((3, 3), float("nan")), torch.tensor([[0, 1, 2]]), "non-finite"),
])  # fmt: skip
def test_what_cannot_be_traced_is_named(positions, faces, message):
    with pytest.raises(ValueError, match=message):
        TriangleMesh(positions, faces)


def test_zero_area_triangles_are_never_hit():
    ball = builtin_scene("sphere", subdivisions=2).merged()
    faces = torch.cat([ball.faces, torch.tensor([[0, 0, 1], [2, 2, 2]])])
    mesh = TriangleMesh(ball.positions, faces)
    _, face, _ = mesh.closest_hits(torch.zeros(len(ball.positions), 3), ball.positions)
    assert bool((face >= 0).all()) and int(face.max()) < len(ball.faces)
