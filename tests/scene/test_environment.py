"""Environments: conventions, bad texels, probes, projection, and the procedural sky and studio."""

import math
import warnings

import numpy as np
import pytest
import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.images import write_image
from diffprt.scene import (
    BUILTIN_ENVIRONMENTS,
    Environment,
    builtin_environment,
    load_environment,
    sky_environment,
    studio_environment,
)
from diffprt.scene.probe import equirect_from_probe
from diffprt.scene.sky import sky_luminance, sun_direction

AXES = {"up": (0, 1, 0), "down": (0, -1, 0), "forward": (0, 0, -1), "back": (0, 0, 1), "right": (1, 0, 0)}
# Row and column as shares of the map, by the convention that diffprt.sh states.
PLACES = {"up": (0, 0.5), "down": (1, 0.5), "forward": (0.5, 0.5), "back": (0.5, 0), "right": (0.5, 0.75)}


@pytest.mark.parametrize("where", AXES)
def test_a_bright_texel_shines_from_where_the_convention_says(tmp_path, where):
    image = torch.zeros(64, 128, 3)
    row, column = PLACES[where]
    image[min(int(row * 64), 63), min(int(column * 128), 127)] = 100.0
    write_image(tmp_path / "a.exr", image)
    light = Environment.load(tmp_path / "a.exr").project(4)
    directions = torch.tensor(list(AXES.values()), dtype=torch.float32)
    brightest = int(light.radiance(directions)[:, 0].argmax())
    assert list(AXES)[brightest] == where
    # Band 1 is sqrt(3 / 4 pi) (-y, z, -x).
    y, z, x = light.coefficients[1:4, 0]
    assert torch.allclose(
        torch.nn.functional.normalize(torch.stack([-x, -y, z]), dim=0),
        torch.tensor(AXES[where], dtype=torch.float32),
        atol=0.05,
    )


def _bad_image():
    image = torch.ones(8, 16, 3)
    image[0, 0, 1] = float("nan")
    image[1, :2] = float("inf")
    image[2, :3, 0] = -2.0
    image[3, 0] = float("-inf")
    return image


def test_bad_texels_are_counted_and_zeroed_never_silently(tmp_path):
    write_image(tmp_path / "bad.exr", _bad_image())
    with pytest.warns(UserWarning, match="3 negative, 1 nan, 3 infinite"):
        loud = Environment.load(tmp_path / "bad.exr")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        quiet = Environment.load(tmp_path / "bad.exr", bad_texels="zero")
    for environment in (loud, quiet):
        assert {k: environment.report[k] for k in ("negative", "nan", "infinite", "texels")} == {
            "negative": 3,
            "nan": 1,
            "infinite": 3,
            "texels": 128,
        }
        # Only the bad channels go.
        assert environment.image[0, 0].tolist() == [1, 0, 1] and environment.image[2, 0].tolist() == [0, 1, 1]
        assert float(environment.image[1, :2].max()) == 0 and bool(torch.isfinite(environment.image).all())
    with pytest.raises(InputError, match="bad texels"):
        Environment.load(tmp_path / "bad.exr", bad_texels="refuse")
    with pytest.raises(InputError, match="bad_texels='ignore'"):
        Environment.load(tmp_path / "bad.exr", bad_texels="ignore")


def test_a_sun_is_not_clamped_and_its_projection_is_the_sum(tmp_path):
    sky, sun = torch.rand(32, 64, 3), torch.zeros(32, 64, 3)
    sun[6, 20] = 1e5
    write_image(tmp_path / "a.exr", sky + sun)
    loaded = Environment.load(tmp_path / "a.exr")
    assert float(loaded.image.max()) >= 1e5
    apart = Environment(sky).project(5).coefficients + Environment(sun).project(5).coefficients
    assert torch.allclose(loaded.project(5).coefficients, apart, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("ending", [".png", ".exr"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_gray_and_alpha_are_read_and_png_is_made_linear(tmp_path, ending, channels):
    write_image(tmp_path / f"a{ending}", torch.full((4, 8, channels), 0.5))
    environment = Environment.load(tmp_path / f"a{ending}")
    stored = 0.5 if ending == ".exr" else ((128 / 255 + 0.055) / 1.055) ** 2.4
    assert torch.allclose(environment.image, torch.full((4, 8, 3), stored), atol=1e-6)
    assert environment.report["gray"] == (channels == 1)
    assert environment.report["alpha_dropped"] == (channels == 4)


def test_other_shapes_name_the_remedy(tmp_path):
    write_image(tmp_path / "square.exr", torch.ones(8, 8, 3))
    write_image(tmp_path / "wide.exr", torch.ones(4, 12, 3))
    with pytest.raises(InputError, match=r"8 x 8.*projection='angular'"):
        Environment.load(tmp_path / "square.exr")
    with pytest.raises(InputError, match="resample it to 12 x 6"):
        Environment.load(tmp_path / "wide.exr")
    with pytest.raises(InputError, match="a probe is square"):
        Environment.load(tmp_path / "wide.exr", projection="angular")
    with pytest.raises(InputError, match="projection='cube'"):
        Environment.load(tmp_path / "square.exr", projection="cube")
    for image in (torch.ones(4, 8), torch.ones(4, 8, 4), torch.ones(4, 8, 3, dtype=torch.int64)):
        with pytest.raises(InputError, match="shape"):
            Environment(image)
    with pytest.raises(InputError, match="1 texels that are not finite"):
        Environment(torch.full((1, 2, 3), 1.0).index_fill(1, torch.tensor([0]), float("nan")))


def _probe(function, size, projection):
    """A probe of a function of direction, by the inverse of the mapping under test."""
    step = (torch.arange(size) + 0.5) / size * 2 - 1
    x, y = step[None, :].expand(size, size), -step[:, None].expand(size, size)
    radius = torch.sqrt(x * x + y * y)
    angle = radius * math.pi if projection == "angular" else 2 * torch.asin(radius.clamp(max=1))
    scale = torch.sin(angle) / radius.clamp_min(1e-9)
    return function(torch.stack([x * scale, y * scale, -torch.cos(angle)], dim=-1))


@pytest.mark.parametrize("projection", ["angular", "mirror_ball"])
def test_probes_become_the_map_of_the_same_light(tmp_path, projection):
    def light(d):
        return 2 + torch.stack([d[..., 0], d[..., 1], d[..., 2]], dim=-1)

    write_image(tmp_path / "probe.exr", _probe(light, 256, projection))
    environment = Environment.load(tmp_path / "probe.exr", projection=projection)
    assert tuple(environment.image.shape) == (128, 256, 3)
    directions = sh.map_directions(128, 256)
    # A mirror ball holds the directions near +z in its last texels.
    seen = directions[..., 2] < (0.99 if projection == "angular" else 0.9)
    assert float((environment.image - light(directions)).abs()[seen].max()) < 0.02
    with pytest.raises(InputError, match="square"):
        equirect_from_probe(torch.ones(4, 8, 3), projection)


def test_projection_reports_what_it_costs_and_carries_gradients():
    image = torch.zeros(32, 64, 3)
    image[4:8, 10:14] = 50.0
    environment = Environment(image.requires_grad_())
    plain, windowed = environment.project(4), environment.project(4, window="auto")
    assert 0 < plain.report["energy_captured"] < 0.5 and plain.report["minimum"] < 0
    assert 0.1 < plain.report["negative_fraction"] < 0.6
    assert windowed.report["minimum"] >= -1e-3 and windowed.report["contrast_cost"] > 0
    plain.coefficients.sum().backward()
    assert float(image.grad.abs().max()) > 0
    constant = builtin_environment("constant", height=16).project(3)
    assert constant.report["energy_captured"] == pytest.approx(1, abs=1e-5)
    assert constant.report["negative_fraction"] == 0
    assert torch.allclose(constant.radiance(torch.tensor([0.0, 0.6, 0.8])), torch.ones(3), atol=1e-5)
    with pytest.raises(InputError):
        environment.project(3, window="triangle")


def _irradiance(image):
    rows = sh.row_weights(*image.shape[:2])
    up = sh.map_directions(*image.shape[:2], torch.float64)[..., 1].clamp_min(0)
    return torch.einsum("hwc,hw,h->c", image.double(), up, rows)


@pytest.mark.parametrize("elevation", [8, 45, 90])
def test_sky_is_exposed_and_its_sun_is_where_it_was_asked(elevation):
    height, azimuth = 256, math.radians(250)
    environment = sky_environment(height, sun_elevation=math.radians(elevation), sun_azimuth=azimuth)
    image = environment.image
    # The exposure is fixed on smooth integrals: a texel is 0.7 degree, the sun may sit half of it lower.
    assert float(_irradiance(image).mean()) == pytest.approx(math.pi, rel=0.02)
    assert float(image.min()) >= 0
    brightest = int(image.sum(dim=-1).argmax())
    direction = sh.map_directions(height, 2 * height).reshape(-1, 3)[brightest]
    expected = sun_direction(math.radians(elevation), azimuth).float()
    assert math.degrees(math.acos(min(float(direction @ expected), 1))) < 0.7
    blue = sky_environment(64, sun_elevation=math.radians(45), sun=False).image[4, 40]
    assert blue[2] > 1.3 * blue[0]


def test_sun_energy_does_not_depend_on_resolution():
    energy, band = [], []
    for height in (64, 128, 256, 512):
        with_sun = sky_environment(height)
        sun = with_sun.image.double() - sky_environment(height, sun=False).image.double()
        energy.append(torch.einsum("hwc,h->c", sun, sh.row_weights(height, 2 * height)))
        band.append(with_sun.project(4).coefficients)
    for i in range(3):
        assert torch.allclose(energy[i], energy[3], rtol=1e-5)
        # What is left is the place of the sun within its texel.
        assert float((band[i] - band[3]).abs().max() / band[3].abs().max()) < 0.01


def test_sky_follows_preetham():
    """At the zenith the model gives the zenith's own luminance and chromaticity: eq. of appendix A.2."""
    sun = sun_direction(math.radians(45), 0.0)
    rgb = sky_luminance(torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64), sun, 2.5)
    expected = (4.0453 * 2.5 - 4.9710) * math.tan((4 / 9 - 2.5 / 120) * (math.pi / 2)) - 0.2155 * 2.5 + 2.4192
    assert float(rgb @ torch.tensor([0.2126729, 0.7151522, 0.0721750], dtype=torch.float64)) == pytest.approx(
        expected, rel=1e-4
    )
    assert rgb[2] > rgb[1] > rgb[0]


@pytest.mark.parametrize(
    "arguments",
    [
        {"sun_elevation": 0.0},
        {"sun_elevation": 2.0},
        {"turbidity": 1.0},
        {"ground_albedo": 1.5},
        {"height": 1},
    ],
)
def test_sky_arguments_are_checked(arguments):
    with pytest.raises(InputError, match=next(iter(arguments))):
        sky_environment(**arguments)


def test_studio_has_mean_one_and_its_key_light_on_the_upper_left():
    environment = studio_environment(128)
    assert float(environment.mean.mean()) == pytest.approx(1, rel=1e-5)
    assert 0 < float(environment.image.min()) < 0.2 and float(environment.image.max()) > 5
    row, column = divmod(int(environment.image[:, 64:128].sum(dim=-1).argmax()), 64)
    assert row < 60 and column < 60
    coarse, fine = studio_environment(64).project(4), studio_environment(256).project(4)
    assert torch.allclose(coarse.coefficients, fine.coefficients, atol=0.02)


def test_builtin_environments_by_name(tmp_path):
    assert set(BUILTIN_ENVIRONMENTS) == {"sky", "studio", "constant"}
    for name in BUILTIN_ENVIRONMENTS:
        environment = load_environment(f"builtin:{name}")
        assert environment.name == name and tuple(environment.image.shape) == (256, 512, 3)
        assert load_environment(environment) is environment
    write_image(tmp_path / "a.hdr", torch.ones(4, 8, 3))
    assert load_environment(tmp_path / "a.hdr").name == "a"
    with pytest.raises(InputError, match="'moon' is unknown: known are sky"):
        load_environment("builtin:moon")
    assert np.isfinite(float(environment.mean.sum()))
