"""Without the folders `app` and `live` the rest installs, runs the README and passes its tests; without others not."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from copy import copy
from pathlib import Path

import pytest

import accelcal
from tests.house.test_readme import blocks

ROOT = Path(__file__).parents[2]
ADD_ONS = ("app", "live")
RESTING_ON_THEM = re.compile(r"\baccelcal(\.| import )(app|live)\b|\bworkbench import|^tests/(app|live)/")
"""Tests of them, by name and text."""
CORE = ["signals", "fleet"]
"""Folders of tests that run in the copy; every other file is collected there."""
LENGTH = ["--seconds", "20"]
"""Of the records of the README: in the copy its commands need only find what they import and read."""
IN_ONE_PROCESS = """
import json, runpy, sys
for words in json.loads(sys.argv[1]):
    sys.argv[1:] = words
    try:
        runpy.run_module("accelcal", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if end.code:
            sys.exit(f"{words} ended with {end.code}")
"""
LOADED = (
    "import sys, accelcal; accelcal.fit; print(*sorted(name for name in sys.modules if name.startswith('accelcal')))"
)


class Copy:
    """Copy of the repository without folders of the package, installed beside the packages of this environment.

    The wheel is made here of the files and of the core that is compiled already: Rust is not what is tested.
    """

    def __init__(self, folder: Path, without: tuple[str, ...]) -> None:
        self.sources, self.site = folder / "sources", folder / "site"
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for name in filter(None, listed.split("\0")):
            if not name.startswith(tuple(f"python/accelcal/{left_out}/" for left_out in without)):
                (self.sources / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / name, self.sources / name)
        self.package = self.sources / "python" / "accelcal"
        (core,) = Path(accelcal.__file__).parent.glob("_core*.so")
        shutil.copy(core, self.package)
        self.install()

    def install(self) -> None:
        """Put the package and its entry point into a folder as pip does from a wheel, without network."""
        about = f"accelcal-{accelcal.__version__}"
        metadata = {
            "METADATA": f"Metadata-Version: 2.1\nName: accelcal\nVersion: {accelcal.__version__}\n",
            "WHEEL": "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: false\nTag: py3-none-any\n",
            "entry_points.txt": "[console_scripts]\naccelcal = accelcal.cli:main\n",
            "RECORD": "",
        }
        wheel = self.sources.parent / f"{about}-py3-none-any.whl"
        with zipfile.ZipFile(wheel, "w") as archive:
            for path in self.package.rglob("*"):
                archive.write(path, path.relative_to(self.package.parent))
            for name, text in metadata.items():
                archive.writestr(f"{about}.dist-info/{name}", text)
        options = ["--quiet", "--no-deps", "--no-index", "--no-compile", "--disable-pip-version-check"]
        words = ["-m", "pip", "install", *options, "--target", str(self.site), str(wheel)]
        subprocess.run([sys.executable, *words], check=True, timeout=120)

    def spoilt(self, folder: Path, without: str = "") -> Copy:
        """Return this installation once more, to be spoilt: its files are copied, with no folder `without`."""
        other = copy(self)
        other.site = folder / "site"
        shutil.copytree(self.site, other.site, ignore=lambda _, names: {without}.intersection(names))
        return other

    def run(self, *words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run Python with the installed copy in front of the package that is tested otherwise."""
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
        environment |= {"PYTHONPATH": str(self.site), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, *words]
        place = self.sources if cwd is None else cwd
        return subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, timeout=900)

    def quick_start(self, folder: Path) -> str:
        """Run the commands and the Python example of the README; return what fails first and says, else nothing."""
        folder.mkdir()
        lines = [shlex.split(line)[1:] for block in blocks("sh") for line in block.splitlines() if line]
        commands = [words + LENGTH if words[0] == "simulate" else words for words in lines]
        for script in ([IN_ONE_PROCESS, json.dumps(commands)], *([example] for example in blocks("python"))):
            end = self.run("-c", *script, cwd=folder)
            if end.returncode:
                return end.stderr
        return ""


@pytest.fixture(scope="module")
def detached(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    return Copy(tmp_path_factory.mktemp("detached"), ADD_ONS)


@pytest.mark.slow
def test_the_rest_installs_and_runs_the_quick_start(detached: Copy, tmp_path: Path) -> None:
    assert not [path for name in ADD_ONS for path in detached.site.glob(f"accelcal/{name}")]
    place = detached.run("-c", "import accelcal; print(accelcal.__file__)", cwd=tmp_path).stdout.strip()
    assert Path(place) == detached.site / "accelcal" / "__init__.py"
    assert detached.quick_start(tmp_path / "start") == ""


@pytest.mark.slow
def test_the_rest_passes_its_own_tests(detached: Copy) -> None:
    tests = {
        str(path.relative_to(detached.sources)): path for path in sorted(detached.sources.glob("tests/**/test_*.py"))
    }
    ours = [name for name, path in tests.items() if not RESTING_ON_THEM.search(f"{name}\n{path.read_text()}")]
    assert len(tests) - 50 < len(ours) < len(tests)
    folders = {Path(name).parts[1] for name in ours}
    assert folders.issuperset(CORE)
    options = ["-q", "-p", "no:cacheprovider", "-m", "not (slow or outside or statistics)"]
    collected_only = [f"--deselect=tests/{folder}/" for folder in sorted(folders.difference(CORE))]
    done = detached.run("-m", "pytest", *options, *collected_only, *ours)
    print(done.stdout.splitlines()[-1])
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_import_loads_what_it_loads_in_the_whole_package(detached: Copy, tmp_path: Path) -> None:
    here = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True).stdout
    assert detached.run("-c", LOADED, cwd=tmp_path).stdout == here
    assert "accelcal.verbs" in here.split()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "words"), [("app", ["--no-browser"]), ("live", ["--file", "a.csv", "--rig", "a.toml"])]
)
def test_a_command_of_a_folder_that_is_not_there_says_so(detached: Copy, name: str, words: list[str]) -> None:
    done = detached.run("-m", "accelcal", name, *words)
    assert done.returncode == 2
    assert done.stderr.startswith(f"accelcal: accelcal was installed without python/accelcal/{name}; install ")


@pytest.mark.slow
def test_without_a_folder_of_the_core_the_quick_start_fails(detached: Copy, tmp_path: Path) -> None:
    end = detached.spoilt(tmp_path, without="data").quick_start(tmp_path / "start")
    assert "accelcal.data" in end


@pytest.mark.slow
def test_a_core_that_imports_an_add_on_fails(detached: Copy, tmp_path: Path) -> None:
    spoilt = detached.spoilt(tmp_path)
    with (spoilt.site / "accelcal" / "verbs.py").open("a") as file:
        file.write("\nfrom accelcal.live import LiveSession\n")
    assert "ModuleNotFoundError in accelcal/verbs.py" in spoilt.quick_start(tmp_path / "start")
