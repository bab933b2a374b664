"""Chunks are pure: another process that unpickles the work gives the same bytes, in every pass."""

import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
import torch

from diffprt.brdf import GGX, Phong
from diffprt.errors import InputError
from diffprt.options.bake import BakeSettings, GlossySettings
from diffprt.scene import Material, Scene, builtin_scene
from diffprt.surface import Surfaces
from diffprt.transfer import GlossyTransfer, bake, bake_glossy, prepare
from diffprt.transfer.baking.chunks import Work
from diffprt.transfer.diffuse.tracing import Tracing
from diffprt.transfer.glossy.materials import GlossyMaterials
from diffprt.transfer.glossy.passes import GlossyPasses


def chunk_bytes(work: bytes, number: int, index: int, before: bytes) -> dict[str, bytes]:
    """One chunk of pickled work, computed here."""
    found = pickle.loads(work).chunk(number, index, pickle.loads(before))
    return {name: np.ascontiguousarray(tensor.numpy()).tobytes() for name, tensor in found.items()}


def works(bumpy: Scene) -> dict[str, Work]:
    surfaces = Surfaces.of(bumpy)
    shiny = bumpy.with_brdf(GGX(0.4, specular=0.7))
    glossy = GlossySettings(2, 64, 1, order_out=3, bounce_rays=32)
    materials = GlossyMaterials.of(shiny, glossy.order, glossy.order_out, glossy.ridge)
    return {
        "diffuse": Tracing(surfaces, surfaces.receivers, BakeSettings(3, 2048, 1)),
        "glossy": GlossyPasses(surfaces, materials, glossy, {}),
    }


def test_another_process_gives_the_same_bytes(bumpy, monkeypatch):
    monkeypatch.setattr("diffprt.transfer.glossy.passes.RECEIVERS_PER_CHUNK", 256)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as other:
        for name, work in works(bumpy).items():
            left, compared = None, 0
            for number, one in enumerate(work.passes):
                assert len(one.cut) > 1
                sent, before = pickle.dumps(work), pickle.dumps(left)
                places = (0, len(one.cut) - 1)
                answers = [other.submit(chunk_bytes, sent, number, index, before) for index in places]
                for index, answer in zip(places, answers, strict=True):
                    assert answer.result(timeout=120) == chunk_bytes(sent, number, index, before), name
                    compared += 1
                with torch.no_grad():
                    work.ready(1)
                    left = work.join(number, (work.chunk(number, i, left) for i in range(len(one.cut))), left)
            assert compared == 2 * len(work.passes)


def test_what_is_heavy_is_not_pickled(bumpy):
    for work in works(bumpy).values():
        before = len(pickle.dumps(work))
        work.ready(1)
        assert len(pickle.dumps(work)) == before


def test_bake_of_a_glossy_scene_is_bake_glossy():
    scene, brdf = builtin_scene("wall_and_floor", subdivisions=1), Phong(8.0, specular=0.5)
    options = {"order": 2, "rays": 32, "bounces": 1}
    one, two = bake(scene.with_brdf(brdf), **options), bake_glossy(scene, brdf, **options)
    assert isinstance(one, GlossyTransfer) and torch.equal(one.glossy, two.glossy)
    assert one.settings == two.settings and one.scene_hash == two.scene_hash == scene.hash()
    job = prepare(scene.with_brdf(brdf), **options)
    assert job.estimate().rays == len(one.receivers) * (32 + 256) and torch.equal(job.run().glossy, one.glossy)


def test_materials_without_a_brdf_reflect_by_their_albedo_beside_others():
    scene = builtin_scene("sphere", subdivisions=1).with_ground(resolution=4)
    mixed = Scene(scene.meshes, (Material(0.5, brdf=GGX(0.4)), scene.materials[1]))
    options = {"order": 2, "rays": 32, "bounces": 0}
    found = bake(mixed, **options)
    assert found.channels == 1
    assert [b["name"] for b in found.settings["brdf"]] == ["ggx", "lambert"]
    assert found.settings["brdf"][1]["diffuse"] == pytest.approx(0.5)
    textured = Material(0.5, albedo_texture=torch.full((2, 2, 3), 0.5), name="tiles")
    with pytest.raises(InputError, match="material 'tiles' has a texture or vertex colors and stands beside BRDFs"):
        bake(Scene(scene.meshes, (Material(0.5, brdf=GGX(0.4)), textured)), **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"tolerance": 0.1}, "tolerance is given with a BRDF"), ({"operator": "stored"}, "operator is given with a BRDF")],
)
def test_what_glossy_bakes_do_not_take_is_named(bumpy, options, message):
    with pytest.raises(InputError, match=message):
        prepare(bumpy.with_brdf(GGX(0.4)), **options)


def test_what_diffuse_bakes_do_not_take_is_named(bumpy):
    with pytest.raises(InputError, match="order_out is given, and no material of scene"):
        prepare(bumpy, order_out=3)
