"""Coherent labels: corners, sweeps, patches, geometry coherence, reclassification, and the price on overdraw."""

import itertools
import math

import pytest
import torch
from tolerances import FLOAT64

from diffprt.compression import (
    expected_overdraw,
    k_subspaces,
    lbg,
    lbg_coherent,
    overdraw,
    smooth_nearest_member,
    super_clusters,
)
from diffprt.compression.clusters.near import near_clusters
from diffprt.compression.clusters.partition import canonical
from diffprt.compression.clusters.subspaces import Subspaces, fit_subspaces
from diffprt.compression.methods.anneal import anneal, spared_draws
from diffprt.compression.methods.geometry_coherence import PLACES, _assign, nearest_member
from diffprt.compression.methods.label_descent import islands, patches, sweep, sweep_patches
from diffprt.compression.methods.priced_overdraw import _edges, price_overdraw
from diffprt.compression.methods.reclassify import reclassify
from diffprt.compression.methods.starts import placed, unit_box
from diffprt.compression.overdraw.corners import Corners
from diffprt.errors import InputError
from diffprt.scene import builtin_scene


def grid(size: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Positions [V, 3] and triangles of a square."""
    y, x = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    corner = (y * size + x)[:-1, :-1].reshape(-1)
    faces = torch.cat(
        [
            torch.stack([corner, corner + 1, corner + size], 1),
            torch.stack([corner + 1, corner + size + 1, corner + size], 1),
        ]
    )
    return torch.stack([x, y, torch.zeros_like(x)], -1).reshape(-1, 3).float() / (size - 1), faces


def total(cost, labels, faces, price):
    return float(cost.gather(1, labels[:, None]).sum()) + price * (overdraw(labels, faces) - 1) * len(faces)


@pytest.fixture(scope="module")
def patchwork():
    """A square whose signal changes smoothly, with noise that makes labels ragged."""
    positions, faces = grid(24)
    generator = torch.Generator().manual_seed(4)
    phase = positions[:, :2] @ torch.tensor([[3.0, 1.0, 5.0], [1.0, 4.0, 2.0]])
    signal = torch.cat([phase.sin(), phase.cos(), (2 * phase).sin()], 1)
    return positions, faces, signal + 0.2 * torch.randn(signal.shape, generator=generator)


@pytest.mark.parametrize("shape", ["sphere", "grid", "fan", "random"])
def test_units_of_one_color_share_no_triangle(shape, generator):
    faces = {
        "sphere": lambda: builtin_scene("sphere", subdivisions=3).meshes[0].faces,
        "grid": lambda: grid(9)[1],
        "fan": lambda: torch.tensor([[0, i, i + 1] for i in range(1, 200)]),
        "random": lambda: torch.randint(0, 90, (3000, 3), generator=generator),
    }[shape]()
    corners = Corners.of(faces, int(faces.max()) + 1)
    color = corners.color_of_unit
    for other in (corners.first, corners.second):
        assert not bool((color[corners.unit] == color[other]).any())
    assert corners.colors <= (90 if shape == "random" else 8)


def test_corners_of_triangles_that_repeat_one():
    """Between patches, a triangle of two has each once, and each sees the other twice; a triangle of one, none."""
    corners = Corners.of(torch.tensor([[0, 0, 1], [2, 2, 2], [1, 2, 1]]), 3)
    rows = sorted(zip(corners.unit.tolist(), corners.first.tolist(), corners.second.tolist(), strict=True))
    assert rows == [(0, 1, 1), (1, 0, 0), (1, 2, 2), (2, 1, 1)]


@pytest.mark.parametrize("price", [0.0, 0.2, 1.0, 50.0])
def test_no_sweep_raises_the_total(price, generator):
    """Price 0 leaves each its cheapest label; a price beyond all costs leaves far fewer triangles mixed."""
    _, faces = grid(12)
    cost = torch.rand(144, 5, generator=generator)
    labels = torch.randint(0, 5, (144,), generator=generator)
    corners, prices = Corners.of(faces, 144), [(price, torch.arange(5))]
    totals = [total(cost, labels, faces, price)]
    for _ in range(6):
        labels = sweep(lambda units: cost[units], labels, corners, 5, prices)
        totals.append(total(cost, labels, faces, price))
    assert all(later <= earlier + 1e-4 for earlier, later in itertools.pairwise(totals))
    assert totals[1] < totals[0]
    if price == 0.0:
        assert torch.equal(labels, cost.argmin(1))
    if price == 50.0:
        assert overdraw(labels, faces) - 1 < 0.25 * (overdraw(cost.argmin(1), faces) - 1)


def test_a_unit_gets_what_was_promised(generator):
    """The change of the total that one unit's move brings is the change of its own cost row."""
    _, faces = grid(5)
    cost = torch.rand(25, 4, generator=generator, dtype=torch.float64)
    labels = torch.randint(0, 4, (25,), generator=generator)
    groups = torch.tensor([0, 0, 1, 1])
    prices = [(0.3, torch.arange(4)), (0.7, groups)]
    swept = sweep(lambda units: cost[units], labels, Corners.of(faces, 25), 4, prices)

    def energy(labels):
        single = total(cost, labels, faces, 0.3)
        return single + 0.7 * (overdraw(groups[labels], faces) - 1) * len(faces)

    assert energy(swept) <= energy(labels)
    for _ in range(30):
        settled = sweep(lambda units: cost[units], swept, Corners.of(faces, 25), 4, prices)
        if torch.equal(settled, swept):
            break
        swept = settled
    for unit in range(25):
        for label in range(4):
            moved = swept.clone()
            moved[unit] = label
            assert energy(moved) >= energy(swept) - 1e-9, "a settled labeling has no better neighbor"


def test_patches_are_connected_labels():
    _, faces = grid(4)
    labels = torch.tensor([0, 0, 1, 1] * 2 + [0, 0, 0, 0] + [2, 2, 2, 2])
    labels[0] = 5
    patch = patches(labels, faces)
    assert len(patch.unique()) == 4
    assert patch[1] == patch[4] == patch[11] != patch[0]


def test_islands_are_all_but_the_largest_patch_of_a_label():
    """Of equals, one is not an island; the main patch of every label stays where it is."""
    labels = torch.tensor([0, 0, 1, 1, 0, 2, 0, 2])
    patch = torch.tensor([0, 0, 1, 1, 2, 3, 4, 5])
    assert islands(patch, labels).tolist() == [2, 4, 5]


def test_only_the_units_that_may_move_do(generator):
    _, faces = grid(12)
    cost = torch.rand(144, 5, generator=generator)
    labels = torch.randint(0, 5, (144,), generator=generator)
    corners, prices, units = Corners.of(faces, 144), [(0.2, torch.arange(5))], torch.arange(0, 144, 3)
    swept = sweep(lambda asked: cost[asked], labels, corners, 5, prices, units)
    moved = (swept != labels).nonzero().flatten()
    assert len(moved) and bool(torch.isin(moved, units).all())
    assert total(cost, swept, faces, 0.2) < total(cost, labels, faces, 0.2)


def test_an_island_joins_what_surrounds_it():
    """Four receivers of another label, none of whom gains by moving alone; the label's main patch is elsewhere."""
    _, faces = grid(8)
    labels = torch.zeros(64, dtype=torch.int64)
    island, main = [27, 28, 35, 36], list(range(56, 64))
    labels[island + main] = 1
    vectors = torch.zeros(64, 1)
    vectors[island] = 1.0
    vectors[main] = 10.0
    subspaces = Subspaces(torch.tensor([[0.0], [1.0]]), torch.zeros(2, 0, 1))
    prices = [(0.35, torch.arange(2))]
    alone = sweep(lambda u: subspaces.residuals(vectors[u]), labels, Corners.of(faces, 64), 2, prices)
    assert torch.equal(alone, labels)
    near = near_clusters(subspaces, vectors, labels, Corners.of(faces, 64))
    joined = sweep_patches(subspaces, vectors, labels, near, faces, prices)
    assert joined.nonzero().flatten().tolist() == main


def test_distance_to_the_nearest_member(generator):
    """Equation 10 by trees is equation 10 by all pairs, and its smooth form tends to it."""
    positions = torch.rand(200, 3, generator=generator, dtype=torch.float64)
    labels = torch.randint(0, 4, (200,), generator=generator)
    pairs = (positions[:, None] - positions).norm(dim=2)
    brute = torch.stack([pairs[:, labels == m].amin(1) for m in range(4)], 1)
    for m in range(4):
        assert torch.allclose(
            nearest_member(positions, labels, m, torch.arange(200)), brute[:, m], atol=FLOAT64["rounding"]
        )
    assert nearest_member(positions, labels, 4, torch.arange(2)).tolist() == [math.inf, math.inf]
    hard = torch.nn.functional.one_hot(labels, 4).double()
    for width in (0.02, 0.002):
        smooth = smooth_nearest_member(positions, hard, width=width, neighbors=200)
        assert float((smooth - brute).abs().max()) <= width * math.log(201)


def test_smooth_coherence_passes_gradcheck(generator):
    positions = torch.rand(12, 3, generator=generator)
    assignment = torch.rand(12, 3, generator=generator, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda q: smooth_nearest_member(positions, q, width=0.2, neighbors=6), assignment)


def test_geometry_coherence_is_equation_9(generator):
    """Its labels are those of all distances: nothing with a lower sum was passed over."""
    vectors = torch.randn(150, 3, generator=generator)
    points = torch.rand(150, 3, generator=generator, dtype=torch.float64)
    labels = torch.randint(0, 6, (150,), generator=generator)
    centers = torch.randn(6, 3, generator=generator)
    chosen, energy = _assign(vectors, points, labels, centers, 2.0)
    geometry = torch.stack([nearest_member(points, labels, m, torch.arange(150)) for m in range(6)], 1)
    brute = (vectors[:, None] - centers).norm(dim=2).double() + 2.0 * geometry
    assert torch.equal(chosen, brute.argmin(1))
    assert energy == pytest.approx(float(brute.amin(1).sum()), rel=1e-5)


@pytest.mark.parametrize("place", PLACES)
def test_geometry_coherence_in_any_unit(patchwork, place):
    positions, _, signal = patchwork
    found = lbg_coherent(signal, positions, 12, alpha=3.0, place=place)
    scaled = lbg_coherent(signal, 1000 * positions + 7, 12, alpha=3.0, place=place)
    assert float((scaled.labels == found.labels).float().mean()) > 0.99
    without = lbg_coherent(signal, positions, 12, alpha=0, place=place)
    assert float((without.labels == lbg(signal, 12).labels).float().mean()) > 0.95
    with pytest.raises(InputError, match="alpha is -1"):
        lbg_coherent(signal, positions, 12, alpha=-1)
    with pytest.raises(InputError, match="place 'here' is unknown"):
        lbg_coherent(signal, positions, 12, place="here")


def test_geometry_coherence_by_means_trades_energy_for_overdraw(patchwork):
    """The thesis's trend: less overdraw, more distance to the means."""
    positions, faces, signal = patchwork
    found = [lbg_coherent(signal, positions, 12, alpha=alpha, place="mean") for alpha in (0.0, 2.0, 10.0)]
    drawn = [overdraw(partition.labels, faces) for partition in found]
    assert drawn == sorted(drawn, reverse=True) and drawn[2] - 1 < 0.9 * (drawn[0] - 1)
    energies = [partition.energy for partition in found]
    assert energies == sorted(energies)


def test_equation_10_holds_receivers_back(patchwork):
    """A receiver's own cluster costs nothing: clusters stay what the first round made them, after fewer rounds."""
    positions, _, signal = patchwork
    plain, held = lbg(signal, 12), lbg_coherent(signal, positions, 12, alpha=30.0)
    assert held.energy > plain.energy and held.iterations < plain.iterations


def test_places_add_three_columns_of_the_same_variance(patchwork):
    positions, _, signal = patchwork
    both = placed(signal, 500 * positions + 3)
    assert torch.equal(both[:, :-3], signal)
    variance = [float((rows - rows.mean(0)).square().sum(1).mean()) for rows in both.split([9, 3], 1)]
    assert variance[0] == pytest.approx(variance[1], rel=1e-4)
    assert bool((placed(signal, torch.ones(len(signal), 3))[:, -3:] == 0).all())


def test_starting_from_places_lowers_overdraw(bumpy_transfer):
    """Of subspaces, at next to no error, before anything has a price."""
    signal, receivers = bumpy_transfer.diffuse.flatten(1), bumpy_transfer.receivers
    starts = (signal, placed(signal, receivers.positions))
    found = [k_subspaces(signal, lbg(rows, 24).labels, 4) for rows in starts]
    drawn = [overdraw(partition.labels, receivers.faces) for partition in found]
    assert drawn[1] - 1 < 0.85 * (drawn[0] - 1)
    assert found[1].error < 1.05 * found[0].error


def test_unit_box_keeps_proportions():
    box = unit_box(torch.tensor([[-1.0, 0, 0], [3, 1, 0]]))
    assert box.tolist() == [[0, 0, 0], [1, 0.25, 0]]
    assert bool(torch.isfinite(unit_box(torch.ones(4, 3))).all())


@pytest.mark.parametrize("tolerance", [0.0, 0.5, 5.0])
def test_reclassification_lowers_overdraw_within_its_tolerance(patchwork, tolerance):
    _, faces, signal = patchwork
    labels = lbg(signal, 12).labels
    subspaces = fit_subspaces(signal, labels, 12, 2)
    moved = reclassify(signal, labels, subspaces, Corners.of(faces, len(signal)), tolerance=tolerance)
    errors = subspaces.residuals(signal)
    before, after = (errors.gather(1, l[:, None])[:, 0] for l in (labels, moved))
    assert bool((after <= before + tolerance * before.mean() + 1e-6).all())
    assert overdraw(moved, faces) <= overdraw(labels, faces)
    if tolerance == 5.0:
        assert overdraw(moved, faces) - 1 < 0.9 * (overdraw(labels, faces) - 1)


@pytest.mark.parametrize("edges", [False, True])
def test_a_price_lowers_overdraw(patchwork, edges):
    _, faces, signal = patchwork
    start = k_subspaces(signal, lbg(signal, 12).labels, 2)
    drawn = [overdraw(start.labels, faces)]
    for price in (0.1, 1.0, 10.0, 100.0):
        found = price_overdraw(signal, start.labels, faces, start.subspaces, price=price, edges=edges)
        drawn.append(overdraw(found.labels, faces))
        assert found.price == price
    assert drawn == sorted(drawn, reverse=True) and drawn[-2] - 1 < 0.5 * (drawn[0] - 1)


def test_the_price_is_chosen_within_the_limit(patchwork):
    _, faces, signal = patchwork
    start = k_subspaces(signal, lbg(signal, 12).labels, 2)
    near = price_overdraw(signal, start.labels, faces, start.subspaces, slack=0.02)
    far = price_overdraw(signal, start.labels, faces, start.subspaces, slack=1.0)
    assert near.error <= 1.02 * min(error for _, error, _ in near.stages)
    assert near.price < far.price and overdraw(far.labels, faces) < overdraw(near.labels, faces)
    none = price_overdraw(signal, start.labels, faces, start.subspaces, limit=0.0)
    assert torch.equal(none.labels, start.labels) and none.price == 0.0


def test_shared_passes_are_priced(patchwork):
    """With three clusters a pass, the overdraw of passes falls, and clusters may stay more mixed within one."""
    _, faces, signal = patchwork
    start = k_subspaces(signal, lbg(signal, 12).labels, 2)
    plain = price_overdraw(signal, start.labels, faces, start.subspaces, price=0.3)
    shared = price_overdraw(signal, start.labels, faces, start.subspaces, price=0.3, per_pass=3)
    drawn = [super_clusters(canonical(p.labels)[0], faces, 3).overdraw for p in (start, shared)]
    assert drawn[1] - 1 < 0.8 * (drawn[0] - 1)
    assert overdraw(plain.labels, faces) < overdraw(shared.labels, faces)


def test_spared_draws_are_the_slope_of_expected_overdraw(generator):
    _, faces = grid(4)
    assignment = torch.rand(16, 3, generator=generator, dtype=torch.float64, requires_grad=True)
    slope = torch.autograd.grad(expected_overdraw(assignment, faces) * len(faces), assignment)[0]
    corners = Corners.of(faces, 16)
    order = corners.unit.argsort(stable=True)
    own = torch.bincount(corners.unit, minlength=16)[:, None]  # a receiver's own draws, whatever its neighbors do
    spared = spared_draws(assignment.detach(), corners.unit[order], corners.first[order], corners.second[order])
    assert torch.allclose(own - spared, slope, atol=FLOAT64["rounding"])


@pytest.mark.parametrize("price", [0.0, 0.5])
def test_annealing_ends_better_than_it_began(patchwork, price):
    """Error + price x overdraw of hard labels, subspaces refitted."""
    _, faces, signal = patchwork
    start = k_subspaces(signal, lbg(signal, 12).labels, 2)
    labels = anneal(signal, start.labels, faces, start.subspaces, price=price)

    def objective(labels):
        fitted = fit_subspaces(signal, labels, 12, 2, passes=8)
        error = float(fitted.own(signal, labels).sum())
        return error + price * start.error * (overdraw(labels, faces) - 1) * len(faces)

    assert objective(labels) < objective(start.labels)


def test_edges_are_each_once():
    edges = _edges(torch.tensor([[0, 1, 2], [2, 1, 3]]))
    assert edges.tolist() == [[0, 1, 1], [0, 2, 2], [1, 2, 2], [1, 3, 3], [2, 3, 3]]
