"""What an improvement says: what was found apart from what is left, and nothing named on too short a record."""

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.findings import Confounded, Finding, equivalent_sigma, with_findings
from accelcal.results import json as results_json
from accelcal.simulation import ADXL105_RIG, CXL02_RIG
from tests.schemas import require_published


def late(seconds, delay=2e-3, seed=5):
    rng = np.random.default_rng(seed)
    truth = {"bias": 0.05, "scale_factor": 0.01, "time_offset": delay}
    return ac.simulate("interleaved", seconds=seconds, rig=ADXL105_RIG, parameters=truth, rng=rng).recording


@pytest.fixture(scope="module")
def delayed():
    return ac.improve(late(40.0))


def test_the_sentence_opens_with_what_was_found_and_left_speaks_of_the_last_model(delayed):
    content = results_json.content(delayed)
    assert content["schema"] == "accelcal/improvement/5"
    require_published(content)
    assert content["effects"] == ["time_offset"]
    assert content["sentence"].startswith("time_offset was found (2")
    assert "nothing else is missing" in content["sentence"]
    assert content["verdict"] == "tied"  # with a lag of the sensor
    assert content["left"][0] == "adequate"
    (finding,) = content["detected"]
    assert finding["estimate"][0] == pytest.approx(2e-3, abs=4.5 * finding["std"][0])
    assert finding["sigma"] == pytest.approx(finding["estimate"][0] / finding["std"][0])
    assert len(finding["group"]["members"]) > 1
    assert {"classes", "diagnosis", "steps", "changes"} <= set(content)


def test_a_diagnosis_says_the_delay_as_well(delayed):
    assert delayed.diagnosis.sentence == delayed.sentence
    assert delayed.diagnosis.left.startswith("Nothing is missing")


def test_the_last_model_is_fitted_to_the_held_out_end_as_well(delayed):
    whole, last = delayed.best, delayed.steps[-1].fit
    assert (whole.runs[0].end, last.runs[0].end) == (pytest.approx(40.0, abs=0.1), pytest.approx(28.0, abs=0.1))
    assert whole["scale_factor"].std < last["scale_factor"].std
    assert delayed.diagnosis.fit["bias"] == last["bias"]


def test_few_blocks_need_more_than_a_normal_deviate_to_name_a_delay():
    # Nine blocks: eight degrees of freedom, 8.5 standard deviations at the level where a normal deviate needs 4.3.
    delay = 2.6e-4
    short, longer = ac.improve(late(1.0, delay)), ac.improve(late(4.0, delay))
    assert short.verdict == "too_short"
    assert short.effects == ()
    assert short.detected == ()
    result = short.steps[-1].fit["time_offset"]
    assert result.value - 5e-5 > 5.0 * result.std  # the tolerance of the low-pass is not counted
    assert longer.effects == ("time_offset",)
    # Where it is beyond doubt, it is found on few blocks as well: confounded with a lag, and no verdict on the rest.
    sure = ac.improve(late(1.0))
    assert (sure.verdict, sure.effects) == ("too_short", ("time_offset",))
    assert "confounded with sensor_lag" in sure.sentence


def test_what_is_lacking_but_not_added_is_not_said_to_explain():
    rng = np.random.default_rng(8)
    truth = {"bias": 0.05, "quadratic": 1e-3}
    recording = ac.simulate("interleaved", seconds=30.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
    improvement = ac.improve(recording, most=0)
    assert improvement.effects == ()
    assert improvement.verdict == "unexplained"
    assert "explains what the model lacks" not in improvement.sentence
    (note,) = (r for r in improvement.diagnosis.remarks if r.code == "not_added")
    assert note.values["effect"] == "quadratic"
    assert improvement.diagnosis.scan.detected[0].effect == "quadratic"


def test_findings_are_joined_as_a_sentence():
    finding = Finding(Confounded("cubic", ("cubic",), ""), (1.0,), (0.1,), "m", 10.0, None)
    two = dataclasses.replace(finding, group=Confounded("velocity", ("velocity", "coulomb"), ""), sigma=None)
    assert with_findings((), "Nothing is missing.") == "Nothing is missing."
    assert with_findings((finding,), "Nothing is missing (5).") == (
        "cubic was found (1 m, 10 sigma); nothing else is missing (5)."
    )
    assert with_findings((finding, two), "The residual is not white.") == (
        "cubic (1 m, 10 sigma) and velocity (1 m; confounded with coulomb) were found. The residual is not white."
    )
    assert equivalent_sigma(np.log(0.0026998)) == pytest.approx(3.0, abs=1e-4)
