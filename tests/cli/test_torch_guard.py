"""Every command works with one torch thread, unless the environment says otherwise."""

import json
import os
import subprocess
import sys

import pytest
import torch
import typer
from typer.main import get_group

from diffprt import bake, trace
from diffprt.cli import app
from diffprt.scene import builtin_scene


def every_command(group=None, words=()):
    """The words of every command, as the parser finds them."""
    group = get_group(app) if group is None else group
    context = typer.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        yield from every_command(command, (*words, name)) if hasattr(command, "list_commands") else [(*words, name)]


EVERY = list(every_command())


@pytest.fixture
def four_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(4)
    yield
    torch.set_num_threads(before)


def test_commands_of_groups_in_groups_are_found():
    assert {("bake",), ("study", "overdraw"), ("invert", "light")} < set(EVERY) and len(EVERY) > 20


@pytest.mark.parametrize("words", EVERY, ids=" ".join)
def test_every_command_has_one_torch_thread(words, monkeypatch, four_threads):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    group, found = get_group(app), []
    for name in words[:-1]:
        group = group.get_command(typer.Context(group), name)
    command = group.get_command(typer.Context(group), words[-1])

    def run(**given: object) -> None:
        found.append((torch.get_num_threads(), os.environ["OMP_NUM_THREADS"], os.environ["OMP_WAIT_POLICY"]))

    monkeypatch.setattr(command, "callback", run)
    monkeypatch.setattr(command, "params", [])
    get_group(app)(args=list(words), standalone_mode=False)
    assert found == [(1, "1", "PASSIVE")]
    assert torch.get_num_threads() == 4 and "OMP_NUM_THREADS" not in os.environ


PROGRAM = """
import json, os, sys
import diffprt.cli.lazy as lazy, diffprt.cli.doctor as doctor
from diffprt.cli import main
def run() -> None:
    import torch
    print(json.dumps(torch.get_num_threads()))
doctor.run = run
main(["doctor"])
"""


@pytest.mark.parametrize("asked", [None, "2"])
def test_torch_is_imported_with_one_thread_or_as_many_as_the_environment_asks_for(asked):
    environment = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    environment |= {} if asked is None else {"OMP_NUM_THREADS": asked}
    run = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, env=environment)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout) == min(int(asked or 1), os.cpu_count() or 1)


def test_a_bake_from_python_has_one_torch_thread_and_gives_the_others_back(monkeypatch, four_threads):
    found = []
    scene = builtin_scene("sphere", subdivisions=0)
    monkeypatch.setattr(type(scene), "glossy", property(lambda self: found.append(torch.get_num_threads())))
    bake(scene, order=2, rays=16, bounces=0)
    trace(scene, order=2, rays=16, bounces=0)
    assert len(found) >= 2 and set(found) == {1}
    assert torch.get_num_threads() == 4
