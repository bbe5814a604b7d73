"""Where a model fails on a velocity and on an acceleration: nowhere, if nothing is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.faults import Examined, RelationColumns, position_steps
from accelcal.estimation.run import prepare
from accelcal.io import load
from accelcal.validation.evaluation import accel_spectrum, one_step_spectrum
from tests.worlds import Hidden, Nuisances, World
from tests.worlds.world import ACCEL_RATE, Reference

NOWHERE = "no region stands out"


def fitted(folder, reference: Reference, seed: int, quadratic: float = 0.0) -> tuple[ac.Fit, ac.Recording]:
    """The linear model of a sensor whose output may have a term in the square, 1/(m/s²)."""
    hidden = (Hidden("quadratic", quadratic),) if quadratic else ()
    world = World("moves", "CXL02", hidden, seconds=40.0, seed=seed, reference=reference, nuisances=Nuisances())
    world = replace(world, encoder_rate=2.0 * ACCEL_RATE, encoder_noise=6e-7)
    recording = load(world.record().write(folder))
    return ac.fit(recording), recording


@pytest.mark.parametrize("seed", [41, 42])
@pytest.mark.parametrize("reference", ["velocity", "reference_acceleration"])
def test_nothing_stands_out_where_nothing_is_missing(tmp_path, reference: Reference, seed: int) -> None:
    """False alarms: a region in 1 % of the records, a spectrum outside its limits in less than 1e-4."""
    fit, recording = fitted(tmp_path, reference, seed)
    evaluation = ac.compare(fit, recording)[0]
    print(evaluation.worst, fit.runs[0].nis, evaluation.nis)
    assert evaluation.worst.lower().startswith(NOWHERE)
    for nis in (fit.runs[0].nis, evaluation.nis):
        assert nis is not None
        assert abs(nis - 1.0) < 0.05
    assert evaluation.innovations is not None
    assert len(evaluation.normalised[1]) == len(evaluation.innovations[1]) > 1000
    for spectrum in (accel_spectrum(fit, evaluation), one_step_spectrum(evaluation)):
        assert spectrum is not None
        ratio = spectrum.density / spectrum.predicted
        assert np.mean((ratio < spectrum.low) | (ratio > spectrum.high)) < 0.2


@pytest.mark.parametrize("reference", ["velocity", "reference_acceleration"])
def test_another_recording_is_as_white(tmp_path, reference: Reference) -> None:
    fit, _ = fitted(tmp_path, reference, 44)
    world = World("bursts", "CXL02", seconds=40.0, seed=44, reference=reference, nuisances=Nuisances())
    world = replace(world, encoder_rate=2.0 * ACCEL_RATE, encoder_noise=6e-7)
    other = ac.compare(fit, load(world.record().write(tmp_path, "other")))[0]
    print(other.nis)
    assert other.nis is not None
    assert abs(other.nis - 1.0) < 0.1


def test_a_missing_effect_still_stands_out(tmp_path) -> None:
    fit, recording = fitted(tmp_path, "velocity", 43, quadratic=2e-3)
    assert "mean residual" in ac.compare(fit, recording)[0].worst


def test_an_integral_has_no_steps(tmp_path) -> None:
    """Lost readings of a velocity leave errors in its integral that jump and stay; they are no lost counts."""
    world = World("tones", "CXL02", seed=46, reference="velocity", nuisances=Nuisances(missing=0.1))
    recording = load(replace(world, encoder_rate=ACCEL_RATE, encoder_noise=3.4e-9).record().write(tmp_path))
    assert position_steps(RelationColumns(prepare(recording).complete))
    assert Examined(recording).source.recording is recording
    diagnosis = ac.diagnose(ac.fit(recording), recording)
    assert "position_step" not in [remark.code for remark in diagnosis.remarks]
