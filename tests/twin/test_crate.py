"""What a user of the crate runs: its examples give the numbers of the NumPy twin and find the sensor."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.twin import reference

pytestmark = pytest.mark.outside

CRATE = Path(__file__).parents[2] / "crates" / "ekf-core"
RECORD = CRATE / "examples" / "record.csv"
TRUTH = {"k": 0.02, "K0": 0.1, "K2": 2e-3, "K3": 3e-4}
DENSITY, JERK = 1.9e-6, 1e5  # as in examples/paper.rs
SIGMA = {"p": 1e-3, "v": 0.1, "a": 20.0, "k": 0.05, "K0": 0.5, "K2": 1e-2, "K3": 1e-3}
FILTERS = {
    "ACI, linear, first order, RK2": ("aci", "rk2", 1, ("p", "v", "k", "K0")),
    "CWPA, linear, first order": ("cwpa", "exact", 1, ("p", "v", "a", "k", "K0")),
    "ACI, cubic, second order, RK4": ("aci", "rk4", 2, ("p", "v", *TRUTH)),
    "CWPA, cubic, second order": ("cwpa", "exact", 2, ("p", "v", "a", *TRUTH)),
}
"""The lines of the example `paper`: system, integrator, order, states."""
TWO_SLOPES = {"k": 0.02, "K0": 0.1, "s": -0.005}


def example(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = ["cargo", "run", "--quiet", "--example", name, "--", *arguments]
    return subprocess.run(command, cwd=CRATE, capture_output=True, text=True, timeout=300, check=False)


def printed(line: str) -> dict[str, tuple[float, float]]:
    """Estimates of a line, each with its standard deviation."""
    return {name: (float(x), float(s)) for name, x, s in re.findall(r"(\w+) = (-?[\d.]+)\(([\d.]+)\)", line)}


def shortened(path: Path, rows: int) -> Path:
    """The first rows of the record, as another file."""
    path.write_text("\n".join(RECORD.read_text().splitlines()[: rows + 1]) + "\n")
    return path


def test_the_paper_on_a_csv_gives_the_numbers_of_the_twin(tmp_path):
    csv = shortened(tmp_path / "short.csv", 300)
    table = np.genfromtxt(csv, delimiter=",", skip_header=1)
    read = np.isfinite(table[:, 2])
    done = example("paper", str(csv))
    assert done.returncode == 0, done.stderr
    lines = {line[:36].strip(): printed(line) for line in done.stdout.splitlines()}
    assert lines.keys() == FILTERS.keys()
    for name, (system, integrator, order, states) in FILTERS.items():
        q = {"aci": DENSITY, "cwpa": JERK}[system]
        twin = reference.Twin(
            system, "forward", "cubic", integrator, order, "dense", q, 1e-12, r_accel=DENSITY * 1667.0
        )
        prior = np.diag([SIGMA[state] ** 2 for state in states])
        run = reference.run(twin, np.zeros(len(states)), prior, *table[:, :2].T, *table[read][:, [0, 2]].T)
        for i, state in enumerate(states):
            if state in TRUTH:
                estimate, sigma = lines[name][state]
                assert abs(estimate - run.x[-1][i]) <= 0.6e-6  # six digits are printed
                assert abs(sigma - np.sqrt(run.P[-1][i, i])) <= 0.6e-6


def test_the_example_finds_the_sensor_where_the_model_is_whole():
    lines = {line[:36].strip(): printed(line) for line in example("paper").stdout.splitlines()}

    def worst(name: str) -> float:
        return max(abs(x - TRUTH[parameter]) / s for parameter, (x, s) in lines[name].items())

    assert worst("ACI, cubic, second order, RK4") < 4.0  # one record whose bits are fixed: 4 x 6e-5
    assert worst("CWPA, cubic, second order") < 4.0
    assert worst("ACI, linear, first order, RK2") > 4.0  # K2 and K3 are left out


@pytest.mark.parametrize(
    ("name", "truth"),
    [("fixed_rate", {"k": 0.02, "K0": 0.1}), ("own_sensor", TWO_SLOPES)],
    ids=lambda value: str(value),
)
def test_the_other_examples_find_their_sensor(name, truth):
    done = example(name)
    assert done.returncode == 0, done.stderr
    result = printed(done.stdout)
    assert result.keys() == truth.keys()
    for parameter, (estimate, sigma) in result.items():
        assert abs(estimate - truth[parameter]) < 0.5 * sigma  # nothing is random but the prior's share
        assert abs(1.2 * truth[parameter] - estimate) > 0.5 * sigma  # a fifth more would be seen


def test_a_csv_that_no_filter_can_use_ends_in_one_sentence(tmp_path):
    rows = RECORD.read_text().splitlines()
    for text, message in (
        ("\n".join([*rows[:9], "0.1,word,"]), "word"),
        ("\n".join([*rows[:9], rows[3]]), "NotRising"),
    ):
        (tmp_path / "bad.csv").write_text(text)
        done = example("paper", str(tmp_path / "bad.csv"))
        assert done.returncode == 1
        assert message in done.stderr
        assert "panicked" not in done.stderr


def test_the_package_builds_from_the_files_that_it_holds():
    command = ["cargo", "package", "--allow-dirty", "--offline", "--quiet"]
    both = [*command, "-p", "ekf-core", "-p", "ekf-simd"]
    done = subprocess.run(both, cwd=CRATE, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    holds = {"ekf-core": {"examples/record.csv", "src/lib.rs"}, "ekf-simd": {"tests/common/mod.rs", "src/lib.rs"}}
    for name, files in holds.items():
        listing = [*command, "-p", name, "--list"]
        listed = subprocess.run(listing, cwd=CRATE, capture_output=True, text=True, check=True).stdout.split()
        assert {"README.md", "LICENSE-MIT", "LICENSE-APACHE", *files} <= set(listed)
        assert not [file for file in listed if file.startswith(("fuzz", "benches"))]


@pytest.mark.parametrize("licence", ["LICENSE-MIT", "LICENSE-APACHE"])
@pytest.mark.parametrize("crate", ["ekf-core", "ekf-simd"])
def test_a_package_holds_its_licence_and_not_the_way_to_it(crate, licence):
    root = CRATE.parents[1]
    assert (CRATE.parent / crate / licence).read_bytes() == (root / licence).read_bytes()
