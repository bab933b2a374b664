"""A kind that is defined here is exported by one decorated function; what it lacks is told in one line."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import pytest
import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.exporters import Packed, export, export_glb, pack
from diffprt.exporters.gltf.three_module import three_kinds
from diffprt.exporters.packers.packed import floats, surface_arrays
from diffprt.exporters.web.template import page_classes
from diffprt.rendering import render
from diffprt.representation import ConstantBasis, Lighting, Lit, Provenance, Representation, TensorSpec
from diffprt.scene import Camera
from diffprt.shading import tone_map
from diffprt.surface import Receivers


@dataclass(frozen=True)
class OpenSky(Representation):
    """The unshadowed sky over every receiver, dimmed: one number each."""

    name: ClassVar[str] = "open_sky"
    description: ClassVar[str] = "share of the open sky"
    spec: ClassVar = {"share": TensorSpec(("V",), per_element=True, trainable=True)}
    elements_type: ClassVar = Receivers
    order: ClassVar[int] = 3

    share: torch.Tensor
    elements: Receivers = None  # a default, so that the field stands for the interface's property
    provenance: Provenance = field(default_factory=Provenance)

    def transfer(self) -> torch.Tensor:
        cosine = sh.rotate_zonal(sh.clamped_cosine(self.order), self.elements.normals.double())
        return self.share[:, None] * cosine.float()

    def lit(self, lighting, *, albedo=None) -> Lit:
        light = Lighting.of(lighting).coefficients(self.order, self.name)
        albedo = self.elements.albedo if albedo is None else albedo
        return Lit((albedo / torch.pi * (self.transfer() @ light))[:, :, None], ConstantBasis())


@pytest.fixture
def registered():
    """A packer for the new kind, one of whose fields a test may take away."""
    without: dict = {}

    def pack_open_sky(asset: OpenSky) -> Packed:
        packed = Packed(
            kind="open_sky",
            page="diffuse",
            programs=("diffuse",),
            geometry=surface_arrays(asset.elements, albedo=True),
            signal={"transfer": floats(asset.transfer())[:, None]},
            numbers={"channels": 1, "coefficients": asset.order**2},
            facts={"order": asset.order, "channels": 1},
            equation="radiance = albedo / pi * sum_k transfer[vertex, k] light[k]",
            tables=("transfer",),
        )
        return replace(packed, **without)

    pack.register(pack_open_sky)
    return without


@pytest.fixture
def open_sky(plain) -> OpenSky:
    share = 0.6 + 0.3 * torch.sin(4 * plain.elements.positions[:, 0])
    return OpenSky(share, plain.elements)


def test_a_new_kind_is_drawn_as_it_is_rendered(open_sky, registered, synthetic, tmp_path, open_page) -> None:
    export(open_sky, tmp_path)
    page = open_page(tmp_path / "index.html")
    camera = Camera((2.1, 1.3, -3.4), (0.1, -0.05, 0.0), fov=38.0, width=128, height=96)
    light = synthetic.random_light(3, 5)
    near, far = camera.depth_range(open_sky.elements.positions)
    matrices = {"view": camera.view(), "projection": camera.projection(near, far)}
    page.calls(
        ("setCamera", {key: value.flatten().tolist() for key, value in matrices.items()}),
        ("setLight", light.coefficients.flatten().tolist()),
        ("setExposure", 0.5),
        ("setCurve", "aces"),
        ("resize", camera.width, camera.height),
    )
    picture, mask = page.pixels()
    expected = tone_map(render(open_sky, light, camera), exposure=0.5, curve="aces").numpy()
    shown = mask & open_sky.elements.view(camera).mask.numpy()
    error = np.abs(picture - expected)[shown]
    assert shown.mean() > 0.2 and expected[shown].std() > 0.05
    assert np.quantile(error, 0.95) <= 1.5 / 255


def test_a_new_kind_goes_into_gltf_with_its_equation(open_sky, registered, tmp_path) -> None:
    export_glb(open_sky, tmp_path / "a.glb")
    content = (tmp_path / "a.glb").read_bytes()
    assert "open_sky" not in three_kinds()
    assert b'"kind":"open_sky"' in content and b"sum_k transfer[vertex, k] light[k]" in content


@pytest.mark.parametrize(
    ("without", "words"),
    [
        ({"equation": ""}, "'open_sky' has no equation"),
        ({"page": ""}, "'open_sky' names the page class '', which"),
        ({"page": "open_sky"}, "name one of diffuse, unshadowed, clustered_diffuse, glossy, clustered_glossy in its"),
    ],
)
def test_what_a_new_kind_lacks_is_told(without, words, open_sky, registered, tmp_path) -> None:
    registered.update(without)
    with pytest.raises(InputError, match=words) as caught:
        (export_glb if "equation" in without else export)(open_sky, tmp_path / "a")
    assert "\n" not in str(caught.value)


def test_a_kind_that_nothing_packs_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"asset is a dict, which has no shader: give a Transfer or .*pack.register"):
        pack({})


def test_passes_are_refused_by_kinds_drawn_in_one(plain, clustered, glossy_assets) -> None:
    assert pack(clustered).in_passes(18).facts["passes"] > 1
    for asset in (plain, *glossy_assets):
        assert pack(asset).in_passes(None).page in page_classes()
        with pytest.raises(InputError, match="drawn in one pass: leave registers out"):
            pack(asset).in_passes(64)
