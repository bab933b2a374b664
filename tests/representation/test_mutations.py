"""Assets of which a field or a tensor was replaced: refused in one line, or sound enough for every command."""

from __future__ import annotations

import json
import os
import random
from dataclasses import replace
from pathlib import Path

import pytest
import safetensors
import safetensors.torch
import torch
from representations import REPRESENTATIONS

from diffprt.compression import compress
from diffprt.errors import InputError
from diffprt.exporters import export
from diffprt.rendering import render
from diffprt.representation.files import load, save
from diffprt.representation.header import read_header
from diffprt.representation.registry import HOMES
from diffprt.scene import Camera
from diffprt.shading import shade

# More by hand: DIFFPRT_MUTATIONS=400.
CASES = int(os.environ.get("DIFFPRT_MUTATIONS", "16"))


def nested(depth: int) -> object:
    value: object = 0
    for number in range(depth):
        value = [value] if number % 2 else {"a": value}
    return value


# As JSON text, for not all of it can be written.
HOSTILE = [
    "null", "true", "[]", "{}", '""', "0", "-1", "1.5", "1e400", "-1e400", "NaN", "Infinity", "1" * 400,
    "-" + "9" * 400, "1" * 5000, "1e308", '"' + "x" * 300 + '"',
    '"' + "x" * 70000 + '"', '"\\ud800"', '"\\u0000"', '"\\u001b[2J"',
    '"[/x]"', '"../../x"', "[[1, 2], [3]]", '{"a": [1, {"b": null}]}', "[" * 900 + "]" * 900, json.dumps(nested(31)),
    json.dumps(nested(29)), "[" + "1," * 3000 + "1]", '{"name": "ggx", "roughness": "rough"}', '{"": ""}', "2",
]  # fmt: skip


def raw(path: Path) -> tuple[str, dict[str, torch.Tensor]]:
    with safetensors.safe_open(path, framework="pt") as file:
        text = file.metadata()["diffprt"]
    return text, safetensors.torch.load_file(path)


def write(path: Path, text: str, tensors: dict[str, torch.Tensor]) -> None:
    data = {name: tensor.contiguous().clone() for name, tensor in tensors.items()}
    safetensors.torch.save_file(data, path, metadata={"diffprt": text})


def places(value: object, path: tuple = ()) -> list[tuple]:
    """Every entry of a header, at any depth."""
    held = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path] * bool(path) + [place for key, part in held for place in places(part, (*path, key))]


def header_mutated(text: str, generator: random.Random) -> str:
    """The header with one entry replaced, renamed or left out."""
    header = json.loads(text)
    place = generator.choice(places(header))
    holder = header
    for key in place[:-1]:
        holder = holder[key]
    how = generator.randrange(8)
    if how == 0 and isinstance(holder, dict):
        del holder[place[-1]]
        return json.dumps(header)
    if how == 1 and isinstance(holder, dict):
        holder[generator.choice(["[/x]", "\x1b[2J", "x" * 5000, ""])] = holder.pop(place[-1])
        return json.dumps(header)
    holder[place[-1]] = "@hostile@"
    return json.dumps(header).replace('"@hostile@"', generator.choice(HOSTILE))


def tensor_mutated(tensors: dict[str, torch.Tensor], generator: random.Random) -> None:
    """One tensor of another dtype or shape, with numbers that are out of range, or missing, or one too many."""
    name = generator.choice(sorted(tensors))
    tensor = tensors[name]
    shape = list(tensor.shape)
    axis = generator.randrange(len(shape))
    how = generator.randrange(7)
    if how == 0:
        types = (torch.float16, torch.bfloat16, torch.float32, torch.float64, torch.uint8, torch.int8, torch.int16)
        tensors[name] = (
            tensor.float()
            .clamp(0, 100)
            .to(generator.choice((*types, torch.int32, torch.int64, torch.bool, torch.uint16, torch.uint32)))
        )
    elif how == 1:
        shape[axis] = generator.choice([0, 1, 2, 3, 4, shape[axis] - 1, shape[axis] + 1, 2 * shape[axis]])
        tensors[name] = torch.zeros(shape, dtype=tensor.dtype)
    elif how == 2:
        shape.insert(axis, generator.choice([0, 1, 2]))
        tensors[name] = torch.zeros(shape, dtype=tensor.dtype)
    elif how == 3:
        tensors[name] = tensor.flatten() if generator.random() < 0.5 else tensor.transpose(0, -1)
    elif how == 4:
        wide = [float("nan"), float("inf"), -float("inf"), -1.0, 1.5, 1e30, -1e30, 3e38, 1e-40, 0.0]
        value = generator.choice(wide if tensor.is_floating_point() else [-1, 255, 127, 2**31 - 1, -(2**31)])
        limits = None if tensor.is_floating_point() else torch.iinfo(tensor.dtype)
        value = value if limits is None else min(max(value, limits.min), limits.max)
        flat = tensor.flatten().clone()
        flat[generator.randrange(len(flat)) if generator.random() < 0.5 else slice(None)] = value
        tensors[name] = flat.view(tensor.shape)
    elif how == 5:
        del tensors[name]
    else:
        tensors[generator.choice(["extra", "[/x]", "\x1b[2J", "", "x" * 300])] = tensor


def is_sound(path: Path, folder: Path, number: int) -> bool:
    """Whether an asset loads; then nothing that is done with it, of which `number` picks one, may end in anything but
    one line."""
    try:
        read_header(path)
        asset = load(path)
    except InputError as error:
        assert "\n" not in str(error) and len(str(error)) < 1500, error
        return False
    light = REPRESENTATIONS[asset.name].lights(1.0, 0.5)

    def camera() -> Camera:
        return Camera.framing(asset.elements.positions, width=12, height=8)

    tries = [
        lambda: save(asset, folder / "again.prt"),
        lambda: shade(asset, light, torch.tensor(camera().eye).float()),
        lambda: render(asset, light, camera()),
        lambda: export(asset, folder / "page"),
        lambda: compress(asset.decode(), clusters=3, components=2, iterations=2),
    ]
    try:
        tries[number % len(tries)]()
    except InputError as error:
        assert "\n" not in str(error)
    return True


@pytest.fixture(scope="module")
def seeds(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("seeds")
    made = {}
    for name in HOMES:
        asset = REPRESENTATIONS[name].make()
        save(asset, folder / f"{name}.prt")
        made[name] = folder / f"{name}.prt"
    few = compress(
        REPRESENTATIONS["transfer"].make(), clusters=6, components=3, weights_format="uint8", bases_format="uint8"
    )
    save(few, folder / "few.prt")
    return made | {"few": folder / "few.prt"}


@pytest.mark.parametrize("kind", [*HOMES, "few"])
@pytest.mark.parametrize("what", ["header", "tensor"])
def test_mutants_are_refused_in_one_line_or_sound(seeds, kind, what, tmp_path):
    generator = random.Random(f"{kind} {what}")
    text, tensors = raw(seeds[kind])
    refused = 0
    for number in range(CASES):
        changed, held = text, dict(tensors)
        if what == "header":
            changed = header_mutated(text, generator)
        else:
            tensor_mutated(held, generator)
        write(tmp_path / "x.prt", changed, held)
        refused += not is_sound(tmp_path / "x.prt", tmp_path, number)
    assert refused >= CASES // 8


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"settings": {"note": "x" * (1 << 20)}}, "most of them settings"),
        ({"settings": {"rays": float("nan")}}, "nan, no finite number as settings.rays"),
        ({"settings": {"a": {"b": [1, float("inf")]}}}, "inf, no finite number as settings.a.b"),
        ({"settings": {"seed": 10**400}}, "as settings.seed"),
        ({"settings": {"where": Path("a")}}, "as settings.where"),
        ({"settings": {"size": (1, 2)}}, "a tuple"),
        ({"settings": {1: 2}}, "a key that is no text"),
        ({"settings": {"name": "\ud800"}}, "no Unicode"),
        ({"plan": {"a": nested(40)}}, "nested more than 32 deep"),
        ({"plan": None}, "plan is a NoneType"),
        ({"certificate": {"noise_relative": "small"}}, "noise_relative of its certificate as a str"),
        ({"scene_hash": "x" * 1000}, "scene_hash"),
    ],
)
def test_settings_that_load_would_refuse_are_not_saved(change, words, tmp_path):
    asset = REPRESENTATIONS["transfer"].make()
    save(asset, tmp_path / "a.prt")
    before = (tmp_path / "a.prt").read_bytes()
    with pytest.raises(InputError, match=words.replace("^", r"\^")) as caught:
        save(asset.labeled(replace(asset.provenance, **change)), tmp_path / "a.prt")
    assert "\n" not in str(caught.value) and "cannot be saved" in str(caught.value)
    assert (tmp_path / "a.prt").read_bytes() == before


@pytest.mark.parametrize(
    ("part", "value", "words"),
    [
        ("diffuse", torch.nan, "non-finite diffuse"),
        ("openness", 1.5, r"openness from .* to 1.5, wanted 0 to 1"),
        ("albedo", -0.5, r"albedo from -0.5 to .*, wanted 0 to 1"),
        ("albedo", torch.inf, "non-finite albedo"),
        ("normals", 7.0, "normals from"),
    ],
)
def test_numbers_that_load_would_refuse_are_not_saved(part, value, words, tmp_path):
    asset = REPRESENTATIONS["transfer"].make()
    owner = asset if part in asset.spec else asset.receivers
    changed = getattr(owner, part).clone()
    changed.view(-1)[3] = value
    owner = replace(owner, **{part: changed})
    asset = owner if part in asset.spec else replace(asset, receivers=owner)
    with pytest.raises(InputError, match=words) as caught:
        save(asset, tmp_path / "a.prt")
    assert "cannot be saved" in str(caught.value) and not list(tmp_path.iterdir())
    text, tensors = raw(saved_sound(tmp_path))
    tensors[part] = changed
    write(tmp_path / "a.prt", text, tensors)
    with pytest.raises(InputError, match=words):
        load(tmp_path / "a.prt")


def saved_sound(folder: Path) -> Path:
    save(REPRESENTATIONS["transfer"].make(), folder / "sound.prt")
    return folder / "sound.prt"


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_dtypes_that_load_would_refuse_are_not_saved(dtype, tmp_path):
    asset = REPRESENTATIONS["glossy_transfer"].make()
    with pytest.raises(InputError, match=r"glossy of dtype .*, wanted float32 or float64"):
        save(asset.with_signal(asset.glossy.to(dtype)), tmp_path / "a.prt")


def test_plain_settings_come_back_equal(tmp_path):
    asset = REPRESENTATIONS["transfer"].make()
    plain = {"a": [1, -0.5, None, True, "é\n"], "b": {"": {}}, "c": nested(29), "d": 2**64, "e": 5e-324}
    save(asset.labeled(replace(asset.provenance, settings=plain)), tmp_path / "a.prt")
    assert load(tmp_path / "a.prt").settings == plain
