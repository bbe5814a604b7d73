"""Faults are left out before anything is estimated and told, in files as loggers write them; honest files keep all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.clocks import lost_rows, packets, slewed
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
    "range_while": "other_scale",
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
    [
        ("jitter", "scattered_stamps"),
        ("repeated_rows", "repeated_rows"),
        ("other_rate", "other_rate"),
        ("lost_rows", "lost_rows"),
        ("clock_slewed", "slewed_stamps"),
    ],
)
def test_what_a_logger_does_to_rows_and_stamps_is_undone_or_said(
    kind: str, noticed: str, seed: int, tmp_path: Path
) -> None:
    record = honest(seed)
    ACCIDENTS[kind].plant(record)
    recording = read(record, tmp_path)
    assert noticed in {finding.kind for finding in recording.findings}
    assert max(off(ac.fit(recording), record)) < SIGMA


@pytest.mark.parametrize("seed", [71, 72])
@pytest.mark.parametrize("kind", ["jitter", "clock_slewed"])
def test_samples_are_counted_where_a_clock_is_late_or_slewed(kind: str, seed: int, tmp_path: Path) -> None:
    """A line through all stamps of a host is off by its rate, 2e-7 to 1e-6, which is 6 to 9 standard deviations."""
    record = honest(seed)
    ACCIDENTS[kind].plant(record)
    late = read(record, tmp_path).accel.t - record.t
    assert np.ptp(late) < 2e-6
    assert abs(late[0]) < 1e-5


@pytest.mark.parametrize("seed", [71, 72])
def test_rows_lost_one_in_so_many_are_put_back_in_time(seed: int, tmp_path: Path) -> None:
    """Of both channels, whose rate alone is declared."""
    record = honest(seed)
    left = (np.arange(len(record.t)) + 11) % 50 != 0
    record.u, record.z, record.stamped = record.u[left], record.z[left], False
    recording = read(record, tmp_path)
    first = next(finding for finding in recording.findings if finding.kind == "lost_rows")
    assert first.count == np.count_nonzero(~left)
    for channel in (recording.accel, recording.position):
        assert np.allclose(channel.t, record.t[left], atol=1e-9)
    assert max(off(ac.fit(recording), record)) < SIGMA


def test_lost_rows_are_distinguished_from_what_is_none() -> None:
    for seed in (71, 73, 75):
        record = honest(seed)
        rng, n = record.rng, len(record.t)
        dropped = np.zeros(n, dtype=bool)
        dropped[rng.choice(n - 10, n // 500, replace=False)] = True
        lost = lost_rows([record.u[~dropped], record.z[~dropped]])
        assert lost is not None
        assert 0.7 * np.count_nonzero(dropped) < np.sum(lost) <= np.count_nonzero(dropped)
        missed_counts = record.z + 2e-5 * np.cumsum(rng.random(n) < 2e-3)
        knocked = record.u + np.where(rng.random(n) < 1e-3, 0.3, 0.0) * rng.choice([-1.0, 1.0], n)
        shock = shocks(seed)
        for columns in ([record.u, record.z], [missed_counts], [knocked], [shock.u, shock.z], [np.round(record.u, 1)]):
            assert lost_rows(columns) is None


def test_an_oscillator_that_drifts_is_not_slewed() -> None:
    t = np.arange(50_000) / 1000.0
    for drift in (1.5e-3 * (1.0 - np.exp(-t / 5.0)), 1e-5 * t**2, 1e-3 * np.sin(t / 5.0), 1e-3 * np.rint(t)):
        assert not slewed(t + drift)[0]


@pytest.mark.parametrize(("rate", "samples"), [(1000.0, 16), (500.0, 16), (2000.0, 32)])
def test_bursts_of_noisy_readings_are_no_packets(rate: float, samples: int) -> None:
    """Readings are missing in gaps of 10 ms, and noise hides any one of them."""
    rng = np.random.default_rng(int(rate))
    begins = np.cumsum(samples / rate + 1e-2 * rng.uniform(0.5, 1.5, int(60.0 * rate / samples)))
    t = (begins[:, None] + np.arange(samples) / rate).ravel()
    size, w = np.array([0.03, 1e-3]), 2.0 * np.pi * np.array([0.31, 3.7])
    z = np.sin(np.outer(t, w)) @ size + 1e-3 * rng.standard_normal(len(t))
    u = -np.sin(np.outer(t, w)) @ (size * w**2) + 0.3 * rng.standard_normal(len(t))
    assert packets(t, [u, z]) is None


@pytest.mark.parametrize("seed", [7002, 7003])
def test_a_touch_lasts_seconds_in_a_short_record_too(seed: int, tmp_path: Path) -> None:
    record = honest(seed)
    ACCIDENTS["touched"].plant(record)
    assert "disturbed" in {note.code for note in ac.fit(read(record, tmp_path)).remarks}


@pytest.mark.parametrize("seed", range(61, 65))
def test_a_logger_that_runs_before_the_stage_is_homed(seed: int, tmp_path: Path) -> None:
    # A second of readings within the range of the sensor, and a position that counts from nowhere.
    record = honest(seed)
    early, before = record.t < record.t[0] + 1.0, record.t_z < record.t_z[0] + 1.0
    size = float(np.max(np.abs(record.u)))
    record.u[early] = record.rng.uniform(-size, size, np.count_nonzero(early))
    steps = record.rng.standard_normal(np.count_nonzero(before))
    record.z[before] = record.z[before][-1] + 5e-3 * np.cumsum(steps) / np.sqrt(len(steps))
    recording = read(record, tmp_path)
    (gap,) = (gap for gap in examine(recording).source.recording.left_out if gap.kind == "unrelated")
    assert gap.stretches[0][0] == pytest.approx(record.t[0], abs=0.2)
    assert 0.8 < gap.stretches[-1][1] - record.t[0] < 2.5
    assert max(off(ac.fit(recording), record)) < SIGMA


def test_what_a_fit_leaves_out_is_left_out_with_another_effect_too(tmp_path: Path) -> None:
    record = honest(71)
    ACCIDENTS["touched"].plant(record)
    recording = read(record, tmp_path)
    base = ac.fit(recording)
    assert "disturbed" in {note.code for note in base.remarks}
    added = ac.add(base, recording, "cubic")
    for fit in (added, ac.drop(added, recording, "cubic")):
        assert "disturbed" in {note.code for note in fit.remarks}
        assert fit.runs[0].readings == base.runs[0].readings
        assert fit.noise().q == pytest.approx(base.noise().q, rel=0.2)


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
    (fault,) = cleaned.left_out
    assert wrong.any()
    assert not np.isin(recording.accel.t[wrong], cleaned.accel.t).any()
    assert fault.count <= np.count_nonzero(wrong) + 40


def test_a_damaged_packet_costs_its_readings_alone(tmp_path: Path) -> None:
    record = honest(74)
    ACCIDENTS["absurd"].plant(record)
    (fault,) = examine(read(record, tmp_path)).source.recording.left_out
    assert fault.count == 3


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


def test_a_disturbance_that_is_added_is_no_other_gain(tmp_path: Path) -> None:
    """A touch that is as slow as the motion is taken up by its scale, which then looks a quarter larger."""
    codes = []
    for seed in range(47_101, 47_121):
        record = honest(seed)
        ACCIDENTS["touched"].plant(record)
        examined = examine(read(record, tmp_path))
        codes += [reading.kind for reading in examined.source.recording.left_out]
    assert codes == []


@pytest.mark.parametrize(("seed", "rest", "ratio"), [(1, 6.0, 2.0), (3, 6.0, 1.4), (5, 10.0, 1.4), (6, 3.0, 0.5)])
def test_another_gain_is_found_where_the_part_holds_a_rest(
    seed: int, rest: float, ratio: float, tmp_path: Path
) -> None:
    record = honest(seed)
    t, k = record.t, int(0.6 * len(record.t))
    ends = np.clip((np.abs(t - 0.75 * t[-1]) - 0.5 * rest) / 2.0, 0.0, 1.0)
    p = record.p * np.sin(0.5 * np.pi * ends) ** 2
    a = np.gradient(np.gradient(p, t), t)
    record.u = record.bias + a + 3e-3 * record.rng.standard_normal(len(t))
    record.u[k:] *= ratio
    record.z = p + 1e-6 * record.rng.standard_normal(len(t))
    kinds = [reading.kind for reading in examine(read(record, tmp_path)).source.recording.left_out]
    assert kinds == ["other_scale"]


@pytest.mark.parametrize("seed", [3, 8, 19])
def test_a_rest_of_a_biased_sensor_whose_clock_drifts_has_no_other_gain(seed: int) -> None:
    """Behind a last move the filter decays, which any gain explains."""
    draw = np.random.default_rng(seed)
    t = np.arange(0.0, 70.0, 2e-3)
    late, begin, at, places = 60e-6 * (t - 35.0), 1.5, 0.0, np.zeros((2, len(t)))
    while begin < 64.0:
        to, cycles = draw.uniform(-0.15, 0.15), draw.integers(8, 40)
        burst = draw.random() < 0.4
        duration = draw.uniform(2.0, 4.0) if burst else np.sqrt(7.5 * abs(to - at) / draw.uniform(3.0, 8.0))
        u = np.clip((np.stack([t, t - late]) - begin) / duration, 0.0, 1.0)
        if burst:
            tone = np.sin(np.pi * u) ** 2 * np.sin(2.0 * np.pi * cycles * u)
            places += 5.0 * (duration / (2.0 * np.pi * cycles)) ** 2 * tone
        else:
            places += (to - at) * u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
            at = to
        begin += duration + draw.uniform(0.1, 0.6)
    output = np.gradient(np.gradient(places[1], t), t) - 0.2 + 0.03 * draw.standard_normal(len(t))
    units = {"t": "s", "accel": "m/s^2", "position": "m"}
    recording = ac.Recording.from_arrays(t, output, np.round(places[0], 6), units=units)
    assert examine(recording).source.recording.left_out == ()


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


def test_no_effect_takes_the_place_of_the_scale_factor(tmp_path: Path) -> None:
    record = shocks(1009)  # eight readings in each: hysteresis would take a third of the scale factor
    improvement = ac.improve(ac.load(record.write(tmp_path / "run.csv")))
    assert improvement.effects == ("time_offset",)
    assert "1 + k = 0.6" in " ".join(improvement.diagnosis.notes)
    assert "was not added: beside it" in " ".join(improvement.diagnosis.notes)
    assert "range setting" not in improvement.sentence
    assert improvement.best["scale_factor"].value == pytest.approx(record.scale_factor, abs=5e-3)
