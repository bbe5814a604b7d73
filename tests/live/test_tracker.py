"""The filter of a live view against `filters.run` on the same rows: the same bits, however they arrive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel, RecordingError
from accelcal.data.rig import LowPass, Rig
from accelcal.filters import FilterRun, run
from accelcal.io import read_sidecar
from accelcal.io.stream import Rows
from accelcal.live.tracker import MOST_BETWEEN, SETTLING, Innovation, LiveSettings, Tracker, settings_of
from accelcal.simulation import ADXL105_RIG
from tests.live.streams import BIAS, RIG, SCALE, Stream, stream


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text(RIG)
    return read_sidecar(path).rig


def on_record(settings: LiveSettings, made: Stream) -> FilterRun:
    """The same filter over the record as a whole."""
    output, read = ~np.isnan(made.u), ~np.isnan(made.z)
    t, u = made.t[output] - settings.offset, settings.stage_output(made.u[output])
    position = Channel("position", made.t[read], made.z[read], "m")
    first = max(0, int(np.searchsorted(t, position.t[0], side="right")) - 1)
    accel = Channel("accel", t[first:], u[first:], "m/s^2")
    x0, P0 = settings.start(float(position.y[0]), max(0.0, float(position.t[0] - accel.t[0])))
    q, r, tau = settings.q, settings.r_position, settings.tau
    return run(
        settings.choice,
        accel,
        position,
        q=q,
        r_position=r,
        x0=x0,
        P0=P0,
        tau=tau,
        parameters=settings.parameters,
    )


def tracked(settings: LiveSettings, made: Stream, seed: int) -> tuple[Tracker, list[Innovation]]:
    """Fed in pieces of random length."""
    rng, tracker, found, i = np.random.default_rng(seed), Tracker(settings), [], 0
    while i < len(made.t):
        j = i + int(rng.integers(1, 50))
        found += tracker.feed(Rows(made.t[i:j], made.u[i:j], made.z[i:j]))
        i = j
    return tracker, found + tracker.finish()


def split(made: Stream) -> Stream:
    """Readings in rows of their own, between outputs, with holes in both."""
    rng = np.random.default_rng(5)
    read = ~np.isnan(made.z)
    t = np.concatenate([made.t, made.t[read] + 1.3e-4])
    u = np.concatenate([made.u, np.full(read.sum(), np.nan)])
    z = np.concatenate([np.full(len(made.t), np.nan), made.z[read]])
    order = np.argsort(t)
    kept = order[rng.random(len(order)) > 0.1]
    return Stream(t[kept], u[kept], z[kept])


WORLDS = {
    "level": {},
    "reversed, up": {"axis": "up", "mount": "reversed"},
    "low-pass": {"lowpass": LowPass(200.0)},
}


@pytest.mark.parametrize("offset", [0.0, 0.9e-3, -1.6e-3, 0.02])
@pytest.mark.parametrize("apart", [False, True], ids=["one row", "rows of their own"])
@pytest.mark.parametrize("world", WORLDS)
def test_the_stream_is_the_record_bit_for_bit(rig: Rig, world: str, apart: bool, offset: float) -> None:
    mine = replace(rig, **WORLDS[world])  # type: ignore[arg-type]
    settings = replace(settings_of(mine), offset=offset)
    made = stream(2.0, polarity=mine.polarity, gravity=mine.gravity)
    made = split(made) if apart else made
    tracker, found = tracked(settings, made, seed=3)
    record = on_record(settings, made)
    assert tracker.filter is not None
    assert tracker.refused == 0
    assert np.array_equal(tracker.filter.estimate, record.states[-1])
    assert np.array_equal(tracker.filter.covariance, record.covariance)
    # Innovations as well, but for those whose reading was not the only one between two outputs.
    there = {
        t: (e, s)
        for t, e, s in zip(record.times, record.innovations, record.innovation_variances, strict=True)
        if not np.isnan(e)
    }
    assert len(found) + tracker.untested == len(there) == tracker.readings
    assert tracker.untested < 0.2 * len(there)
    assert all(there[one.t][0] == one.e for one in found)
    apart_by = max(abs(one.variance / there[one.t][1] - 1.0) for one in found[SETTLING:])
    print(f"{world}, offset {offset:g} s: {len(found)} innovations, expected variances within {apart_by:.1e}")
    assert apart_by < (1e-9 if not apart and offset == 0.0 else 2e-3)


def test_parameters_are_those_of_the_sensor_however_it_is_mounted(rig: Rig) -> None:
    for world in ({}, {"axis": "up"}, {"axis": "down", "mount": "reversed"}):
        mine = replace(rig, **world)  # type: ignore[arg-type]
        made = stream(8.0, seed=2, polarity=mine.polarity, gravity=mine.gravity)
        tracker, _ = tracked(settings_of(mine), made, seed=1)
        found = {e.name: e for e in tracker.estimates}
        for name, truth in (("bias", BIAS), ("scale_factor", SCALE)):
            # False alarm 7e-6 each.
            assert abs(found[name].value - truth) < 4.5 * found[name].std + 2e-4, (world, name)


def test_a_model_gives_parameters_noise_and_offset() -> None:
    truth = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 2e-4, "quadratic": 1e-3}
    made = ac.simulate("tones", seconds=20.0, rig=ADXL105_RIG, parameters=truth, rng=np.random.default_rng(1))
    fit = ac.fit(made.recording, ac.Model.cubic())
    settings = settings_of(made.recording.rig, fit)
    assert settings.offset == fit["time_offset"].value
    assert settings.names == ("k", "K0", "K2", "K3")
    start = {e.name: e for e in Tracker(settings).estimates}
    for name in ("bias", "scale_factor", "quadratic", "cubic"):
        assert start[name].value == pytest.approx(fit[name].value)
        assert start[name].std == pytest.approx(fit[name].std)


def test_what_cannot_be_tracked_is_refused_with_the_cure(rig: Rig, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no noise of the sensor"):
        settings_of(replace(rig, sensor=replace(rig.sensor, noise=None)))
    with pytest.raises(RecordingError, match="neither noise nor resolution of the position"):
        settings_of(replace(rig, resolution=None))
    made = ac.simulate("tones", seconds=10.0, rig=ADXL105_RIG, parameters={"bias": 0.05}, rng=np.random.default_rng(1))
    fit = ac.fit(made.recording, ac.Model.linear().add("velocity"))
    with pytest.raises(RecordingError, match="velocity cannot be tracked"):
        settings_of(made.recording.rig, fit)


def test_an_absurd_value_does_not_end_it(rig: Rig) -> None:
    made = stream(1.0)
    for value in (1e300, 1e154, -1e100):
        u = made.u.copy()
        u[500] = value
        with np.errstate(all="ignore"):
            tracker, found = tracked(settings_of(rig), Stream(made.t, u, made.z), seed=1)
        print(f"output {value:g}: {len(found)} innovations, {tracker.refused} events refused: {tracker.refusal}")
        assert tracker.outputs == len(u)


@pytest.mark.parametrize("offset", [0.0, 0.9e-3])
def test_an_absurd_stamp_does_not_end_it(rig: Rig, offset: float) -> None:
    made = stream(1.0)
    for stamp in (1e200, 1e150, 1e110):
        t, u, z = made.t.copy(), made.u.copy(), made.z.copy()
        t[-1], u[-1], z[-1] = stamp, np.nan, 0.005
        with np.errstate(all="ignore"):
            tracker, found = tracked(replace(settings_of(rig), offset=offset), Stream(t, u, z), seed=1)
        print(f"stamp {stamp:g}: {len(found)} innovations, {tracker.refused} events refused: {tracker.refusal}")
        assert tracker.outputs == len(u) - 1
        assert len(found) > 400


def test_readings_without_outputs_do_not_end_it(rig: Rig) -> None:
    made = stream(1.0)
    u = made.u.copy()
    u[300:900] = np.nan  # 300 readings in a row
    tracker, found = tracked(settings_of(rig), Stream(made.t, u, made.z), seed=1)
    assert tracker.refused == 300 - MOST_BETWEEN
    assert "readings without an output" in tracker.refusal
    assert len(found) > 600
