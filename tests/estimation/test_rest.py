"""A sensor at rest: coverage of the intervals, Allan deviation by definition, warm-up, refusals, the command."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import accelcal as ac
from accelcal import plots
from accelcal.estimation.allan import (
    FLOOR,
    TERMS,
    NoiseTerm,
    OutputNoise,
    allan_deviation,
    degrees_of_freedom,
    rest,
)
from accelcal.io import read_sidecar
from accelcal.plots import model
from benches.allan import flicker, sensor
from tests.commands import accelcal as command
from tests.schemas import require_published

NONE = np.empty(0)
RATE = 50.0


def still(y, rate=RATE, t=None, **side):
    t = np.arange(len(y)) / rate if t is None else t
    channels = {name: ac.Channel(name, t, x, "degC" if name == "temperature" else "m/s^2") for name, x in side.items()}
    accel = ac.Channel("accel", t, y, "m/s^2") if len(y) else ac.Channel("accel", NONE, NONE, "m/s^2")
    return ac.Recording(accel, ac.Channel("position", NONE, NONE, "m"), ac.Rig(), channels, "still.csv")


def white(count=20_000, seed=1, size=0.01):
    return 0.1 + size * np.random.default_rng(seed).standard_normal(count)


def test_intervals_hold_the_truth_in_95_of_100():
    """Of 20 records for each term at 95 %: rejected below the 0.1 % point of the binomial distribution, so for 0.3 % of
    seeds. The twin that must fail: intervals half as wide."""
    records, held, half = 20, [], []
    for seed in range(records):
        recording, truth = sensor(np.random.default_rng([7, seed]), 10_000)
        (output,) = rest(recording).outputs
        for term, x in zip(output.terms, truth, strict=True):
            held.append(term.low <= x <= term.high)
            half.append(math.sqrt(term.low * term.value) <= x <= math.sqrt(term.high * term.value))
    counts, fewer = (np.sum(np.reshape(of, (records, 3)), axis=0) for of in (held, half))
    least = stats.binom.ppf(0.001, records, 0.95)
    print(f"of {records}: {counts} for {TERMS} (at least {least:.0f}), half as wide {fewer}")
    assert np.all(counts >= least)
    assert np.any(fewer < least)


def test_flicker_of_the_bench_has_the_floor_that_defines_it():
    """Mean Allan variance of 200 records at 16 to 256 samples, each known to 2 %: 0.664 B within 1.5 %."""
    variances = [allan_deviation(flicker(4096, np.random.default_rng(seed)), 1.0)[1][4:9] ** 2 for seed in range(200)]
    assert np.sqrt(np.mean(variances)) == pytest.approx(FLOOR, rel=0.015)


def test_the_allan_deviation_is_that_of_its_definition():
    y = np.random.default_rng(3).standard_normal(200)
    tau, deviation = allan_deviation(y, 4.0)
    for m, result in zip(np.rint(4.0 * tau).astype(int), deviation, strict=True):
        means = np.convolve(y, np.full(m, 1.0 / m), "valid")
        assert result == pytest.approx(math.sqrt(0.5 * np.mean((means[m:] - means[:-m]) ** 2)), rel=1e-12)


@pytest.mark.parametrize("kind", range(3))
def test_degrees_of_freedom_are_those_of_the_scatter(kind):
    """2 mean²/variance of the Allan variance over 1500 records, itself known to 4 %; the formulas are approximations
    to some per cent, worse in the last octave."""
    simulated = []
    for seed in range(1500):
        rng = np.random.default_rng(seed)
        steps = rng.standard_normal(512)
        simulated.append(allan_deviation((steps, flicker(512, rng), np.cumsum(steps))[kind], 1.0)[1] ** 2)
    scatter = 2.0 * np.mean(simulated, axis=0) ** 2 / np.var(simulated, axis=0)
    formula = degrees_of_freedom(512, 2.0 ** np.arange(len(scatter)))[kind]
    assert np.abs(np.log(formula / scatter))[:-1].max() < 0.2


def test_lines_of_the_sidecar_are_read_as_they_were_estimated(tmp_path):
    output = rest(sensor(np.random.default_rng([1, 3]), 50_000)[0]).outputs[0]
    path = tmp_path / "rig.toml"
    path.write_text(output.sidecar)
    declared = read_sidecar(path).rig.sensor
    determined = [term for term in output.terms if term.determined]
    assert len(determined) > 1
    for term in determined:
        assert getattr(declared, term.name) == pytest.approx(term.value, rel=1e-3)  # four digits are written


def test_short_records_give_upper_limits_and_say_how_long_one_must_be():
    result = rest(still(white()))
    noise, instability, walk = result.outputs[0].terms
    assert noise.low < 0.01 * math.sqrt(2.0 / RATE) < noise.high
    assert not instability.determined
    assert not walk.determined
    text = str(result)
    assert "upper limit; 100 times the Allan minimum, at least 5.6 h" in text
    assert "# bias_instability is below" in result.outputs[0].sidecar


@pytest.mark.parametrize(("lag", "order"), [(0.0, 1), (40.0, 1), (0.0, 2)])
def test_a_warm_up_is_no_noise(lag, order):
    """Slope within 4 standard deviations; random walk below what the warm-up would look like; memory where it is."""
    t = np.arange(30_000) / RATE
    rng = np.random.default_rng(5)
    heated = 25.0 + 20.0 * (1.0 - np.exp(-t / 120.0)) + 4.0 * np.sin(2.0 * np.pi * t / 150.0)
    true = heated
    if lag:
        true = np.empty(len(t))
        true[0] = heated[0]
        for i in range(1, len(t)):
            true[i] = true[i - 1] + (heated[i] - true[i - 1]) / (lag * RATE)
    middle = 0.5 * (heated.min() + heated.max())
    y = 3e-3 * (true - middle) + (order - 1) * 2e-4 * (true - middle) ** 2 + 0.01 * rng.standard_normal(len(t))
    (output,) = rest(still(y, temperature=np.round(heated + 0.02 * rng.standard_normal(len(t)), 2))).outputs
    warm_up = output.warm_up
    assert abs(warm_up.slope - 3e-3) < 4.0 * warm_up.std
    assert warm_up.std < 3e-5
    assert not output.terms[2].determined
    assert (warm_up.trend.memory == "lag") == bool(lag)
    assert warm_up.trend.order == order
    if lag:
        assert warm_up.trend.time == pytest.approx(lag, rel=0.1)
    assert rest(still(y)).outputs[0].terms[2].determined  # the twin: without the temperature it is a random walk


def test_a_line_and_a_low_pass_are_left_out_and_named():
    y, t = white(60_000), np.arange(60_000) / RATE
    hummed = rest(still(y + 0.004 * np.sin(2.0 * np.pi * 7.3 * t))).outputs[0]
    assert "the largest at 7.3 Hz" in hummed.notes[0]
    assert hummed.terms[0].value == pytest.approx(0.002, rel=0.03)
    passed = rest(still(np.convolve(y, [0.5, 0.5], "valid"))).outputs[0]
    assert len(passed.notes) == 1
    assert "the noise is not white" in passed.notes[0]
    # The fall that is left in the band is 0.6 %, the standard deviation of the estimate 0.8 %: three of them.
    assert passed.terms[0].value == pytest.approx(0.002, rel=0.03)
    assert not rest(still(y)).outputs[0].notes


def spoiled(kind):
    y, t = white(), np.arange(20_000) / RATE
    if kind == "short":
        return still(y[:60])
    if kind == "bump":
        y[9_000:9_100] += np.sin(np.arange(100))
    if kind == "coarse":
        y = np.round(y / 0.05) * 0.05
    if kind == "gap":
        rows = (t < 100.0) | (t > 130.0)
        return still(y[rows], t=t[rows])
    if kind in ("clipped", "constant"):
        y = np.minimum(y, 0.11) if kind == "clipped" else np.full(len(y), 0.1)
        return ac.Recording.from_arrays(t, y, t, units={"t": "s", "accel": "m/s^2", "position": "m"})
    if kind == "volts":
        simulated = still(NONE, t=t)
        return replace(simulated, side={"accel_x": ac.Channel("accel_x", t, y, "V")})
    return still(y)


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("short", "60 samples, expected at least 100"),
        ("bump", r"does not rest: from t = 179.2 s on .* in 3 of 312 windows.* --only 183.04:399.34"),
        ("coarse", r"in steps of 0.05 m/s², coarser than its noise"),
        ("gap", r"1 gaps, the first at t = 99.98 s .* --only 130.02:399.98"),
        ("clipped", "piled up at the extreme"),
        ("constant", "carries no information"),
        ("volts", 'declare scale and zero of this channel in the sidecar: accel_x = { column = "...", unit = "V"'),
    ],
    ids=lambda text: text if text.isalpha() else "",
)
def test_what_is_no_record_at_rest_is_refused_with_the_next_step(kind, sentence):
    with pytest.raises(ac.RecordingError, match=sentence):
        rest(spoiled(kind))
    rest(spoiled("none"))


def test_figure_has_the_numbers_of_the_result():
    result = rest(sensor(np.random.default_rng([1, 3]), 20_000)[0])
    output = result.outputs[0]
    (panel,) = model.allan(result).panels
    points = next(mark for mark in panel.marks if getattr(mark, "name", "") == "Allan deviation")
    assert points.y * 9.80665e-6 == pytest.approx(output.deviation)
    level = panel.marks[-1]
    assert level.at == pytest.approx(output.minimum[0])
    tau = np.geomspace(0.1, 10.0, 2001) * output.minimum[0]
    total = np.linalg.norm(output.allan(tau), axis=0)
    assert tau[np.argmin(total)] == pytest.approx(output.minimum[0], rel=0.01)
    assert plots.allan(result).axes


def test_the_command_prints_lines_writes_json_and_a_figure_and_its_advice_works(tmp_path):
    y = np.stack([white(seed=seed) for seed in range(3)])
    y[:, 9_000:9_100] += 1.0
    rows = np.column_stack([np.arange(20_000) / RATE, *y])
    np.savetxt(tmp_path / "still.csv", rows, "%.6f", ",", header="t,x,y,z", comments="")
    channels = "".join(f'accel_{a} = {{ column = "{a}", unit = "m/s^2" }}\n' for a in "xyz")
    (tmp_path / "still.toml").write_text(f'[channels]\ntime = {{ column = "t", unit = "s" }}\n{channels}')
    refused = command("rest", "still.csv", cwd=tmp_path)
    assert refused.returncode == 3
    advice = refused.stderr.partition("accelcal cut ")[2].split()
    assert command("cut", *advice, cwd=tmp_path).returncode == 0
    done = command("rest", "rest_1.csv", "--figure", "a.png", "-o", "rest.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n[sensor]") == 3
    require_published(json.loads((tmp_path / "rest.json").read_text()))
    assert (tmp_path / "a.png").stat().st_size > 10_000


@pytest.mark.parametrize(("seconds", "reached"), [(240.0, False), (250.0, True)])
def test_the_minimum_is_that_of_the_three_terms_where_half_of_the_record_reaches_it(seconds, reached):
    terms = tuple(NoiseTerm(name, x, 0.5 * x, 2.0 * x) for name, x in zip(TERMS, (1e-3, 2e-5, 1e-5), strict=True))
    noise = OutputNoise("accel", seconds, RATE, 10.0, terms, NONE, NONE, NONE, NONE, None, ())
    tau = np.linspace(100.0, 150.0, 5001)
    deviation = np.linalg.norm(noise.allan(tau), axis=0)
    least = int(np.argmin(deviation))
    assert noise.minimum == (
        (pytest.approx(tau[least], rel=1e-3), pytest.approx(deviation[least])) if reached else None
    )
