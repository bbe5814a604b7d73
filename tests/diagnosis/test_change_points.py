"""A break is found where a relation ends for good, and never on a record that is only noisy, nonlinear or at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from accelcal.data.recording import Channel
from accelcal.diagnosis.faults import RelationColumns, faults, unexplained, usable
from accelcal.estimation.run import prepare
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, Vibration, simulate

from ..real.recordings import recording

RIGS = {"ADXL105": ADXL105_RIG, "CXL02": CXL02_RIG}
MOTIONS = ("tones", "interleaved", "moves", "fast", "rests", "bursts", "chirp")
VARIANTS = (
    {},
    {"vibration": Vibration(1.0, 230.0)},
    {"vibration": Vibration(3.0, 120.0)},
    {"lsb": 0.01},
)


def record(motion, rig, seed, **more):
    parameters = {"bias": 0.1, "scale_factor": 0.02, "time_offset": 1e-3, **more.pop("parameters", {})}
    rng = np.random.default_rng(seed)
    return simulate(motion, seconds=60.0, rig=rig, parameters=parameters, rng=rng, missing=0.1, **more).recording


def output(recording, y, t=None):
    t = recording.accel.t if t is None else t
    return replace(recording, accel=Channel("accel", np.ascontiguousarray(t), np.ascontiguousarray(y), "m/s²"))


def encoder(recording, y):
    return replace(recording, position=Channel("position", recording.position.t, y, "m"))


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("motion", MOTIONS)
def test_good_records_are_used_whole(motion, rig):
    """4 records each, 56 in all: plain, with vibration, coarse steps, in every second a strong nonlinearity."""
    alarms = []
    for seed in range(4):
        parameters = {"cubic": 1e-3, "quadratic": 3e-3} if (seed + MOTIONS.index(motion)) % 2 else {}
        recording = record(motion, RIGS[rig], 50 + seed, parameters=parameters, **VARIANTS[seed % 4])
        alarms += [(seed, "break", t) for t in usable(recording).breaks]
        alarms += [(seed, fault.kind, fault.time) for fault in faults(recording, prepare(recording))]
    print(f"{motion} {rig}: {len(alarms)} alarms in 4 records")
    assert alarms == []


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("motion", ["interleaved", "fast", "tones"])
def test_break_is_found_where_the_stage_leaves_the_sensor(motion, rig):
    """From 37 s on the encoder follows another motion: nothing in the output tells of it."""
    good, other = record(motion, RIGS[rig], 3), record(motion, RIGS[rig], 4)
    p = np.interp(good.position.t, other.position.t, other.position.y)
    broken = encoder(good, np.where(good.position.t < 37.0, good.position.y, p))
    breaks = usable(broken).breaks
    assert len(breaks) == 1
    assert breaks[0] == pytest.approx(37.0, abs=0.2)  # both may rest at that moment


def test_disturbance_that_passes_is_no_break():
    """A blow to the encoder of 1 s: the relation holds again behind it."""
    good = record("interleaved", ADXL105_RIG, 3)
    t = good.position.t
    blow = np.where((t > 30.0) & (t < 31.0), 1e-3 * np.sin(2 * np.pi * 8.0 * t), 0.0)
    assert usable(encoder(good, good.position.y + blow)).breaks == ()


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("motion", ["interleaved", "fast"])
@pytest.mark.parametrize("kind", ["position_step", "dropped_samples", "dropout", "rail_hit"])
def test_each_fault_is_reported_with_time_and_size(kind, motion, rig):
    good = record(motion, RIGS[rig], 5)
    a, p = good.accel, good.position
    half = (a.t > 20.0) & (a.t < 20.5)
    if kind == "position_step":
        bad, channel, time, size = encoder(good, p.y + 20e-6 * (p.t > 33.3)), "position", 33.3, 20e-6
    elif kind == "dropped_samples":
        lost = (a.t > 25.0) & (a.t < 25.0 + 1.5 / 1667.0)
        t = np.where(a.t > 25.0, a.t - 1.0 / 1667.0, a.t)
        bad, channel, time, size = output(good, a.y[~lost], t[~lost]), "accel", 25.0, -1.0
    elif kind == "dropout":
        bad, channel, time, size = output(good, a.y[~half], a.t[~half]), "accel", 20.0, 0.5
    else:
        limit = 0.8 * float(np.max(np.abs(a.y)))
        at = float(a.t[np.argmax(np.abs(a.y) > limit)])
        bad, channel, time, size = output(good, np.clip(a.y, -limit, limit)), "accel", at, None
    results = [f for f in faults(bad, prepare(bad)) if f.kind == kind and f.channel == channel]
    assert results, kind
    # 0.6 s: a change of delay shows only while the stage moves
    assert min(abs(f.time - time) for f in results) < (0.6 if kind == "dropped_samples" else 0.05)
    if size is not None:
        assert results[0].size == pytest.approx(size, rel=0.15)
    print(results[0].sentence)


@pytest.mark.parametrize("rate", [14e-6, 17e-6, 20e-6, -17e-6])
def test_a_clock_that_runs_at_another_rate_loses_no_sample(rate):
    """Its delay grows by about 1 ms over the record, of which the best step is one sample of the output."""
    good = record("fast", CXL02_RIG, 5)
    bad = output(good, good.accel.y, good.accel.t * (1.0 + rate))
    assert not [fault for fault in faults(bad, prepare(bad)) if fault.kind == "dropped_samples"]


REAL = {
    "cyberdiver_ext_ret_trial1": (0.202, 0.005),  # water contact
    "cyberdiver_ext_ret_trial2": (0.202, 0.005),
    "cyberdiver_15npmm_6mps_trial1": (0.607, 0.005),
    "rocket_gw1_airbrakes_bay": (10.842, 0.1),  # ejection: first output beyond 15 m/s² of the descent
    "rocket_gw1_nosecone": (10.845, 0.1),
    "rocket_jackpot4": (18.425, 0.1),
    "broad_trial10": None,
    "broad_trial15": None,
}


@pytest.mark.parametrize("name", REAL)
def test_breaks_of_real_records(name):
    breaks = usable(recording(name)).breaks
    print(name, breaks)
    expected = REAL[name]
    if expected is None:
        assert breaks == ()
    else:
        assert breaks[0] == pytest.approx(expected[0], abs=expected[1])


def test_what_a_band_leaves_is_the_residual_of_least_squares():
    """In pieces or at once: by QR of NumPy over all columns of the band, and its share of the variance as R squared."""
    run = prepare(record("interleaved", CXL02_RIG, 9))
    relation = RelationColumns(run).in_band(4.0)
    columns = np.concatenate(list(relation.columns()))
    c = np.linalg.lstsq(columns[:, :4], columns[:, 4])[0]
    expected = (columns[:, 4] - columns[:, :4] @ c) * relation.size[4]
    np.testing.assert_allclose(relation.residual(), expected, atol=1e-9 * np.std(expected))
    rows = np.random.default_rng(4).standard_normal((3, 40, 5)) @ np.diag([1.0, 1.0, 1.0, 0.0, 1.0])
    rows[:, :, 3], rows[:, :, 4] = 1.0, rows[:, :, 4] + 0.7 * rows[:, :, 0] + 5.0  # a constant is no motion
    left, share = unexplained(np.einsum("kni,knj->kij", rows, rows))
    for k, block in enumerate(rows):
        residual = block[:, 4] - block[:, :4] @ np.linalg.lstsq(block[:, :4], block[:, 4])[0]
        assert left[k] == pytest.approx(residual @ residual, rel=1e-6)
        assert share[k] == pytest.approx(1.0 - np.mean(residual**2) / np.var(block[:, 4]), rel=1e-6)
