"""Two estimates of one record: they agree where nothing is wrong, and the verdict says so first where they do not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.checks import engines
from accelcal.diagnosis.independent_estimate import as_normal, differences
from accelcal.diagnosis.policy import ENGINES_APART, ENGINES_LEAST_STD
from accelcal.estimation import drive
from accelcal.estimation.estimate import solve_runs
from accelcal.io import load
from accelcal.simulation import CXL02_RIG
from benches.engines import compared, worst
from tests.hostile.case import case_rng
from tests.regimes.regimes import TABLE
from tests.regimes.rig import Planted
from tests.regimes.trials import Trial

HONEST = ("a-trap-adxl105", "a-mixed-servo", "b-nm-1k-1k-0.4", "c-phone-irregular", "k-miss10-random", "s-skew")


def record(regime: str, number: int, folder) -> ac.Recording:
    trial = Trial(regime, number, 20)
    return load(TABLE[regime].build(trial.record_seed, Planted()).write(folder))


@pytest.mark.parametrize("regime", HONEST)
def test_both_agree_on_an_honest_record(regime: str, tmp_path) -> None:
    comparison = compared(regime, record(regime, 0, tmp_path))
    print(
        f"{regime}: {dict(zip(comparison['names'], np.round(comparison['sigma'], 2), strict=True))} "
        f"(at most {ENGINES_APART:g})"
    )
    assert comparison["sigma"]
    assert worst(comparison) < ENGINES_APART


def test_they_agree_with_an_effect_in_the_model_and_two_runs() -> None:
    records = [
        ac.simulate(
            motion,
            seconds=20.0,
            rig=CXL02_RIG,
            parameters={"bias": 0.05, "cubic": 1e-3},
            rng=case_rng("two", number),
        ).recording
        for number, motion in enumerate(("interleaved", "tones"))
    ]
    result = differences(solve_runs(ac.Model.linear().add("cubic"), records))
    assert {"bias", "scale_factor", "cubic"} <= {item.name for item in result}
    assert [item.run for item in result if item.name == "time_offset"] == [0, 1]
    assert not [*engines(SimpleNamespace(differences=result))]


def test_a_fault_of_the_replay_alone_is_the_first_thing_that_is_said(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An output that is linear between its samples moves the scale factor on a nanometre reference."""
    recording = record("b-nm-1k-1k-0.25", 0, tmp_path)
    fit = ac.fit(recording, method="replay")
    before = ac.diagnose(fit, recording)
    assert before.verdict == "adequate"
    assert "independent estimates" not in before.sentence
    monkeypatch.setattr(drive, "INTERPOLATION", "linear")
    after = ac.diagnose(fit, recording)
    assert after.verdict != "adequate"
    assert after.sentence.startswith("Two independent estimates of this record disagree in scale_factor: ")
    assert "othing is missing" not in after.sentence
    assert "othing else is missing" not in after.sentence
    moved = abs(after.fit["scale_factor"].value - fit["scale_factor"].value) / fit["scale_factor"].std
    note = next(remark for remark in after.remarks if remark.code == "engines_disagree")
    print(f"moved by {moved:.1f} standard deviations, seen at {note.values['sigma']:.1f}")
    assert moved > 5.0
    assert float(note.values["weak"]) == pytest.approx(fit["scale_factor"].value, abs=fit["scale_factor"].std)


def test_few_blocks_and_small_differences_count_for_less() -> None:
    ones = np.ones(1)
    of_many = float(as_normal(5.0 * ones, ones, 1e6 * ones, 0.1 * ones)[0])
    of_ten = float(as_normal(5.0 * ones, ones, 10.0 * ones, 0.1 * ones)[0])
    of_small = float(as_normal(-0.3 * ones, 1e-3 * ones, 40.0 * ones, ENGINES_LEAST_STD * ones)[0])
    assert of_many == pytest.approx(5.0, abs=1e-3)
    assert 2.0 < of_ten < 4.0
    assert of_small == pytest.approx(-3.0)
