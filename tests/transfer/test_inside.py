"""Receivers inside other geometry: found, filled, and nothing else touched."""

import numpy as np
import pytest
import torch
from tolerances import FLOAT64, relative_error
from trimesh.creation import box, icosphere

from diffprt.scene import Material, Mesh, Scene, builtin_scene
from diffprt.surface import Receivers, Surfaces
from diffprt.transfer import bake, trace
from diffprt.transfer.diffuse.inside import Fill, find_inside
from diffprt.transfer.diffuse.picked import PickedReceivers

OPTIONS = {"order": 3, "rays": 256, "bounces": 2}


def block_on_a_floor(cells: int = 16, lid: bool = True) -> Scene:
    """A closed unit cube, or only its top turned up as a sheet, sunk a little into a floor of 4 x 4."""
    step = torch.linspace(-2, 2, cells + 1)
    x, z = torch.meshgrid(step, step, indexing="ij")
    floor = torch.stack([x, torch.zeros_like(x), z], -1).reshape(-1, 3)
    i = (torch.arange(cells)[:, None] * (cells + 1) + torch.arange(cells)).reshape(-1)
    faces = torch.cat(
        [torch.stack([i, i + 1, i + cells + 1], 1), torch.stack([i + 1, i + cells + 2, i + cells + 1], 1)]
    )
    cube = box((1.1, 1.1, 1.1)) if lid else box((1.1, 0.1, 1.1))
    positions, sides = torch.tensor(cube.vertices).float() + torch.tensor([0, 0.5, 0]), torch.tensor(cube.faces)
    if not lid:
        up = torch.linalg.cross(*(positions[sides[:, k]] - positions[sides[:, 0]] for k in (1, 2)))[:, 1] > 0.5
        sides = sides[up]
    flat = positions[sides].reshape(-1, 3)
    meshes = (Mesh.create(floor, faces, name="floor"), Mesh.create(flat, torch.arange(len(flat)).reshape(-1, 3)))
    return Scene(meshes, (Material(0.7),))


def under(receivers: Receivers) -> torch.Tensor:
    return (receivers.positions[:, 1] == 0) & (receivers.positions[:, [0, 2]].abs() < 0.55).all(1)


def test_floor_under_a_block_takes_its_surroundings():
    scene = block_on_a_floor()
    filled, black = bake(scene, **OPTIONS), bake(scene, **OPTIONS, fill_inside=False)
    hidden = under(filled.receivers)
    assert filled.certificate["receivers_inside"] == int(hidden.sum()) > 10
    assert "receivers_inside" not in black.certificate
    assert float(black.diffuse[hidden].abs().max()) == 0
    assert float(filled.openness[hidden].min()) > 0.3
    around = filled.openness[~hidden & (filled.receivers.positions[:, 1] == 0)]
    assert float(filled.openness[hidden].max()) <= float(around.max())
    # Outside, direct transfer is the same; light reflected by the floor's hidden part is what changes.
    assert torch.equal(filled.openness[~hidden], black.openness[~hidden])
    assert torch.equal(bake(scene, **OPTIONS, threads=1).diffuse, filled.diffuse)


def test_interpolation_no_longer_carries_black_out():
    """On triangles that reach under a block of the Cornell room the floor is nearly as bright as points there are."""
    scene = builtin_scene("cornell", subdivisions=4)
    options = {"order": 2, "rays": 512, "bounces": "converged"}
    filled, black = bake(scene, **options), bake(scene, **options, fill_inside=False)
    r = filled.receivers
    changed = filled.openness != black.openness
    assert float(r.positions[changed][:, 1].abs().max()) == 0, "only the floor has receivers inside a block"
    straddling = r.faces[changed[r.faces].any(1) & ~changed[r.faces].all(1)]
    weights = torch.distributions.Dirichlet(torch.ones(3)).sample((4, len(straddling)))
    points = (weights[..., None] * r.positions[straddling]).sum(2).reshape(-1, 3)
    up = torch.tensor([0.0, 1.0, 0.0]).expand(len(points), 3)
    truth = bake(scene, receivers=Receivers.points(points, up), **options).diffuse
    seen = truth[:, 1, 0] > 0.02
    errors = []
    for transfer in (filled, black):
        value = (weights[..., None, None] * transfer.diffuse[straddling]).sum(2).reshape(truth.shape)
        errors.append(float((value - truth)[seen].norm() / truth[seen].norm()))
    assert errors[0] < 0.2 < errors[1]


@pytest.mark.parametrize("scene", ["sheet", "closed_box", "bowl", "wall_and_floor", "bunny"])
def test_scenes_without_buried_receivers_are_left_alone(scene):
    """An open sheet over a floor shows its back to nearly all of the sky from there, and encloses nothing."""
    if scene == "sheet":
        scene = block_on_a_floor(lid=False)
    else:
        scene = builtin_scene(scene, subdivisions={"bunny": 0, "bowl": 1}.get(scene))
    on, off = bake(scene, **OPTIONS), bake(scene, **OPTIONS, fill_inside=False)
    assert on.certificate["receivers_inside"] == 0
    assert torch.equal(on.diffuse, off.diffuse)


def test_a_buried_part_with_no_way_out_stays_black():
    """A ball inside a ball has no neighbor outside to take anything from."""
    outer, inner = icosphere(subdivisions=2, radius=1.0), icosphere(subdivisions=1, radius=0.5)
    meshes = (Mesh.create(outer.vertices, outer.faces), Mesh.create(inner.vertices, inner.faces))
    transfer = bake(Scene(meshes, (Material(0.5),)), **OPTIONS)
    assert transfer.certificate["receivers_inside"] == len(inner.vertices)
    assert float(transfer.diffuse[len(outer.vertices) :].abs().max()) == 0


def leaking_shells(holes: int = 12) -> Scene:
    """Balls inside balls, whose shells have a few slits: what lies within sees out through them, or not."""
    draw = np.random.default_rng(5)
    outer, inner = icosphere(subdivisions=4, radius=1.0), icosphere(subdivisions=3, radius=0.9)
    kept = np.ones(len(outer.faces), dtype=bool)
    kept[draw.choice(len(kept), holes, replace=False)] = False
    # One mesh, so that what is hidden has neighbors to be filled from.
    corners = len(outer.vertices) + inner.faces
    bridge = [[0, 1, len(outer.vertices)]]
    return Scene.from_mesh(
        np.concatenate([outer.vertices, inner.vertices]).astype(np.float32),
        np.concatenate([outer.faces[kept], corners, bridge]),
        albedo=0.5,
    )


def test_what_is_inside_does_not_depend_on_rays_or_seed():
    """Slits of a thousandth of the sky were met by some bakes and missed by others, which filled what they missed."""
    scene = leaking_shells()
    found = {
        bake(scene, order=2, rays=rays, bounces=0, seed=seed).certificate["receivers_inside"]
        for rays, seed in ((32, 0), (200, 1), (1024, 2), (4096, 3))
    }
    assert len(found) == 1 and 20 < found.pop() < 640


@pytest.mark.parametrize("bounces", [0, 1])
def test_tolerance_holds_where_receivers_are_filled(bounces):
    """Against 4,096 rays of another seed; noise comes from a few receivers by the slits, of which trials see some."""
    scene, tolerance = leaking_shells(), 0.005
    options = {"order": 3, "bounces": bounces}
    fine = bake(scene, **options, rays=4096, seed=99).diffuse
    for seed in (0, 1):
        rough = bake(scene, **options, tolerance=tolerance, seed=seed)
        error = relative_error(rough.diffuse, fine)
        assert error <= tolerance and error <= rough.certificate["expected_error"]
        third = bake(scene, **options, rays=rough.settings["rays"] // 3, seed=seed).diffuse
        assert relative_error(third, fine) > tolerance


def test_picked_receivers_are_filled_as_all_are():
    scene = block_on_a_floor()
    surfaces = Surfaces.of(scene)
    whole = bake(scene, order=3, rays=64, bounces=0, seed=4)
    inside = find_inside(surfaces, surfaces.receivers)
    fill = Fill.of(surfaces.receivers, inside)
    pick = torch.randperm(len(inside), generator=torch.Generator().manual_seed(0))[:200].sort().values
    assert int(inside[pick].sum()) > 10
    picked = PickedReceivers(surfaces, pick, fill)
    transfer, error = picked.trace(64, 4, 3)
    # Places differ by a rounding, so that some patterns are turned otherwise.
    assert relative_error(transfer.float(), whole.diffuse[pick]) < 0.05
    assert relative_error(transfer[inside[pick]].float(), whole.diffuse[pick][inside[pick]]) < 0.1
    assert error.shape == (200, 1, 9)
    # Those with the same mean are one draw.
    filled = {int(row): int(number) for row, number in zip(fill.rows, fill.alike, strict=True)}
    hidden = [place for place, row in enumerate(pick.tolist()) if row in filled]
    assert len(picked.alike.unique()) == len(pick) - len(hidden) + len({filled[int(pick[p])] for p in hidden})


def strip(length: int = 8) -> Receivers:
    """A strip of quads along x, cut along a seam in the middle: two rows of 2 (length + 1) vertices."""
    x = torch.arange(length + 1.0)
    positions = torch.cat([torch.stack([x, torch.zeros_like(x), torch.full_like(x, z)], 1) for z in (0, 1, 1, 2)])
    n, i = length + 1, torch.arange(length)
    faces = []
    for low, high in ((0, n), (2 * n, 3 * n)):
        faces += [
            torch.stack([low + i, low + i + 1, high + i], 1),
            torch.stack([low + i + 1, high + i + 1, high + i], 1),
        ]
    normals = torch.tensor([0.0, 1.0, 0.0]).expand(4 * n, 3)
    return Receivers(positions, normals, torch.ones(4 * n, 3), torch.cat(faces))


def test_fill_is_a_mean_of_visible_neighbors_across_seams(generator):
    receivers = strip()
    x = receivers.positions[:, 0]
    inside = (x >= 3) & (x <= 5)
    fill = Fill.of(receivers, inside)
    assert torch.equal(fill.rows, inside.nonzero()[:, 0])
    constant = torch.ones(len(x), 2).masked_fill(inside[:, None], 0.0)
    assert torch.allclose(fill.apply(constant), torch.ones(len(x), 2))
    signal = torch.randn(len(x), 2, dtype=torch.float64, generator=generator)
    filled = fill.apply(signal)
    assert torch.equal(filled[~inside], signal[~inside])
    n = 9
    assert torch.equal(filled[n : 2 * n][inside[n : 2 * n]], filled[2 * n : 3 * n][inside[n : 2 * n]]), (
        "seam twins agree"
    )
    other = torch.randn(len(x), 2, dtype=torch.float64, generator=generator)
    assert float((filled * other).sum()) == pytest.approx(
        float((signal * fill.transposed(other)).sum()), rel=FLOAT64["rounding"]
    )
    assert Fill.of(receivers, torch.zeros(len(x), dtype=torch.bool)) is None
    assert Fill.of(receivers, torch.ones(len(x), dtype=torch.bool)) is None


def test_gradients_pass_through_the_filled_operator():
    transport = trace(block_on_a_floor(8), order=1, rays=64, bounces=1)
    assert transport.findings["receivers_inside"] > 0
    operator = transport.operator
    x = torch.randn(operator.sources, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    y = torch.randn(operator.receivers, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    x.requires_grad_()
    value = (operator.gather(x) * y).sum()
    (gradient,) = torch.autograd.grad(value, x)
    assert float((gradient * x).sum().detach()) == pytest.approx(float(value.detach()), rel=FLOAT64["twin"])
