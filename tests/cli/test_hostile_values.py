"""Every option of every command with hostile values: refused in one line, or of no harm."""

import ast
import os
import re
import time
from importlib import import_module
from pathlib import Path
from typing import get_type_hints

import pytest
import torch
from command_line import run
from typer.main import get_command

from diffprt import InputError
from diffprt.cli.main import app
from diffprt.options.numbers import NUMBERS as NUMBERS_BY_NAME
from diffprt.options.numbers import check_numbers

NUMBERS = (
    "nan", "inf", "-inf", "1e400", "-1", "0", "-1e300", "1e300", "1000000000000", "100000000000000000000",
    "1" + "0" * 400, "9" * 400 + "GB", "1" * 5000, "1000000000x1000000000", "nan,nan,nan", "1e300,0,0",
)  # fmt: skip
STEERING = (
    "[red]x[/red] [link=http://a.b]c[/link]", "\x1b[31mred\x1b[0m\x1b]0;title\x07", "a\nnote: b",
    "\u202ereversed\u2066", "caf\udce9",
)  # fmt: skip
TEXTS = ("", " ", ",", "=", ":", "n" * 5000, "*.glb", "--", "\x00")
# What no line on a terminal may hold.
STEERS = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
ENOUGH = len(STEERING) + 4
TRIANGLES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def commands(group, path=()):
    """Every command of the tree, by its words."""
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "list_commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


COMMANDS = dict(commands(get_command(app)))

# What makes each command work, in little time; studies and the demo end where their work would begin.
WORKING = {
    "demo": "-o {out}/demo",
    "doctor": "",
    "plan": "{tetra}",
    "bake": "{tetra} --order 1 --rays 16 --bounces 0 -o {out}/a.prt",
    "compress": "{baked} --clusters 2 --components 1 --iterations 1 -o {out}/a.prt",
    "render": "{baked} --light constant --size 8 --samples 1 -o {out}/a.png",
    "optimize": "{small} --references {references} --steps 1 -o {out}/a.prt",
    "export": "{baked} --light constant -o {out}/page",
    "info": "{baked}",
    "invert light": "{baked} --references {references} -o {out}/a.exr",
    "invert albedo": "{baked} --references {references} -o {out}/a.prt",
    "invert joint": "{baked} --references {references} -o {out}/a.prt",
    "study unseen": "--references {references} -o {out}/unseen",
    **{
        f"study {name}": "-o {out}/study"
        for name in ("reference", "visibility", "tolerance", "overdraw", "clustering", "optimize", "references")
    },
    **{f"study {name}": "" for name in ("gradient", "inverse", "display", "window")},
}
WORK = (
    "diffprt.demo:run_demo",
    "diffprt.cli.doctor:_rays_per_second",
    "diffprt.study.reference.study:reference_study",
    "diffprt.study.visibility.study:visibility_study",
    "diffprt.study.tolerance.study:tolerance_study",
    "diffprt.study.overdraw.study:overdraw_study",
    "diffprt.study.clustering:clustering_study",
    "diffprt.study.gradient.study:gradient_study",
    "diffprt.study.inverse:inverse_study",
    "diffprt.study.display.study:display_study",
    "diffprt.study.display.pictures:display_pictures",
    "diffprt.study.optimization.study:optimize_study",
    "diffprt.study.optimization.references:mitsuba_references",
    "diffprt.study.optimization.unseen:unseen_study",
    "diffprt.study.window:window_study",
)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A mesh, assets of it and pictures, all tiny."""
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "tetra.obj").write_text(TRIANGLES)
    os.mkfifo(folder / "pipe")
    bake = ("--order", 1, "--rays", 16, "--bounces", 0)
    assert run("bake", folder / "tetra.obj", *bake, "-o", folder / "baked.prt") == 0
    small = ("--clusters", 2, "--components", 1, "-o", folder / "small.prt")
    assert run("compress", folder / "baked.prt", *small) == 0
    views = ("--reference-set", 3, "--size", 8, "--samples", 1, "-o", folder / "references")
    assert run("render", folder / "baked.prt", *views) == 0
    return folder


def working(words, place, out):
    names = {"tetra": place / "tetra.obj", "baked": place / "baked.prt", "small": place / "small.prt"}
    return WORKING[" ".join(words)].format(**names, references=place / "references", out=out).split()


def test_every_command_is_walked():
    assert {" ".join(words) for words in COMMANDS} == set(WORKING)
    assert sum(len(command.params) for command in COMMANDS.values()) > 200


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_hostile_values_are_one_line_or_no_harm(words, place, tmp_path, capsys, monkeypatch):
    for work in WORK:
        module, _, name = work.partition(":")
        monkeypatch.setattr(import_module(module), name, _ends)
    monkeypatch.setattr("diffprt.exporters.web.export.fallback_picture", lambda *asked, **options: "")
    monkeypatch.chdir(tmp_path)
    base = working(words, place, tmp_path)
    paths = (str(tmp_path), str(place / "pipe"), "/dev/null", str(tmp_path / "gone" / "x"))
    options = [p for p in COMMANDS[words].params if p.name != "help" and not getattr(p, "is_flag", False)]
    assert options
    for option in options:
        accepted = 0
        for value in (*STEERING, *paths, *TEXTS, *NUMBERS):
            accepted += _tried(words, option.opts, base, value, capsys) == 0
            # What takes any text, such as a title, need not do all of its work for all of them.
            if accepted == ENOUGH:
                break


def _tried(words, names, base, value, capsys):
    """The exit status with an option's value, or the first argument, replaced."""
    if names[0].startswith("-"):
        arguments = [*words, *_without(base, names), f"{names[-1]}={value}"]
    else:
        rest = base if not base or base[0].startswith("-") else base[1:]
        arguments = [*words, value, *rest]
    begun = time.perf_counter()
    try:
        status = run(*arguments)
    except BaseException as error:
        raise AssertionError(f"{arguments} ended in {type(error).__name__}: {error}") from error
    said = capsys.readouterr()
    assert status in (0, 2), (arguments, status)
    assert time.perf_counter() - begun < 60, arguments
    assert not STEERS.search(said.out + said.err), (arguments, said)
    if status == 2:
        lines = said.err.splitlines()
        assert lines[-1].startswith("diffprt: ") and len(lines[-1]) < 1500, (arguments, lines)
        assert all(line.startswith("note: ") for line in lines[:-1]), (arguments, lines)
    return status


def _without(arguments, options):
    """Arguments without an option and its value."""
    kept, skip = [], False
    for argument in arguments:
        if not skip and argument not in options:
            kept.append(argument)
        skip = argument in options
    return kept


def _ends(*arguments, **options):
    raise InputError("here work begins")


def numbers():
    """Options that are read as numbers, by command."""
    for words, command in COMMANDS.items():
        for option in command.params:
            if option.opts[0].startswith("-") and not getattr(option, "is_flag", False):
                yield words, option


def test_every_number_option_has_a_range(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    ranged = set()
    for words, option in numbers():
        module = import_module(f"diffprt.cli.{'.'.join(words if words[0] == 'study' else words[:1])}")
        run_of = module.run if hasattr(module, "run") else getattr(module, words[-1])
        kind = str(get_type_hints(run_of)[option.name]) if option.name in get_type_hints(run_of) else ""
        if "int" in kind.replace("print", "") or "float" in kind:
            assert option.name in NUMBERS_BY_NAME, (words, option.name)
            ranged.add(option.name)
    assert len(ranged) > 40


@pytest.mark.parametrize("name", NUMBERS_BY_NAME)
def test_every_range_refuses_what_is_no_size(name):
    known = NUMBERS_BY_NAME[name]
    for value in (float("nan"), float("inf"), -float("inf"), 10**400, 1e300):
        for given in (value, [value], (value,)):
            with pytest.raises(InputError, match="give "):
                check_numbers({name: given})
    assert known.wanted


def test_python_callers_have_the_ranges_too():
    from diffprt.options import BakeOptions, CompressOptions, ExportOptions
    from diffprt.options.study import OverdrawOptions, VisibilityOptions
    from diffprt.scene import Camera

    nan, inf = float("nan"), float("inf")
    for kind, options in (
        (BakeOptions, {"hours": nan}),
        (BakeOptions, {"hours": inf}),
        (BakeOptions, {"ridge": inf}),
        (BakeOptions, {"threads": 10**9}),
        (CompressOptions, {"coherence": 1e300}),
        (CompressOptions, {"slack": nan}),
        (CompressOptions, {"components": 10**12}),
        (CompressOptions, {"registers": -1}),
        (ExportOptions, {"exposure": nan}),
        (OverdrawOptions, {"minutes": nan}),
        (VisibilityOptions, {"rays": (256, 10**12)}),
    ):
        with pytest.raises(InputError, match="give "):
            kind(**options)
    for angle in ("azimuth", "elevation", "fov"):
        for value in (nan, inf):
            with pytest.raises(InputError, match=angle):
                Camera.framing(torch.eye(3), **{angle: value})


def test_a_picture_beyond_memory_is_refused_before_it_is_begun(place, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("diffprt.rendering.memory.available_memory", lambda: 1 << 30)
    assert run("render", place / "baked.prt", "--size", 16384, "--samples", 1, "-o", tmp_path / "a.png") == 2
    assert "GiB are free: give a smaller size" in capsys.readouterr().err
    views = ("--reference-set", 100_000, "--size", 512, "--samples", 1)
    assert run("render", place / "baked.prt", *views, "-o", tmp_path / "views") == 2
    assert "100000 times" in capsys.readouterr().err


def test_names_in_files_do_not_steer_the_terminal(tmp_path, capsys):
    """Of meshes, materials and files, in notes, tables, warnings and errors."""
    nasty = "[red]a\x1b[2J\u202e"
    mesh = tmp_path / f"{nasty}.obj"
    mesh.write_text(f"mtllib {nasty}.mtl\no {nasty}\n" + TRIANGLES.replace("f 1 4 3\n", ""))
    few = ("--order", 1, "--rays", 16, "--bounces", 0)
    assert run("bake", mesh, tmp_path / "b\nnote: c.obj", *few, "-o", tmp_path / "out") == 1
    said = capsys.readouterr()
    assert not STEERS.search(said.out + said.err)
    assert "[red]a\\x1b[2J\\u202e.prt" in said.out and "b\\nnote: c.obj" in said.err + said.out
    assert "material library [red]a" in said.out


def test_commands_print_through_the_terminal():
    """No module of the command line prints what it did not make neutral."""
    from diffprt import cli

    for file in Path(cli.__file__).parent.rglob("*.py"):
        tree = ast.parse(file.read_text())
        prints = any(isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print" for node in ast.walk(tree))
        ours = any(
            isinstance(node, ast.ImportFrom)
            and node.module == "diffprt.cli.terminal"
            and any(alias.name in ("print", "one_line", "awaits_document") for alias in node.names)
            for node in ast.walk(tree)
        )
        assert not prints or ours or file.name == "terminal.py", file
