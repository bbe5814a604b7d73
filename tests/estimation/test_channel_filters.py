"""Declared filters in a fit: responses against closed forms, inversion, high-passes, and what refuses them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from accelcal.data.recording import RecordingError
from accelcal.data.rig import STANDARD_GRAVITY, ChannelFilter, Rig
from accelcal.estimation.channel_filters import LEAST_GAIN, ChannelFilters, uniform
from accelcal.estimation.estimate import Fit, estimate
from accelcal.filters.choice import FilterChoice
from accelcal.filters.live_model import LiveModel
from accelcal.io import load
from accelcal.model import Model
from accelcal.signals.processing import applied, memory, noise_bandwidth, response
from accelcal.simulation.sensor import ADXL105_RIG, simulate
from accelcal.verbs import fit
from tests.docs.pages import DOCS
from tests.regimes import filters as own
from tests.regimes.regimes import TABLE

RATE = 1667.0
KINDS = {
    "RC": ChannelFilter("RC", cutoff=159.0),
    "butterworth": ChannelFilter("butterworth", cutoff=50.0, order=4),
    "bessel": ChannelFilter("bessel", cutoff=100.0, order=3),
    "resonance": ChannelFilter("resonance", cutoff=40.0, quality=7.0),
    "biquad": ChannelFilter("biquad", b=(0.2, 0.4, 0.2), a=(1.0, -0.4, 0.2)),
    "sinc": ChannelFilter("sinc", length=16, order=3),
    "fir": ChannelFilter("fir", b=(0.25, 0.5, 0.25)),
}
BLOCKING = ChannelFilter("RC", "highpass", cutoff=0.5 / np.pi)


@pytest.mark.parametrize(
    ("kind", "declared"),
    [("RC", own.single_pole(159.0)), ("butterworth", own.butterworth(50.0, 4)), ("bessel", own.bessel(100.0, 3))],
)
def test_an_analog_response_is_that_of_its_poles(kind: str, declared: own.Declared) -> None:
    f = np.geomspace(0.1, 800.0, 50)
    poles = np.asarray(declared.poles)
    expected = np.prod(-poles[:, None] / (2j * np.pi * f - poles[:, None]), axis=0)
    np.testing.assert_allclose(response([KINDS[kind]], RATE)(f), expected, rtol=1e-9)
    corner = np.array([KINDS[kind].cutoff])
    assert abs(response([KINDS[kind]], RATE)(corner)[0]) == pytest.approx(0.5**0.5, rel=1e-9)


@pytest.mark.parametrize("quality", [0.3, 0.5, 7.0])
def test_a_resonance_is_a_mass_on_a_spring(quality: float) -> None:
    f = np.geomspace(0.1, 800.0, 50)
    ratio = f / 40.0
    expected = 1.0 / (1.0 - ratio**2 + 1j * ratio / quality)
    np.testing.assert_allclose(response([replace(KINDS["resonance"], quality=quality)], RATE)(f), expected, rtol=1e-9)


@pytest.mark.parametrize("kind", ["biquad", "sinc", "fir"])
def test_a_digital_filter_applied_is_its_recursion(kind: str) -> None:
    declared = KINDS[kind]
    taps = own.averages(16, 3).b if kind == "sinc" else declared.b
    y = np.concatenate([np.zeros(200), np.random.default_rng(3).standard_normal(3000)])
    expected = lfilter(taps, declared.a or (1.0,), y)
    result = applied(y, 1 / RATE, response([declared], RATE), memory([declared], RATE))
    np.testing.assert_allclose(result, expected, atol=1e-6)  # of a memory that is cut at 1.5e-8
    other = applied(y, 1 / RATE, response([replace(declared, rate=2 * RATE)], RATE), memory([declared], RATE))
    assert np.max(np.abs(other - expected)) > 1e-2


def slow_delay(filters: list[ChannelFilter]) -> float:
    """Delay of slow motion behind filters, s."""
    return -np.angle(response(filters, RATE)(np.array([1e-3]))[0]) / (2e-3 * np.pi)


def test_a_digital_butterworth_keeps_its_corner_and_an_analog_one_its_delay() -> None:
    digital = replace(KINDS["butterworth"], rate=400.0)
    assert abs(response([digital], RATE)(np.array([50.0]))[0]) == pytest.approx(0.5**0.5)
    assert slow_delay([KINDS["RC"]]) == pytest.approx(1 / (2 * np.pi * 159.0), rel=1e-6)
    assert slow_delay([KINDS["fir"]]) == pytest.approx(1 / RATE, rel=1e-6)
    assert noise_bandwidth(response([KINDS["fir"]], RATE), RATE) == pytest.approx(RATE * (1 + 4 + 1) / 16)


def test_a_low_pass_is_inverted_with_its_phase_up_to_its_least_gain() -> None:
    for kind in ("butterworth", "sinc"):
        filters = ChannelFilters(Rig(output_filters=(KINDS[kind],)), RATE, 833.0)
        f = np.array([1.0, 0.5 * filters.edge, 1.01 * filters.edge])
        both = filters.inverse(f) * response([KINDS[kind]], RATE)(f)
        np.testing.assert_allclose(both, [1.0, 1.0, 0.0], atol=1e-12)
        assert abs(response([KINDS[kind]], RATE)(np.array([filters.edge]))[0]) == pytest.approx(LEAST_GAIN, rel=0.02)


def test_what_a_high_pass_removes_is_added_back() -> None:
    step = 1e-3
    t = np.arange(0.0, 20.0, step)
    w = 2 * np.pi * 0.7
    p, v, a, jerk = 1 - np.cos(w * t), w * np.sin(w * t), w**2 * np.cos(w * t), -(w**3) * np.sin(w * t)
    p[t < 0] = 0.0
    filters = ChannelFilters(Rig(output_filters=(BLOCKING,)), 1 / step, 1 / step)
    blocked = filters.blocked(t, p)
    behind = tuple(filters.behind_high_passes(y, step) for y in (p, v))
    tau = 1.0
    a_behind = a - behind[1] / tau  # H a = a - v_H/tau
    jerk_behind = jerk - a_behind / tau
    result = filters.recoupled((p - blocked, behind[1], a_behind, jerk_behind), blocked, step)
    late = t > 12.0  # the motion began with a jump in acceleration, which fades with tau
    for signal, true, size in zip(result, (p, v, a, jerk), (1.0, w, w**2, w**3), strict=True):
        np.testing.assert_allclose(signal[late], true[late], atol=2e-3 * size)
    assert np.max(np.abs((behind[1] - v)[late])) > 0.05 * w


def z_of(name: str, seed: int, tmp_path, **declared) -> tuple[Fit, dict[str, float]]:
    record = TABLE[name].build(seed, seconds=20.0)
    loaded = load(record.write(tmp_path))
    fit = estimate(Model.linear(), replace(loaded, rig=replace(loaded.rig, **declared)))
    free = {e.name: e for e in fit.free}
    return fit, {n: (free[n].value - true) / free[n].std for n, true in record.truth.items() if n in free}


@pytest.mark.parametrize(
    "name", ["t-butter50", "t-bessel100", "t-sinc3", "t-fir31", "t-rc-rc", "t-highpass0.1", "t-position-lag200"]
)
def test_estimates_behind_a_declared_filter_hold(name: str, tmp_path) -> None:
    """False-alarm rate: 3 normal deviates beyond 4.5 in 7 records, 1.4e-4."""
    fit, z = z_of(name, 11, tmp_path)
    assert all(abs(score) < 4.5 for score in z.values()), z
    assert 0.85 < fit.runs[0].noise.ratio < 1.15
    if name == "t-highpass0.1":
        assert "bias" not in z
        assert any(
            "bias is not observable behind the declared RC high-pass" in remark.sentence for remark in fit.remarks
        )


@pytest.mark.parametrize("name", ["t-butter50", "t-position-lag200"])
def test_the_same_records_without_the_declaration_fail(name: str, tmp_path) -> None:
    _, z = z_of(name, 11, tmp_path, output_filters=(), position_filters=())
    assert max(abs(score) for score in z.values()) > 30.0


@pytest.mark.parametrize(
    "rig",
    [
        replace(ADXL105_RIG, lowpass=None, output_filters=(KINDS["butterworth"], KINDS["sinc"])),
        replace(ADXL105_RIG, output_filters=(BLOCKING,)),
        replace(ADXL105_RIG, position_filters=(ChannelFilter("bessel", cutoff=150.0, order=4),)),
    ],
    ids=["low", "high", "position"],
)
def test_a_simulated_rig_with_filters_is_recovered(rig: Rig) -> None:
    """False-alarm rate: 3 normal deviates beyond 4.5 in 3 records, 6e-5."""
    truth = {"bias": 0.1, "scale_factor": 0.01, "time_offset": 2e-4}
    simulation = simulate("interleaved", seconds=20.0, rig=rig, parameters=truth, rng=np.random.default_rng(4))
    fit = estimate(Model.linear(), simulation.recording)
    assert all(abs(e.value - truth[e.name]) < 4.5 * e.std for e in fit.free)
    assert 0.85 < fit.runs[0].noise.ratio < 1.15


def rows() -> list[list[str]]:
    """Rows of the table of support on the page of the user's own data."""
    text = (DOCS / "your-data.md").read_text(encoding="utf-8")
    table = text.split("| filter | fit, diagnose")[1].split("\n\n")[0]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()[2:]]


def rig_of(row: str) -> Rig:
    if row.startswith("one RC"):
        return ADXL105_RIG
    plain = replace(ADXL105_RIG, lowpass=None)
    if row.startswith("RC high-pass"):
        return replace(plain, output_filters=(BLOCKING,))
    if row.startswith("several RC"):
        return replace(plain, output_filters=(KINDS["RC"], replace(KINDS["RC"], cutoff=300.0)))
    match = re.match(r"(\w+) of `(accel|position)`", row)
    assert match, row
    field = "output_filters" if match[2] == "accel" else "position_filters"
    return replace(plain, **{field: (KINDS[match[1]],)})


def test_the_table_has_every_kind() -> None:
    assert {word for row in rows() for word in KINDS if word in row[0]} == set(KINDS)
    assert [row[2] for row in rows()].count("refused") == len(rows()) - 1


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_live_filters_do_what_the_table_says(row: list[str]) -> None:
    rig = rig_of(row[0])

    def live() -> LiveModel:
        return LiveModel(Model.linear(), rig, rate=1000.0, q=5e-7, r_position=1e-12, position=0.0)

    if row[2] != "refused":
        assert live().rig == rig
        return
    name = re.escape(rig.filters[0].name)
    with pytest.raises(ValueError, match=rf"a live filter takes one RC low-pass.*{name}.*use fit and diagnose"):
        live()
    simulation = simulate("tones", seconds=2.0, rig=ADXL105_RIG, parameters={}, rng=np.random.default_rng(1))
    with pytest.raises(RecordingError, match=rf"a fit by a live filter takes one RC.*{name}"):
        fit(replace(simulation.recording, rig=rig), method=FilterChoice("aci", "linear"))


def test_gravity_does_not_pass_a_high_pass() -> None:
    up = replace(ADXL105_RIG, axis="up", output_filters=(BLOCKING,))
    simulation = simulate("interleaved", seconds=20.0, rig=up, parameters={}, rng=np.random.default_rng(5))
    assert abs(np.mean(simulation.recording.accel.y)) < 0.1 * STANDARD_GRAVITY
    fit = estimate(Model.linear(), simulation.recording)
    assert abs(fit["scale_factor"].value) < 4.5 * fit["scale_factor"].std


def test_noise_that_enters_behind_a_resonance_is_coloured_near_it() -> None:
    """|1 - (f/f0)²|² is 0.56 at f0/2 and 0.99 at f0/20; behind a low-pass with a corner there, the noise is white."""
    rig = replace(ADXL105_RIG, lowpass=None, output_filters=(KINDS["resonance"],))
    filters = ChannelFilters(rig, RATE, RATE)
    assert filters.colour(20.0)
    assert not filters.colour(2.0)
    assert not ChannelFilters(replace(rig, output_filters=(KINDS["butterworth"],)), RATE, RATE).colour(20.0)


def test_even_samples_are_left_as_they_are_and_others_are_made_even() -> None:
    t = 7.3 + np.arange(500) / 250.0
    y = np.sin(9.0 * t)
    at, same = uniform(t, y, 1.0 / 250.0)
    assert at is t
    assert same is y
    uneven = np.delete(t, [100, 101, 333])
    at, read = uniform(uneven, np.sin(9.0 * uneven), 1.0 / 250.0)
    np.testing.assert_allclose(at, t, atol=1e-12)
    np.testing.assert_allclose(read, y, atol=1e-6)
