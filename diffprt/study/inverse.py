"""Lights and albedos recovered from pictures that another program, or another bake, has made.

The pictures come from Mitsuba's path tracer, or from a bake with other rays and another seed; never from the transfer
that is inverted. Noise is added to every pixel. What is asked: the coefficients of an environment from a few views of a
matt object, overall and by band, with what the object cannot tell of it; the albedo of every receiver under known
light; and light and albedo together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import torch

from diffprt import sh
from diffprt.errors import InputError
from diffprt.inverse import recover_albedo, recover_light, recover_light_and_albedo
from diffprt.options import takes
from diffprt.options.study import InverseOptions
from diffprt.rendering import render
from diffprt.scene import Camera, Light, Scene, builtin_environment, builtin_scene, load_scene
from diffprt.study.mitsuba.scene import mitsuba_scene, path_trace, start_mitsuba
from diffprt.transfer import Transport, trace

# Makes a picture [H, W, 3] of a scene under a light from a camera.
Photograph = Callable[[Scene, Light, Camera, int], torch.Tensor]

_BOUNCES = 8


@takes(InverseOptions)
def inverse_study(source: str | Scene, asked: InverseOptions) -> dict:
    """Recovers light, albedo and both, and says how far off they are.

    Args:
        source: a scene file, "builtin:NAME" or a scene of one mesh.
        rays: rays per receiver of the transfer that is inverted; the other bake has as many of another seed.
        views: pictures for a light, from around the object.
        albedo_views: pictures for an albedo, under each light.
        samples: Mitsuba's samples per pixel; their noise comes to the noise added.
        noise: standard deviation added to every pixel, as a share of the picture's root mean square.

    Returns:
        Plain numbers: `settings`, `versions`, and `light`, `albedo`, `joint`, lists of rows.

    Raises:
        InputError: Mitsuba is missing, or an option is out of range.
    """
    if min(asked.views, asked.albedo_views, asked.samples) < 1 or not asked.noise >= 0:
        given = ", ".join(f"{name} {getattr(asked, name)}" for name in ("views", "albedo_views", "samples", "noise"))
        raise InputError(f"{given}: give 1 or more")
    mitsuba, _ = start_mitsuba()
    scene = source if isinstance(source, Scene) else load_scene(source)
    traced = partial(_traced, mitsuba, asked.samples)
    lights = {name: builtin_environment(name).project(asked.order, window="auto") for name in ("sky", "studio")}
    asked.say("bake")
    transport = trace(scene, order=asked.order, rays=asked.rays, bounces="converged", seed=asked.seed)
    other = trace(scene, order=asked.order, rays=asked.rays, bounces="converged", seed=asked.seed + 1)
    shoot = partial(_pictures, transport.receivers.positions, size=asked.size, noise=asked.noise, seed=asked.seed)
    rows = []
    for name, light in lights.items():
        for maker, photograph in (("Mitsuba", traced), ("another bake", partial(_baked, other))):
            asked.say(f"light from {asked.views} pictures by {maker} under {name}")
            pictures = shoot(scene, light, photograph, asked.views)
            rows.append(_light_row(scene, maker, name, light, recover_light(transport.transfer(), pictures)))
    asked.say("light from a convex object")
    rows.append(_convex_row(traced, asked))
    painted, truth = painted_scene(scene)
    asked.say(f"albedo from {asked.albedo_views} pictures")
    albedo_rows, seen = [], {}
    for name in lights:
        seen[name] = shoot(painted, lights[name], traced, asked.albedo_views)
        gray = transport.transfer(albedo=torch.full((len(transport.receivers), 3), 0.5))
        for model, asset in (("follows", transport), ("as baked with 0.5", gray)):
            found = recover_albedo(asset, seen[name])
            albedo_rows.append({"light": name, "interreflection": model, **_albedo_row(found, truth)})
    asked.say("light and albedo together")
    half_turn = torch.diag(torch.tensor([-1.0, 1.0, -1.0]))  # about +y
    turned = Light(lights["studio"].coefficients).rotate(half_turn)
    seen["studio, turned"] = shoot(painted, turned, traced, asked.albedo_views)
    lights["studio, turned"] = turned
    pictures = [picture[:2] for own in seen.values() for picture in own]
    lit_by = [index for index, own in enumerate(seen.values()) for _ in own]
    joint = _joint_row(transport, pictures, lit_by, truth, list(lights.values()))
    return {
        "settings": {"scene": scene.name, **asked.settings(), "mitsuba_bounces": _BOUNCES},
        "versions": {"mitsuba": mitsuba.__version__, "variant": mitsuba.variant()},
        "light": rows,
        "albedo": albedo_rows,
        "joint": [joint],
    }


def painted_scene(scene: Scene) -> tuple[Scene, torch.Tensor]:
    """The scene with stripes and waves of color on its mesh, and their albedo [V, 3]."""
    if len(scene.meshes) != 1:
        raise InputError(f"scene '{scene.name}' has {len(scene.meshes)} meshes: this study paints scenes of one")
    mesh = scene.meshes[0]
    low = mesh.positions.amin(0)
    x, y, z = ((mesh.positions - low) / (mesh.positions.amax(0) - low).max()).T
    waves = ((12 * x).sin(), (15 * y + 1).sin() * (9 * z).cos(), (14 * (y + z)).sin())
    albedo = torch.stack([0.5 + 0.3 * wave for wave in waves], dim=1)
    white = scene.with_albedo(1.0)
    return replace(white, meshes=(replace(white.meshes[0], colors=albedo),)), albedo


def _pictures(positions, scene: Scene, light: Light, photograph: Photograph, views: int, *, size, noise, seed) -> list:
    """(image, camera, light) from around the object, from above and from below in turns, with noise."""
    found = []
    for index in range(views):
        elevation = 20.0 if index % 2 == 0 else -10.0
        angles = {"azimuth": 20 + 360 * index / views, "elevation": elevation}
        camera = Camera.framing(positions, **angles, width=size, height=size)
        image = photograph(scene, light, camera, index)
        level = noise * float(image[image.sum(-1) > 0].square().mean().sqrt())
        generator = torch.Generator().manual_seed(seed + index)
        found.append((image + level * torch.randn(image.shape, generator=generator), camera, light.coefficients))
    return found


def _traced(mitsuba, samples: int, scene: Scene, light: Light, camera: Camera, seed: int) -> torch.Tensor:
    target = mitsuba_scene(mitsuba, scene, light, camera)
    return path_trace(mitsuba, target, bounces=_BOUNCES, samples=samples, seed=seed)[..., :3].float()


def _baked(transport: Transport, scene: Scene, light: Light, camera: Camera, seed: int) -> torch.Tensor:
    return render(transport.transfer(), light, camera, samples=4)


def _light_row(scene: Scene, maker: str, name: str, light: Light, found) -> dict:
    """How far each band is off, as a share of that band and of the whole light."""
    truth, order = light.coefficients.double(), light.order
    band = sh.band_of_index(order)
    off = found.light.coefficients.double() - truth
    return {
        "scene": scene.name,
        "pictures": maker,
        "light": name,
        "error": float(off.norm() / truth.norm()),
        "band_error": [float(off[band == l].norm() / truth[band == l].norm().clamp_min(1e-12)) for l in range(order)],
        "band_share": [float(truth[band == l].norm() / truth.norm()) for l in range(order)],
        **{key: value for key, value in found.as_dict().items() if key != "coefficients"},
    }


def _convex_row(photograph: Photograph, asked: InverseOptions) -> dict:
    """A matt sphere at order 6, which cannot see bands 3 and 5."""
    sphere = builtin_scene("sphere", subdivisions=5)
    light = builtin_environment("studio").project(6, window="auto")
    transfer = trace(sphere, order=6, rays=64, bounces="converged").transfer()
    noisy = {"size": asked.size, "noise": asked.noise, "seed": asked.seed}
    pictures = _pictures(transfer.receivers.positions, sphere, light, photograph, asked.views, **noisy)
    return _light_row(sphere, "Mitsuba", "studio", light, recover_light(transfer, pictures))


def _albedo_row(found, truth: torch.Tensor) -> dict:
    """Errors over the receivers that pixels tell, of all and by color."""
    told = found.told.amin(1) > 0.5
    off = (found.albedo - truth)[told]
    return {
        "error": float(off.norm() / truth[told].norm()),
        "color_error": (off.norm(dim=0) / truth[told].norm(dim=0)).tolist(),
        "receivers_told": float(told.float().mean()),
        "residual": found.residual,
        "turns": found.turns,
    }


def _joint_row(transport, pictures: list, lit_by: Sequence[int], truth: torch.Tensor, lights: list[Light]) -> dict:
    """The scale is fixed by the mean of the true albedo; what is off is the rest."""
    found = recover_light_and_albedo(transport, pictures, lit_by=lit_by, mean_albedo=truth.mean(0))
    errors = [
        float((estimate.light.coefficients - light.coefficients).norm() / light.coefficients.norm())
        for estimate, light in zip(found.lights, lights, strict=True)
    ]
    row = _albedo_row(found.albedo, truth)
    return {**row, "light_errors": errors, "mismatch": found.mismatch, "next_best": found.next_best}
