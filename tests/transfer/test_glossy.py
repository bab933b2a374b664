"""Glossy transfer: analytic answers, laws, and twins that evaluate the BRDF along every ray."""

import math

import numpy as np
import pytest
import torch
from tolerances import FLOAT32

from diffprt import sh
from diffprt.brdf import GGX, Lambert, ModifiedPhong, Phong, fitted_matrix, hemisphere_moments
from diffprt.errors import InputError
from diffprt.kernels import TriangleMesh
from diffprt.scene import builtin_scene
from diffprt.sh.frames import tangent_frames
from diffprt.sh.product import product_matrix
from diffprt.shading import shade
from diffprt.surface import Receivers, Surfaces
from diffprt.surface.sampling import Pattern, hemisphere_directions
from diffprt.transfer import bake
from diffprt.transfer.baking.bake import bake_glossy
from diffprt.transfer.glossy.materials import GlossyMaterials
from diffprt.transfer.glossy.reference import radiance_by_rays, shadow_matrix_by_rays, visible
from diffprt.transfer.glossy.shadow_matrix import shadow_matrices
from diffprt.transfer.glossy.visibility_matrix import UniformPattern


def light_of(order: int, seed: int = 1) -> torch.Tensor:
    """Random light [K, 3] whose bands fall off as those of real maps do."""
    bands = sh.band_of_index(order)[:, None]
    light = torch.randn(order**2, 3, generator=torch.Generator().manual_seed(seed)) / (1 + 2 * bands)
    light[0] = 1.0
    return light


def rays_of(scene, step: int, rays: int, uniform: bool = False):
    """Some receivers of a scene, directions from them and what these see, by the plain-torch twin."""
    surfaces = Surfaces.of(scene)
    every = surfaces.receivers
    pick = torch.arange(0, len(every), step)
    pattern = Pattern.create(rays, surfaces.scramble(every, 0))
    pattern = UniformPattern.of(pattern) if uniform else pattern
    own = Pattern(pattern.spiral, pattern.rotation[pick], pattern.ring_shift[pick])
    directions = hemisphere_directions(every.normals[pick].double(), own)
    offset = TriangleMesh(surfaces.positions, surfaces.faces).ray_offset()
    origins = every.origins(offset)[pick].double()
    return pick, directions, visible(surfaces.positions.double(), surfaces.faces, origins, directions)


@pytest.mark.parametrize("cosine", [False, True])
def test_shadow_matrices_match_sums_over_rays(bumpy, cosine):
    """Eq. 1 ray by ray. Open directions are exact in ours and sampled in the twin: only blocked ones are compared."""
    pick, directions, shown = rays_of(bumpy, 40, 128, uniform=not cosine)
    ours = shadow_matrices(bumpy, order=4, rays=128, cosine=cosine)[pick].double()
    solid = math.pi if cosine else 2 * math.pi
    few = 2 * (~shown).sum(1) <= 128
    open_sky = sh.rotate_zonal(
        hemisphere_moments(7, cosine=cosine)[torch.arange(7) * (torch.arange(7) + 1)],
        Surfaces.of(bumpy).receivers.normals[pick].double(),
    )
    blocked = shadow_matrix_by_rays(~shown, directions, 4, solid)
    seen = shadow_matrix_by_rays(shown, directions, 4, solid)
    twin = torch.where(few[:, None, None], product_matrix(open_sky, 4, 4) - blocked, seen)
    off = (ours - twin).abs().amax((1, 2))
    # One ray of 128 that grazes an edge may differ between float32 and float64.
    assert float(off.median()) < FLOAT32["twin"]
    assert float(off.max()) < 1.5 * solid / 128 * 16 / (4 * math.pi)
    assert float(blocked.abs().amax()) > 0.05


def test_uniform_directions_are_even(bumpy):
    _, directions, _ = rays_of(bumpy, 200, 256, uniform=True)
    normals = Surfaces.of(bumpy).receivers.normals[::200].double()
    heights = (directions * normals[:, None]).sum(-1).sort(dim=1).values
    expected = (torch.arange(256, dtype=torch.float64) + 0.5) / 256
    assert float((heights - expected).abs().max()) < FLOAT32["twin"]


@pytest.mark.parametrize(("bounces", "error"), [(0, 1e-6), (2, 3e-3)])
def test_lambert_agrees_with_diffuse_transfer(bumpy, bounces, error):
    """Without bounces to rounding: the Lambertian fit is exact. With them one corner stands for each hit."""
    glossy = bake_glossy(bumpy, Lambert(0.6), order=4, rays=256, bounces=bounces, bounce_rays=256)
    diffuse = bake(bumpy.with_albedo(0.6), order=4, rays=256, bounces=bounces)
    light = light_of(4)
    expected = 0.6 / math.pi * diffuse.diffuse[:, 0] @ light
    found = shade(glossy, light, (2.0, 1.0, 3.0))
    assert float((found - expected).norm()) < error * float(expected.norm())


@pytest.mark.parametrize("kind", [Phong, ModifiedPhong])
def test_phong_seen_along_the_normal_is_a_zonal_convolution(kind):
    """An open sphere seen from straight above: the lobe is whole, radiance is light convolved with cosⁿ."""
    exponent, order = 6.0, 5
    scene = builtin_scene("sphere", subdivisions=2)
    transfer = bake_glossy(scene, kind(exponent), order=order, rays=64, bounces=0)
    power = exponent + (kind is ModifiedPhong)
    t, weight = (torch.from_numpy(v) for v in np.polynomial.legendre.leggauss(40))
    t, weight = (t + 1) / 2, weight / 2
    axis = torch.stack([(1 - t * t).sqrt(), torch.zeros_like(t), t], dim=-1)
    zonal = torch.stack(
        [2 * math.pi * (weight * t**power * sh.basis(axis, order)[:, l * (l + 1)]).sum() for l in range(order)]
    )
    light = light_of(order).double()
    lobe = (power + 1) / (2 * math.pi) * zonal
    expected = sh.evaluate(sh.convolve(light, lobe), transfer.receivers.normals.double())
    eyes = transfer.receivers.positions + 2 * transfer.receivers.normals
    found = shade(transfer, light, eyes).double()
    # What is left is exit radiance cut at order 5, towards one view.
    assert float((found - expected).norm()) < 0.015 * float(expected.norm())


@pytest.mark.parametrize(
    ("brdf", "error"), [(ModifiedPhong(8.0), 0.02), (GGX(0.5, diffuse=0.3, specular=0.6), 0.02)], ids=["phong", "ggx"]
)
def test_shadowed_radiance_agrees_with_direct_integration(bumpy, brdf, error):
    """The BRDF itself along the same rays: the error is that of the order, and falls with it."""
    pick, directions, shown = rays_of(bumpy, 29, 256)
    receivers = Surfaces.of(bumpy).receivers
    eye = torch.tensor([2.0, 1.5, 3.0])
    views = torch.nn.functional.normalize(eye - receivers.positions[pick], dim=-1).double()
    cosine = (views * receivers.normals[pick]).sum(-1).clamp_min(0)
    light = light_of(4)
    truth = radiance_by_rays(shown, directions, receivers.normals[pick].double(), brdf, light.double(), views)
    errors = []
    for order_out in (3, 5):
        transfer = bake_glossy(bumpy, brdf, order=4, order_out=order_out, rays=256, bounces=0)
        found = shade(transfer, light, eye)[pick].double()
        weighted = cosine.sqrt()[:, None]
        errors.append(float(((found - truth) * weighted).norm() / (truth * weighted).norm()))
    assert errors[1] < error
    # Near a half for both; 256 rays on one receiver in 29 leave some hundredths of it to the sample pattern.
    assert errors[1] < 0.6 * errors[0]


def test_tables_are_the_fit_times_the_shadow_matrix(bumpy):
    brdf = ModifiedPhong(10.0, diffuse=0.2, specular=(0.5, 0.4, 0.3))
    materials = GlossyMaterials.of(bumpy.with_brdf(brdf), 3, 4, 3e-4)
    visibility = torch.randn(5, 36, dtype=torch.float64, generator=torch.Generator().manual_seed(4))
    expected = fitted_matrix(brdf, 4, 4) @ product_matrix(visibility, 4, 3)[:, None]
    assert torch.allclose(materials.shade(visibility, torch.zeros(5, dtype=torch.int64)), expected, atol=1e-8)


def test_flux_never_grows(bumpy):
    """Hard case 10: under constant light a receiver sends at most what arrives, with interreflection too."""
    light = torch.zeros(16)
    light[0] = math.sqrt(4 * math.pi)
    moments = hemisphere_moments(4, cosine=True).float()
    flux = []
    for bounces in (0, 1, 3):
        transfer = bake_glossy(bumpy, ModifiedPhong(8.0), order=4, rays=256, bounces=bounces, bounce_rays=512)
        flux.append(torch.einsum("o,vok,k->v", moments, transfer.glossy[:, 0], light) / math.pi)
    # The flux is a sample mean over 256 rays of visibility and 512 of bounces: 2 % of noise.
    assert float(flux[2].max()) < 1.02
    assert bool((flux[1] > flux[0] - 1e-3).all())
    assert float(flux[2].mean()) > float(flux[1].mean()) > float(flux[0].mean())


def test_bounces_do_not_count_twice(bumpy):
    """T_b = T_0 + G T_(b-1): what bounce 2 adds is smaller than what bounce 1 adds, by about the hit fraction."""
    signals = [
        bake_glossy(bumpy, Lambert(0.9), order=2, rays=64, bounces=b, bounce_rays=64).glossy[:, 0, 0, 0]
        for b in range(3)
    ]
    first, second = (float((signals[b + 1] - signals[b]).mean()) for b in range(2))
    assert 0 < second < 0.5 * first


def test_turning_the_scene_turns_the_light(bumpy):
    """Receivers get other frames and other rays: radiance agrees to the sampling of visibility."""
    angle = 0.7
    turn = torch.eye(4, dtype=torch.float64)
    turn[0, 0] = turn[2, 2] = math.cos(angle)
    turn[0, 2], turn[2, 0] = math.sin(angle), -math.sin(angle)
    light, eye, brdf = light_of(4), torch.tensor([2.0, 1.0, -1.5]), ModifiedPhong(8.0)
    rotation = turn[:3, :3].float()
    still = shade(bake_glossy(bumpy, brdf, order=4, rays=2048, bounces=0), light, eye)
    turned = bake_glossy(bumpy.transformed(turn), brdf, order=4, rays=2048, bounces=0)
    moved = shade(turned, sh.rotate(light, rotation), rotation @ eye)
    assert float((moved - still).norm()) < 0.01 * float(still.norm())


def test_materials_by_mesh_and_colors():
    scene = builtin_scene("sphere", subdivisions=1).with_ground(resolution=4)
    shiny, matte = GGX(0.4, specular=(0.9, 0.6, 0.3)), Lambert(0.5)
    both = bake_glossy(scene, [shiny, matte], order=3, rays=64, bounces=0)
    assert both.glossy.shape[1:] == (3, 9, 9)
    ball = torch.arange(len(both.receivers)) < len(scene.meshes[0].positions)
    alone = bake_glossy(scene, shiny, order=3, rays=64, bounces=0)
    assert torch.allclose(both.glossy[ball], alone.glossy[ball], atol=FLOAT32["rounding"])
    plain = bake_glossy(scene, matte, order=3, rays=64, bounces=0)
    assert torch.allclose(both.glossy[~ball], plain.glossy[~ball].expand(-1, 3, -1, -1), atol=FLOAT32["rounding"])
    with pytest.raises(InputError, match="3 BRDFs for 2 materials"):
        bake_glossy(scene, [shiny, matte, matte], order=3, rays=64)


def test_same_bytes_for_any_number_of_threads(bumpy):
    options = {"order": 3, "rays": 64, "bounces": 1, "bounce_rays": 64}
    one, two = (bake_glossy(bumpy, GGX(0.4), threads=t, **options) for t in (1, 2))
    assert torch.equal(one.glossy, two.glossy)
    assert one.certificate == two.certificate
    assert one.settings == two.settings


def test_gradients_reach_the_brdf_through_bounces():
    scene = builtin_scene("wall_and_floor", subdivisions=2)
    light, eye = light_of(3), (3.0, 2.0, 1.0)

    def radiance(exponent: torch.Tensor, diffuse: torch.Tensor) -> torch.Tensor:
        brdf = ModifiedPhong(exponent, diffuse=diffuse, specular=0.5)
        return shade(bake_glossy(scene, brdf, order=3, rays=64, bounces=2, bounce_rays=64), light, eye).mean()

    parameters = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (6.0, 0.3)]
    radiance(*parameters).backward()
    with torch.no_grad():
        for index, step in enumerate((0.3, 0.02)):
            moved = [[p + s * step * (i == index) for i, p in enumerate(parameters)] for s in (1, -1)]
            difference = (radiance(*moved[0]) - radiance(*moved[1])) / (2 * step)
            # Transfer is float32, and the step finite.
            assert float(parameters[index].grad) == pytest.approx(float(difference), rel=1e-2)


def test_certificate_bounds_the_error(bumpy):
    """Even against odd rays errs on the safe side, but not wildly."""
    few, many = (bake_glossy(bumpy, ModifiedPhong(8.0), order=3, rays=r, bounces=0) for r in (128, 8192))
    from diffprt.brdf import hemisphere_gram

    gram = hemisphere_gram(3, cosine=True).float()
    off = (few.glossy - many.glossy)[:, 0]
    error = float((off * (gram @ off)).sum((1, 2)).mean().sqrt())
    assert 0.3 * error < few.certificate["noise_rms"] < 10 * error


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"order": 0}, "order 0"),
        ({"order_out": 11}, "order 11"),
        ({"bounce_rays": 0}, "bounce_rays is 0"),
        ({"rays": 0}, "rays is 0"),
        ({"bounces": "converged"}, "bounces is 'converged'"),
        ({"ridge": -1.0}, "ridge is -1"),
    ],
)
def test_bad_options_are_named(bumpy, options, message):
    with pytest.raises(InputError, match=message):
        bake_glossy(bumpy, Lambert(0.5), **{"order": 3, "rays": 64, **options})


def test_free_receivers_are_refused_by_shape():
    from diffprt.transfer.glossy.signal import GlossyTransfer

    receivers = Receivers.points(torch.zeros(2, 3), torch.tensor([[0.0, 0, 1], [0, 1, 0]]))
    with pytest.raises(InputError, match="glossy transfer has shape"):
        GlossyTransfer(torch.zeros(2, 2, 9, 9), receivers)
    transfer = GlossyTransfer(torch.zeros(2, 1, 16, 9), receivers)
    assert (transfer.order, transfer.order_out, transfer.channels, transfer.nbytes) == (3, 4, 1, 2 * 16 * 9 * 4)
    assert torch.allclose(transfer.frames, tangent_frames(receivers.normals))
