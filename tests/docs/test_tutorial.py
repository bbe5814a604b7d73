"""The tutorial holds no output, and fails where its claims are false; `test_site.py` runs it to the end."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.ipynb"
HIDING = 'hide("random", seed=3)'


def executed(notebook, folder):
    return NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()


def outputs(notebook):
    return [out for cell in notebook.cells if cell.cell_type == "code" for out in cell.outputs]


def test_the_stored_notebook_is_valid_and_holds_no_output():
    notebook = nbformat.read(TUTORIAL, as_version=4)
    nbformat.validate(notebook)
    assert not outputs(notebook)
    assert {cell.execution_count for cell in notebook.cells if cell.cell_type == "code"} == {None}


def test_a_tutorial_whose_claims_are_false_fails(tmp_path):
    notebook = nbformat.read(TUTORIAL, as_version=4)
    (hiding,) = (cell for cell in notebook.cells if HIDING in cell.source)
    hiding.source = hiding.source.replace(HIDING, 'hide("none", seed=3)')
    with pytest.raises(CellExecutionError):
        executed(notebook, tmp_path)
