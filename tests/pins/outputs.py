"""SHA-256 of what diffprt puts out for a table of tiny scenes: assets, pictures, gradients, pages, glTF and shaders.

A change that is to change no output is checked against `pins.json`; one that is to change some names them by what
`check` prints, and writes anew.

    python tests/pins/outputs.py check    # names what differs, exit status 1 if anything does
    python tests/pins/outputs.py write
"""

from __future__ import annotations

import hashlib
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
from pinned_assets import (
    Asset,
    baked_assets,
    clustered_assets,
    optimized_assets,
    projected,
    square_assets,
)

# All that is taken from diffprt, so that a room that moves is a line here.
import diffprt
from diffprt import (
    Camera,
    ClusteredGlossyTransfer,
    ClusteredTransfer,
    Light,
    Transfer,
    export,
    load,
    render,
    save,
    shade,
    tone_map,
)
from diffprt.exporters import export_glb, write_three
from diffprt.exporters.shaders import write_shaders
from diffprt.rendering import FrozenView, picture
from diffprt.transfer import GlossyTransfer

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

Outputs = Iterator[tuple[str, bytes]]


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
    for kind, asset in square_assets().items():
        yield f"exact/{kind}.prt", _file(asset, folder)
        yield f"exact/{kind}.glb", _glb(asset, light, folder)


def _computed(folder: Path) -> Outputs:
    bakes = baked_assets()
    for name, asset in bakes.items():
        yield f"bake/{name}.prt", _file(asset, folder)
    clustered = clustered_assets(bakes)
    for name, asset in clustered.items():
        yield f"compress/{name}.prt", _file(asset, folder)
    for name, asset in optimized_assets(bakes, clustered).items():
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


def _pictures(shown: dict[str, Asset]) -> Outputs:
    for name, asset in shown.items():
        light, camera = projected("sky", asset.order), _camera(asset)
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
        yield f"shade/{name}, albedo", _raw(shade(shown[name], projected("studio"), albedo=albedo))


def _gradients(asset: Asset, light: Light, frozen: FrozenView) -> dict[str, torch.Tensor]:
    """Of a picture's energy: with respect to the signal and the light."""
    leaves = {name: getattr(asset, name).detach().clone().requires_grad_() for name in SIGNALS[type(asset)]}
    coefficients = light.coefficients.detach().clone().requires_grad_()
    energy = picture(replace(asset, **leaves), Light(coefficients), frozen).square().sum()
    values = torch.autograd.grad(energy, [*leaves.values(), coefficients])
    return dict(zip([*leaves, "light"], values, strict=True))


def _pages(shown: dict[str, Asset], bakes: dict[str, Asset], clustered: dict[str, Asset], folder: Path) -> Outputs:
    for name, asset in shown.items():
        light = projected("studio", asset.order)
        yield f"page/{name}", _page(asset, folder)
        yield f"glb/{name}", _glb(asset, light, folder)
    diffuse, glossy = shown["diffuse"], shown["glossy"]
    lights = {name: projected(name) for name in ("sky", "studio")}
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
    yield "glb/glossy, colored", _glb(bakes["glossy, colored"], projected("sky", 3), folder)


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
