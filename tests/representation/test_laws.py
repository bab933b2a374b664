"""What holds of every kind of asset, whatever it is made of."""

import itertools
from dataclasses import replace

import pytest
import torch
from representations import REPRESENTATIONS, Case
from tolerances import FLOAT32, FLOAT64

from diffprt import Camera, load, render, save, shade
from diffprt.errors import InputError
from diffprt.rendering import FrozenView, picture
from diffprt.representation import Lighting
from diffprt.representation.registry import HOMES, kind_of

EYE = (2.0, 1.5, 3.0)


@pytest.fixture(scope="module", params=REPRESENTATIONS)
def case(request) -> Case:
    made = REPRESENTATIONS[request.param].make()
    assert made.name == request.param
    return replace(REPRESENTATIONS[request.param], make=lambda: made)


def camera_of(asset, width: int = 24, height: int = 18) -> Camera:
    return Camera.framing(asset.elements.positions, azimuth=35, elevation=20, width=width, height=height)


def test_the_table_has_every_kind():
    assert set(HOMES) < set(REPRESENTATIONS) and len(REPRESENTATIONS) >= 6


def test_round_trip_and_the_same_bytes_twice(case, tmp_path):
    asset = case.make()
    save(asset, tmp_path / "a.prt")
    back = load(tmp_path / "a.prt")
    assert type(back) is type(asset) is kind_of(asset.name)
    for name, tensor in asset.stored().items():
        assert torch.equal(back.stored()[name], tensor)
    for name in asset.elements_type.spec:
        assert torch.equal(getattr(back.elements, name), getattr(asset.elements, name))
    assert back.provenance == asset.provenance
    save(back, tmp_path / "b.prt")
    assert (tmp_path / "a.prt").read_bytes() == (tmp_path / "b.prt").read_bytes()


def test_linearity_in_light(case):
    """Of coefficients, and of what is seen of them."""
    asset = case.make().to(torch.float64)
    looks = [lambda light: asset.lit(light).coefficients, lambda light: shade(asset, light, EYE)]
    looks.append(lambda light: render(asset, light, camera_of(asset)))
    for look in looks:
        one, two, both = (look(case.lights(a, b)) for a, b in ((1, 0), (0, 1), (0.3, 2.0)))
        assert one.dtype == torch.float64
        mixed = 0.3 * one + 2.0 * two
        assert float((both - mixed).abs().max()) < FLOAT64["rounding"] * float(mixed.abs().max())
        assert float((one - two).abs().max()) > 0.01 * float(one.abs().max())


@pytest.mark.parametrize("samples", [1, 2])
def test_a_frozen_view_is_a_rendering(case, samples):
    asset, light = case.make(), case.lights(1.0, 0.5)
    camera = camera_of(asset)
    frozen = FrozenView.of(asset.elements, camera, samples=samples)
    drawn, image = picture(asset, light, frozen), render(asset, light, camera, samples=samples)
    assert float((drawn - image).abs().max()) < FLOAT32["twin"] * float(image.abs().max())
    assert 0.1 < float((image != 0).any(-1).float().mean()) < 0.9


def test_shading_is_what_is_lit_at_the_elements(case):
    """A sample that sees one element at its own place shows what `shade` says of it."""
    asset, light = case.make().to(torch.float64), case.lights(1.0, 1.0)
    rows = torch.arange(0, len(asset.elements), 7)
    part = shade(asset.picked(rows), light, EYE)
    assert float((part - shade(asset, light, EYE)[rows]).abs().max()) < FLOAT64["rounding"] * float(part.abs().max())


def test_gradients_in_float64(case):
    """To every trainable tensor and through a frozen view, against finite differences on a few elements."""
    asset = case.make().to(torch.float64)
    camera = camera_of(asset, 4, 3)
    frozen = FrozenView.of(asset.elements, camera)
    light = case.lights(1.0, 0.5)
    generator = torch.Generator().manual_seed(2)
    for name in asset.trainable:
        tensor = getattr(asset, name)
        turn = torch.randn(tensor.shape, generator=generator, dtype=torch.float64)
        along = torch.zeros((), dtype=torch.float64, requires_grad=True)

        def image(step, tensor=tensor, turn=turn, name=name):
            return picture(asset.with_tensors(**{name: tensor + step * turn}), light, frozen)

        assert torch.autograd.gradcheck(image, (along,))
        whole = tensor.clone().requires_grad_()
        seen = picture(asset.with_tensors(**{name: whole}), light, frozen).square().sum()
        (gradient,) = torch.autograd.grad(seen, whole)
        assert float(gradient.abs().max()) > 0 and bool(torch.isfinite(gradient).all())


def test_it_moves(case):
    """A dtype changes what its spec admits, a device moves all; the picture stays."""
    asset, light = case.make(), case.lights(1.0, 0.5)
    wide = asset.to(torch.float64)
    assert all(getattr(wide, name).dtype == torch.float64 for name in asset.trainable)
    assert wide.elements.positions.dtype == torch.float32
    back = wide.to("cpu").to(torch.float32)
    for name in asset.trainable:
        assert torch.equal(getattr(back, name), getattr(asset, name))
    difference = shade(wide, light, EYE) - shade(asset, light, EYE)
    assert float(difference.abs().max()) < FLOAT32["twin"] * float(shade(asset, light, EYE).abs().max())
    camera = camera_of(asset)
    moved = FrozenView.of(asset.elements, camera).to("cpu")
    assert torch.equal(picture(asset, light, moved), picture(asset, light, FrozenView.of(asset.elements, camera)))


def test_light_of_another_kind_is_refused(case):
    asset = case.make()
    for light in (Lighting(), Lighting(groups={"nobody": 1.0}) if asset.order else torch.ones(9, 3)):
        with pytest.raises(InputError, match=f"a {type(asset).__name__} was given") as caught:
            asset.lit(light)
        assert "\n" not in str(caught.value)


def test_parts_add_up_to_all():
    """Named groups and lamps: the sum of each alone."""
    asset = REPRESENTATIONS["irradiance_vectors"].make()
    whole = REPRESENTATIONS["irradiance_vectors"].lights(1.0, 0.5)
    parts = [Lighting(groups={name: value}) for name, value in whole.groups.items()]
    parts += [Lighting(local=(lamp,)) for lamp in whole.local]
    assert len(parts) == 3
    sums = list(itertools.accumulate(shade(asset, part) for part in parts))
    assert torch.allclose(sums[-1], shade(asset, whole), rtol=0, atol=FLOAT32["twin"])
