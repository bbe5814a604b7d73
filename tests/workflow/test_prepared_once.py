"""A recording is prepared once for all verbs, as long as nothing is left out of it and nothing breaks."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import pytest

import accelcal as ac
from accelcal.estimation import run
from accelcal.io.write import write_csv
from accelcal.simulation import CXL02_RIG


def calls(verb: Callable[[], object]) -> int:
    """How often a verb prepares a recording."""
    count = 0

    def trace(frame, event, _) -> None:
        nonlocal count
        count += event == "call" and frame.f_code is run.prepare.__code__

    sys.setprofile(trace)
    try:
        verb()
    finally:
        sys.setprofile(None)
    return count


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> ac.Recording:
    simulation = ac.simulate(
        "tones", seconds=20.0, rig=CXL02_RIG, parameters={"cubic": 1e-3}, rng=np.random.default_rng(1)
    )
    path = tmp_path_factory.mktemp("once") / "run.csv"
    write_csv(simulation.recording, path)
    return ac.load(path)


VERBS = (
    ac.fit,
    lambda recording: ac.diagnose(ac.fit(recording), recording),
    lambda recording: ac.add(ac.fit(recording), recording, "cubic"),
    lambda recording: ac.compare(ac.fit(recording), recording),
)


@pytest.mark.parametrize("number", range(len(VERBS)))
def test_a_fit_and_a_diagnosis_prepare_a_file_once(recording, number) -> None:
    recording.accel.y[0] += 1e-9  # other content than that of the tests before
    assert calls(lambda: VERBS[number](recording)) == 1
    assert [calls(lambda verb=verb: verb(recording)) for verb in VERBS] == [0] * len(VERBS)


def test_the_count_counts(recording) -> None:
    assert calls(lambda: [run.prepare(recording) for _ in range(3)]) == 3
