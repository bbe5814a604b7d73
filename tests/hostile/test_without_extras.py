"""Where no extra is installed: every command works, or ends in one sentence with what to install.

Packages that come with extras alone cannot be imported in the processes of these tests, nor in those that they start.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from accelcal._support.errors import MissingExtra
from papers import stakkeland2007 as paper
from tests.house.test_supply import PROJECT, declared

from .case import LONG
from .writers import make_inputs

BARE = """
import sys
from importlib.machinery import PathFinder

HIDDEN = {hidden!r}
found = PathFinder.find_spec
PathFinder.find_spec = classmethod(
    lambda cls, name, path=None, target=None: None if name.partition(".")[0] in HIDDEN else found(name, path, target)
)
"""
INSTALL = re.compile(r"install it with: pip install [\"']accelcal\[(\w+)\]")
REFUSED = {
    "plots of compare": ("plot", "compare m.json other.csv --plots plots"),
    "figure of dwells": ("plot", "dwells tumble.csv --least 1s --figure rests.png"),
    "report": ("report", "report m.json run.csv -o run.html"),
    "light report": ("plot", "report m.json run.csv --light -o run.html"),
    "page of fleet": ("report", "fleet sensors/a -o fleet.html"),
    "PDF": ("", "report m.json run.csv --pdf -o run.html"),
    "port": ("live", "live --serial absent --baud 9600 --rig run.toml"),
    "dask": ("dask", "fleet sensors/a --dask 127.0.0.1:9"),
    "schema": ("dcc", "export m.json --dcc a.xml --schema dcc.xsd"),
    "workbench": ("app", "app --no-browser"),
}
"""By what is asked for: the extra that it needs, "" for one of several, and the command."""
WORKING = {
    "check": "check run.csv",
    "simulate": "simulate --seconds 2 -o made.csv",
    "cut": "cut run.csv --only 1:5 -o part.parquet",
    "init": "init bare.csv",
    "fit": "fit run.csv -o made.json",
    "freeze": "freeze m.json run.csv --at bias=0.05 -o held.json",
    "add": "add m.json run.csv --effect cubic -o cubic.json",
    "compare several": "compare m.json m2.json other.csv",
    "compare": "compare m.json other.csv",
    "power": "power run.csv",
    "diagnose": "diagnose m.json run.csv",
    "export": "export m.json --c a.h --rust a.rs --dcc a.xml",
    "effects": "effects cubic",
    "doctor": "doctor",
    "dwells": "dwells tumble.csv --least 1s",
    "fleet": "fleet sensors/a",
    "live": "live --file run.csv --rig run.toml -o got.parquet",
}
FEW = ("check", "cut", "fit", "export", "live", "doctor")
OFTEN = ("plots of compare", "report", "port", "dask", "workbench")


def of_extras() -> set[str]:
    """Modules that are importable here and would not be without extras."""
    needed, left = set[str](), set(declared(PROJECT["dependencies"]))
    while left:
        name = left.pop()
        needed.add(name)
        try:
            texts = requires(name) or []
        except PackageNotFoundError:
            continue
        items = [Requirement(text) for text in texts]
        left |= {canonicalize_name(r.name) for r in items if r.marker is None or r.marker.evaluate({"extra": ""})}
        left -= needed
    owners = packages_distributions().items()
    return {module for module, owner in owners if not needed & {canonicalize_name(name) for name in owner}} - {
        "accelcal"
    }


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings and models, and beside them what hides the extras."""
    folder = tmp_path_factory.mktemp("bare")
    make_inputs(folder)
    (folder / "dcc.xsd").write_text("<schema/>")
    (folder / "hidden").mkdir()
    (folder / "hidden" / "sitecustomize.py").write_text(BARE.format(hidden=of_extras()))
    return folder


def bare(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python without extras."""
    paths = os.pathsep.join([str(folder / "hidden"), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
        timeout=600,
        check=False,
    )


@pytest.mark.parametrize("name", REFUSED if LONG else OFTEN)
def test_what_needs_an_extra_ends_in_a_sentence_that_names_it(place: Path, name: str) -> None:
    extra, words = REFUSED[name]
    before = {path.name for path in place.rglob("*") if path.is_file()}
    done = bare(place, "-m", "accelcal", *words.split())
    assert done.returncode in (2, 3), (done.returncode, done.stdout, done.stderr)
    *progress, message = done.stderr.splitlines()
    assert message.startswith("accelcal: ")
    assert all("recordings fitted" in line for line in progress)
    named = INSTALL.search(message)
    assert named, done.stderr
    assert named[1] == extra or (not extra and named[1] in PROJECT["optional-dependencies"])
    after = {path.name for path in place.rglob("*") if path.is_file() and path.suffix != ".pyc"}
    assert after - before <= {"fleet.sqlite"}


@pytest.mark.parametrize("name", WORKING if LONG else FEW)
def test_what_needs_no_extra_works_without(place: Path, name: str) -> None:
    done = bare(place, "-m", "accelcal", *WORKING[name].split())
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


def test_the_extras_are_hidden_and_nothing_else(place: Path) -> None:
    for module in ("matplotlib.pyplot", "plotly", "nicegui", "h5py", "distributed", "xmlschema", "jinja2", "typst"):
        done = bare(place, "-c", f"import {module}")
        assert f"ModuleNotFoundError: No module named '{module.partition('.')[0]}'" in done.stderr, module
    assert bare(place, "-c", "import numpy, scipy, pyarrow, pint, pydantic, rich, typer, tomlkit").returncode == 0


def test_paper_asks_for_matplotlib_before_its_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr(paper, "_ITEMS", (lambda plan: pytest.fail("work was done"),))
    with pytest.raises(MissingExtra, match="figures need matplotlib"):
        paper.reproduce(out=tmp_path)
