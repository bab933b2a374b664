"""The rules of the house: imports go downhill, in no circle; faces list what is there; rooms hide no function."""

import ast
import importlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

import diffprt
import diffprt.kernels

SOURCES = Path(diffprt.__file__).parent
KERNELS = Path(diffprt.kernels.__file__).parent

# Each room imports only what stands before it, for types too, and wherever in a file the import stands. `diffprt` is
# the face of the whole: what stands behind it may import from it.
ROOMS = (
    "kernels", "errors", "file_content", "progress", "partial_files", "whole_file", "lock", "sealed_tensors",
    "torch_threads", "images", "options", "sh", "brdf", "scene", "representation", "surface", "planning", "transfer",
    "compression", "shading", "rendering", "optimization", "inverse", "exporters", "diffprt", "study", "demo", "cli",
    "__main__",
)  # fmt: skip

# Importing files and what they import against the order, until it is mended. Each is asked to be real.
UPHILL: set[tuple[str, str]] = set()
CIRCLES: set[frozenset[str]] = set()


@cache
def files() -> dict[str, Path]:
    """Module names and their sources; a package with a face is read from its .pyi, which lists more than its .py."""
    found = {}
    for folder, name in ((SOURCES, "diffprt"), (KERNELS, "diffprt.kernels")):
        for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.pyi")]):
            parts = path.relative_to(folder).with_suffix("").parts
            found[".".join([name, *parts]).removesuffix(".__init__")] = path
    return found


def room_of(module: str) -> str:
    return module.split(".")[1] if "." in module else module


@cache
def face(module: str) -> dict[str, str]:
    """Public names of a package and the modules that define them."""
    path = files()[module]
    if path.suffix != ".pyi":
        return {}
    return {name: target for target, name in imported(module) if name}


def imported(module: str) -> Iterator[tuple[str, str | None]]:
    """(module, name in it) of each import of ours in a file: at any depth, in functions and for types only too."""
    path = files()[module]
    package = module if path.stem == "__init__" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names if room_of(alias.name) in ROOMS)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")
                base = ".".join([*parents[: len(parents) - node.level + 1], *filter(None, [node.module])])
            if base.split(".")[0] == "diffprt":
                yield from ((base, alias.name) for alias in node.names)


def resolved(module: str, name: str | None) -> str:
    """The module that an import leads to: a name of a face leads to the file that defines it."""
    if name is None:
        return module
    if f"{module}.{name}" in files():
        return f"{module}.{name}"
    target = face(module).get(name) if module in files() else None
    return resolved(target, name) if target else module


@cache
def graph() -> dict[str, set[str]]:
    """Each module and those that it imports. That importing a module runs its packages' faces first is left out."""
    return {module: {resolved(*pair) for pair in imported(module)} - {module} for module in files()}


def test_there_is_something_to_check():
    assert len(files()) > 200 and sum(map(len, graph().values())) > 500
    assert {room_of(module) for module in files()} <= set(ROOMS), "a room that stands nowhere in ROOMS"
    missing = {(a, b) for a, bs in graph().items() for b in bs if b not in files()}
    assert not missing, missing


def test_imports_go_downhill():
    place = {room: i for i, room in enumerate(ROOMS)}
    edges = {(a, b) for a, bs in graph().items() for b in bs}
    uphill = {(a, b) for a, b in edges if place[room_of(a)] < place[room_of(b)]}
    assert uphill - UPHILL == set()
    assert UPHILL - uphill == set(), "mended: take it off the list"


def reach(module: str) -> set[str]:
    """What a module imports, directly or through others; itself only in a circle."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        new = graph()[waiting.pop()] - found
        found |= new
        waiting += new
    return found


def circles() -> set[frozenset[str]]:
    """Groups of files each of which imports every other of its group, directly or around."""
    reached = {module: reach(module) for module in graph()}
    in_circles = [module for module in reached if module in reached[module]]
    return {frozenset(b for b in in_circles if b in reached[a] and a in reached[b]) for a in in_circles}


def test_no_files_import_each_other():
    assert circles() - CIRCLES == set()
    assert CIRCLES - circles() == set(), "mended: take it off the list"


def faces() -> list[str]:
    found = [module for module, path in files().items() if path.suffix == ".pyi"]
    assert len(found) > 10
    return found


@pytest.mark.parametrize("module", faces())
def test_every_name_of_a_face_is_there(module):
    package = importlib.import_module(module)
    assert face(module)
    assert set(face(module)) <= set(dir(package))
    for name, target in face(module).items():
        value = getattr(package, name)
        assert isinstance(value, ModuleType) or value is getattr(importlib.import_module(target), name), name


def test_no_room_hides_a_function():
    for room in ROOMS:
        if room != "diffprt":
            assert isinstance(getattr(diffprt, room, diffprt), ModuleType), f"diffprt.{room} is a room and a function"
    functions = {name for name in face("diffprt") if not isinstance(getattr(diffprt, name), ModuleType)}
    assert functions & set(ROOMS) == set()
