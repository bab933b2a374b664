"""The assets whose bytes `outputs.py` records: tiny scenes baked, compressed and optimized in every way."""

from __future__ import annotations

import itertools
from dataclasses import replace

import torch

# All that is taken from diffprt, so that a room that moves is a line here.
from diffprt import (
    ClusteredGlossyTransfer,
    ClusteredTransfer,
    Light,
    Receivers,
    Scene,
    Transfer,
    bake,
    compress,
    make_references,
    optimize,
    trace,
)
from diffprt.brdf import GGX, CookTorrance, Lambert, ModifiedPhong, Phong
from diffprt.compression import FORMATS, METHODS, light_prior
from diffprt.planning import plan
from diffprt.representation import Provenance
from diffprt.representation.file_size import size_in_file
from diffprt.scene import Material, Mesh, builtin_environment, builtin_scene
from diffprt.transfer import GlossyTransfer, bake_glossy

Asset = Transfer | ClusteredTransfer | GlossyTransfer | ClusteredGlossyTransfer
# Glossy settings that keep a bake within a second.
_GLOSSY = {"order": 3, "order_out": 3, "rays": 64, "bounces": 1, "bounce_rays": 32}
_ORDER = 4


def baked_assets() -> dict[str, Asset]:
    """Every way to bake, by name."""
    colored, gray = _bumpy((0.7, 0.5, 0.3)), _bumpy(0.6)
    low = {"order": 3, "rays": 32}
    both = Scene((*gray.meshes, _square(-0.4, 3.0)), gray.materials)
    sheet = Scene(
        (_square(0.5, 2.0), _square(0.0, 4.0, 1)), (Material((0.6, 0.7, 0.8), transmission=0.4), Material(0.5))
    )
    cornell, bowl = builtin_scene("cornell", subdivisions=2), builtin_scene("bowl", subdivisions=0)
    wall = builtin_scene("wall_and_floor", subdivisions=1)
    points = Receivers.points(
        torch.tensor([[0.2, 0.3, 0.6], [-0.5, 1.1, 0.0], [0.0, 0.05, 0.8], [0.9, 0.0, 0.9]]),
        torch.tensor([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5], [-1.0, 1.0, 0.0]]),
        0.6,
    )
    planned = plan(wall, 0.05, light=projected("sky"))
    shiny = Scene((*gray.meshes, _square(-0.8, 3.0, 1)), (*gray.materials, Material(0.5)))
    pair = [Phong(exponent=12.0, specular=0.5, diffuse=0.4), GGX(0.4, specular=0.8)]
    painted = [ModifiedPhong(exponent=8.0, specular=(0.5, 0.4, 0.2), diffuse=0.3), CookTorrance(0.3)]
    return {
        "diffuse, 1 channel": bake(gray, order=_ORDER, rays=64, bounces=1),
        "diffuse, 3 channels": bake(colored, order=_ORDER, rays=64, bounces=2),
        "diffuse, direct": bake(colored, **low, bounces=0, seed=7),
        "draft": bake(bowl, quality="draft"),
        "converged": bake(cornell, **low, bounces="converged"),
        "stored": bake(cornell, **low, bounces=2, operator="stored"),
        "recompute": bake(cornell, **low, bounces=2, operator="recompute"),
        "ground": bake(gray.with_ground(resolution=8), **low, bounces=1),
        "fill inside": bake(both, **low, bounces=1),
        "no fill inside": bake(both, **low, bounces=1, fill_inside=False),
        "free receivers": bake(cornell, receivers=points, **low, bounces=2),
        "free receivers, direct": bake(cornell, receivers=points, **low, bounces=0),
        "free receivers, converged": bake(cornell, receivers=points, **low, bounces="converged"),
        "planned": bake(wall, plan=planned, rays=32),
        "planned, open": bake(
            Scene((_square(0.0, 2.0),), (Material(0.5),)),
            plan=plan(Scene((_square(0.0, 2.0),), (Material(0.5),)), 0.05, order=3),
        ),
        "tolerance": bake(bowl, order=3, bounces=1, tolerance=0.05),
        "planned, tolerance": bake(wall, plan=plan(wall, 0.1, light=projected("studio")), tolerance=0.1),
        "translucent": bake(sheet, order=_ORDER, rays=64, bounces=2),
        "translucent, recompute": bake(sheet, **low, bounces=2, operator="recompute"),
        "traced": trace(colored, **low, bounces=1).transfer(3),
        "glossy, Phong and GGX": bake_glossy(shiny, pair, **_GLOSSY),
        "glossy, colored": bake_glossy(shiny, painted, **_GLOSSY),
        "glossy, Lambert": bake_glossy(gray, Lambert(0.5), **(_GLOSSY | {"bounces": 0, "order_out": 2})),
    }


def clustered_assets(bakes: dict[str, Asset]) -> dict[str, Asset]:
    """Every way to compress `bakes`, by name."""
    diffuse, gray, glossy = (bakes[n] for n in ("diffuse, 3 channels", "diffuse, 1 channel", "glossy, Phong and GGX"))
    few = {"clusters": 6, "components": 3}
    prior = light_prior([projected(name).coefficients for name in ("sky", "studio")])
    found: dict[str, Asset] = {f"method {name}": compress(diffuse, **few, method=name) for name in METHODS}
    for weights, bases in itertools.product(FORMATS, FORMATS):
        formats = {"weights_format": weights, "bases_format": bases}
        found[f"formats {weights} {bases}"] = compress(diffuse, **few, method="lbg", **formats)
        found[f"overdraw, formats {weights} {bases}"] = compress(diffuse, **few, iterations=8, **formats)
        found[f"glossy, formats {weights} {bases}"] = compress(
            glossy, clusters=4, components=2, method="lbg", **formats
        )
    return found | {
        "default": compress(diffuse, clusters=8, components=2),
        "gray": compress(gray, **few, seed=3),
        "hyper-box": compress(diffuse, **few, method="lbg", start="hyper-box"),
        "coherence": compress(diffuse, **few, coherence=0.3, iterations=8),
        "registers": compress(diffuse, **few, registers=96),
        "registers, small": compress(diffuse, **few, registers=96, weights_format="uint8", bases_format="float16"),
        "prior": compress(diffuse, **few, prior=prior),
        "prior, lbg, small": compress(
            diffuse, **few, method="lbg", prior=prior, weights_format="uint8", bases_format="uint8"
        ),
        "points": compress(bakes["free receivers"], clusters=2, components=1),
        "translucent": compress(bakes["translucent"], **few),
        "glossy": compress(glossy, clusters=4, components=3),
        "glossy, prior": compress(glossy, clusters=4, components=3, prior=prior[:9] / prior[:9].mean()),
        "glossy, colored": compress(bakes["glossy, colored"], clusters=4, components=2, registers=256),
    }


def optimized_assets(bakes: dict[str, Asset], clustered: dict[str, Asset]) -> dict[str, Asset]:
    """Every way to optimize them, by name."""
    diffuse, glossy = bakes["diffuse, 3 channels"], bakes["glossy, Phong and GGX"]
    size = {"width": 16, "height": 12, "seed": 3}
    seen = make_references(diffuse, [projected("sky"), projected("studio")], 6, **size)
    shiny = make_references(glossy, [projected("sky", 3)], 5, **size, samples=2)
    start, small = clustered["method lbg"], clustered["formats uint8 float16"]
    dark = replace(diffuse, diffuse=0.7 * diffuse.diffuse)
    run = {"steps": 5, "batch": 2}
    return {
        "target": optimize(start, seen, target=diffuse, **run),
        "target, small": optimize(small, seen, target=diffuse, **run),
        "bytes": optimize(start, seen, target=diffuse, bytes=size_in_file(start) // 2, **run),
        "pictures": optimize(start, seen, loss="image + 0.1*ssim", parameters=["means", "weights"], **run),
        "labels": optimize(
            clustered["hyper-box"],
            seen,
            target=diffuse,
            parameters=["means", "bases", "weights", "labels"],
            loss="transfer + 0.001*overdraw",
            steps=20,
            batch=2,
        ),
        "uncompressed": optimize(dark, seen, learning_rate=0.3, **run),
        "albedo and exposure": optimize(dark, seen, parameters=["albedo", "exposure"], loss="log", **run),
        "glossy, target": optimize(clustered["glossy"], shiny, target=glossy, **run),
        "glossy, bytes": optimize(
            clustered["glossy"], shiny, target=glossy, bytes=4 * size_in_file(clustered["glossy"]) // 5, **run
        ),
        "glossy, pictures": optimize(clustered["glossy"], shiny, **run),
    }


def square_assets() -> dict[str, Asset]:
    """One asset of each kind, of numbers that no processor rounds."""
    receivers = Receivers(
        torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, -1.0], [0.0, 0.0, -1.0]]),
        torch.tensor([[0.0, 1.0, 0.0]]).repeat(4, 1),
        torch.tensor([[0.5, 0.25, 0.125]]).repeat(4, 1),
        torch.tensor([[0, 1, 2], [0, 2, 3]]),
    )
    facts = {"provenance": Provenance({"order": 2}, {}, {"noise_relative": 0.25}, "0" * 64)}
    labels, weights = torch.tensor([0, 0, 1, 1]), torch.tensor([[0.5], [-0.5], [0.25], [-0.25]])
    means, bases = torch.arange(24.0).reshape(2, 3, 4) / 4, torch.zeros(2, 1, 3, 4)
    bases[:, 0, 0, 0] = 1
    exits, axes = torch.arange(96.0).reshape(2, 3, 4, 4) / 16, torch.zeros(2, 1, 3, 4, 4)
    axes[:, 0, 0, 0, 0] = 1
    return {
        "diffuse": Transfer(
            torch.arange(48.0).reshape(4, 3, 4) / 32,
            receivers,
            **facts,
            openness=torch.tensor([1.0, 0.5, 0.25, 0.0]),
            bent_normals=receivers.normals.clone(),
        ),
        "clustered": ClusteredTransfer(
            labels=labels, means=means, bases=bases, weights=weights, receivers=receivers, **facts
        ),
        "glossy": GlossyTransfer(torch.arange(192.0).reshape(4, 3, 4, 4) / 64, receivers, **facts),
        "clustered glossy": ClusteredGlossyTransfer(
            labels=labels, means=exits, bases=axes, weights=weights, receivers=receivers, **facts
        ),
    }


def _bumpy(albedo: float | tuple[float, float, float]) -> Scene:
    """A ball with dents: partly shadowed nearly everywhere."""
    ball = builtin_scene("sphere", subdivisions=3).meshes[0]
    p = ball.positions.double()
    scale = 1 + 0.3 * (5 * p[:, :1]).sin() * (7 * p[:, 1:2]).sin() * (6 * p[:, 2:]).sin()
    return Scene.from_mesh((p * scale).float(), ball.faces, albedo=albedo, name="bumpy")


def _square(height: float, size: float, material: int = 0, cells: int = 6) -> Mesh:
    """A horizontal square that faces up."""
    step = torch.linspace(-size / 2, size / 2, cells + 1)
    x, z = torch.meshgrid(step, step, indexing="ij")
    i, n = (torch.arange(cells)[:, None] * (cells + 1) + torch.arange(cells)).reshape(-1), cells + 1
    faces = torch.cat([torch.stack([i, i + 1, i + n], 1), torch.stack([i + 1, i + n + 1, i + n], 1)])
    return Mesh.create(torch.stack([x, torch.full_like(x, height), z], -1).reshape(-1, 3), faces, material=material)


def projected(name: str, order: int = _ORDER) -> Light:
    """A built-in environment as SH."""
    return builtin_environment(name, height=32).project(order)
