"""Plans: what each scene calls for, and that nothing else is missed."""

import ast
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

import diffprt.planning
from diffprt import sh
from diffprt.errors import InputError
from diffprt.planning import Plan, plan
from diffprt.planning.confidence import share_below
from diffprt.planning.open_proof import prove_open
from diffprt.planning.shadows import error_without
from diffprt.scene import BUILTIN_SCENES, Light, Mesh, Scene, builtin_environment, builtin_scene, constant_light
from diffprt.transfer import bake, trace
from diffprt.transfer.diffuse.direct import open_transfer

TOLERANCES = (0.1, 0.01, 0.001)


def of_mesh(mesh: trimesh.Trimesh, **options) -> Scene:
    return Scene.from_mesh(mesh.vertices, mesh.faces, **options)


def with_offset(scene: Scene, distance: float) -> Scene:
    """The scene and a copy of it, `distance` away along x."""
    mesh = scene.meshes[0]
    moved = replace(mesh, positions=mesh.positions + torch.tensor([distance, 0.0, 0.0]))
    return replace(scene, meshes=(mesh, moved))


def ball(subdivisions: int = 3) -> Scene:
    return builtin_scene("sphere", subdivisions=subdivisions)


def leaky_box() -> Scene:
    """The closed box without one of its 96 x 2 triangles, perfectly white."""
    mesh = builtin_scene("closed_box", subdivisions=2).meshes[0]
    return Scene((replace(mesh, faces=mesh.faces[1:]),), builtin_scene("closed_box").materials).with_albedo(1.0)


# name: (scene, shadows, some bounces, channels)
SCENES = {
    "sphere": (lambda: builtin_scene("sphere"), False, False, 1),
    "bunny": (lambda: builtin_scene("bunny"), True, True, 1),
    "bowl": (lambda: builtin_scene("bowl"), True, True, 1),
    "wall_and_floor": (lambda: builtin_scene("wall_and_floor"), True, True, 1),
    "closed_box": (lambda: builtin_scene("closed_box"), True, False, 1),
    "cornell": (lambda: builtin_scene("cornell"), True, True, 3),
    "black bunny": (lambda: builtin_scene("bunny").with_albedo(0.0), True, False, 1),
    "red bunny": (lambda: builtin_scene("bunny").with_albedo((0.8, 0.2, 0.1)), True, True, 3),
    "nearly gray bunny": (lambda: builtin_scene("bunny").with_albedo((0.5, 0.501, 0.499)), True, True, 1),
    "red sphere": (lambda: builtin_scene("sphere").with_albedo((0.8, 0.2, 0.1)), False, False, 1),
    "sphere on a ground": (lambda: ball().with_ground(resolution=16), True, True, 1),
    "spheres far apart": (lambda: with_offset(ball().with_albedo(0.5), 1000.0), False, False, 1),
    "spheres side by side": (lambda: with_offset(ball().with_albedo(0.5), 3.0), True, True, 1),
}


@pytest.mark.parametrize("name", SCENES)
def test_effects_that_a_scene_calls_for(name):
    make, shadows, bounces, channels = SCENES[name]
    decided = plan(make())
    found = (decided.shadows.value, decided.bounces.value > 0, decided.channels.value)
    assert found == (shadows, bounces, channels), decided.lines()
    assert decided.transfer.value == "vector" and decided.overridden == ()
    assert decided.order.value == (6 if shadows else 3)


def test_every_builtin_scene_is_in_the_table():
    assert set(BUILTIN_SCENES) <= set(SCENES)


# Fineness at which the full simulation takes about a second; the plan is of the same mesh.
FULL = {"bunny": 0, "bowl": 1, "wall_and_floor": 1, "closed_box": 2, "cornell": 2}


def difference(planned: torch.Tensor, full: torch.Tensor) -> float:
    """The measure of error stated in `diffprt.planning`, but at least relative to 1e-2 of an open receiver's signal:
    a closed room holds nothing but the rounding of sums that cancel."""
    planned, full = planned.double().expand(-1, 3, -1), full.double().expand(-1, 3, -1)
    size = full.square().sum((1, 2)).mean().sqrt().clamp_min(1e-2 * (2 * torch.pi) ** 0.5)
    return float((planned - full).square().sum((1, 2)).mean().sqrt() / size)


@pytest.mark.parametrize("name", [*FULL, "bumpy", "nearly gray bumpy", "red bowl"])
def test_planned_and_full_differ_by_less_than_the_tolerance(name, bumpy):
    others = {
        "bumpy": bumpy,
        "nearly gray bumpy": bumpy.with_albedo((0.5, 0.51, 0.49)),
        "red bowl": builtin_scene("bowl", subdivisions=1).with_albedo((0.9, 0.3, 0.1)),
    }
    scene = others[name] if name in others else builtin_scene(name, subdivisions=FULL[name])
    plans = [plan(scene, tolerance) for tolerance in TOLERANCES]
    # A closed room is dark: in bands above the first, a bake of it holds the noise of its rays and nothing else.
    for order in (1,) if name == "closed_box" else (1, 4):
        transport = trace(scene, order=order, rays=128, bounces=1)
        full = transport.transfer(30).diffuse
        for decided in plans:
            assert decided.shadows.value
            albedo = transport.receivers.albedo
            albedo = albedo.mean(1, keepdim=True) if decided.channels.value == 1 else albedo
            planned = transport.transfer(decided.bounces.value, albedo=albedo).diffuse
            error = difference(planned, full)
            assert error < decided.tolerance, decided.lines()
            left_out = decided.bounces.evidence.get("error", 0) + decided.channels.evidence["error"] * (
                decided.channels.value == 1
            )
            assert error <= left_out + 1e-4, "the bound that the plan states holds too"


@pytest.mark.parametrize("make", [ball, lambda: with_offset(ball(1).with_albedo(0.5), 1000.0)])
def test_what_needs_no_shadows_bakes_as_if_open(make):
    decided, scene = plan(make()), make()
    assert not decided.shadows.value and decided.bounces.value == 0
    full = bake(scene, order=4, rays=512, bounces=8)
    planned = open_transfer(full.receivers.normals, 4)[:, None]
    error = difference(planned, full.diffuse)
    assert error < (1e-6 if decided.shadows.evidence["proved"] else decided.tolerance)


PROVED = {
    "cube with smooth normals": lambda: of_mesh(trimesh.creation.box()),
    "cube with face normals": lambda: of_mesh(trimesh.creation.box().unmerge_vertices() or trimesh.creation.box()),
    "long box, finely cut": lambda: of_mesh(trimesh.creation.box(extents=(1, 2, 5)).subdivide().subdivide()),
    "cylinder": lambda: of_mesh(trimesh.creation.cylinder(1, 2, sections=48)),
    "icosahedron": lambda: ball(0),
    "fine sphere": lambda: ball(6),
    "open sheet": lambda: Scene.from_mesh([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1.0]], [[0, 2, 1], [0, 3, 2]]),
    "one triangle": lambda: Scene.from_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]], [[0, 1, 2]]),
}
REFUTED = {
    "torus": lambda: of_mesh(trimesh.creation.torus(2, 0.5)),
    "room of convex shape, seen from within": lambda: builtin_scene("closed_box", subdivisions=0),
    "two convex objects": lambda: with_offset(ball(2), 5.0),
    "a normal that leans over its surface": lambda: Scene(
        (Mesh.create([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]], [[0, 1, 2]], [[0.5, 0, 1], [0, 0, 1], [0, 0, 1]]),),
        ball(0).materials,
    ),
    "an occluder above": lambda: ball(1).with_occluder(of_mesh(trimesh.creation.box().apply_translation((0, 3, 0)))),
}


@pytest.mark.parametrize("name", [*PROVED, *REFUTED])
def test_openness_is_proved_of_what_is_open_and_of_nothing_else(name):
    scene = (PROVED | REFUTED)[name]()
    geometry = scene.merged()
    receives = torch.tensor([not m.occluder_only for m in scene.meshes])[geometry.mesh_of_vertex]
    arrays = [t.numpy() for t in (geometry.positions, geometry.normals, geometry.faces, receives)]
    assert prove_open(*arrays).proved == (name in PROVED)
    # The claim itself, without hulls: no vertex rises above any receiver's tangent plane.
    points, normals = arrays[0].astype(np.float64), arrays[1].astype(np.float64)
    if len(points) < 3000:
        heights = normals[receives.numpy()] @ points.T
        heights -= (normals * points).sum(1)[receives.numpy(), None]
        assert (heights.max() <= 2e-6 * scene.diagonal) == (name in PROVED)


def test_a_smaller_tolerance_never_removes_an_effect(bumpy):
    light = builtin_environment("sky").project(10)
    for scene in (builtin_scene("cornell", subdivisions=2), bumpy, with_offset(ball(2).with_albedo(0.3), 100.0)):
        plans = [plan(scene, tolerance, light=light) for tolerance in (1.0, 0.1, 0.01, 1e-9)]
        values = [(p.shadows.value, p.bounces.value, p.channels.value, p.order.value) for p in plans]
        for loose, tight in pairwise(values):
            assert all(a <= b for a, b in zip(loose, tight, strict=True)), values
        assert values[0] != values[-1]


def test_scale_and_runs_change_nothing(bumpy):
    again = plan(bumpy)
    assert plan(bumpy).as_dict() == again.as_dict()
    for scale in (1e-3, 1e3):
        scaled = plan(bumpy.transformed(np.diag([scale, scale, scale, 1.0])))
        for name in ("shadows", "bounces", "channels", "order"):
            assert getattr(scaled, name).value == getattr(again, name).value
        assert scaled.bounces.evidence["error"] == pytest.approx(again.bounces.evidence["error"], rel=0.05)


def test_albedo_and_openings_decide_bounces():
    bowl = builtin_scene("bowl", subdivisions=1)
    counts = [plan(bowl.with_albedo(albedo)).bounces.value for albedo in (0.0, 0.1, 0.8)]
    assert counts == sorted(counts) and counts[0] == 0 and counts[-1] > counts[1] > 0
    # A bowl's contraction is half its albedo (hard case 6); upper bounds lie above it, but not far.
    assert 0.4 <= plan(bowl.with_albedo(0.8)).bounces.evidence["contraction"] < 0.5
    endless = plan(leaky_box())
    assert endless.bounces.value == "converged" and "hardly fades" in endless.bounces.reason
    assert json.loads(json.dumps(endless.as_dict(), allow_nan=False)) == endless.as_dict(), "infinity is no JSON"
    dark = plan(builtin_scene("closed_box", subdivisions=2).with_albedo(1.0)).bounces
    assert dark.value == 0 and "no light comes in" in dark.reason
    absorbed = ball(2).with_occluder(of_mesh(trimesh.creation.box().apply_translation((0, 2, 0))))
    assert plan(absorbed).shadows.value and plan(absorbed).bounces.value == 0


def test_order_follows_from_the_light():
    q, r = torch.linalg.qr(torch.randn(64, 3, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64))
    q = q * r.diagonal(dim1=1, dim2=2).sign()[:, None, :]
    turns = q * q.det()[:, None, None]
    shadowed = builtin_scene("cornell", subdivisions=1)
    lights = {name: light_of(name) for name in ("sky", "studio")}
    all_turned = {
        name: torch.stack([sh.rotate(light.coefficients.double(), turn) for turn in turns])
        for name, light in lights.items()
    }
    for scene, bounces, rays in ((ball(2), 0, 16), (shadowed, 8, 512)):
        full = bake(scene, order=10, rays=rays, bounces=bounces).diffuse.double().expand(-1, 3, -1)
        orders = []
        for name, tolerance in (("sky", 0.02), ("sky", 0.2), ("studio", 0.1)):
            order, turned = plan(scene, tolerance, light=lights[name]).order.value, all_turned[name]
            orders.append(order)
            shaded = torch.einsum("vck,tkc->tvc", full, turned)
            fewer = torch.einsum("vck,tkc->tvc", full[..., : order**2], turned[:, : order**2])
            assert float(((fewer - shaded).square().sum() / shaded.square().sum()).sqrt()) < tolerance
        assert orders[1] < orders[0]
    assert plan(ball(1), light=constant_light(1.0, 6)).order.value == 1
    assert plan(ball(1), light=Light(torch.zeros(16, 3))).order.value == 1
    assert plan(ball(1), light=builtin_environment("sky")).order == plan(ball(1), light=lights["sky"]).order
    assert plan(ball(1), 1e-6, light=light_of("sky", 5)).order.value == 5, "no more than the light has"


def light_of(name: str, order: int = 10) -> Light:
    return builtin_environment(name).project(order)


def test_plans_survive_json_and_say_why(bumpy):
    for scene in (ball(2), bumpy):
        decided = plan(scene, light=light_of("sky"))
        text = json.dumps(decided.as_dict(), allow_nan=False)
        assert json.loads(text) == decided.as_dict()
        assert Plan.from_dict(json.loads(text)) == decided
        lines = decided.lines()
        assert len(lines) == 5 and all("(" in line and "\n" not in line for line in lines)
        with pytest.raises(AttributeError):
            decided.tolerance = 1.0


def test_what_is_asked_for_is_done_and_the_evidence_stays(bumpy):
    own = plan(bumpy)
    asked = plan(bumpy, bounces=7, order=9, channels=1)
    assert (asked.bounces.value, asked.order.value, asked.channels.value) == (7, 9, 1)
    assert asked.overridden == ("bounces", "channels", "order")
    assert asked.shadows == own.shadows
    assert asked.bounces.evidence == own.bounces.evidence | {"planned": own.bounces.value}
    assert "asked for" in asked.lines()[1]
    dark = plan(bumpy, shadows=False)
    assert (dark.shadows.value, dark.bounces.value, dark.channels.value) == (False, 0, 1)
    assert dark.shadows.evidence["error"] > dark.tolerance
    assert plan(bumpy, bounces=0).channels.value == 1, "no bounce, no colour"
    sphere = plan(ball(2), shadows=True, bounces=2)
    assert (sphere.shadows.value, sphere.bounces.value, sphere.channels.value) == (True, 2, 1)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        *[({"tolerance": t}, "tolerance") for t in (0, -0.1, 1.01, float("nan"), float("inf"), "1 %", None, True)],
        *[({"bounces": b}, "bounces") for b in (-1, 65, 1.5, True)],
        *[({"channels": c}, "channels") for c in (0, 2, 4)],
        *[({"order": o}, "order") for o in (0, 11)],
        ({"shadows": 1}, "shadows"),
        ({"shadows": False, "bounces": 1}, "bounces"),
    ],
)
def test_bad_input_is_one_line(options, word):
    with pytest.raises(InputError, match=word) as refused:
        plan(ball(0), **options)
    assert "\n" not in str(refused.value)


def test_scenes_without_receivers_or_triangles_are_refused():
    only = Scene(tuple(replace(m, occluder_only=True) for m in ball(0).meshes), ball(0).materials)
    with pytest.raises(InputError, match="occluder"):
        plan(only)
    mesh = ball(0).meshes[0]
    with pytest.raises(InputError, match="triangles"):
        plan(replace(ball(0), meshes=(replace(mesh, faces=mesh.faces[:0]),)))


def test_bounds_are_bounds():
    assert share_below(0, 1000) == pytest.approx(1 - 0.05 ** (1 / 1000))
    assert share_below(10, 10) == 1.0
    shares = [share_below(k, 50) for k in range(51)]
    assert shares == sorted(shares)
    assert error_without(0.0, 1.0) == 0.0 and error_without(1e-6, 1.0) == float("inf")
    errors = [error_without(h, 0.5) for h in (1e-8, 1e-6, 1e-4, 1e-2)]
    assert errors == sorted(errors) and errors[0] == pytest.approx(errors[1] / 10, rel=0.01)


def test_the_room_imports_only_what_stands_before_it():
    sources = list(Path(diffprt.planning.__file__).parent.glob("*.py"))
    assert len(sources) >= 6
    rooms = ("errors", "kernels", "options", "plan", "scene", "sh", "surface", "torch_threads")
    allowed = tuple(f"diffprt.{name}" for name in rooms)
    for source in sources:
        for node in ast.walk(ast.parse(source.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("diffprt"):
                names = [f"{node.module}.{alias.name}" for alias in node.names]
                assert all(n.startswith(allowed) for n in names), (source, names)
