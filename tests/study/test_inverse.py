"""The study of inverse problems: what it paints, and the mistakes it names (`diffprt study inverse` runs it whole)."""

import pytest
import torch

from diffprt.errors import InputError
from diffprt.scene import builtin_scene
from diffprt.study.inverse import inverse_study, painted_scene


def test_paint_is_the_albedo_of_the_scene(bumpy):
    painted, albedo = painted_scene(bumpy)
    assert torch.allclose(painted.meshes[0].vertex_albedo(painted.materials), albedo, atol=1e-6)
    assert float(albedo.min()) > 0 and float(albedo.max()) < 1 and float(albedo.std()) > 0.1
    assert torch.equal(painted.meshes[0].positions, bumpy.meshes[0].positions)


def test_bad_options_are_named():
    with pytest.raises(InputError, match="views 0"):
        inverse_study("builtin:bunny", views=0)
    with pytest.raises(InputError, match="paints scenes of one"):
        painted_scene(builtin_scene("cornell"))
