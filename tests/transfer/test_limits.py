"""What does not fit: hits traced again where memory does not hold them, and refusals before hours are spent."""

import time
from dataclasses import replace

import pytest
import torch
from tolerances import FLOAT32

from diffprt.errors import InputError
from diffprt.scene import builtin_scene
from diffprt.transfer import bake, prepare, trace
from diffprt.transfer.baking import estimate
from diffprt.transfer.baking.estimate import check_time
from diffprt.transfer.diffuse import retrace


@pytest.mark.parametrize("bounces", [2, "converged"])
def test_recomputed_hits_give_the_same_transfer_and_gradient(bounces, monkeypatch):
    """In several blocks, with receivers inside geometry, for any number of threads."""
    monkeypatch.setattr(retrace, "RAYS_PER_BLOCK", 1 << 14)
    scene = builtin_scene("cornell", subdivisions=2)
    options = {"order": 1, "rays": 128, "bounces": bounces}
    found = []
    for choice in ({"operator": "stored"}, {"operator": "recompute"}, {"operator": "recompute", "threads": 3}):
        report: dict = {}
        albedo = torch.full((3,), 0.6, requires_grad=True)
        signal = trace(scene, **options, **choice, report=report).transfer(albedo=albedo).diffuse
        (gradient,) = torch.autograd.grad(signal.square().sum(), albedo)
        found.append((signal.detach(), gradient))
        assert (report["counts"]["operator_entries"] == 0) == (choice["operator"] == "recompute")
    for signal, gradient in found[1:]:
        assert float((signal - found[0][0]).abs().max()) < FLOAT32["rounding"]
        assert torch.allclose(gradient, found[0][1], rtol=FLOAT32["twin"])
    assert torch.equal(found[1][0], found[2][0])


def test_memory_decides_and_recomputing_needs_less(bumpy, monkeypatch):
    assert prepare(bumpy, order=2, rays=256, bounces=2).estimate().operator == "stored"
    room = builtin_scene("closed_box", subdivisions=6)
    options = {"order": 2, "rays": 2048, "bounces": 2}
    jobs = [prepare(room, **options, operator=name) for name in ("stored", "recompute")]
    stored, again = (job.estimate() for job in jobs)
    assert again.memory_bytes < 0.5 * stored.memory_bytes
    monkeypatch.setattr(estimate, "available_memory", lambda: (stored.memory_bytes + again.memory_bytes) // 2)
    assert prepare(room, **options).estimate().operator == "recompute"
    monkeypatch.setattr(estimate, "available_memory", lambda: again.memory_bytes)
    with pytest.raises(InputError, match=r"use fewer --rays, a coarser mesh or --operator recompute"):
        jobs[0].run()
    monkeypatch.setattr(estimate, "available_memory", lambda: 1 << 20)
    with pytest.raises(InputError, match=r"or --bounces 0"):
        jobs[1].run()


def test_bake_refuses_before_it_traces(bumpy, monkeypatch):
    begun = time.perf_counter()
    with pytest.raises(
        InputError, match=r"takes about .* hours .* --seconds or fewer --rays, or allow it with --hours"
    ):
        bake(bumpy, order=2, rays=1 << 20, bounces=1, hours=1e-3)
    monkeypatch.setattr(estimate, "available_memory", lambda: 1 << 26)
    with pytest.raises(InputError, match=r"needs about .* GiB and 0.06 GiB are free"):
        bake(bumpy, order=2, rays=1 << 20, bounces=1)
    with pytest.raises(InputError, match=r"needs about"):
        trace(bumpy, order=10, rays=1024, operator="stored")
    assert time.perf_counter() - begun < 30


def test_a_time_that_is_allowed_is_allowed(bumpy):
    expected = replace(prepare(bumpy, order=1, rays=64, bounces=0).estimate(), seconds=7200.0)
    check_time(expected, 2.5, "wait")
    with pytest.raises(InputError, match=r"about 2.0 hours .* --hours 2$"):
        check_time(expected, 1.0, "wait")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"operator": "fast"}, "operator is 'fast'"),
        ({"hours": 0}, "hours is 0"),
        ({"bounces": "all"}, "bounces is all"),
    ],
)
def test_options_out_of_range_are_named(bumpy, options, message):
    with pytest.raises(InputError, match=message):
        bake(bumpy, **options)
