"""Every notebook runs from top to bottom, in this interpreter; each asserts its own result."""

import re
import sys
from pathlib import Path

import jupytext
import nbformat
import pytest
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.py"))


def test_there_are_notebooks():
    assert NOTEBOOKS, f"no notebook in {FOLDER}"


def kernel() -> AsyncKernelManager:
    """A kernel of this interpreter, whatever a kernel specification of the user's says."""
    manager = AsyncKernelManager(kernel_name="python3")
    manager.kernel_spec.argv = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    manager.kernel_spec.env = {}
    return manager


@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_notebook_runs(path, tmp_path):
    notebook = jupytext.read(path, fmt="py:percent")
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert any("assert " in cell.source for cell in code), f"{path.name} asserts nothing"
    proof = nbformat.v4.new_code_cell("import sys\nprint(sys.executable)")
    notebook.cells.append(proof)
    client = NotebookClient(notebook, km=kernel(), timeout=120, resources={"metadata": {"path": str(tmp_path)}})
    failure = None
    try:
        client.execute()
    except CellExecutionError as error:
        failure = re.sub(r"\x1b\[[0-9;]*m", "", str(error))
    if failure:
        pytest.fail(f"notebook {path.name} failed\n{failure}", pytrace=False)
    assert proof.outputs[0].text.strip() == sys.executable
    assert any("image/png" in output.get("data", {}) for cell in code for output in cell.outputs), "no picture"
