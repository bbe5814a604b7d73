"""The tutorial runs from the first cell to the last, and its claims at the end are true."""

import re
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


def test_the_tutorial_finds_what_was_hidden_and_the_error_falls(tmp_path):
    notebook = executed(nbformat.read(TUTORIAL, as_version=4), tmp_path)
    html = [out.data["text/html"] for out in outputs(notebook) if "text/html" in out.get("data", {})]
    cards = [card for card in html if 'class="accelcal"' in card]
    for title in ("Recording", "Fit of", "Model against", "Diagnosis: an effect is missing", "base, base + "):
        assert any(title in card for card in cards), title
    assert "Diagnosis: no effect is missing" in " ".join(cards)
    assert sum("image/png" in out.get("data", {}) for out in outputs(notebook)) == 3
    printed = next(out.text for out in outputs(notebook) if out.get("text", "").startswith("hidden:"))
    hidden, found = re.findall(r"^(?:hidden|found):\s+(\w+), (\S+)", printed, flags=re.MULTILINE)
    assert hidden[0] == found[0]
    assert float(found[1]) == pytest.approx(float(hidden[1]), rel=0.2)  # 20 sigma or more
    assert {path.name for path in tmp_path.iterdir()} == {"model.json", "report.html"}


def test_a_tutorial_whose_claims_are_false_fails(tmp_path):
    notebook = nbformat.read(TUTORIAL, as_version=4)
    (hiding,) = (cell for cell in notebook.cells if HIDING in cell.source)
    hiding.source = hiding.source.replace(HIDING, 'hide("none", seed=3)')
    with pytest.raises(CellExecutionError):
        executed(notebook, tmp_path)
