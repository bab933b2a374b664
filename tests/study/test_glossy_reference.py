"""Glossy pictures beside Mitsuba's: every BRDF agrees, and what Mitsuba does not know is named before any work."""

import pytest
import torch

from diffprt.brdf import GGX, Conductor, CookTorrance, Lambert, ModifiedPhong, Phong, Schlick
from diffprt.errors import InputError
from diffprt.study.mitsuba import scene as peer_scene
from diffprt.study.mitsuba.bsdf import mitsuba_bsdf
from diffprt.study.reference.study import reference_study


@pytest.fixture(scope="module")
def mitsuba():
    pytest.importorskip("mitsuba")
    return peer_scene.start_mitsuba()[0]


BRDFS = [
    Lambert((0.6, 0.5, 0.4)),
    Phong(12.0, diffuse=0.3, specular=(0.6, 0.5, 0.4)),
    ModifiedPhong(12.0),
    CookTorrance(0.4, masking="smith", fresnel=Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.1))),
    GGX(0.5, diffuse=(0.3, 0.2, 0.1), specular=0.6),
]


@pytest.mark.parametrize("brdf", BRDFS, ids=lambda b: type(b).__name__)
def test_lobes_are_those_of_mitsuba(mitsuba, brdf):
    """rho times cosine at random pairs of directions, the density of sampling included."""
    import drjit

    generator = torch.Generator().manual_seed(0)
    pairs = torch.nn.functional.normalize(torch.randn(2, 400, 3, generator=generator), dim=-1)
    bsdf = mitsuba.load_dict(mitsuba_bsdf(mitsuba, brdf))
    context, found, density = mitsuba.BSDFContext(), [], []
    for towards_light, towards_eye in pairs.transpose(0, 1).tolist():
        at = drjit.zeros(mitsuba.SurfaceInteraction3f)
        at.wi = mitsuba.Vector3f(towards_eye)
        out = mitsuba.Vector3f(towards_light)
        found.append([float(v[0]) if hasattr(v, "__len__") else float(v) for v in bsdf.eval(context, at, out)])
        pdf = bsdf.pdf(context, at, out)
        density.append(float(pdf[0]) if hasattr(pdf, "__len__") else float(pdf))
    expected = brdf.evaluate(*pairs.double()) * pairs[0, :, 2:].clamp_min(0)
    found = torch.tensor(found, dtype=torch.float64)
    assert int((expected > 0).all(1).sum()) > 50
    # Mitsuba's Smith term of Beckmann's distribution is a rational fit, good to 0.35 % (Walter et al. 2007).
    tolerance = 8e-3 if isinstance(brdf, CookTorrance) else 1e-3
    assert torch.allclose(found, expected.expand(-1, 3), rtol=tolerance, atol=1e-4)
    assert all(d > 0 for d, e in zip(density, expected[:, 0], strict=True) if e > 1e-3)


def test_the_study_with_a_glossy_brdf(mitsuba, tmp_path):
    report = reference_study(
        "builtin:sphere",
        ["studio"],
        tmp_path,
        order=3,
        order_out=5,
        rays=64,
        bounces=0,
        size=32,
        samples=256,
        brdf=[ModifiedPhong(6.0)],
    )
    (row,) = report["rows"]
    assert row["relative_rmse"] < 0.03
    assert row["mean_ratio"] == pytest.approx(1, abs=0.02)
    assert report["settings"]["brdf"] == [{"name": "modified-phong", "diffuse": 0.0, "specular": 1.0, "exponent": 6.0}]
    assert len(list(tmp_path.iterdir())) == 4


@pytest.mark.parametrize(
    ("brdf", "message"),
    [
        (CookTorrance(0.3), "masking is 'v-cavity' and Mitsuba has Smith's alone: give masking=smith"),
        (GGX(0.3, diffuse=(0.5, 0.1, 0.1), specular=(0.1, 0.1, 0.6)), "weights add up to 1.1"),
        (GGX(0.3, fresnel=Schlick(0.04)), "Mitsuba has no Schlick term: give eta and k"),
    ],
)
def test_what_mitsuba_has_not_is_named(mitsuba, brdf, message, tmp_path):
    with pytest.raises(InputError, match=message):
        reference_study("builtin:sphere", ["studio"], tmp_path / "never", brdf=[brdf])
    assert not (tmp_path / "never").exists()


def test_albedo_beside_a_brdf_is_refused(mitsuba, tmp_path):
    with pytest.raises(InputError, match="albedo is given with brdf"):
        reference_study("builtin:sphere", ["studio"], tmp_path, brdf=[GGX(0.3)], albedo=0.5)
