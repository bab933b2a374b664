"""`kernels/` is `diffprt.kernels` and nothing else; every room is in the package list."""

import subprocess
import sys
from pathlib import Path

import pytest

import diffprt

ROOT = Path(diffprt.__file__).parents[1]


@pytest.mark.checkout
def test_kernels_refuse_their_bare_name():
    run = subprocess.run([sys.executable, "-c", "import kernels"], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode != 0 and "import diffprt.kernels" in run.stderr


@pytest.mark.checkout
def test_every_room_is_packaged():
    import tomllib

    listed = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    rooms = {str(p.parent.relative_to(ROOT)).replace("/", ".") for p in (ROOT / "diffprt").rglob("__init__.py")}
    assert rooms and listed == rooms | {"diffprt.kernels"}
    strays = [p for p in (ROOT / "diffprt").rglob("*.py") if not (p.parent / "__init__.py").is_file()]
    assert strays == []


def test_kernels_import_no_room():
    folder = (
        Path(sys.modules["diffprt.kernels"].__file__).parent if "diffprt.kernels" in sys.modules else ROOT / "kernels"
    )
    sources = list(folder.glob("*.py"))
    assert len(sources) >= 4
    for source in sources:
        for line in source.read_text().splitlines():
            assert not line.startswith(("import diffprt", "from diffprt")) or "diffprt.kernels" in line, (
                source,
                line,
            )
