"""Sensitivity by frequency against exact shakers: errors, coverage, structures, linearity, the command."""

from __future__ import annotations

import csv
import json
import math
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import accelcal as ac
from accelcal.calibration.export import Laboratory
from accelcal.data import ChannelFilter
from accelcal.data.recording import Channel, Recording, RecordingError, integrated
from accelcal.data.rig import Sensor, Uncertainty
from accelcal.plots.response import response_note
from accelcal.response import Point, Reference, broadband, fit_response, frequency_response, stepped_response
from accelcal.response.export import draft_response, lines
from accelcal.response.linearity import Harmonics, linearity
from accelcal.response.sine import find_steps
from accelcal.simulation import ADXL105_RIG, CXL02_RIG
from accelcal.simulation.motion import sine_steps
from benches.response import broadband_runs, largest, mpu9250_runs, vibrometer_runs
from tests.calibration.export.order import require_order
from tests.schemas import require_published
from tests.worlds.shaker import SecondOrder, Step, published_sensor, run

DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
RATE = 2000.0
STEPS = [Step(f, 10.0, 1.0 + 8.0 / f) for f in (8.0, 15.0, 28.0, 50.0, 90.0, 160.0)]
SENSOR = SecondOrder(1.02, 400.0, 2.0, 50e-6)


def shaken(sensor: SecondOrder = SENSOR, steps=STEPS, *, jitter: float = 0.0, seed: int = 1) -> Recording:
    """Two clocks, the output with stamps that scatter by a share of their spacing."""
    rng = np.random.default_rng(seed)
    seconds = sum(s.seconds for s in steps) + 0.1 * (len(steps) + 1)
    t = (np.arange(0.0, seconds, 1.0 / RATE) + jitter / RATE * rng.uniform(-0.5, 0.5, math.ceil(seconds * RATE))).clip(
        0
    )
    tz = np.arange(0.0, seconds, 1.0 / 3000.0) + 7e-5
    output, displacement = run(steps, sensor, t, tz, 0.1)
    output = output + 0.02 * rng.standard_normal(len(t))
    displacement = displacement + 1e-9 * rng.standard_normal(len(tz))
    units = {"t": "s", "accel": "m/s^2", "position": "m"}
    return Recording.from_arrays(t, output, displacement, position_t=tz, units=units, name="shaker")


@pytest.fixture(scope="module")
def recording() -> Recording:
    return shaken()


def test_the_shaker_world_is_continuous_and_obeys_its_equation():
    # x'' + w0/Q x' + w0² x = k w0² p'' by central differences inside each phase
    sensor, h = SecondOrder(1.02, 50.0, 2.0, 0.0), 1e-4
    t = np.arange(0.0, 3.3, h)
    x, p = run([Step(10.0, 5.0, 3.0)], sensor, t, t, 0.2)
    w0 = 2 * np.pi * sensor.f0
    second = lambda y: (y[2:] - 2 * y[1:-1] + y[:-2]) / h**2  # noqa: E731
    error = second(x) + w0 / sensor.Q * (x[2:] - x[:-2]) / (2 * h) + w0**2 * x[1:-1] - sensor.k * w0**2 * second(p)
    assert np.median(np.abs(error)) < 2e-5 * w0**2 * 5.0
    assert np.max(np.abs(np.diff(x))) < 1.1 * 5.2 * 2 * np.pi * 10.0 * h


def test_a_laser_vibrometer_measures_within_a_thousandth_and_a_tenth_of_a_degree():
    result = vibrometer_runs(5, seed=11)
    print(result.text())
    assert largest(result.magnitude) < 1e-3
    assert largest(result.phase) < 0.1
    assert largest(result.parameters["f0"]) < 0.005
    assert largest(result.parameters["Q"]) < 0.05
    assert result.covered > 0.90  # 160 intervals: 0.955 with a standard deviation of 0.016
    assert result.lost == 0


def test_the_published_response_of_a_low_pass_with_delay_comes_back():
    result = mpu9250_runs(3, seed=12)
    print(published_sensor(), result.text())
    assert largest(result.magnitude) < 5e-3
    assert largest(result.phase) < 0.3
    assert result.lost == 0


def test_a_sweep_is_covered():
    result = broadband_runs("sweep", 2, seed=13)
    print(result.text())
    assert 0.88 < float(np.mean(np.abs(result.scores) < 1.0)) < 0.99


def test_uneven_stamps_of_the_output_change_nothing():
    response = frequency_response(shaken(jitter=0.4), check=False)
    assert len(response.points) == len(STEPS)
    for point in response.points:
        truth = complex(SENSOR.response(np.array([point.frequency]))[0])
        assert abs(point.value - truth) < 4.0 * math.sqrt(2.0) * point.std


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_reference_may_be_acceleration_velocity_or_position(order):
    simulation = ac.simulate(
        sine_steps([10.0, 30.0], 5.0, 3.0),
        seconds=6.6,
        rig=ac.Rig(sensor=ac.Sensor(noise=1e-4)),
        parameters={"scale_factor": 0.02, "time_offset": 1e-4},
        rng=np.random.default_rng(1),
    )
    t = np.arange(0.0, 6.6, 1e-3)
    y = simulation.truth.motion.derivatives(t)[2 - order]
    reference = Reference(Channel("reference", t, y, ("m/s^2", "m/s", "m")[order]), order)
    for point in frequency_response(simulation.recording, reference=reference, check=False).points:
        expected = 1.02 * np.exp(-2j * math.pi * point.frequency * 1e-4)
        assert abs(point.value - expected) < 5e-4


def test_delay_and_low_pass_are_one_class_where_magnitude_does_not_tell_them_apart():
    f = np.array([5.0, 10.0, 20.0, 40.0])
    value = np.exp(-2j * math.pi * f * 1e-4)
    rng = np.random.default_rng(3)

    def model(std):
        noise = std * (rng.standard_normal(4) + 1j * rng.standard_normal(4))
        points = [
            Point(float(a), complex(b), std, 100.0, 1.0 + 0j, "sine", 0.0, 1.0)
            for a, b in zip(f, value + noise, strict=True)
        ]
        result = fit_response(points)
        assert result is not None
        return result

    blurred, sharp = model(1e-3), model(1e-7)
    names = {s.structure.name for s in (blurred.best, *blurred.rivals)}
    assert {"gain and delay", "one pole"} <= names
    assert "one class" in " ".join(blurred.sentences)
    assert sharp.best.structure.name == "gain and delay"
    assert not sharp.rivals
    assert sharp.best["delay"].value == pytest.approx(1e-4, rel=1e-3)


def test_a_declared_high_pass_and_the_reference_are_in_the_answer():
    rng, rate, fc = np.random.default_rng(5), 2000.0, 0.4
    t = np.arange(0.0, 16.0, 1.0 / rate)
    output, displacement = 2e-3 * rng.standard_normal((2, len(t))) * [[1.0], [1e-6]]
    for k, f in enumerate((5.0, 10.0, 40.0, 160.0)):
        inside = (t > 4.0 * k + 0.3) & (t < 4.0 * k + 3.7)
        gain = 1.01 * 1j * f / (1j * f + fc) * np.exp(-2j * math.pi * f * 50e-6)
        wave = np.exp(2j * math.pi * f * t)
        output += inside * np.real(5.0 * gain * wave)
        displacement -= inside * np.real(5.0 / (2.0 * math.pi * f) ** 2 * wave)
    rig = ac.Rig(
        output_filters=(ChannelFilter("RC", "highpass", cutoff=fc),), uncertainty=Uncertainty(encoder_scale=2e-3)
    )
    units = {"t": "s", "accel": "m/s^2", "position": "m"}
    shaker = Recording.from_arrays(t, output, displacement, position_t=t, units=units, rig=rig, name="shaker")
    answer = frequency_response(shaker, check=False)
    assert answer.model is not None
    best = answer.model.best
    assert best.structure.name == "gain and delay"
    assert best.p_value > 1e-3  # of chi-square: one false alarm in 1000
    assert "behind the declared RC high-pass at 0.4 Hz" in answer.model.sentences[0]
    assert abs(best["delay"].value - 50e-6) < 4.0 * best["delay"].std < 1e-6
    assert abs(best["k"].value - 1.01) < best["k"].expanded == pytest.approx(2.0 * 2e-3 * 1.01, rel=0.05)
    for point in answer.points:
        assert point.expanded == pytest.approx(2.0 * math.hypot(point.std, 2e-3 * point.magnitude), rel=0.05)
        assert point.expanded_phase < 1e-3
    assert "rectification" not in {term.source for term in answer.terms}
    table = lines(answer, Sensor(scale=0.1, scale_unit="V"))
    assert table[0].endswith("S, mV/(m/s²)")
    assert re.search(r"  10[0-2]\.\d* ± 0\.4\d$", table[1])  # 100 mV/(m/s²) times 1.01, with 0.4 % of it
    assert re.search(r"1 \+ k = 1\.01\d* ± 0\.00\d+, delay = \d+\.\d+ ± 0\.\d+ µs \(± U, k = 2\)", "\n".join(table))
    for message in ("\n".join(lines(answer)), response_note(answer)):
        assert "0.2 %, on magnitudes (type B)" in message


@pytest.mark.parametrize("shape", [lambda u: 0.5 - 0.5 * np.cos(np.pi * u), lambda u: u], ids=["cosine", "line"])
def test_a_slow_fading_is_no_step(shape):
    rng, rate, seconds, fade = np.random.default_rng(6), 5000.0, 3.0, 0.8
    t = np.arange(0.0, seconds, 1.0 / rate)
    envelope = shape(np.clip(np.minimum(t, seconds - t) / fade, 0.0, 1.0))
    sines = ((80.0, 10.0), (160.0, 20.0), (500.0, 40.0), (1000.0, 50.0), (1000.0, 20.0), (1000.0, 10.0))
    y = np.concatenate([envelope * a * np.sin(2.0 * np.pi * f * t) for f, a in sines])
    output = Channel("accel", np.arange(len(y)) / rate, y + 2e-3 * rng.standard_normal(len(y)), "m/s^2")
    steps = find_steps(output, 2000.0)
    assert [s.frequencies for s in steps] == [pytest.approx((f,), rel=1e-4) for f, _ in sines]


def test_a_frequency_that_no_structure_describes_is_named():
    f = np.geomspace(10.0, 300.0, 12)
    value = SENSOR.response(f)
    value[7] *= 1.01  # a mode of the mount
    points = [
        Point(float(a), complex(b), 1e-4, 32.0, 1.0 + 0j, "sine", 0.0, 1.0) for a, b in zip(f, value, strict=True)
    ]
    result = fit_response(points)
    assert result is not None
    assert f[7] in result.failing
    assert "it fails at" in " ".join(result.sentences)


def test_harmonics_and_levels_give_quadratic_and_cubic_terms():
    levels = [2.0, 5.0, 10.0, 15.0, 20.0]
    simulation = ac.simulate(
        sine_steps([20.0] * 5 + [35.0] * 5, levels * 2, 1.6),
        seconds=18.2,
        rig=ac.Rig(sensor=ac.Sensor(noise=1e-3)),
        parameters={"scale_factor": 0.01, "quadratic": 1e-3, "cubic": 1e-4},
        rng=np.random.default_rng(4),
        position_noise=1e-8,
    )
    response = frequency_response(simulation.recording, check=False)
    assert len(response.points) == 10
    terms = {(t.name, t.source): t for t in response.terms}
    assert set(terms) == {("K2", "harmonic 2"), ("K3", "harmonic 3"), ("K2", "rectification"), ("K3", "fundamental")}
    for (name, source), term in terms.items():
        truth = {"K2": 1e-3, "K3": 1e-4}[name]
        print(name, source, term.value, term.expanded)
        assert abs(term.value - truth) < 2.5 * term.expanded + 0.01 * truth


@pytest.mark.parametrize(("behind", "source"), [(False, "harmonic 2"), (True, "harmonic 2, behind the fitted poles")])
def test_a_quadratic_term_is_one_before_or_behind_the_resonance(behind, source):
    def gain(f):
        return 1.02 / (1.0 - (f / 900.0) ** 2 + 1j * f / 900.0 / 12.0)

    rng, steps = np.random.default_rng(5), []
    for f in (10.0, 40.0, 100.0, 200.0, 315.0, 400.0):
        first, second = gain(np.array([f, 2.0 * f]))
        result = 0.5e-4 * ((first / 1.02 * 10.0) ** 2 if behind else second / 1.02 * 10.0**2)
        point = Point(f, complex(first), 1e-5, 32.0, 10.0 + 0j, "sine", 0.0, 1.0)
        output = np.array([10.0 * first, result + 1e-4 * (rng.standard_normal() + 1j * rng.standard_normal())])
        steps.append(Harmonics(point, output, np.array([10.0 + 0j, 0j]), np.array([1e-4, 1e-4]), 0.0))
    (term,) = [term for term in linearity(steps, gain, 1.02) if term.source.startswith("harmonic 2")]
    assert term.source == source
    assert abs(term.value - 1e-4) < 2.0 * term.expanded


def test_frequencies_that_are_asked_for_are_kept_or_said_to_be_missing(recording):
    response = frequency_response(recording, frequencies=[15.0, 50.0], check=False)
    assert [round(p.frequency) for p in response.points] == [15, 50]
    with pytest.raises(RecordingError, match=r"no steady sine at 33 Hz; found are: 8, 15"):
        frequency_response(recording, frequencies=[33.0], check=False)
    with pytest.raises(RecordingError, match="positive numbers in Hz"):
        frequency_response(recording, frequencies=[-1.0])


def test_rest_has_no_response():
    simulation = ac.simulate("rest", seconds=10.0, rig=ADXL105_RIG, parameters={}, rng=np.random.default_rng(1))
    with pytest.raises(RecordingError, match="no frequency in common"):
        frequency_response(simulation.recording)


def test_the_command_writes_table_certificate_and_json(recording, tmp_path):
    from accelcal.cli import write_recording

    path = tmp_path / "s.csv"
    write_recording(recording, path)
    script = Path(sys.executable).with_name("accelcal")
    out = subprocess.run(
        [script, "response", path, "--json", "--csv", tmp_path / "t.csv", "--dcc", tmp_path / "t.xml"],
        capture_output=True,
        text=True,
        check=True,
    )
    content = json.loads(out.stdout)
    require_published(content)
    assert content["model"]["best"]["structure"]["name"].startswith("second order")
    assert "time-domain fit" in content["check"]["sentence"]
    with (tmp_path / "t.csv").open() as text:
        rows = list(csv.DictReader(text))
    assert [float(r["magnitude"]) for r in rows] == [p["magnitude"] for p in content["points"]]
    table = ElementTree.parse(tmp_path / "t.xml").getroot()
    lists = [node.text.split() for node in table.iter("{https://ptb.de/si}valueXMLList")]
    assert [len(numbers) for numbers in lists] == [len(STEPS)] * 4
    assert [float(text) for text in lists[1]] == [p["magnitude"] for p in content["points"]]
    assert "is a draft; missing: certificate.identifier" in out.stderr


def test_steps_of_close_frequencies_are_all_found():
    steps = [Step(float(f), 10.0, 0.8 + 8.0 / float(f)) for f in np.geomspace(10.0, 350.0, 16)]
    response = frequency_response(shaken(steps=steps), check=False)
    np.testing.assert_allclose([p.frequency for p in response.points], [s.frequency for s in steps], rtol=1e-3)


@pytest.mark.parametrize("motion", ["tones", "interleaved", "sweep", "chirp", "moves", "rest"])
def test_other_motions_are_not_one_of_steps_and_a_moment_tells(motion, monkeypatch):
    from accelcal.response import measure

    simulation = ac.simulate(motion, seconds=60.0, rig=CXL02_RIG, parameters={}, rng=np.random.default_rng(2)).recording
    monkeypatch.setattr(measure, "_sine", lambda *_: pytest.fail("the whole search"))
    assert stepped_response(simulation) is None


def test_steps_have_a_response_from_three_frequencies_on(recording):
    result = stepped_response(recording, check=False)
    assert result is not None
    assert result.points == frequency_response(recording, check=False).points
    assert stepped_response(shaken(steps=STEPS[:2]), check=False) is None
    assert stepped_response(shaken(steps=STEPS[:3]), check=False) is not None


def test_the_certificate_is_whole_and_states_the_table(recording):
    response = frequency_response(recording, check=False)
    sensor = ac.Sensor(model="QFLEX", serial="7", scale=-0.02, scale_unit="V")
    draft = draft_response(response, sensor, Laboratory())
    assert draft.missing == Laboratory().missing
    require_order(draft.text)
    root = ElementTree.fromstring(draft.text)
    results = root.findall(f"{DCC}measurementResults/{DCC}measurementResult/{DCC}results/{DCC}result")
    names = [r.findtext(f"{DCC}name/{DCC}content") for r in results]
    assert names == [
        "Frequency response of the sensitivity",
        "Parametric fit of the frequency response",
        "Amplitude linearity",
    ]
    messages = [r.findtext(f"{DCC}description/{DCC}content") or "" for r in results]
    assert ["The uncertainty of the reference is not contained" in text for text in messages] == [False, False, True]
    columns = {
        q.findtext(f"{DCC}name/{DCC}content"): q.find(f"{SI}realListXMLList") for q in results[0].iter(f"{DCC}quantity")
    }
    units = {name: column.findtext(f"{SI}unitXMLList") for name, column in columns.items()}
    assert units["phase of output over acceleration"] == r"\degree"
    assert units["magnitude of the sensitivity"] == r"\volt\metre\tothe{-1}\second\tothe{2}"

    def numbers(name, tag):
        return [float(text) for text in columns[name].findtext(tag).split()]

    magnitude, spread = "magnitude of output over acceleration", f"{SI}expandedUncXMLList/{SI}"
    assert numbers(magnitude, f"{SI}valueXMLList") == [p.magnitude for p in response.points]
    stated = zip(
        numbers(magnitude, f"{spread}uncertaintyXMLList"),
        numbers(magnitude, f"{spread}coverageFactorXMLList"),
        strict=True,
    )
    for (expanded, factor), point in zip(stated, response.points, strict=True):
        assert expanded / factor == pytest.approx(point.std, rel=1e-3)
    volts = numbers("magnitude of the sensitivity", f"{SI}valueXMLList")
    np.testing.assert_allclose(volts, [0.02 * p.magnitude for p in response.points])
    f0 = next(q for q in results[1].iter(f"{DCC}quantity") if q.findtext(f"{DCC}name/{DCC}content") == "f0")
    assert f0.findtext(f"{SI}real/{SI}unit") == r"\hertz"
    assert "no contribution of the calibration of the reference" in draft.text


def test_a_sweep_is_certified_without_amplitudes():
    simulation = ac.simulate(
        "sweep", seconds=20.0, rig=CXL02_RIG, parameters={}, rng=np.random.default_rng(1)
    ).recording
    response = frequency_response(simulation, method="broadband", check=False)
    text = draft_response(response, simulation.rig.sensor, Laboratory()).text
    require_order(text)
    assert "Spectral estimation" in text
    assert "amplitude of the acceleration" not in text


def test_the_json_of_every_kind_of_motion_follows_its_schema(recording):
    simulation = ac.simulate("interleaved", seconds=20.0, rig=CXL02_RIG, parameters={}, rng=np.random.default_rng(1))
    for item in (recording, simulation.recording):
        response = frequency_response(item)
        require_published(json.loads(response.to_json()))
        assert type(response).from_json(response.to_json()).points == response.points


def test_a_recorded_velocity_is_the_reference():
    """The recording alone says which of the two it was."""
    position = shaken()
    t, p = position.position.t, position.position.y
    velocity = Channel("velocity", t[1:-1], (p[2:] - p[:-2]) / (t[2:] - t[:-2]), "m/s")
    run_of_velocity = Recording(position.accel, integrated(velocity), position.rig, reference=velocity)
    step = t[1] - t[0]
    for first, other in zip(
        frequency_response(position, check=False).points,
        frequency_response(run_of_velocity, check=False).points,
        strict=True,
    ):
        w = 2.0 * math.pi * first.frequency * step
        assert other.magnitude * math.sin(w) / w == pytest.approx(first.magnitude, rel=2e-3)


def test_the_reference_widens_the_gain_by_its_own_degrees_of_freedom():
    # few degrees of the noise say nothing of a declared uncertainty that exceeds it by far
    points = [
        Point(f, complex(1.02 + 1e-5 * (-1) ** i), 1e-5, 6.0, 10.0 + 0.0j, "sine", 0.0, 1.0, reference_std=2e-3)
        for i, f in enumerate((10.0, 20.0))
    ]
    (model,) = [fit_response(points)]
    assert model is not None
    gain = model.best["k"]
    assert gain.expanded == pytest.approx(2.0 * 2e-3 * 1.02, rel=1e-3)
    exact = fit_response([replace(p, reference_std=0.0) for p in points])
    assert exact is not None
    assert exact.best["k"].expanded > 2.1 * exact.best["k"].std


def scores_behind_delay_and_resonance(seed: int) -> np.ndarray:
    """Errors over standard uncertainties, real and imaginary, of 60 tones in 20 s: 30 ms late, resonant at 45 Hz."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 20.0, 1 / 500)
    f, phase = rng.uniform(0.5, 20.0, 60), rng.uniform(0.0, 2.0 * np.pi, 60)

    def gain(f):
        return np.exp(-2j * np.pi * f * 0.03) / (1.0 - (f / 45.0) ** 2 + 0.2j * f / 45.0)

    tones = np.exp(1j * (2.0 * np.pi * f * t[:, None] + phase))
    accel = np.imag(tones @ (0.06 * gain(f))) + 1e-3 * rng.standard_normal(len(t))
    place = np.imag(tones @ (-0.06 / (2.0 * np.pi * f) ** 2)) + 1e-7 * rng.standard_normal(len(t))
    recording = Recording.from_arrays(t, accel, place, units={"accel": "m/s^2", "position": "m"})
    points = frequency_response(recording, method="broadband", check=False).points
    errors = np.array([(p.value - gain(p.frequency)) / p.std for p in points])
    return np.concatenate([errors.real, errors.imag])


def test_a_gain_that_changes_over_the_width_of_a_window_has_its_uncertainty(monkeypatch):
    """The rms of about 110 numbers, of which neighbours share their windows, was 0.75 to 1.4 in 20 records. The twin,
    whose gain is constant over the width, is wrong by several uncertainties."""
    rms = math.sqrt(float(np.mean(scores_behind_delay_and_resonance(11) ** 2)))
    whole = broadband.amplitudes

    def first(*given, columns=broadband.COLUMNS):
        return whole(*given, columns=columns) * (np.arange(columns) == 0)[:, None, None]

    monkeypatch.setattr(broadband, "amplitudes", first)
    twin = math.sqrt(float(np.mean(scores_behind_delay_and_resonance(11) ** 2)))
    print(f"rms of errors over uncertainties {rms:.2f}, with one column {twin:.1f}")
    assert 0.6 < rms < 1.6
    assert twin > 2.5
