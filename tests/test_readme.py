"""What README and docs say is true: the quick start runs, every command and option exists, every link leads on."""

import importlib.metadata
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
import typer.testing

import diffprt
from diffprt.brdf import BRDFS
from diffprt.cli import app
from diffprt.compression import compress
from diffprt.images import read_image
from diffprt.planning import Plan, plan
from diffprt.representation.files import load
from diffprt.representation.geometry import with_geometry
from diffprt.scene import POLICY, Scene, builtin_scene
from diffprt.scene.readers.loading import READERS
from diffprt.transfer import bake

ROOT = Path(__file__).resolve().parents[1]


def readme() -> str:
    """The file, or what the wheel carries of it."""
    file = ROOT / "README.md"
    return file.read_text("utf-8") if file.is_file() else importlib.metadata.metadata("diffprt").get_payload()


def blocks(language: str) -> list[str]:
    found = re.findall(rf"^```{language}\n(.*?)^```$", readme(), re.MULTILINE | re.DOTALL)
    assert found, f"README has no {language} block"
    return found


def command_lines() -> list[str]:
    """Every `diffprt ...` in shell blocks and in running text."""
    lines = [line.partition("#")[0] for block in blocks("sh") for line in block.splitlines()]
    lines = [line.strip().removeprefix(".venv/bin/") for line in lines]
    lines += re.findall(r"`(diffprt [^`]+)`", readme())
    found = sorted({line for line in lines if line.startswith("diffprt ") and "COMMAND" not in line})
    assert len(found) > 8
    return found


@cache
def help_of(*command: str) -> str:
    """The help of a command, wide enough that no option is cut; empty when there is no such command."""
    result = typer.testing.CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "200"})
    return result.output if result.exit_code == 0 else ""


def split_command(line: str) -> tuple[list[str], list[str]]:
    """The command, with a group's second word, and its arguments."""
    words = shlex.split(line)[1:]
    count = 2 if re.search(r"^\s*Usage: .* COMMAND ", help_of(words[0]), re.MULTILINE) else 1
    return words[:count], words[count:]


@pytest.mark.parametrize("line", command_lines())
def test_command_and_options_exist(line):
    command, arguments = split_command(line)
    text = help_of(*command)
    assert text, f"README names '{line}', and there is no such command"
    known = set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", text))
    for option in (word for word in arguments if re.match(r"--?[a-z]", word)):
        assert option in known, f"README names '{line}', and {' '.join(command)} has no {option}"


def test_options_in_running_text_exist():
    named = set(re.findall(r"`(--[a-z-]+)[ `]", readme()))
    known = set().union(*(re.findall(r"--[a-z][a-z-]*", help_of(*split_command(line)[0])) for line in command_lines()))
    assert len(named) > 5
    assert named <= known


def test_table_lists_every_command():
    rows = re.findall(r"^\| `diffprt ([a-z ]+)` \|", readme(), re.MULTILINE)
    named = {row.split()[0] for row in rows}
    listed = help_of().partition("Commands")[2]
    existing = set(re.findall(r"^[\s│|]*([a-z]+) {2,}", listed, re.MULTILINE))
    assert existing and named == existing


def test_every_brdf_and_scene_format_is_named():
    """Where they are listed by hand: commands' help, README, and what loads scenes."""
    brdfs, formats = set(BRDFS), {reader.partition(":")[0] for reader in READERS.values()}
    assert len(brdfs) >= 5 and len(formats) >= 5
    assert brdfs <= set(re.findall(r"[\w-]+", re.sub(r"-[\s│|]+", "-", help_of("bake"))))
    assert brdfs <= set(re.findall(r"`([\w-]+)`", readme()))
    for command in ("bake", "plan"):
        assert formats <= {READERS[ending].partition(":")[0] for ending in endings_of(help_of(command))}
    told = readme().partition("- scenes from")[2].partition(" files")[0]
    assert formats <= set(re.findall(r"\w+", told.lower()))
    for docs in (Scene.load.__doc__, diffprt.scene.__doc__):
        assert endings_of(docs) == set(READERS)


def endings_of(text: str) -> set[str]:
    return set(re.findall(r"\.\w+", text)) & set(READERS)


def test_quick_start_runs_as_written(tmp_path):
    (source,) = blocks("python")
    (tmp_path / "quick_start.py").write_text(source)
    run = subprocess.run([sys.executable, "quick_start.py"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    image = read_image(tmp_path / "bunny.png")
    assert 0.2 < float(image.mean()) < 0.9
    assert load(tmp_path / "bunny.prt").clusters == 32
    assert (tmp_path / "page" / "index.html").stat().st_size > 100_000


def pages() -> list[Path]:
    found = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
    assert len(found) >= 6
    return found


@pytest.mark.checkout
def test_links_lead_to_files():
    links = 0
    for page in pages():
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text("utf-8")):
            links += 1
            assert (page.parent / target).exists(), f"{page.name} links to {target}"
    assert links > 5


@pytest.mark.checkout
def test_names_in_the_docs_exist():
    """Every `diffprt.x.y` in the pages can be imported."""
    names = {n for page in pages() for n in re.findall(r"`(diffprt(?:\.\w+)+)", page.read_text("utf-8"))}
    names -= {"diffprt.ROOM"}
    assert len(names) > 5
    for name in names:
        found, module = None, ""
        for part in name.split("."):
            module = f"{module}.{part}".lstrip(".")
            try:
                # Modules come first: `diffprt.optimization` is a room, and a function of the same name.
                found = importlib.import_module(module)
            except ModuleNotFoundError:
                found = getattr(found, part)


@pytest.mark.checkout
def test_policy_table_is_the_policy():
    (page,) = (page for page in pages() if page.name == "defects.md")
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", page.read_text("utf-8"), re.MULTILINE))
    assert rows == POLICY


@pytest.mark.checkout
def test_asset_tables_list_certificate_and_plan():
    """Every entry that a bake and a compression write is explained, and no other."""
    (page,) = (page for page in pages() if page.name == "assets.md")
    _, _, text = page.read_text("utf-8").partition("## Certificate")
    certificate, _, planned = text.partition("## Plan")

    def entries(part: str) -> set[str]:
        rows = re.findall(r"^\| (`[^|]*`) \|", part, re.MULTILINE)
        return {name for row in rows for name in re.findall(r"`(\w+)`", row)}

    scene = builtin_scene("sphere", subdivisions=1).with_ground(resolution=4)
    decided = plan(scene, 0.5, order=2, bounces=1)
    asset = compress(bake(scene, plan=decided, tolerance=0.2), clusters=2, components=1)
    assert Plan.from_dict(asset.plan) == decided
    elsewhere = {"rays_fewest", "rays_mean", "rays_most"}
    rounded = {"geometry_displacement", "geometry_displacement_relative", "geometry_normals_degrees"}
    assert entries(certificate) - elsewhere - rounded == set(asset.certificate)
    assert rounded < set(with_geometry(asset, 16).certificate)
    assert entries(planned) == set(asset.plan)
