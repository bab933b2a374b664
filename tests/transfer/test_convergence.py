"""Interreflection to convergence: furnaces, bowls, energy, and what never converges."""

import math

import pytest
import torch
from tolerances import FLOAT64

from diffprt.errors import InputError
from diffprt.representation import files as asset
from diffprt.scene import builtin_scene
from diffprt.shading import shade
from diffprt.surface import Receivers, StoredOperator
from diffprt.surface.operator import OperatorRows
from diffprt.transfer import bake, converge, interreflect, trace

UNIT = math.sqrt(4 * math.pi)


def radiance_under_unit_light(transfer, albedo: float) -> torch.Tensor:
    """Exit radiance [V] under light of radiance 1 everywhere."""
    return albedo / math.pi * transfer.diffuse[:, 0, 0] * UNIT


def random_operator(generator: torch.Generator, size: int = 12, entries: int = 4) -> StoredOperator:
    """Rows that sum to at most 1."""
    columns = torch.stack([torch.randperm(size, generator=generator)[:entries].sort().values for _ in range(size)])
    values = torch.rand(size, entries, generator=generator)
    values = values / values.sum(1, keepdim=True) * torch.rand(size, 1, generator=generator)
    counts = torch.full((size,), entries, dtype=torch.int32)
    return StoredOperator(
        [OperatorRows(counts.numpy(), columns.int().flatten().numpy(), values.flatten().numpy())], size
    )


@pytest.mark.parametrize(("name", "subdivisions"), [("bunny", 0), ("bowl", 2), ("cornell", 3)])
def test_white_furnace(name, subdivisions):
    """Hard case 5: albedo 1 under unit light gives radiance 1."""
    scene = builtin_scene(name, subdivisions=subdivisions).with_albedo(1.0)
    radiance = radiance_under_unit_light(bake(scene, order=1, rays=512, bounces="converged"), 1.0)
    assert float(radiance.max()) < 1 + 1e-3
    assert float(radiance.mean()) == pytest.approx(1.0, abs=1e-3)
    # A ray along a crease may slip behind its surface, whose back is black.
    assert float(radiance.quantile(0.001)) > 1 - 1e-3


@pytest.mark.parametrize("albedo", [0.2, 0.8, 1.0])
def test_bowl(albedo):
    """Hard case 6."""
    scene = builtin_scene("bowl", subdivisions=2).with_albedo(albedo)
    transfer = bake(scene, order=1, rays=1024, bounces="converged")
    inside = transfer.receivers.positions[:, 1] < -0.05
    radiance = radiance_under_unit_light(transfer, albedo)[inside]
    assert float(radiance.mean()) == pytest.approx(albedo / (2 - albedo), rel=5e-3)
    assert transfer.settings["bounces"] < 10


def test_what_is_recorded(bumpy, tmp_path):
    transfer = bake(bumpy, order=2, rays=64, bounces="converged")
    asset.save(transfer, tmp_path / "a.prt")
    back = asset.load(tmp_path / "a.prt")
    assert 1 < back.settings["bounces"] < 12
    assert 0 < back.certificate["convergence_residual"] <= back.certificate["convergence_error"] * 2 <= 2e-4
    again = bake(bumpy, order=2, rays=64, bounces="converged", threads=1)
    assert torch.equal(again.diffuse, transfer.diffuse)


def test_the_bytes_do_not_depend_on_the_threads_of_torch(bumpy):
    transport = trace(bumpy, order=4, rays=64, bounces=1)
    threads = torch.get_num_threads()
    try:
        found = []
        for count in (1, 2):
            torch.set_num_threads(count)
            found.append(transport.transfer("converged").diffuse)
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(*found)


@pytest.mark.parametrize("albedo", [0.5, 1.0])
def test_no_worse_than_the_series_and_honest_about_it(albedo):
    """The error is within the tolerance, is estimated within a factor of 10 or below, and the series at the same
    number of products is no better."""
    transport = trace(builtin_scene("cornell", subdivisions=3).with_albedo(albedo), order=3, rays=128, bounces=1)
    direct, reflectance = transport.direct, transport.receivers.albedo[:, :1]
    truth, _ = converge(direct.double(), transport.operator, reflectance.double(), tolerance=1e-11)
    signal, ended = converge(direct, transport.operator, reflectance)
    size = float(direct.norm())
    error = float((signal - truth).norm()) / size
    series = interreflect(direct, transport.operator, reflectance, ended.products)
    assert error <= 1e-4 and error <= 10 * ended.error
    assert error < 0.1 * float((series - truth).norm()) / size
    residual = signal - direct - transport.operator.gather(reflectance[..., None] * signal)
    assert float(residual.norm()) / size <= ended.residual + 1e-6


def test_solution_of_random_systems_is_exact(generator):
    for _ in range(5):
        operator = random_operator(generator)
        direct = torch.randn(12, 3, 4, dtype=torch.float64, generator=generator)
        direct[:, 1] = 0
        albedo = torch.rand(12, 3, dtype=torch.float64, generator=generator)
        signal, ended = converge(direct, operator, albedo, tolerance=1e-12)
        dense = operator.matrix.to_dense().double()
        for c in range(3):
            system = torch.eye(12, dtype=torch.float64) - dense * albedo[:, c]
            assert torch.allclose(signal[:, c], torch.linalg.solve(system, direct[:, c]), atol=FLOAT64["twin"])
        assert ended.products <= 13


def test_gradients_pass_gradcheck(generator):
    operator = random_operator(generator, size=4, entries=2)
    direct = torch.randn(4, 2, 1, dtype=torch.float64, generator=generator, requires_grad=True)
    albedo = torch.rand(4, 2, dtype=torch.float64, generator=generator, requires_grad=True)
    assert torch.autograd.gradcheck(lambda d, a: converge(d, operator, a, tolerance=1e-13)[0], (direct, albedo))


def test_gradients_reach_the_albedo_and_hold_one_node(bumpy):
    transport = trace(bumpy, order=2, rays=64, bounces=1)
    albedo = transport.receivers.albedo.double().requires_grad_()
    direct = transport.direct.double().expand(-1, 3, -1)

    def loss(a: torch.Tensor) -> torch.Tensor:
        return converge(direct, transport.operator, a, tolerance=1e-10)[0].square().sum()

    (gradient,) = torch.autograd.grad(loss(albedo), albedo)
    direction = torch.randn(albedo.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    step = 1e-4
    with torch.no_grad():
        numeric = (loss(albedo + step * direction) - loss(albedo - step * direction)) / (2 * step)
    assert float((gradient * direction).sum()) == pytest.approx(float(numeric), rel=1e-5)
    signal = transport.transfer("converged", albedo=albedo.detach().float().requires_grad_()).diffuse
    above = [node for node, _ in signal.grad_fn.next_functions if node is not None]
    assert "Implicit" in signal.grad_fn.name() and not any("Product" in node.name() for node in above)


def test_many_bounces_tend_to_convergence_in_color():
    transport = trace(builtin_scene("cornell", subdivisions=3), order=3, rays=128, bounces=1)
    solved, series = transport.transfer("converged").diffuse, transport.transfer(60).diffuse
    assert solved.shape[1] == 3
    assert float((solved - series).norm() / series.norm()) < 1e-4


def test_free_receivers_gather_the_converged_signal(bumpy):
    own = bake(bumpy, order=2, rays=128, bounces="converged")
    r = own.receivers
    points = Receivers.points(r.positions[::9], r.normals[::9], r.albedo[::9])
    free = bake(bumpy, receivers=points, order=2, rays=128, bounces="converged")
    difference = (free.diffuse - own.diffuse[::9]).norm(dim=-1) / own.diffuse.norm(dim=-1).mean()
    assert float(difference.median()) < 1e-3
    assert free.settings["bounces"] == own.settings["bounces"] + 1 and "convergence_error" in free.certificate


def test_light_that_never_leaves_is_refused():
    room = builtin_scene("closed_box", subdivisions=2)
    with pytest.raises(InputError, match=r"does not converge: 150 of 150 receivers have albedo 1"):
        bake(room.with_albedo(1.0), order=1, rays=64, bounces="converged")
    assert float(bake(room.with_albedo(0.99), order=1, rays=64, bounces="converged").diffuse.abs().max()) == 0


def test_reflected_flux_never_exceeds_the_flux_that_arrives():
    """Hard case 10: of the light that arrives, what leaves towards the sky is at most all; at albedo 1, all."""
    transport = trace(builtin_scene("cornell", subdivisions=3), order=4, rays=512, bounces=1)
    light = torch.zeros(16, 3)
    light[:4] = torch.tensor([[2.0], [0.3], [1.0], [0.5]])
    areas = vertex_areas(transport.receivers)
    shares = {}
    for albedo in (0.6, 1.0):
        direct, whole = (transport.transfer(bounces, albedo=torch.full((3,), albedo)) for bounces in (0, "converged"))
        arrives = math.pi / albedo * (shade(direct, light)[:, 0] * areas).sum()
        leaves = math.pi * (shade(whole, light)[:, 0] * whole.openness * areas).sum()
        shares[albedo] = float(leaves / arrives)
    # Up to the quadrature of areas by vertices.
    assert shares[1.0] == pytest.approx(1.0, abs=0.02)
    assert 0.2 < shares[0.6] < 0.6


def vertex_areas(receivers: Receivers) -> torch.Tensor:
    """A third of each triangle's area at its corners, [V]."""
    a, b, c = receivers.positions[receivers.faces].unbind(1)
    area = torch.linalg.cross(b - a, c - a).norm(dim=1) / 2
    return torch.zeros(len(receivers)).index_add_(0, receivers.faces.flatten(), (area / 3).repeat_interleave(3))
