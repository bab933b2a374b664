"""Thin translucent surfaces: both sides of a sheet in one signal, through `bake`, the plan and the estimates."""

import json
import math

import numpy as np
import pytest
import torch
import trimesh
from tolerances import FLOAT32, FLOAT64

from diffprt.errors import InputError
from diffprt.options.bake import BakeSettings
from diffprt.planning import plan
from diffprt.representation import files as asset
from diffprt.scene import Material, Mesh, Scene, builtin_scene
from diffprt.surface import Receivers, StoredOperator
from diffprt.surface.operator import OperatorRows
from diffprt.surface.sides import Sides
from diffprt.transfer import bake, interreflect, prepare, rays_for_tolerance, trace
from diffprt.transfer.diffuse.direct import open_transfer
from diffprt.transfer.diffuse.sheets import SheetOperator

UNIT = math.sqrt(4 * math.pi)


def square(height: float = 0.0, size: float = 2.0, cells: int = 8, *, down: bool = False, material: int = 0) -> Mesh:
    """A horizontal square that faces up, or down."""
    step = torch.linspace(-size / 2, size / 2, cells + 1)
    x, z = torch.meshgrid(step, step, indexing="ij")
    i, n = (torch.arange(cells)[:, None] * (cells + 1) + torch.arange(cells)).reshape(-1), cells + 1
    faces = torch.cat([torch.stack([i, i + 1, i + n], 1), torch.stack([i + 1, i + n + 1, i + n], 1)])
    positions = torch.stack([x, torch.full_like(x, height), z], -1).reshape(-1, 3)
    return Mesh.create(positions, faces.flip(1) if down else faces, material=material)


def sheet_over_floor(transmission: float, *, down: bool = False, floor: float = 0.5) -> Scene:
    materials = (Material((0.6, 0.7, 0.8), transmission=transmission), Material(floor))
    return Scene((square(0.5, down=down), square(0.0, 4.0, material=1)), materials)


@pytest.mark.parametrize("transmission", [0.0, 0.25, 0.5, 1.0])
def test_an_open_sheet_sees_both_clamped_cosines(transmission):
    mesh = square()
    scene = Scene.from_mesh(mesh.positions, mesh.faces, transmission=transmission)
    transfer = bake(scene, order=5, rays=64, bounces=2)
    up = open_transfer(transfer.receivers.normals, 5)
    down = open_transfer(-transfer.receivers.normals, 5)
    expected = (1 - transmission) * up + transmission * down
    assert torch.allclose(transfer.diffuse[:, 0].double(), expected, atol=FLOAT32["rounding"])
    assert torch.allclose(transfer.diffuse[:, 0, 0], torch.tensor(math.sqrt(math.pi) / 2), atol=FLOAT32["rounding"])


def test_a_sheet_over_a_floor_is_the_mix_of_two_opaque_ones():
    """Direct transfer of both sides comes from two opaque bakes, one of them turned over."""
    options = {"order": 4, "rays": 512, "bounces": 0}
    up, down = (bake(sheet_over_floor(0.0, down=d), **options).diffuse[:81] for d in (False, True))
    mixed = bake(sheet_over_floor(0.3), **options).diffuse[:81]
    assert float((mixed - (0.7 * up + 0.3 * down)).abs().max()) < FLOAT32["rounding"]
    assert float((up - down).norm()) > 1
    turned = bake(sheet_over_floor(1.0), **options).diffuse[:81]
    assert float((turned - down).abs().max()) < FLOAT32["rounding"]


def test_light_from_the_floor_comes_through():
    """The first bounce: what the floor reflects reaches the sheet from below, with the share of transmission."""
    options = {"order": 2, "rays": 512, "bounces": 1}
    gained = []
    for scene in (sheet_over_floor(0.0, down=True), sheet_over_floor(0.5), sheet_over_floor(0.0)):
        transport = trace(scene, **options)
        gained.append((transport.transfer().diffuse - transport.direct)[:81])
    below, half, above = gained
    assert float((half - 0.5 * below).abs().max()) < FLOAT32["rounding"] and float(below[:, :, 0].max()) > 0.05
    assert float(above.abs().max()) == 0, "an opaque sheet sees nothing above it"


@pytest.mark.parametrize("transmission", [0.3, 1.0])
def test_energy_never_grows(transmission):
    """White everywhere under unit light: no radiance above 1, whatever passes through."""
    bowl, ball = builtin_scene("bowl", subdivisions=1), builtin_scene("sphere", subdivisions=1).meshes[0]
    inner = Mesh.create(0.3 * ball.positions - torch.tensor([0, 0.4, 0]), ball.faces, material=1)
    scene = Scene((*bowl.meshes, inner), (Material(1.0, transmission=transmission), Material(1.0)))
    transfer = bake(scene, order=1, rays=256, bounces="converged")
    radiance = transfer.diffuse[:, 0, 0] * UNIT / math.pi
    assert float(radiance.max()) < 1 + 1e-3
    assert float(radiance.mean()) > 0.5


def test_without_transmission_nothing_changes(bumpy):
    """The same hash and bytes as a scene that has never heard of it, and no second hemisphere."""
    mesh = bumpy.meshes[0]
    zero = Scene.from_mesh(mesh.positions, mesh.faces, albedo=(0.7, 0.5, 0.3), transmission=0.0)
    assert zero.hash() == bumpy.hash()
    report: dict = {}
    transfer = bake(zero, order=3, rays=64, bounces=1, report=report)
    assert transfer.receivers.transmission is None and Sides.of(transfer.receivers) is None
    assert report["counts"]["rays"] == 64 * len(mesh.positions)
    assert Scene.from_mesh(mesh.positions, mesh.faces, albedo=(0.7, 0.5, 0.3), transmission=0.5).hash() != bumpy.hash()


def test_same_bytes_for_any_thread_count_operator_and_after_a_save(tmp_path):
    scene, options = sheet_over_floor(0.4), {"order": 3, "rays": 256, "bounces": 2}
    report: dict = {}
    one = bake(scene, **options, threads=1, report=report)
    assert report["counts"]["rays"] == 256 * (2 * 81 + 81)
    assert torch.equal(one.diffuse, bake(scene, **options, threads=3, checkpoint=tmp_path / "parts").diffuse)
    assert torch.equal(one.diffuse, bake(scene, **options, checkpoint=tmp_path / "parts").diffuse)
    assert float((one.diffuse - bake(scene, **options, operator="recompute").diffuse).abs().max()) < FLOAT32["rounding"]
    asset.save(one, tmp_path / "sheet.prt")
    assert torch.equal(asset.load(tmp_path / "sheet.prt").diffuse, one.diffuse)


def test_free_receivers_have_two_sides_too():
    scene = sheet_over_floor(0.4)
    vertices = bake(scene, order=3, rays=1024, bounces=2)
    r = vertices.receivers
    inside = r.positions[:, [0, 2]].abs().amax(1) < 0.9
    free = Receivers.points(r.positions[inside], r.normals[inside], transmission=r.transmission[inside])
    gathered = bake(scene, receivers=free, order=3, rays=1024, bounces=2).diffuse
    assert float((gathered - vertices.diffuse[inside]).abs().max()) < 2e-3
    for wrong in (1.5, -0.1, float("nan")):
        with pytest.raises(InputError, match="transmission outside"):
            Receivers.points(r.positions, r.normals, transmission=wrong)


def small_sheet() -> tuple[SheetOperator, Sides]:
    """Three receivers of which the first and the last are translucent, and a dense operator of five sides."""
    through = torch.tensor([0.25, 0.0, 1.0])
    receivers = Receivers.points(torch.rand(3, 3), torch.rand(3, 3) + 0.1, transmission=through)
    sides = Sides.of(receivers)
    values = torch.rand(15, generator=torch.Generator().manual_seed(3)) / 3
    rows = OperatorRows(np.full(5, 3, np.int32), np.tile(np.arange(3, dtype=np.int32), 5), values.numpy())
    return SheetOperator(StoredOperator([rows], 3), sides), sides


def test_the_transpose_is_the_transpose_and_gradients_are_exact(generator):
    operator, sides = small_sheet()
    x = torch.randn(5, 2, dtype=torch.float64, generator=generator)
    y = torch.randn(3, 2, dtype=torch.float64, generator=generator)
    assert float((sides.combined(x) * y).sum()) == pytest.approx(
        float((x * sides.spread(y)).sum()), rel=FLOAT64["rounding"]
    )
    direct = torch.rand(3, 1, 4, dtype=torch.float64, generator=generator).requires_grad_()
    albedo = torch.rand(3, 1, dtype=torch.float64, generator=generator).requires_grad_()
    assert torch.autograd.gradcheck(lambda d, a: interreflect(d, operator, a, 3), (direct, albedo))


def test_gradients_reach_the_albedo_as_through_opaque_surfaces():
    transport = trace(sheet_over_floor(0.5), order=2, rays=128, bounces=2)
    albedo = torch.tensor([0.3, 0.5, 0.7], requires_grad=True)
    (gradient,) = torch.autograd.grad(transport.transfer(albedo=albedo).diffuse.square().sum(), albedo)
    step = 1e-2
    for channel in range(3):
        ends = []
        for sign in (1, -1):
            moved = albedo.detach().clone()
            moved[channel] += sign * step
            ends.append(float(transport.transfer(albedo=moved).diffuse.double().square().sum()))
        assert float(gradient[channel]) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-2)


def test_the_plan_looks_at_both_sides():
    """Above the sheet all is open and nothing reflects; below it lies a floor."""
    sheet = Scene((square(0.5),), (Material(0.8, transmission=0.5),))
    alone = plan(sheet, 0.01)
    assert not alone.shadows.value and alone.bounces.value == 0
    planned, full = bake(sheet, plan=alone), bake(sheet, order=alone.order.value, rays=64, bounces=2)
    assert torch.allclose(planned.diffuse, full.diffuse, atol=FLOAT32["rounding"])
    # The sheet's back sees the floor, which does not see the sheet's front: one bounce, and no more.
    scene = Scene((square(0.05), square(0.0, 8.0, material=1)), (Material(0.8, transmission=0.9), Material(0.9)))
    decided = plan(scene, 0.02)
    assert decided.shadows.value and decided.bounces.value >= 1
    options = {"order": decided.order.value, "rays": 512}
    planned, full = bake(scene, plan=decided, rays=512), bake(scene, **options, bounces="converged")
    difference = (planned.diffuse - full.diffuse).square().sum(-1).mean().sqrt()
    assert float(difference / full.diffuse.square().sum(-1).mean().sqrt()) < 0.02


def test_estimates_count_both_sides_and_tolerance_is_met():
    """From above the sheet is exact; noise comes from below, where trials must look too."""
    scene = Scene((square(0.3), square(0.0, 4.0, material=1)), (Material(0.8, transmission=0.7), Material(0.5)))
    settings = BakeSettings(order=3, rays=256, bounces=1)
    assert prepare(scene, **settings.as_dict()).estimate().rays == 256 * 3 * 81
    rate = rays_for_tolerance(scene, settings, 0.02)
    truth = bake(scene, order=3, rays=16 * rate.rays, bounces=1, seed=9).diffuse
    found = bake(scene, order=3, rays=rate.rays, bounces=1).diffuse
    error = float((found - truth).square().sum(-1).mean().sqrt() / truth.square().sum(-1).mean().sqrt())
    assert 0.002 < error < 0.02


def test_material_and_gltf(tmp_path):
    assert Material(0.5).transmission == 0
    for wrong in (-0.1, 1.5, float("nan")):
        with pytest.raises(InputError, match=r"material 'leaf' has transmission .*: give the share"):
            Material(0.5, transmission=wrong, name="leaf")
    assert Scene.from_mesh(np.eye(3), [[0, 1, 2]], transmission=0.4).with_albedo(0.2).materials[0].transmission == 0.4
    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(
        uv=np.zeros((8, 2)), material=trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 255, 255, 255])
    )
    files = trimesh.Scene([box]).export(file_type="gltf")
    header = json.loads(files["model.gltf"])
    through = {"diffuseTransmissionFactor": 0.35, "diffuseTransmissionTexture": {"index": 0}}
    header["materials"][0]["extensions"] = {"KHR_materials_diffuse_transmission": through}
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "model.gltf").write_text(json.dumps(header))
    scene = Scene.load(tmp_path / "model.gltf")
    assert scene.materials[scene.meshes[0].material].transmission == 0.35
    assert any("diffuse transmission: left out" in line for line in scene.defects.lines())
    occluder = Mesh.create(np.eye(3), [[0, 1, 2]], occluder_only=True)
    assert not Scene((square(), occluder), (Material(0.5, transmission=0.0),)).merged().transmission.any()
