"""BRDFs as plain values and as text: what goes out comes back, and mistakes are named."""

import json
from dataclasses import dataclass

import pytest
import torch
from tolerances import FLOAT32

from diffprt.brdf import (
    BRDFS,
    GGX,
    Conductor,
    CookTorrance,
    Lambert,
    ModifiedPhong,
    Phong,
    Schlick,
    brdf_of,
    describe_brdf,
    parse_brdf,
)
from diffprt.errors import InputError

EXAMPLES = [
    Lambert((0.6, 0.5, 0.4)),
    Phong(16.0, diffuse=0.4, specular=0.5),
    ModifiedPhong(torch.tensor(7.5), specular=(0.9, 0.6, 0.3)),
    CookTorrance(0.2, fresnel=Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.1))),
    GGX(0.4, fresnel=Schlick(0.04), masking="v-cavity", diffuse=0.3, specular=0.7),
]


@pytest.mark.parametrize("brdf", EXAMPLES, ids=lambda b: type(b).__name__)
def test_plain_values_come_back(brdf):
    plain = json.loads(json.dumps(describe_brdf(brdf)))
    back = brdf_of(plain)
    assert type(back) is type(brdf) and describe_brdf(back) == plain
    directions = torch.nn.functional.normalize(torch.rand(2, 50, 3, dtype=torch.float64) + 0.1, dim=-1)
    assert torch.allclose(back.evaluate(*directions), brdf.evaluate(*directions), rtol=FLOAT32["rounding"])


def test_every_brdf_has_a_name():
    assert {type(brdf) for brdf in EXAMPLES} == set(BRDFS.values())
    for name, kind in BRDFS.items():
        assert type(parse_brdf(name)) is kind


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("phong:exponent=16,specular=0.5", Phong(16.0, specular=0.5)),
        ("GGX:roughness=0.2,specular=0.9,0.6,0.3", GGX(0.2, specular=(0.9, 0.6, 0.3))),
        ("cook-torrance:masking=smith,f0=0.9", CookTorrance(masking="smith", fresnel=Schlick(0.9))),
        ("ggx:eta=0.2,k=3.9", GGX(fresnel=Conductor(0.2, 3.9))),
    ],
)
def test_text(text, expected):
    assert describe_brdf(parse_brdf(text)) == describe_brdf(expected)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shiny", "'shiny' is unknown: use one of lambert, phong"),
        ("phong:roughness=0.3", "phong has no parameter 'roughness': give diffuse, specular, exponent"),
        ("phong:exponent=2e6", "exponent is 2000000.0: give 0 to 1e"),
        ("phong:exponent=-1", "exponent is -1.0"),
        ("phong:exponent=", "exponent is ''"),
        ("phong:specular=0.5,0.5", "specular is '0.5,0.5': give one number, or three"),
        ("phong:16", "has '16' without a parameter"),
        ("phong:exponent=1,exponent=2", "gives exponent twice"),
        ("phong:diffuse=0.5", "add up to 1.5"),
        ("ggx:roughness=0", "roughness is 0.0: give 0.001 to 1"),
        ("ggx:roughness=nan", "roughness is nan"),
        ("ggx:masking=none", "masking 'none' is unknown"),
        ("ggx:eta=2", "eta stands alone"),
        ("ggx:f0=0.5,k=2", "f0 stands beside eta or k"),
        ("lambert:specular=1", "lambert has no parameter 'specular'"),
    ],
)
def test_mistakes_are_named(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_brdf(text)
    assert text in str(caught.value) and "\n" not in str(caught.value)


@dataclass(frozen=True)
class Shiny(GGX):
    """A user's own BRDF: a lobe with a parameter of its own."""

    tint: tuple | torch.Tensor = 0.5
    kind: str = "satin"


def test_a_users_own_brdf_describes_itself_or_says_why_not():
    assert "tint" in Shiny.parameters() and "f0" in Shiny.parameters()
    plain = describe_brdf(Shiny(0.25, fresnel=Schlick(0.5), tint=0.75))
    assert plain["name"].endswith("Shiny") and (plain["tint"], plain["f0"], plain["kind"]) == (0.75, 0.5, "satin")
    with pytest.raises(InputError, match="Shiny has 'tint', which assets cannot record"):
        describe_brdf(Shiny(tint=(0.1, 0.2, 0.3)))
    marked = GGX(0.5)
    object.__setattr__(marked, "notes", [1])
    with pytest.raises(InputError, match="GGX has 'notes'"):
        describe_brdf(marked)
