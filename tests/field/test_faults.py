"""Faults are left out before anything is estimated and told, in files as loggers write them; honest files keep all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.faults import examine
from tests.commands import accelcal
from tests.field.accidents import ACCIDENTS, Record, honest, shocks

SIGMA = 4.5
"""Beyond which one of the 100 parameters here lies once in 1500 runs."""


def read(record: Record, folder: Path) -> ac.Recording:
    """The recording, by way of a file."""
    return ac.load(record.write(folder / "run.csv"))


def off(fit: ac.Fit, record: Record) -> list[float]:
    """Errors of bias and scale factor, standard deviations."""
    truth = {"bias": record.bias, "scale_factor": record.scale_factor}
    return [abs(fit[name].value - value) / fit[name].std for name, value in truth.items()]


LEFT_OUT = {
    "absurd": "denied",
    "junk": "denied",
    "range_early": "other_scale",
    "range_late": "other_scale",
    "idle": "stuck",
    "encoder_hung": "stuck",
    "saturated": "saturated",
}


@pytest.mark.parametrize("seed", [71, 72])
@pytest.mark.parametrize(("kind", "code"), LEFT_OUT.items())
def test_wrong_readings_are_left_out_and_said(kind: str, code: str, seed: int, tmp_path: Path) -> None:
    record = honest(seed)
    ACCIDENTS[kind].plant(record)
    recording = read(record, tmp_path)
    fit = ac.fit(recording)
    assert [note.code for note in fit.remarks if note.code in LEFT_OUT.values()] == [code]
    assert max(off(fit, record)) < SIGMA


@pytest.mark.parametrize("seed", [76, 77])
@pytest.mark.parametrize(
    ("kind", "noticed"),
    [("jitter", "scattered_stamps"), ("repeated_rows", "repeated_rows"), ("other_rate", "other_rate")],
)
def test_what_a_logger_does_to_rows_and_stamps_is_undone_or_said(
    kind: str, noticed: str, seed: int, tmp_path: Path
) -> None:
    record = honest(seed)
    ACCIDENTS[kind].plant(record)
    recording = read(record, tmp_path)
    assert noticed in {finding.kind for finding in recording.findings}
    assert max(off(ac.fit(recording), record)) < SIGMA


def test_samples_at_uneven_instants_keep_their_stamps(tmp_path: Path) -> None:
    record = honest(78)
    at = np.sort(record.t + record.rng.uniform(-0.3, 0.3, len(record.t)) / record.rate)
    record.u = np.interp(at, record.t, record.bias + (1.0 + record.scale_factor) * record.a)
    record.t_u, record.clocks = at, 2
    recording = read(record, tmp_path)
    assert not any(finding.kind == "scattered_stamps" for finding in recording.findings)
    assert np.allclose(recording.accel.t, at, atol=1e-6)


@pytest.mark.parametrize("seed", range(81, 87))
def test_an_honest_record_keeps_every_reading(seed: int, tmp_path: Path) -> None:
    record = honest(seed)
    recording = read(record, tmp_path)
    assert examine(recording).source.recording.left_out == ()
    assert max(off(ac.fit(recording), record)) < SIGMA


@pytest.mark.parametrize("kind", ["absurd", "junk"])
def test_the_same_readings_kept_would_bend_the_estimate(kind: str, tmp_path: Path) -> None:
    record = honest(73)
    ACCIDENTS[kind].plant(record)
    recording = read(record, tmp_path)
    wrong = np.abs(recording.accel.y - record.bias - (1.0 + record.scale_factor) * record.a) > 1.0
    cleaned = examine(recording).source.recording
    (gone,) = cleaned.left_out
    assert wrong.any()
    assert not np.isin(recording.accel.t[wrong], cleaned.accel.t).any()
    assert gone.count <= np.count_nonzero(wrong) + 40


def test_a_damaged_packet_costs_its_readings_alone(tmp_path: Path) -> None:
    record = honest(74)
    ACCIDENTS["absurd"].plant(record)
    (gone,) = examine(read(record, tmp_path)).source.recording.left_out
    assert gone.count == 3


@pytest.mark.parametrize("seed", [91, 92])
def test_a_true_shock_is_kept(seed: int, tmp_path: Path) -> None:
    """Far beyond the rest, like a damaged packet, but the encoder follows."""
    record = honest(seed)
    width, peak = 0.02, 60.0
    x = np.clip((record.t - record.t[record.middle()]) / width, 0.0, 1.0)
    a = peak * np.sin(2.0 * np.pi * x)
    record.z += peak * width**2 / (2.0 * np.pi) * (x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi))
    record.u += (1.0 + record.scale_factor) * a
    assert examine(read(record, tmp_path)).source.recording.left_out == ()


def test_check_and_fit_list_the_same_findings(tmp_path: Path) -> None:
    record = honest(75)
    ACCIDENTS["range_early"].plant(record)
    path = record.write(tmp_path / "run.csv")
    sentence = next(note.sentence for note in ac.fit(ac.load(path)).remarks if note.code == "other_scale")
    done = accelcal("check", path.name, cwd=tmp_path)
    assert sentence.partition("; a file without that: ")[0] in done.stdout


@pytest.mark.parametrize("seed", [93, 96, 99])
def test_two_accelerometers_share_their_noise_as_measured(seed: int, tmp_path: Path) -> None:
    """Half of it each, as assumed before, made a scale factor wander at 33 standard deviations where nothing does."""
    recording = read(shocks(seed), tmp_path)
    fit = ac.fit(recording)
    diagnosis = ac.diagnose(fit, recording)
    assert diagnosis.verdict == "adequate"
    assert not any("random_walk" in name or "gauss_markov" in name for name in diagnosis.effects)
