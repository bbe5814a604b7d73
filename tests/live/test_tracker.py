"""The filter of a live view against `filters.run` on the same rows: the same bits, however they arrive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel, RecordingError
from accelcal.data.rig import LowPass, Rig
from accelcal.filters import FilterRun, run
from accelcal.io import read_sidecar
from accelcal.io.stream import Rows
from accelcal.live.tracker import LiveSettings, Tracker, settings_of
from accelcal.simulation import ADXL105_RIG
from benches import monitoring
from tests.live.streams import BIAS, RIG, SCALE, Stream, stream


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text(RIG)
    return read_sidecar(path).rig


def on_record(settings: LiveSettings, samples: Stream) -> FilterRun:
    """The same filter over the record as a whole."""
    output, read = ~np.isnan(samples.u), ~np.isnan(samples.z)
    t, u = samples.t[output] - settings.offset, settings.stage_output(samples.u[output])
    position = Channel("position", samples.t[read], samples.z[read], "m")
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


def tracked(settings: LiveSettings, samples: Stream, seed: int) -> tuple[Tracker, tuple[np.ndarray, ...]]:
    """Fed in pieces of random length: the tracker, and stamps, innovations and variances of all readings."""
    rng, tracker, result, i = np.random.default_rng(seed), Tracker(settings), [], 0
    while i < len(samples.t):
        j = i + int(rng.integers(1, 50))
        result.append(tracker.feed(Rows(samples.t[i:j], samples.u[i:j], samples.z[i:j])))
        i = j
    result.append(tracker.finish())
    return tracker, tuple(np.concatenate([of.table[:, k] for of in result]) for k in (0, 2, 3))


def test_outputs_before_the_first_reading_do_not_pile_up(rig: Rig) -> None:
    samples = stream(6.0, seed=8)
    z = np.where(samples.t < 3.0, np.nan, samples.z)
    settings = replace(settings_of(rig), offset=1.1e-3)
    tracker, most = Tracker(settings), 0
    for rows in np.array_split(np.stack([samples.t, samples.u, z], axis=1), 200):
        tracker.feed(Rows(*rows.T))
        most = max(most, len(tracker._waiting[0]))
    tracker.finish()
    assert most < 100
    assert (tracker.outputs, tracker.readings) == (len(samples.t), np.isfinite(z).sum())
    assert tracker.filter is not None
    assert np.array_equal(tracker.filter.estimate, on_record(settings, Stream(samples.t, samples.u, z)).states[-1])
    none = Tracker(settings)
    none.feed(Rows(samples.t, samples.u, np.full_like(z, np.nan)))
    none.finish()
    assert (none.outputs, none.readings) == (len(samples.t), 0)


@pytest.mark.parametrize("lost", [0.03, 0.5, 2.0, 3600.0])
def test_a_hole_begins_the_motion_anew_and_keeps_the_parameters(rig: Rig, lost: float) -> None:
    """Rows are missing, or the device slept and its stage did not; false-alarm rate 6e-5 for each parameter."""
    samples, share, walk = stream(12.0, seed=6), [], []
    there = (samples.t < 5.0) | (samples.t > 5.0 + min(lost, 2.0))
    late = np.where(samples.t > 5.0, max(0.0, lost - 2.0), 0.0)
    rows = np.stack([samples.t + late, samples.u, samples.z])[:, there]
    for random_walk in (0.0, 1e-3):
        tracker = Tracker(settings_of(replace(rig, sensor=replace(rig.sensor, random_walk=random_walk))))
        readings = [tracker.feed(Rows(*part)) for part in np.array_split(rows, 40, axis=1)] + [tracker.finish()]
        t, e, variance = (np.concatenate([r.table[:, k] for r in readings]) for k in (0, 2, 3))
        behind = t > 5.0 + lost
        assert np.mean(e[behind] ** 2 / variance[behind]) < 1.3
        for estimate, truth in zip(tracker.estimates, (SCALE, BIAS), strict=True):
            assert abs(estimate.value - truth) < 4.0 * estimate.std, (estimate, truth)
        share.append(tracker.noise_share.value)  # type: ignore[union-attr]
        walk.append(tracker.settings.covariance[1, 1])
    assert walk[1] - walk[0] > 0.9e-6 * lost  # the bias has walked meanwhile
    whole = Tracker(settings_of(rig))
    whole.feed(Rows(samples.t, samples.u, samples.z))
    assert share[0] == pytest.approx(whole.noise_share.value, rel=0.2)  # type: ignore[union-attr]


def test_a_model_saved_behind_a_hole_has_the_parameters_before_it(rig: Rig) -> None:
    samples = stream(6.0, seed=7)
    tracker = Tracker(settings_of(rig))
    tracker.feed(Rows(samples.t[:10_000], samples.u[:10_000], samples.z[:10_000]))
    before = tracker.estimates
    tracker.feed(Rows(samples.t[10_000:] + 5.0, samples.u[10_000:], np.full_like(samples.z[10_000:], np.nan)))
    assert tracker.filter is None
    for now, then in zip(tracker.estimates, before, strict=True):
        assert now.value == pytest.approx(then.value, abs=0.1 * then.std)
        assert now.std == pytest.approx(then.std, rel=0.01)


def test_what_waits_where_the_end_fails_is_counted_as_refused(rig: Rig) -> None:
    class Failing:
        waiting = 5

        def __init__(self, tracker: Tracker) -> None:
            filter = tracker.filter
            assert filter is not None
            self.feed, self.names, self.estimate = filter.feed, filter.names, filter.estimate

        def finish(self) -> None:
            raise ValueError("the innovation variance is NaN")

    samples, tracker = stream(1.0), Tracker(settings_of(rig))
    tracker.feed(Rows(samples.t, samples.u, samples.z))
    tracker.filter = Failing(tracker)  # type: ignore[assignment]
    assert tracker.finish().t[0] > samples.t[-1] - 16e-3  # of readings that waited before the filter
    assert (tracker.refused, tracker.refusal) == (5, "the innovation variance is NaN")


@pytest.mark.parametrize(("setting", "run"), [(5, 33), (7, 115), (8, 87)])
def test_a_start_that_noise_leads_astray_is_begun_anew(setting: int, run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a noisy sensor at a high rate, from nothing; in the twin the first start stays. Chunks make no difference."""

    def error(chunk: int) -> float:
        rng, rig = np.random.default_rng((77, setting, run)), monitoring.SETTINGS[setting]
        chosen = monitoring.settings(rig, rng)
        record, tracker = monitoring.Record(rig, rng), Tracker(chosen)
        rows = [record.take(int(rig.rate) // 20) for _ in range(400)]
        for first in range(0, len(rows), chunk):
            parts = rows[first : first + chunk]
            tracker.feed(
                Rows(*(np.concatenate([getattr(part, x) for part in parts]) for x in ("t", "accel", "position")))
            )
        k = next(e for e in tracker.estimates if e.name == "scale_factor")
        return (k.value - monitoring.SCALE) / k.std

    assert abs(error(1)) < 4.5
    assert error(1) == error(40)
    monkeypatch.setattr("accelcal.live.tracker.MOST_TRIES", 0)
    assert abs(error(40)) > 6.0


def split(samples: Stream) -> Stream:
    """Readings in rows of their own, between outputs, with holes in both."""
    rng = np.random.default_rng(5)
    read = ~np.isnan(samples.z)
    t = np.concatenate([samples.t, samples.t[read] + 1.3e-4])
    u = np.concatenate([samples.u, np.full(read.sum(), np.nan)])
    z = np.concatenate([np.full(len(samples.t), np.nan), samples.z[read]])
    order = np.argsort(t)
    remaining = order[rng.random(len(order)) > 0.1]
    return Stream(t[remaining], u[remaining], z[remaining])


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
    samples = stream(2.0, polarity=mine.polarity, gravity=mine.gravity)
    samples = split(samples) if apart else samples
    tracker, (t, e, variance) = tracked(settings, samples, seed=3)
    record = on_record(settings, samples)
    assert tracker.filter is not None
    assert tracker.refused == 0
    assert np.array_equal(tracker.filter.estimate, record.states[-1])
    assert np.array_equal(tracker.filter.covariance, record.covariance)
    there = ~np.isnan(record.innovations)
    for result, expected in ((t, record.times), (e, record.innovations), (variance, record.innovation_variances)):
        assert np.array_equal(result, expected[there])


def test_parameters_are_those_of_the_sensor_however_it_is_mounted(rig: Rig) -> None:
    for world in ({}, {"axis": "up"}, {"axis": "down", "mount": "reversed"}):
        mine = replace(rig, **world)  # type: ignore[arg-type]
        samples = stream(8.0, seed=2, polarity=mine.polarity, gravity=mine.gravity)
        tracker, _ = tracked(settings_of(mine), samples, seed=1)
        results = {e.name: e for e in tracker.estimates}
        for name, truth in (("bias", BIAS), ("scale_factor", SCALE)):
            # False alarm 7e-6 each.
            assert abs(results[name].value - truth) < 4.5 * results[name].std + 2e-4, (world, name)


def test_a_model_gives_parameters_noise_and_offset() -> None:
    truth = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 2e-4, "quadratic": 1e-3}
    simulation = ac.simulate("tones", seconds=20.0, rig=ADXL105_RIG, parameters=truth, rng=np.random.default_rng(1))
    fit = ac.fit(simulation.recording, ac.Model.cubic())
    settings = settings_of(simulation.recording.rig, fit)
    assert settings.offset == fit["time_offset"].value
    assert settings.names == ("k", "K0", "K2", "K3")
    start = {e.name: e for e in Tracker(settings).estimates}
    for name in ("bias", "scale_factor", "quadratic", "cubic"):
        assert start[name].value == pytest.approx(fit[name].value)
        assert start[name].std == pytest.approx(fit[name].std)


def test_noise_that_nobody_declares_is_asked_for(rig: Rig) -> None:
    with pytest.raises(RecordingError, match="no noise of the sensor"):
        settings_of(replace(rig, sensor=replace(rig.sensor, noise=None)))
    with pytest.raises(RecordingError, match="neither noise nor resolution of the position"):
        settings_of(replace(rig, resolution=None))


def test_an_absurd_value_does_not_end_it(rig: Rig) -> None:
    samples = stream(1.0)
    for value in (1e300, 1e154, -1e100):
        u = samples.u.copy()
        u[500:503] = value  # alone it would be left out
        with np.errstate(all="ignore"):
            tracker, result = tracked(settings_of(rig), Stream(samples.t, u, samples.z), seed=1)
        print(f"output {value:g}: {len(result[0])} innovations, {tracker.refused} events refused: {tracker.refusal}")
        assert tracker.outputs == len(u)


@pytest.mark.parametrize("offset", [0.0, 0.9e-3])
def test_an_absurd_stamp_does_not_end_it(rig: Rig, offset: float) -> None:
    samples = stream(1.0)
    for stamp in (1e200, 1e150, 1e110):
        t, u, z = samples.t.copy(), samples.u.copy(), samples.z.copy()
        t[-1], u[-1], z[-1] = stamp, np.nan, 0.005
        with np.errstate(all="ignore"):
            tracker, result = tracked(replace(settings_of(rig), offset=offset), Stream(t, u, z), seed=1)
        print(f"stamp {stamp:g}: {len(result[0])} innovations, {tracker.refused} events refused: {tracker.refusal}")
        assert tracker.outputs == len(u) - 1
        assert len(result[0]) > 400


def test_readings_without_outputs_do_not_end_it(rig: Rig) -> None:
    samples = stream(1.0)
    u = samples.u.copy()
    u[300:900] = np.nan  # 300 readings in a row
    tracker, result = tracked(settings_of(rig), Stream(samples.t, u, samples.z), seed=1)
    assert 45 <= tracker.refused <= 52
    assert "more than 252 events wait" in tracker.refusal
    assert len(result[0]) > 600
