"""A kind defined in `face_colors.py` alone goes wherever the built-in ones go, and is refused where it cannot."""

import json
import subprocess
import sys
from dataclasses import dataclass, field, replace
from typing import ClassVar

import pytest
import torch
from face_colors import FaceColors, Faces
from representations import irradiance_vectors, transfer

from diffprt import Camera, Light, compress, export, load, make_references, optimize, render, save, shade
from diffprt.cli import main
from diffprt.cli.invert import with_albedo
from diffprt.errors import InputError
from diffprt.inverse import recover_albedo, recover_light_and_albedo
from diffprt.rendering import FrozenView, picture
from diffprt.representation import ConstantBasis, Lighting, Lit, Provenance, Representation, TensorSpec
from diffprt.scene import builtin_scene
from diffprt.surface import Receivers


@pytest.fixture(scope="module")
def asset() -> FaceColors:
    ball = builtin_scene("sphere", subdivisions=2).meshes[0]
    colors = torch.rand(len(ball.faces), 3, generator=torch.Generator().manual_seed(0)) + 0.1
    return FaceColors(colors, Faces(ball.positions[ball.faces]), Provenance({"made": "by hand"}, scene_hash="7" * 64))


@dataclass(frozen=True)
class Shares(Representation):
    """On receivers, with an albedo beside its signal: what each sees of an even sky."""

    name, description, elements_type = "shares", "share of the sky that is seen", Receivers
    spec: ClassVar = {"shares": TensorSpec(("V",), per_element=True, trainable=True)}
    order = 1
    shares: torch.Tensor
    elements: Receivers
    provenance: Provenance = field(default_factory=Provenance, compare=False)

    def check_albedo(self):
        pass

    def lit(self, lighting, *, albedo=None):
        light = Lighting.of(lighting).coefficients(1, "Shares").to(self.shares)
        albedo = self.elements.albedo if albedo is None else albedo
        return Lit((self.shares[:, None] * light * 0.28209479 * albedo)[..., None], ConstantBasis())


def ambient_shares() -> Shares:
    return Shares(transfer().openness, transfer().receivers)


LIGHT = Light(torch.tensor([[3.0, 2.0, 1.0]]))


def test_it_is_written_read_and_described(asset, tmp_path, capsys):
    path = tmp_path / "faces.prt"
    assert save(asset, path) == path.stat().st_size
    back = load(path)
    assert back.name == "face_colors" and back.settings == {"made": "by hand"} and back.scene_hash == "7" * 64
    assert torch.equal(back.colors, asset.colors) and torch.equal(back.elements.corners, asset.elements.corners)
    save(back, tmp_path / "again.prt")
    assert path.read_bytes() == (tmp_path / "again.prt").read_bytes()
    # A fresh process knows nothing of the kind: it describes the file, and says why it cannot be loaded.
    report = tmp_path / "info.json"
    info = [sys.executable, "-m", "diffprt", "info", str(path), "--json", str(report)]
    said = subprocess.run(info, capture_output=True, text=True, check=True).stdout
    assert "face_colors" in said and "320x3x3" in said and "by hand" in said
    assert json.loads(report.read_text())["tensors"]["colors"] == {"dtype": "F32", "shape": [320, 3]}
    render_it = [sys.executable, "-m", "diffprt", "render", str(path), "-o", str(tmp_path / "x.png")]
    refused = subprocess.run(render_it, capture_output=True, text=True)
    assert refused.returncode == 2 and refused.stderr.count("\n") == 1
    assert "'face_colors' is no kind of asset known here" in refused.stderr
    # Here it is known, so that commands take it.
    with pytest.raises(SystemExit) as ended:
        main(["render", str(path), "--light", "constant", "--size", "32", "-o", str(tmp_path / "x.png")])
    assert ended.value.code == 0 and (tmp_path / "x.png").is_file()


def test_it_is_shaded_and_drawn(asset):
    radiance = shade(asset, LIGHT)
    assert torch.allclose(radiance, asset.colors * LIGHT.coefficients * 0.28209479, rtol=1e-6)
    camera = Camera.framing(asset.elements.positions, width=24, height=20)
    image = render(asset, LIGHT, camera, samples=2)
    frozen = FrozenView.of(asset.elements, camera, samples=2)
    assert torch.allclose(picture(asset, LIGHT, frozen), image, atol=1e-6)
    # Flat colors: every pixel inside shows one face's radiance, not a blend.
    plain = render(asset, LIGHT, camera)
    mask = asset.elements.view(camera).mask
    nearest = (plain[mask][:, None] - radiance).abs().amax(-1).amin(1)
    assert len(nearest) > 100 and float(nearest.max()) < 1e-6


def test_gradients_reach_it_through_a_frozen_view(asset):
    few = replace(asset, colors=asset.colors[:20].double(), elements=asset.elements.picked(torch.arange(20)))
    camera = Camera.framing(few.elements.positions, width=6, height=5)
    frozen = FrozenView.of(few.elements, camera)
    inputs = few.colors.clone().requires_grad_(), LIGHT.coefficients.double().requires_grad_()
    # The sparse product keeps its weights in float32: they are constants, so gradients are those of what is drawn.
    assert torch.autograd.gradcheck(lambda c, l: picture(replace(few, colors=c), l, frozen), inputs)
    assert (
        float(torch.autograd.grad(picture(replace(few, colors=inputs[0]), LIGHT, frozen).sum(), inputs[0])[0].norm())
        > 0
    )


def test_it_is_trained_towards_pictures(asset):
    lights = [Light(torch.tensor([values])) for values in ([3.0, 2.0, 1.0], [1.0, 2.0, 3.0], [2.0, 2.0, 2.0])]
    references = make_references(asset, lights, 12, width=32, height=32, turn=False)
    start = replace(asset, colors=torch.full_like(asset.colors, 0.5))
    report: dict = {}
    found = optimize(start, references, steps=60, learning_rate=0.3, report=report)
    assert report["errors"]["after"] < 0.2 * report["errors"]["before"]
    assert found.certificate["optimized_image_relative"] == report["errors"]["after"]


def test_it_is_exported(asset, tmp_path):
    report = export(asset, tmp_path, lights={"white": LIGHT})
    assert report["bytes"] == (tmp_path / "index.html").stat().st_size


def test_what_it_cannot_do_is_one_line(asset):
    camera = Camera.framing(asset.elements.positions, width=16, height=16)
    references = make_references(asset, [LIGHT], 4, width=16, height=16)
    refusals = [
        (lambda: compress(asset), "a FaceColors has no signal to compress"),
        (lambda: optimize(asset, references, bytes=1000), "a FaceColors cannot be fitted to bytes"),
        (lambda: optimize(asset, references, target=asset), "a FaceColors has no signal"),
        (lambda: optimize(asset, references, parameters=["means"]), "a FaceColors has no means"),
        (lambda: optimize(asset, references, parameters=["albedo"]), "a FaceColors has its colors inside"),
        (lambda: shade(asset, LIGHT, albedo=torch.ones(320, 3)), "a FaceColors has its colors inside"),
        (lambda: shade(asset, {"lamp": 1.0}), "a FaceColors was given groups light: it answers to distant light"),
        (lambda: shade(asset, Lighting()), "no light"),
        (lambda: render(asset, Light(torch.ones(4, 3)), camera), "project the light with order=1"),
    ]
    for attempt, message in refusals:
        with pytest.raises(InputError, match=message) as caught:
            attempt()
        assert "\n" not in str(caught.value)


def test_commands_say_that_a_kind_answers_to_no_distant_light(tmp_path, capsys):
    save(irradiance_vectors(), tmp_path / "v.prt")
    for command in (["render"], ["render", "--reference-set", "2"], ["export"]):
        with pytest.raises(SystemExit) as ended:
            main([*command, str(tmp_path / "v.prt"), "-o", str(tmp_path / ("p" if len(command) > 1 else "p.png"))])
        said = capsys.readouterr().err
        assert ended.value.code == 2 and "answers to no distant light" in said and said.count("\n") == 1


def test_albedo_is_recovered_of_a_kind_that_takes_one():
    made = ambient_shares()
    painted = made.elements.positions.sin().abs() * 0.5 + 0.2
    truth = made.with_elements(made.elements.with_albedo(painted))
    lights = [Light(torch.tensor([values])) for values in ([3.0, 2.0, 1.0], [1.0, 2.0, 3.0])]
    references = make_references(truth, lights, 8, width=48, height=48, turn=False)
    found = recover_albedo(made, references, noise=1e-3)
    told = found.told.amin(1) > 0.5
    assert float(told.float().mean()) > 0.5
    assert float((found.albedo - painted)[told].norm() / painted[told].norm()) < 0.02
    back = with_albedo(made, found.albedo)
    assert torch.equal(back.elements.albedo, found.albedo) and torch.equal(back.shares, made.shares)
    inside, pictures = irradiance_vectors(), [(entry.image, entry.camera) for entry in references]
    with pytest.raises(InputError, match="the asset holds its light inside"):
        recover_light_and_albedo(inside, pictures, groups=torch.zeros(len(inside.elements), dtype=torch.int64))


def test_references_are_of_distant_light(asset):
    references = make_references(asset, [LIGHT], 2, width=16, height=16)
    with pytest.raises(InputError, match="a IrradianceVectors answers to no distant light"):
        optimize(irradiance_vectors(), references, steps=1)
