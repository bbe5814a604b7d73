"""The README's examples run as printed, its figure is the one they draw, and its map is complete."""

import os
import re
import shlex
from pathlib import Path

import pytest

from tests.commands import accelcal, python
from tests.docs.pages import examples

pytestmark = pytest.mark.always
README = Path(__file__).parents[2] / "README.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README.read_text(), flags=re.M | re.S)


def test_the_python_example_runs_prints_a_falling_error_and_draws_the_figure(tmp_path):
    (example,), (recordings, *_) = blocks("python"), blocks("sh")
    for line in recordings.splitlines():
        python("-m", *shlex.split(line), cwd=tmp_path, check=True)
    assert len([line for line in example.splitlines() if line]) <= 15
    done = python("-c", example, cwd=tmp_path, check=True)
    size = r"([\d.]+) (m?µ?g) \([^)]+\)"
    pattern = rf"Systematic error of the output below [\d.]+ Hz: {size} → (?:≤ )?{size} rms; limit of detection {size}"
    (result,) = re.findall(pattern, " ".join(done.stdout.split()))
    before, after, floor = (float(result[i]) * {"mg": 1e3, "µg": 1.0}[result[i + 1]] for i in (0, 2, 4))
    print(f"systematic error {before:.3g} -> {after:.3g} µg, limit of detection {floor:.3g} µg")
    assert after < before / 3.0
    assert after < 1.5 * floor
    (shown,) = re.findall(r"!\[[^]]+\]\(docs/static/([\w.-]+)\)", README.read_text())
    assert {path.name for path in tmp_path.iterdir() if not path.name.startswith("run1")} == {shown, "sensor12.json"}
    assert (README.parent / "docs" / "static" / shown).stat().st_size < 200_000


def test_it_is_short_enough_to_be_read():
    assert len(README.read_text().splitlines()) <= 120


def test_the_first_picture_is_the_loop():
    assert re.search(r"!\[[^]]+\]\(([^)]+)\)", README.read_text())[1] == "docs/static/loop.png"


def test_the_map_names_every_folder():
    listed = set(re.findall(r"`([\w./-]+)`", README.read_text().partition("## Map")[2]))
    package = README.parent / "python" / "accelcal"
    folders = {path.parent.name for path in package.glob("*/__init__.py")} - {"_support"}
    assert folders <= listed
    assert {f"crates/{path.parent.name}" for path in README.parent.glob("crates/*/Cargo.toml")} <= listed
    assert {"firmware", "tests", "benches", "tools", "docs"} <= listed
    homes = (README.parent, package, package / "diagnosis")
    assert not [name for name in listed if not any((home / name).exists() for home in homes)]


def test_shell_examples_run_in_order(tmp_path):
    lines = [line for block in blocks("sh") for line in block.splitlines() if line]
    assert lines
    environment = os.environ | {"COLUMNS": "120"}
    for line in lines:
        program, *arguments = shlex.split(line)
        assert program == "accelcal"
        done = accelcal(*arguments, cwd=tmp_path, env=environment)
        assert done.returncode == 0, f"{line}: {done.stderr}"


def test_the_examples_of_quick_start_are_these():
    """Those of quick-start.md, which are run here."""
    runnable = [example.text for example in examples("quick-start") if example.language in ("sh", "python")]
    first, *others = blocks("sh")
    assert runnable == [first, *blocks("python"), *others]


def test_there_are_exactly_two_set_up_commands():
    (console,) = blocks("console")
    assert console.split("\n")[:-1] == ["make demo", "make test"]
