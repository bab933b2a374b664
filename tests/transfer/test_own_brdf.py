"""A BRDF of a user's own, wherever it flows: it works, or one line says why not."""

import json
import math
import warnings
from dataclasses import dataclass

import pytest
import representations as kinds
import torch

from diffprt import Light, bake, bake_glossy, compress, export, load, render, save, shade
from diffprt.brdf import Brdf, Lambert, ModifiedPhong, brdf_matrix, describe_brdf
from diffprt.brdf.local import cosine_pdf, cosine_sample
from diffprt.cli import main
from diffprt.errors import InputError, Interrupted
from diffprt.scene import Camera, Material
from diffprt.study.mitsuba.bsdf import mitsuba_bsdf

BAKE = {"order": 3, "rays": 32, "bounces": 1}


class Even(Brdf):
    """The same in every direction; no dataclass, no parameters."""

    @property
    def width(self):
        return 1.0

    def lobe(self, incoming, outgoing):
        return torch.full_like(incoming[..., :1], 1 / math.pi)

    def sample_lobe(self, outgoing, u):
        return cosine_sample(u)

    def lobe_pdf(self, incoming, outgoing):
        return cosine_pdf(incoming)


@dataclass(frozen=True)
class Table(Even):
    """Measured: a table over the cosine of the incident angle."""

    table: torch.Tensor | None = None

    def lobe(self, incoming, outgoing):
        place = (incoming[..., 2] * (len(self.table) - 1)).long().clamp(0, len(self.table) - 1)
        return self.table[place][..., None]


@dataclass(frozen=True)
class Called(Even):
    """Holds a function, which no file records."""

    falloff: object = torch.ones_like

    def lobe(self, incoming, outgoing):
        return self.falloff(incoming[..., 2:]) / math.pi


@dataclass(frozen=True)
class MyPhong(ModifiedPhong):
    pass


def test_it_bakes_what_the_known_one_bakes():
    known = bake_glossy(kinds.ball(), ModifiedPhong(8.0, specular=0.7), **BAKE)
    own = bake_glossy(kinds.ball(), MyPhong(8.0, specular=0.7), **BAKE)
    assert torch.equal(own.glossy, known.glossy)
    even = bake_glossy(kinds.ball(), Even(specular=0.5), **BAKE)
    assert torch.allclose(even.glossy, bake_glossy(kinds.ball(), Lambert(0.5), **BAKE).glossy, atol=1e-5)
    material = bake(kinds.ball().with_brdf([Even(specular=0.5)]), **BAKE)
    assert torch.equal(material.glossy, even.glossy) and material.scene_hash == even.scene_hash


def test_float32_lobes_and_gradients_work():
    class Single(Even):
        def lobe(self, incoming, outgoing):
            return torch.full((*incoming.shape[:-1], 1), 1 / math.pi, dtype=torch.float32)

    specular = torch.tensor(0.5, dtype=torch.float64, requires_grad=True)
    bake_glossy(kinds.ball(), Single(specular=specular), **BAKE).glossy.square().sum().backward()
    assert float(specular.grad) > 0


def test_its_description_is_saved_and_shown(tmp_path, capsys):
    own = Table(specular=0.5, table=torch.linspace(0.1, 0.3, 200, dtype=torch.float64))
    asset = bake_glossy(kinds.ball(), own, **BAKE)
    (described,) = asset.settings["brdf"]
    assert described["name"].endswith("Table") and described["specular"] == 0.5
    assert described["table"].startswith("float64 [200] sha256 ") and describe_brdf(own) == described
    assert describe_brdf(Table(table=own.table * 2))["table"] != described["table"]
    save(compress(asset, clusters=3, components=2), tmp_path / "a.prt")
    back = load(tmp_path / "a.prt")
    assert back.settings["brdf"] == [described]
    with pytest.raises(SystemExit):
        main(["info", str(tmp_path / "a.prt")])
    assert "Table" in capsys.readouterr().out
    assert not shade(back, Light(torch.ones(9, 3)), (0, 0, 3)).isnan().any()


def test_what_no_file_records_is_used_and_not_saved(tmp_path):
    with pytest.warns(UserWarning, match="can be used and not saved: Called has 'falloff'"):
        asset = bake_glossy(kinds.ball(), Called(specular=0.5), **BAKE)
    assert torch.allclose(asset.glossy, bake_glossy(kinds.ball(), Even(specular=0.5), **BAKE).glossy, atol=1e-6)
    light = Light(torch.ones(9, 3))
    assert bool(render(asset, light, Camera.framing(asset.receivers.positions, width=16, height=16)).any())
    export(asset, tmp_path / "page", lights={"light": light})
    json.dumps(asset.settings)
    for kept in (asset, compress(asset, clusters=3, components=2), asset.with_signal(2 * asset.glossy)):
        with pytest.raises(InputError, match="cannot be saved: Called has 'falloff', which assets") as caught:
            save(kept, tmp_path / "a.prt")
        assert "\n" not in str(caught.value) and not (tmp_path / "a.prt").exists()


def test_chunks_of_another_of_the_same_name_are_refused(tmp_path):
    def named(factor):
        class Changed(Even):
            def lobe(self, incoming, outgoing):
                return super().lobe(incoming, outgoing) * factor

        return Changed(specular=0.5)

    assert describe_brdf(named(1.0)) == describe_brdf(named(0.5))
    first = bake_glossy(kinds.ball(), named(1.0), **BAKE, checkpoint=tmp_path / "chunks")
    again = bake_glossy(kinds.ball(), named(1.0), **BAKE, checkpoint=tmp_path / "chunks")
    assert torch.equal(first.glossy, again.glossy)
    with pytest.raises((InputError, Interrupted), match="another"):
        bake_glossy(kinds.ball(), named(0.5), **BAKE, checkpoint=tmp_path / "chunks")


@pytest.mark.parametrize("own", [Even(), MyPhong(8.0)])
def test_a_comparison_with_mitsuba_does_not_take_it_for_another(own):
    with pytest.raises(InputError, match=f"Mitsuba has no {type(own).__name__}"):
        mitsuba_bsdf(None, own)


def changed(**methods):
    return type("Changed", (Even,), methods)


class NoWeights(Even):
    def __init__(self):
        object.__setattr__(self, "power", 2.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (changed(lobe=lambda s, i, o: i[..., 2]), r"Changed.lobe gives \[64\] for \[64, 3\]: give \[64, 1\]"),
        (changed(lobe=lambda s, i, o: 0.5), "Changed.lobe gives float"),
        (changed(lobe=lambda s, i, o: i.abs()), "3 colors and channels is 1"),
        (changed(lobe=lambda s, i, o: i[..., 2:] * math.nan), "a value of nan"),
        (changed(lobe=lambda s, i, o: -i[..., 2:]), "a value of -0"),
        (changed(lobe=lambda s, i, o: i[..., :1].abs()), "not isotropic, it changes by"),
        (changed(width=0.0), "Changed.width is 0.0"),
        (changed(width=math.inf), "Changed.width is inf"),
        (NoWeights, r"NoWeights has an unchecked diffuse: call super\(\).__init__"),
    ],
)
def test_one_of_which_no_table_can_be_made_is_refused(make, message):
    for use in (lambda: bake_glossy(kinds.ball(), make(), **BAKE), lambda: brdf_matrix(make(), 3, 3)):
        with warnings.catch_warnings(), pytest.raises(InputError, match=message) as caught:
            warnings.simplefilter("ignore")
            use()
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("brdf", [Even, lambda i, o: 1.0, "ggx", None])
def test_what_is_no_brdf_is_refused(brdf):
    with pytest.raises(InputError, match=r"give a diffprt\.brdf\.Brdf, such as GGX"):
        bake_glossy(kinds.ball(), brdf, **BAKE)
    if brdf is not None:
        with pytest.raises(InputError, match=r"give a diffprt\.brdf\.Brdf, such as GGX"):
            Material(0.5, brdf=brdf)
