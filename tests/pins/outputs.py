"""SHA-256 of what diffprt puts out for a table of tiny scenes: assets, pictures, gradients, pages, glTF and shaders.

A change that is to change no output is checked against `pins.json`; one that is to change some names them by what
`check` prints, and writes anew.

    python tests/pins/outputs.py check    # names what differs, exit status 1 if anything does
    python tests/pins/outputs.py write
"""

from __future__ import annotations

import hashlib
import itertools
import json
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import torch

# All that is taken from diffprt, so that a room that moves is a line here.
import diffprt
from diffprt import (
    Camera,
    ClusteredGlossyTransfer,
    ClusteredTransfer,
    Light,
    Receivers,
    Scene,
    Transfer,
    bake,
    compress,
    export,
    load,
    make_references,
    optimize,
    render,
    save,
    shade,
    tone_map,
    trace,
)
from diffprt.brdf import GGX, CookTorrance, Lambert, ModifiedPhong, Phong
from diffprt.compression import FORMATS, METHODS, light_prior
from diffprt.exporters import export_glb, write_three
from diffprt.exporters.shaders import write_shaders
from diffprt.planning import plan
from diffprt.rendering import FrozenView, picture
from diffprt.representation import Provenance
from diffprt.scene import Material, Mesh, builtin_environment, builtin_scene
from diffprt.transfer import GlossyTransfer, bake_glossy

# What assets hold and gradients reach.
SIGNALS = {
    Transfer: ("diffuse",),
    ClusteredTransfer: ("means", "bases", "weights"),
    GlossyTransfer: ("glossy",),
    ClusteredGlossyTransfer: ("means", "bases", "weights"),
}

PINS = Path(__file__).with_name("pins.json")
# Their bytes depend on the libraries at most; all others also on the processor, by its instructions and its blocking
# of matrix products.
EXACT = ("exact/", "shader/", "three/")
LIBRARIES = ("torch", "numpy", "scipy", "warp-lang", "safetensors", "pillow")

Asset = Transfer | ClusteredTransfer | GlossyTransfer | ClusteredGlossyTransfer
Outputs = Iterator[tuple[str, bytes]]
# Glossy settings that keep a bake within a second.
_GLOSSY = {"order": 3, "order_out": 3, "rays": 64, "bounces": 1, "bounce_rays": 32}
_ORDER = 4


def machine() -> dict[str, str]:
    """What the bytes of dense linear algebra depend on."""
    return {"processor": _processor(), "python": platform.python_version()} | {
        name: version(name) for name in LIBRARIES
    }


def outputs() -> dict[str, str]:
    """SHA-256 of every output by its name, on one torch thread: matrix products depend on their number."""
    return exact_outputs() | computed_outputs()


def exact_outputs() -> dict[str, str]:
    """Those that are the same on every processor; their names begin with one of `EXACT`."""
    return _digests(_exact)


def computed_outputs() -> dict[str, str]:
    """The others, whose bytes are promised for one machine."""
    return _digests(_computed)


def differences(found: dict[str, str], pinned: dict[str, str]) -> list[str]:
    """Names whose outputs differ, are missing or are new."""
    return sorted(name for name in found.keys() | pinned.keys() if found.get(name) != pinned.get(name))


def _digests(source: Callable[[Path], Outputs]) -> dict[str, str]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with tempfile.TemporaryDirectory() as folder:
            found = [(name, hashlib.sha256(content).hexdigest()) for name, content in source(Path(folder))]
    finally:
        torch.set_num_threads(threads)
    twice = {name for name, _ in found if sum(name == other for other, _ in found) > 1}
    if twice or not found:
        raise AssertionError(f"outputs are not named once each: {sorted(twice)}")
    return dict(found)


def _exact(folder: Path) -> Outputs:
    for path in write_shaders(folder / "shaders"):
        yield f"shader/{path.relative_to(folder / 'shaders')}", path.read_bytes()
    for path in write_three(folder / "three"):
        yield f"three/{path.name}", path.read_bytes()
    light = Light(torch.arange(12.0).reshape(4, 3) / 8)
    for kind, asset in _square_assets().items():
        yield f"exact/{kind}.prt", _file(asset, folder)
        yield f"exact/{kind}.glb", _glb(asset, light, folder)


def _computed(folder: Path) -> Outputs:
    bakes = _bakes()
    for name, asset in bakes.items():
        yield f"bake/{name}.prt", _file(asset, folder)
    clustered = _clustered(bakes)
    for name, asset in clustered.items():
        yield f"compress/{name}.prt", _file(asset, folder)
    for name, asset in _optimized(bakes, clustered).items():
        yield f"optimize/{name}.prt", _file(asset, folder)
    shown = {
        "diffuse": bakes["diffuse, 3 channels"],
        "gray": bakes["diffuse, 1 channel"],
        "clustered": clustered["method k-subspaces-overdraw"],
        "glossy": bakes["glossy, Phong and GGX"],
        "clustered glossy": clustered["glossy"],
    }
    yield from _pictures(shown)
    yield from _pages(shown, bakes, clustered, folder)


def _bakes() -> dict[str, Asset]:
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
    planned = plan(wall, 0.05, light=_light("sky"))
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
        "planned, tolerance": bake(wall, plan=plan(wall, 0.1, light=_light("studio")), tolerance=0.1),
        "translucent": bake(sheet, order=_ORDER, rays=64, bounces=2),
        "translucent, recompute": bake(sheet, **low, bounces=2, operator="recompute"),
        "traced": trace(colored, **low, bounces=1).transfer(3),
        "glossy, Phong and GGX": bake_glossy(shiny, pair, **_GLOSSY),
        "glossy, colored": bake_glossy(shiny, painted, **_GLOSSY),
        "glossy, Lambert": bake_glossy(gray, Lambert(0.5), **(_GLOSSY | {"bounces": 0, "order_out": 2})),
    }


def _clustered(bakes: dict[str, Asset]) -> dict[str, Asset]:
    diffuse, gray, glossy = (bakes[n] for n in ("diffuse, 3 channels", "diffuse, 1 channel", "glossy, Phong and GGX"))
    few = {"clusters": 6, "components": 3}
    prior = light_prior([_light(name).coefficients for name in ("sky", "studio")])
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


def _optimized(bakes: dict[str, Asset], clustered: dict[str, Asset]) -> dict[str, Asset]:
    diffuse, glossy = bakes["diffuse, 3 channels"], bakes["glossy, Phong and GGX"]
    size = {"width": 16, "height": 12, "seed": 3}
    seen = make_references(diffuse, [_light("sky"), _light("studio")], 6, **size)
    shiny = make_references(glossy, [_light("sky", 3)], 5, **size, samples=2)
    start, small = clustered["method lbg"], clustered["formats uint8 float16"]
    dark = replace(diffuse, diffuse=0.7 * diffuse.diffuse)
    run = {"steps": 5, "batch": 2}
    return {
        "target": optimize(start, seen, target=diffuse, **run),
        "target, small": optimize(small, seen, target=diffuse, **run),
        "bytes": optimize(start, seen, target=diffuse, bytes=start.nbytes // 3, **run),
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
            clustered["glossy"], shiny, target=glossy, bytes=clustered["glossy"].nbytes // 2, **run
        ),
        "glossy, pictures": optimize(clustered["glossy"], shiny, **run),
    }


def _pictures(shown: dict[str, Asset]) -> Outputs:
    for name, asset in shown.items():
        light, camera = _light("sky", asset.order), _camera(asset)
        plain = render(asset, light, camera)
        yield f"render/{name}", _raw(plain)
        yield f"render/{name}, default camera", _raw(render(asset, light)[::8, ::8])
        yield f"render/{name}, on light, 2 samples", _raw(render(asset, light, camera, background="light", samples=2))
        yield f"render/{name}, on color", _raw(render(asset, light, camera, background=(0.1, 0.2, 0.3)))
        for curve in ("linear", "reinhard", "aces"):
            yield f"tone map/{name}, {curve}", _raw(tone_map(plain, exposure=0.6, curve=curve))
        view = torch.tensor(camera.eye) if "glossy" in name else None
        yield f"shade/{name}", _raw(shade(asset, light, view))
        for samples in (1, 2):
            frozen = FrozenView.of(asset.receivers, camera, samples=samples)
            yield f"frozen/{name}, {samples} samples", _raw(picture(asset, light, frozen))
        for key, gradient in _gradients(asset, light, frozen).items():
            yield f"gradient/{name}, {key}", _raw(gradient)
    albedo = shown["diffuse"].receivers.albedo.flip(1)
    for name in ("diffuse", "clustered"):
        yield f"shade/{name}, albedo", _raw(shade(shown[name], _light("studio"), albedo=albedo))


def _gradients(asset: Asset, light: Light, frozen: FrozenView) -> dict[str, torch.Tensor]:
    """Of a picture's energy: with respect to the signal and the light."""
    leaves = {name: getattr(asset, name).detach().clone().requires_grad_() for name in SIGNALS[type(asset)]}
    coefficients = light.coefficients.detach().clone().requires_grad_()
    energy = picture(replace(asset, **leaves), Light(coefficients), frozen).square().sum()
    values = torch.autograd.grad(energy, [*leaves.values(), coefficients])
    return dict(zip([*leaves, "light"], values, strict=True))


def _pages(shown: dict[str, Asset], bakes: dict[str, Asset], clustered: dict[str, Asset], folder: Path) -> Outputs:
    for name, asset in shown.items():
        light = _light("studio", asset.order)
        yield f"page/{name}", _page(asset, folder)
        yield f"glb/{name}", _glb(asset, light, folder)
    diffuse, glossy = shown["diffuse"], shown["glossy"]
    lights = {name: _light(name) for name in ("sky", "studio")}
    start, small = shown["clustered"], clustered["formats uint8 float16"]
    yield "page/registers", _page(start, folder, registers=96, lights=lights, title="In <passes>")
    yield (
        "page/versions",
        _page(start, folder, versions={"small": small, "baked": diffuse}, exposure=0.7, curve="linear"),
    )
    yield "page/uncompressed", _page(small, folder, uncompressed=diffuse, camera=_camera(diffuse))
    yield "page/before", _page(small, folder, before=start)
    yield "page/all", _page(small, folder, registers=96, uncompressed=diffuse, before=start, lights=lights)
    yield "page/glossy, uncompressed", _page(shown["clustered glossy"], folder, uncompressed=glossy)
    yield "glb/small", _glb(small, lights["sky"], folder)
    yield "glb/glossy, colored", _glb(bakes["glossy, colored"], _light("sky", 3), folder)


def _square_assets() -> dict[str, Asset]:
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


def _light(name: str, order: int = _ORDER) -> Light:
    return builtin_environment(name, height=32).project(order)


def _camera(asset: Asset) -> Camera:
    return Camera.framing(asset.receivers.positions, azimuth=40, elevation=25, width=32, height=24)


def _file(asset: Asset, folder: Path) -> bytes:
    """The bytes of the asset's file, which is read and written again in between."""
    path = folder / "asset.prt"
    save(asset, path)
    content = path.read_bytes()
    save(load(path), path)
    if path.read_bytes() != content:
        raise AssertionError("an asset that was loaded is saved as other bytes")
    return content


def _glb(asset: Asset, light: Light, folder: Path) -> bytes:
    path = folder / "asset.glb"
    export_glb(asset, path, lights={"light": light}, name="pinned")
    return path.read_bytes()


def _page(asset: Asset, folder: Path, **options: object) -> bytes:
    export(asset, folder / "page", **options)
    return (folder / "page" / "index.html").read_bytes()


def _raw(tensor: torch.Tensor) -> bytes:
    tensor = tensor.detach().contiguous()
    return f"{tensor.dtype} {tuple(tensor.shape)}\n".encode() + tensor.numpy().tobytes()


def _processor() -> str:
    """Model name, family and model: some machines name no more than the brand."""
    keys = ("model name", "cpu family", "model")
    try:
        lines = Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    found = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    return ", ".join(found[key] for key in keys if key in found) or platform.machine()


def main(arguments: list[str]) -> int:
    if arguments not in (["check"], ["write"]):
        print(f"usage: python {sys.argv[0]} check|write")
        return 2
    begun = time.process_time()
    found, here = outputs(), machine()
    print(f"{len(found)} outputs of {Path(diffprt.__file__).parent}, {time.process_time() - begun:.0f} s of CPU")
    if arguments == ["write"]:
        PINS.write_text(json.dumps({"machine": here, "pins": dict(sorted(found.items()))}, indent=1) + "\n")
        return 0
    recorded = json.loads(PINS.read_text())
    if here != recorded["machine"]:
        print(f"recorded on another machine: {recorded['machine']}, this is {here}")
    differing = differences(found, recorded["pins"])
    for name in differing:
        print(f"differs: {name}")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
