"""The public face has types: annotated in full, marked for type checkers, and seen by one; `help` lists it."""

import dataclasses
import importlib
import inspect
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest

import diffprt
import diffprt.kernels

ROOT = Path(diffprt.__file__).parent
ROOMS = ["diffprt", *(f"diffprt.{path.parent.name}" for path in sorted(ROOT.glob("*/__init__.pyi"))), "diffprt.kernels"]

PROGRAM = """
from pathlib import Path

import torch
from typing_extensions import reveal_type

import diffprt
from diffprt.brdf import GGX
from diffprt.compression import ClusteredSignal
from diffprt.scene import builtin_scene


def loss(image: torch.Tensor, reference: torch.Tensor) -> torch.Tensor:
    return (image - reference).square().mean()


scene = diffprt.Scene.load(Path("a.glb"))
transfer = diffprt.bake(scene, order=4, rays=64, bounces="converged", seed=1)
small = diffprt.compress(transfer, clusters=16, components=4)
lights = [diffprt.Environment.load("a.hdr").project(4)]
images = diffprt.render(small, lights, diffprt.Camera.framing(transfer.receivers.positions), samples=2)
references = diffprt.make_references(transfer, lights, 8)
better = diffprt.optimize(small, references, target=transfer, loss={"image": 1.0, loss: 0.1}, steps=3)
alone = diffprt.optimize(small, references, loss=loss)
written = diffprt.save(better, "a.prt")
page = diffprt.export(diffprt.load("a.prt"), "page", exposure=1.0)
glossy = diffprt.bake_glossy(builtin_scene("sphere"), [GGX(0.3)], order=4)
reveal_type(transfer)  # Transfer | GlossyTransfer
reveal_type(glossy)  # GlossyTransfer
reveal_type(small)  # ClusteredSignal
reveal_type(better)  # Representation
reveal_type(diffprt.shade(small, torch.zeros(2, 16, 3)))  # Tensor
reveal_type(diffprt.tone_map(images, exposure=0.5))  # Tensor
reveal_type(written)  # int
diffprt.bake(scene, order="six")  # wrong: reportArgumentType
diffprt.bake(scene, rayz=64)  # wrong: reportCallIssue
diffprt.compress(transfer, clusters="many")  # wrong: reportArgumentType
diffprt.render(small, 5)  # wrong: reportArgumentType
diffprt.export(small, "page", expsure=1.0)  # wrong: reportCallIssue
"""


def members(room: str) -> Iterator[tuple[str, object]]:
    """Public functions of a room, and methods of its classes."""
    module = importlib.import_module(room)
    for name in module.__all__:
        value = getattr(module, name)
        if isinstance(value, ModuleType) or not str(getattr(value, "__module__", "")).startswith("diffprt"):
            continue
        if not inspect.isclass(value):
            yield from [(name, value)] if callable(value) else []
            continue
        written = not dataclasses.is_dataclass(value)
        for key, method in vars(value).items():
            if not key.startswith("_") or key == "__call__" or (key == "__init__" and written):
                method = getattr(method, "fget", getattr(method, "__func__", method))
                yield from [(f"{name}.{key}", method)] if inspect.isfunction(method) else []


@pytest.mark.parametrize("room", ROOMS)
def test_every_signature_is_annotated(room):
    missing, count = [], 0
    for name, function in members(room):
        count += 1
        signature = inspect.signature(function)
        parameters = [p for p in signature.parameters.values() if p.name not in ("self", "cls")]
        missing += [f"{name}({p.name})" for p in parameters if p.annotation is p.empty]
        missing += [f"{name} ->" for _ in [0] if signature.return_annotation is signature.empty]
    assert count and not missing


def test_type_checkers_are_told():
    assert (ROOT / "py.typed").is_file()


def test_help_names_every_function_with_one_line():
    functions = [name for name in diffprt.__all__ if inspect.isfunction(getattr(diffprt, name))]
    lines = dict(re.findall(r"^    (\w+) {2,}(\S.*)$", diffprt.__doc__, re.MULTILINE))
    assert len(functions) > 12 and sorted(lines) == sorted(functions)
    assert all(10 < len(line) < 100 for line in lines.values())
    classes = {name for name in diffprt.__all__ if inspect.isclass(getattr(diffprt, name))}
    assert all(re.search(rf"`{name}`", diffprt.__doc__) for name in classes - {"References"})
    assert all(inspect.getdoc(getattr(diffprt, name)) for name in functions)


@pytest.mark.skipif(find_spec("basedpyright") is None, reason="the type checker is for developers")
def test_a_users_program_is_checked(tmp_path):
    """As installed: a package beside others, with the signatures of options that decorators make."""
    package = tmp_path / "site" / "diffprt"
    package.mkdir(parents=True)
    for path in [*ROOT.iterdir(), Path(diffprt.kernels.__file__).parent]:
        if not (package / path.name).exists():
            (package / path.name).symlink_to(path)
    (tmp_path / "program.py").write_text(PROGRAM)
    (tmp_path / "pyrightconfig.json").write_text(json.dumps({"typeCheckingMode": "basic", "include": ["program.py"]}))
    command = [sys.executable, "-m", "basedpyright", "--pythonpath", sys.executable, "--outputjson"]
    environment = {**os.environ, "PYTHONPATH": str(package.parent)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    found = json.loads(done.stdout)["generalDiagnostics"]
    lines = PROGRAM.splitlines()
    wrong = {number: line.split("# wrong: ")[1] for number, line in enumerate(lines) if "# wrong" in line}
    errors = {d["range"]["start"]["line"]: d["rule"] for d in found if d["severity"] == "error"}
    assert errors == wrong, [d for d in found if d["severity"] == "error"]
    shown = {d["range"]["start"]["line"]: d["message"] for d in found if d["severity"] == "information"}
    revealed = {n: line.split("  # ")[1] for n, line in enumerate(lines) if line.startswith("reveal_type")}
    assert {n: re.search(r' is "(.*)"$', shown[n])[1] for n in revealed} == revealed
