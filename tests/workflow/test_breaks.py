"""Every verb looks for breaks: a fit, a comparison and a held-out recording end where the relation of the channels
does."""

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel
from accelcal.simulation import CXL02_RIG

BREAK = 25.0


def record(seed, seconds=40.0):
    rng = np.random.default_rng(seed)
    truth = {"bias": 0.05, "scale_factor": 0.01}
    return ac.simulate("interleaved", seconds=seconds, rig=CXL02_RIG, parameters=truth, rng=rng).recording


def broken(seed):
    """From 25 s on the encoder follows another motion."""
    good, other = record(seed), record(seed + 50)
    p = np.interp(good.position.t, other.position.t, other.position.y)
    y = np.where(good.position.t < BREAK, good.position.y, p)
    return dataclasses.replace(good, position=Channel("position", good.position.t, y, "m"), digest=f"broken {seed}")


@pytest.fixture(scope="module")
def fits():
    return ac.fit(broken(1)), ac.fit(record(1))


def test_a_fit_ends_at_a_break_and_says_so(fits):
    cut, whole = fits
    assert cut.runs[0].end == pytest.approx(BREAK, abs=0.3)
    assert "no relation of output and position holds" in cut.remarks[0].sentence
    assert whole.runs[0].end > 39.0
    assert not any(remark.code == "break" for remark in whole.remarks)
    free = cut["scale_factor"]
    assert free.value == pytest.approx(0.01, abs=5.0 * free.std)
    chosen = ac.fit(broken(1), start=0.0, end=20.0)
    assert not any(remark.code == "break" for remark in chosen.remarks)


def test_an_effect_is_added_to_the_same_part(fits):
    grown = ac.add(fits[0], broken(1), "cubic")
    assert grown.runs[0].end == fits[0].runs[0].end


def test_a_comparison_ends_at_a_break(fits):
    broken_run, good = ac.compare(fits[1], broken(2))[0], ac.compare(fits[1], record(2))[0]
    assert broken_run.breaks[0] == pytest.approx(BREAK, abs=0.3)
    assert broken_run.residual[0][-1] < BREAK + 0.3
    assert broken_run.coast_rms[1.0] < 2.0 * good.coast_rms[1.0]
    assert good.breaks == ()
    assert type(broken_run).from_json(broken_run.to_json()).breaks == broken_run.breaks


def test_a_held_out_recording_is_cut_at_its_break():
    improvement = ac.improve(record(3), holdout=broken(2), most=1)
    (note,) = [remark for remark in improvement.diagnosis.remarks if remark.code == "break"]
    assert note.sentence.startswith("held out, ")
    assert improvement.steps[0].heldout.residual[0][-1] < BREAK + 0.3
    assert any("held out" in text for text in improvement.diagnosis.suspect)
