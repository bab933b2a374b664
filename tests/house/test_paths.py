"""Every option that names a file says whether it is read or written, and every command is checked by it."""

import importlib
import inspect
from pathlib import Path
from typing import get_args

import pytest

from diffprt.cli.lazy import _command
from diffprt.cli.main import COMMANDS
from diffprt.cli.paths import roles_of
from diffprt.cli.study import COMMANDS as STUDIES

# Texts that name no file. A new option stands here, or has one of the types of `diffprt.cli.paths`.
PLAIN = {
    "albedo", "background", "bases_format", "bounces", "brdf", "brdfs", "bytes", "curve", "exposure", "loss",
    "mean_albedo", "method", "methods", "non_finite", "operator", "parameters", "quality", "signal", "size", "start",
    "title", "up", "weights_format", "winding", "window",
}  # fmt: skip
# A point there, a file elsewhere.
POINTS = {"diffprt.cli.render": {"target"}, "diffprt.cli.export": {"target"}}


def commands() -> dict:
    """Functions by the name of their command."""
    found = {}
    for package, names in (("diffprt.cli", COMMANDS), ("diffprt.cli.study", STUDIES)):
        for name in names:
            module = importlib.import_module(f"{package}.{name}")
            if hasattr(module, "run"):
                found[f"{package}.{name}"] = module.run
            elif name != "study":
                for registered in module.app.registered_commands:
                    run = inspect.unwrap(registered.callback)
                    found[f"{package}.{name} {run.__name__}"] = run
    return found


def test_all_commands_are_seen():
    assert len(commands()) > 20


@pytest.mark.parametrize("command", commands())
def test_options_that_may_name_files_say_what_becomes_of_them(command):
    run = commands()[command]
    roles, used = roles_of(run), set()
    for name, parameter in inspect.signature(run, eval_str=True).parameters.items():
        kinds = {parameter.annotation, *get_args(parameter.annotation)}
        kinds |= {part for kind in kinds for part in get_args(kind)}
        if kinds & {Path, str}:
            assert (name in roles) != (name in PLAIN | POINTS.get(command, set())), (
                f"{command}: {name} is neither read, nor written, nor plain"
            )
            assert Path not in kinds or name in roles, f"{command}: {name} is a path without a role"
            used.add(name)
    assert "json_file" not in used or roles["json_file"].writes
    assert "output" not in used or roles["output"].writes


def test_nothing_is_called_plain_that_is_not_there():
    names = {name for run in commands().values() for name in inspect.signature(run, eval_str=True).parameters}
    assert names >= PLAIN


@pytest.mark.parametrize(("package", "names"), [("diffprt.cli", COMMANDS), ("diffprt.cli.study", STUDIES)])
def test_every_command_is_checked(package, names):
    for name in names:
        command = _command(package, name)
        for one in getattr(command, "commands", {"": command}).values():
            layers, function = [], one.callback
            while function is not None:
                layers.append(function.__code__.co_qualname)
                function = getattr(function, "__wrapped__", None)
            checked = any("with_checked_paths" in layer for layer in layers)
            assert checked or not getattr(one, "params", None) or name == "study", (name, layers)
