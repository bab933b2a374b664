"""`bake(plan=...)` obeys the plan, records it, and stays within its tolerance of the full simulation."""

import pytest
import torch

from diffprt.planning import plan
from diffprt.representation import files as asset
from diffprt.scene import builtin_scene
from diffprt.transfer import bake
from diffprt.transfer.diffuse.direct import open_transfer


def test_no_ray_is_traced_where_shadows_are_proved_unnecessary(tmp_path):
    scene = builtin_scene("sphere")
    decided = plan(scene, 0.01)
    report: dict = {}
    planned = bake(scene, plan=decided, report=report)
    assert report["counts"]["rays"] == 0
    assert torch.equal(planned.diffuse[:, 0], open_transfer(planned.receivers.normals, planned.order).float())
    full = bake(scene, order=planned.order, rays=64, bounces=4)
    assert torch.equal(planned.diffuse, full.diffuse)
    asset.save(planned, tmp_path / "a.prt")
    assert asset.load(tmp_path / "a.prt").plan == planned.plan == decided.as_dict()


@pytest.mark.parametrize("name", ["bowl", "cornell", "bunny", "wall_and_floor"])
def test_planned_and_full_differ_by_less_than_the_tolerance(name):
    scene = builtin_scene(name, **({"subdivisions": 0} if name == "bunny" else {}))
    tolerance = 0.02
    decided = plan(scene, tolerance)
    planned = bake(scene, plan=decided, rays=128)
    full = bake(scene, order=planned.order, rays=128, bounces=40)
    assert planned.channels == decided.channels.value
    difference = planned.diffuse.expand_as(full.diffuse) - full.diffuse
    error = difference.square().sum(dim=(1, 2)).mean().sqrt() / full.diffuse.square().sum(dim=(1, 2)).mean().sqrt()
    assert float(error) < tolerance
    assert decided.bounces.value < 40


def test_what_is_given_beside_the_plan_wins(bumpy):
    decided = plan(bumpy, 0.05)
    transfer = bake(bumpy, plan=decided, order=2, bounces=0, rays=16)
    assert transfer.order == 2 and transfer.settings["bounces"] == 0
