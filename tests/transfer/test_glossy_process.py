"""A glossy bake as a process: its estimate, its limits, its reports, and vertices in any order."""

from contextlib import contextmanager

import pytest
import torch
from tolerances import FLOAT32

from diffprt.brdf import GGX, ModifiedPhong
from diffprt.errors import InputError, Interrupted
from diffprt.options.bake import GlossySettings
from diffprt.scene import Scene
from diffprt.surface import Surfaces
from diffprt.transfer import bake_glossy, discard_chunks, prepare
from diffprt.transfer.glossy.estimate import glossy_memory


def test_order_6_and_more_go_through(bumpy):
    """Bands of visibility reach order 15 here, beyond those of lights."""
    transfer = bake_glossy(bumpy, ModifiedPhong(16.0), order=6, order_out=10, rays=32, bounces=0)
    assert transfer.glossy.shape[2:] == (100, 36) and bool(torch.isfinite(transfer.glossy).all())


def test_vertices_may_come_in_any_order(bumpy):
    """Receivers are traced along a curve; patterns follow positions, so a shuffled mesh has the same transfer."""
    mesh = bumpy.meshes[0]
    shuffle = torch.randperm(len(mesh.positions), generator=torch.Generator().manual_seed(0))
    place = torch.empty_like(shuffle)
    place[shuffle] = torch.arange(len(shuffle))
    mixed = Scene.from_mesh(mesh.positions[shuffle], place[mesh.faces], normals=mesh.normals[shuffle])
    options = {"order": 2, "rays": 64, "bounces": 1, "bounce_rays": 64}
    one, two = (bake_glossy(s, GGX(0.5), **options).glossy for s in (bumpy, mixed))
    off = (two - one[shuffle]).flatten(1).norm(dim=1) / one.flatten(1).norm(dim=1).mean()
    # A ray along an edge may go either way once the triangles have another order.
    assert float(off.median()) < FLOAT32["twin"]
    assert float(off.quantile(0.95)) < 0.02


def test_estimate_knows_sizes(bumpy, monkeypatch):
    options = {"rays": 64, "bounces": 1, "order_out": 2, "threads": 1, "hours": 1e-9}
    jobs = [prepare(bumpy.with_brdf(GGX(0.5)), order=order, **options) for order in (2, 4)]
    one, two = (job.estimate() for job in jobs)
    signal = bake_glossy(bumpy, GGX(0.5), **jobs[0].settings.as_dict()).nbytes
    assert signal < one.asset_bytes < signal + 100 * len(Surfaces.of(bumpy).receivers)
    assert two.memory_bytes > one.memory_bytes > 2 * signal
    assert one.rays == one.receivers * (64 + 256) and one.seconds > 0
    with pytest.raises(InputError, match=r"allow it with --hours \d+"):
        jobs[0].run()
    monkeypatch.setattr("diffprt.transfer.baking.estimate.available_memory", lambda: 1000)
    with pytest.raises(InputError, match=r"0\.00 GiB are free: use a lower --order \(now 2\)"):
        jobs[0].run()


def test_a_bake_beyond_memory_is_refused_before_work(bumpy, monkeypatch):
    monkeypatch.setattr("diffprt.transfer.baking.estimate.available_memory", lambda: 1 << 16)
    monkeypatch.setattr("diffprt.transfer.glossy.materials.GlossyMaterials.of", lambda *_: pytest.fail("work began"))
    with pytest.raises(InputError, match="this bake needs about"):
        bake_glossy(bumpy, GGX(0.5), order=3, rays=64)


def test_memory_grows_with_channels_and_bounces(bumpy):
    surfaces = Surfaces.of(bumpy)
    plain, bounced = GlossySettings(6, 64, 0), GlossySettings(6, 64, 2)
    signal = len(surfaces.receivers) * 36 * 36 * 4
    assert glossy_memory(surfaces, 3, plain, 1) - glossy_memory(surfaces, 1, plain, 1) >= 4 * signal
    assert glossy_memory(surfaces, 1, bounced, 1) > glossy_memory(surfaces, 1, plain, 1) + signal


def test_ctrl_c_says_what_is_lost(bumpy, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("diffprt.transfer.glossy.passes.GlossyPasses.shadows", stop)
    with pytest.raises(Interrupted, match="0 of 2 chunks were done, and nothing is kept"):
        bake_glossy(bumpy, GGX(0.5), order=2, rays=64)


@pytest.mark.parametrize("passes", [0, 1, 2])
def test_stopped_in_any_pass_and_resumed(passes, bumpy, tmp_path, monkeypatch):
    """Hard case 30: in the shadow pass, the first or the second bounce; finished chunks are not computed again."""
    monkeypatch.setattr("diffprt.transfer.glossy.passes.RECEIVERS_PER_CHUNK", 128)
    options = {"order": 2, "order_out": 3, "rays": 32, "bounces": 2, "bounce_rays": 32}
    begun = []

    @contextmanager
    def impatient(text, total, done):
        begun.append((text, total, done))
        calls = []

        def advance():
            calls.append(1)
            if len(begun) == passes + 1 and len(calls) == 3:
                raise KeyboardInterrupt

        yield advance

    brdf = GGX(0.5, diffuse=(0.3, 0.2, 0.1), specular=0.6)
    with pytest.raises(Interrupted, match=r"interrupted: \d+ of 18 chunks were done, and are kept in"):
        bake_glossy(bumpy, brdf, **options, checkpoint=tmp_path / "parts", track=impatient)
    assert [total for _, total, _ in begun] == [6] * (passes + 1)
    report: dict = {}
    resumed = bake_glossy(bumpy, brdf, **options, checkpoint=tmp_path / "parts", report=report)
    assert 6 * passes + 3 <= report["counts"]["resumed_chunks"] < 6 * (passes + 1)
    whole = bake_glossy(bumpy, brdf, **options)
    assert torch.equal(resumed.glossy, whole.glossy) and resumed.certificate == whole.certificate
    again: dict = {}
    finished = bake_glossy(bumpy, brdf, **options, checkpoint=tmp_path / "parts", report=again)
    assert again["counts"]["resumed_chunks"] == again["counts"]["chunks"] == 18
    assert torch.equal(finished.glossy, whole.glossy)
    with pytest.raises(InputError, match="chunks of a bake with other settings or another scene"):
        bake_glossy(bumpy, GGX(0.6), **options, checkpoint=tmp_path / "parts")
    discard_chunks(tmp_path / "parts")
    assert list(tmp_path.iterdir()) == []


def test_gradients_are_not_kept_on_disk(bumpy, tmp_path):
    roughness = torch.tensor(0.5, requires_grad=True)
    with pytest.raises(InputError, match="asks for gradients, which files do not keep"):
        bake_glossy(bumpy, GGX(roughness), order=2, rays=16, bounces=0, checkpoint=tmp_path / "parts")
    with torch.no_grad():
        bake_glossy(bumpy, GGX(roughness), order=2, rays=16, bounces=0, checkpoint=tmp_path / "parts")


def test_settings_hold_every_option_as_plain_values():
    settings = GlossySettings(4, 2048, 2)
    assert (settings.order_out, settings.bounce_rays) == (4, 512)
    assert GlossySettings(**settings.as_dict()) == settings
    with pytest.raises(InputError, match="order 11"):
        GlossySettings(order_out=11)
