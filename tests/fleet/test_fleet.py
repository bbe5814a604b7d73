"""Many sensors: components against the analysis of variance and by simulation; the command, killed and resumed."""

import json
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from distributed import LocalCluster
from scipy import stats
from typer.testing import CliRunner

import accelcal as ac
from accelcal.cli import app, write_recording
from accelcal.fleet import campaign, summary
from accelcal.fleet.summary import AGEING_ALPHA, OUTLYING, fit_of, moving_range, population, summarise
from accelcal.model import Prior
from accelcal.simulation import CXL02_RIG
from tests.schemas import require_published

SENSORS, RUNS = 24, 4


def drawn(rng, sensors=SENSORS, runs=RUNS, between=3.0, within=1.0, error=0.3):
    sensor = np.repeat(np.arange(sensors), runs)
    std = error * np.exp(0.3 * rng.standard_normal(len(sensor)))
    y = 10.0 + between * rng.standard_normal(sensors)[sensor] + within * rng.standard_normal(len(sensor))
    return y + std * rng.standard_normal(len(sensor)), std, sensor


def test_equal_runs_give_the_analysis_of_variance():
    y, _, sensor = drawn(np.random.default_rng(1))
    result = population(y, np.full(len(y), 1e-6), sensor)
    item = y.reshape(SENSORS, RUNS)
    within = np.sum((item - item.mean(axis=1, keepdims=True)) ** 2) / (SENSORS * (RUNS - 1))
    between = np.var(item.mean(axis=1), ddof=1) - within / RUNS
    assert result.run_to_run.value == pytest.approx(math.sqrt(within), rel=1e-4)
    assert result.between_sensors.value == pytest.approx(math.sqrt(between), rel=1e-4)
    assert result.mean == pytest.approx(np.mean(y), rel=1e-9)


def test_components_mean_and_intervals_hold_over_fleets():
    """100 fleets: z-rms of mean and sensors, coverage of 95 % intervals within its 99 % region, false outliers."""
    z, sensors, inside, outliers = [], [], [], 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        S = 3.0 * rng.standard_normal(SENSORS)
        sensor = np.repeat(np.arange(SENSORS), RUNS)
        std = 0.3 * np.exp(0.3 * rng.standard_normal(len(sensor)))
        y = 10.0 + S[sensor] + np.hypot(1.0, std) * rng.standard_normal(len(sensor))
        result = population(y, std, sensor)
        z.append((result.mean - 10.0) / result.mean_std)
        sensors.append((result.sensors - 10.0 - S) / result.sensors_std)
        inside += [c.low <= truth <= c.high for c, truth in ((result.between_sensors, 3.0), (result.run_to_run, 1.0))]
        outliers += np.any(result.outlying < OUTLYING)
    low, high = stats.binom.ppf([0.005, 0.995], len(inside), 0.95)
    rms = [float(np.sqrt(np.mean(np.square(item)))) for item in (z, sensors)]
    print(f"z-rms of the mean {rms[0]:.2f} of 100, of sensors {rms[1]:.3f} of {100 * SENSORS}; {sum(inside)} inside")
    assert low <= sum(inside) <= high
    assert stats.chi2.ppf(0.005, 100) < 100 * rms[0] ** 2 < stats.chi2.ppf(0.995, 100)
    assert 0.9 < rms[1] < 1.1
    assert outliers <= stats.binom.ppf(0.975, 100, OUTLYING)


def test_an_outlying_sensor_is_found_in_every_fleet():
    for seed in range(20):
        y, std, sensor = drawn(np.random.default_rng(seed))
        y[sensor == 7] += 25.0
        result = population(y, std, sensor)
        assert result.outlying[7] < OUTLYING
        assert np.count_nonzero(result.outlying < OUTLYING) == 1


def test_one_run_a_sensor_leaves_one_spread_and_one_sensor_is_no_fleet():
    y, std, _ = drawn(np.random.default_rng(2), runs=1)
    result = population(y, std, np.arange(SENSORS))
    assert result.run_to_run.value == 0.0
    assert result.between_sensors.value == pytest.approx(np.std(y, ddof=1), rel=0.05)
    with pytest.raises(ValueError, match="at least two"):
        population(y, std, np.zeros(SENSORS, dtype=np.intp))


def test_a_prior_shortens_a_calibration_that_is_coarser_than_the_population():
    y, std, sensor = drawn(np.random.default_rng(3), within=0.01, error=0.01)
    result = population(y, std, sensor)
    wide = result.next_run_std
    assert result.shorter(0.5 * wide) == pytest.approx(0.75)
    assert result.shorter(2.0 * wide) == 0.0
    # a normal prior and a reading of a shorter calibration give the variance of the whole one
    s, share = 0.5 * wide, 0.75
    assert 1.0 / (1.0 / wide**2 + share / s**2) == pytest.approx(s**2)


def test_the_prior_of_a_fleet_holds_for_the_next_sensor():
    """250 fleets of 20 sensors, three runs each, spread w = 1, and five further sensors from a third of a record: 1250
    intervals, 93-97 % with the truth (false alarm 0.5 %); their width is the formula's within 10 %. Twin: half that
    spread as prior covers less."""
    rng, held, twin, ratios = np.random.default_rng(61), [], [], []
    for _ in range(250):
        y, std, sensor = drawn(rng, sensors=20, runs=3, between=1.0, within=0.2, error=0.6)
        prior = population(y, std, sensor).prior
        truth = 10.0 + rng.standard_normal(5) * math.hypot(1.0, 0.2)
        u1 = 0.6 * math.sqrt(3.0)
        estimate = truth + u1 * rng.standard_normal(5)
        for spread, outcomes in ((prior.std, held), (0.5 * prior.std, twin)):
            u = 1.0 / math.sqrt(u1**-2 + spread**-2)
            posterior = u**2 * (estimate / u1**2 + prior.mean / spread**2)
            outcomes += [abs(posterior - truth) < 1.96 * u]
        ratios.append(math.sqrt((u1**-2 + prior.std**-2) / (u1**-2 + 1.0 / 1.04)))
    print(f"cover {np.mean(held):.3f} of 1250 (0.93 to 0.97), half the spread {np.mean(twin):.3f}")
    assert 0.93 <= np.mean(held) <= 0.97
    assert np.mean(twin) < 0.93
    assert np.median(ratios) == pytest.approx(1.0, abs=0.1)


def fitted_with(prior: Prior, seconds: float, k: float, seed: int) -> ac.Fit:
    rng = np.random.default_rng(seed)
    truth = {"bias": 0.05, "scale_factor": k}
    simulation = ac.simulate("interleaved", seconds=seconds, rig=CXL02_RIG, parameters=truth, rng=rng)
    return ac.fit(simulation.recording, ac.Model.linear().with_priors({"scale_factor": prior}))


def test_the_estimate_with_a_prior_is_its_weighted_mean_with_that_without():
    wide, narrow = Prior(0.0, 1.0), Prior(0.012, 1e-4)
    alone, both = (fitted_with(prior, 12.0, 0.012, 5)["scale_factor"] for prior in (wide, narrow))
    assert both.std == pytest.approx((alone.std**-2 + narrow.std**-2) ** -0.5, rel=0.02)
    expected = both.std**2 * (alone.value / alone.std**2 + narrow.mean / narrow.std**2)
    assert both.value == pytest.approx(expected, abs=0.3 * both.std)  # the fit weighs the readings anew


@pytest.mark.parametrize(("k", "message"), [(0.0121, False), (0.013, True)])
def test_a_sensor_that_is_not_of_the_type_is_said_to_be_none(k, message):
    fit = fitted_with(Prior(0.012, 1e-4), 12.0, k, 5)
    notes = [note for note in fit.remarks if note.code == "not_of_type"]
    assert bool(notes) == message
    assert not message or "scale_factor lies" in notes[0].sentence


@pytest.fixture(scope="module")
def sensors(tmp_path_factory):
    """Four sensors of five runs: the bias of s1 grows, that of s3 is elsewhere; one file of s2 is broken."""
    folder, rng = tmp_path_factory.mktemp("fleet"), np.random.default_rng(1)
    for i in range(4):
        k, b = 0.01 + 0.003 * rng.standard_normal(), 0.05 + 0.4 * (i == 3)
        (folder / f"s{i}").mkdir()
        for j in range(5):
            bias = b + 5e-4 * rng.standard_normal() + 0.02 * j * (i == 1)
            truth = {"bias": bias, "scale_factor": k}
            simulation = ac.simulate("tones", seconds=6.0, rig=CXL02_RIG, parameters=truth, rng=rng)
            side = write_recording(simulation.recording, folder / f"s{i}" / f"r{j}.csv")
            side.write_text(f"{side.read_text()}\n[run]\ndate = 2026-{j + 1:02d}-0{i + 1}\n")
    (folder / "s2" / "r4.csv").write_text("t_s,accel_g\n0,1\n")
    (folder / "s0" / "r2.html").write_text("a report")
    return folder


def run(folder, store, *options, sensors=range(4)):
    names = [str(folder / f"s{i}") for i in sensors]
    return CliRunner().invoke(app, ["fleet", *names, "--store", str(store), *options])


def test_a_fleet_is_compared_and_its_page_links_reports(sensors, tmp_path):
    page = sensors / "fleet.html"
    done = run(sensors, tmp_path / "a.sqlite", "--workers", "2", "-o", str(page), "--json")
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["populations"]["scale_factor"]["between_sensors"]["value"] > 1e-3
    assert [chart["sensor"] for chart in answer["charts"] if chart["p_value"] < 0.01] == ["s1"]
    assert [len(answer["errors"]), len(answer["files"])] == [1, 19]
    assert any("1 of 20 recordings could not be fitted" in text for text in answer["sentences"])
    text = page.read_text()
    assert 'href="s0/r2.html"' in text
    assert "bias of s1 ages" in text
    assert text.count("<tr>") > 19 + 4
    assert "http://" not in text  # opens offline
    assert "https://" not in text


def test_a_fleet_is_the_prior_of_the_next_sensor(sensors, tmp_path):
    """The command, and what cannot be a prior, by sentences."""
    written = run(sensors, tmp_path / "a.sqlite", "--json")
    assert written.exit_code == 0
    (tmp_path / "fleet.json").write_text(written.stdout)
    next_one = next(path for path in sorted(sensors.glob("*/*.csv")))
    fit = CliRunner().invoke(app, ["fit", str(next_one), "--prior", str(tmp_path / "fleet.json"), "--json"])
    assert fit.exit_code == 0, fit.output
    priors = json.loads(fit.stdout)["model"]["priors"]
    assert {"bias", "scale_factor"} <= set(priors)
    for text in ("{}", "not JSON"):
        (tmp_path / "other.json").write_text(text)
        refused = CliRunner().invoke(app, ["fit", str(next_one), "--prior", str(tmp_path / "other.json")])
        assert refused.exit_code == 2
        assert "accelcal fleet FOLDER..." in refused.output.replace("\n", " ")


def test_a_fleet_is_the_prior_of_sizes_in_a_search(tmp_path):
    """Of eight sensors whose K3 differs little; the twin, --prior none, has no second set."""
    truth, rng = {"bias": 0.05, "cubic": 1.5e-4}, np.random.default_rng(1)
    simulation = ac.simulate("interleaved", seconds=12.0, rig=CXL02_RIG, parameters=truth, rng=rng)
    side, path = write_recording(simulation.recording, tmp_path / "run.csv"), tmp_path / "fleet.json"
    side.write_text(f'{side.read_text()}\n[prior]\nodd_quadratic = "1 g/g^2"\n')
    sensor = np.arange(8)
    cubic = population(1.5e-4 + 1e-6 * rng.standard_normal(8), np.full(8, 1e-7), sensor)
    names, values = tuple(f"s{i}" for i in sensor), {"cubic": np.full(8, 1.5e-4), "cubic.std": np.full(8, 1e-7)}
    fleet = summary.Fleet(names, names, sensor, values, {"cubic": "(m/s²)⁻²"}, {"cubic": cubic}, (), {})
    path.write_text(fleet.to_json())
    model = str(tmp_path / "m.json")
    assert CliRunner().invoke(app, ["fit", str(tmp_path / "run.csv"), "-o", model]).exit_code == 0
    sets = {}
    for prior in ((), ("--prior", str(path)), ("--prior", "none")):
        done = CliRunner().invoke(app, ["diagnose", model, str(tmp_path / "run.csv"), *prior, "--json"])
        assert done.exit_code == 0, done.output
        answer = json.loads(done.stdout)
        sets[prior[-1:]] = answer["scan"]["detected"][0]["weights"], answer["sentence"]
    (sheet, text), (given, prior_text), (alone, bare) = sets.values()
    first = {name: w["by_record"] for name, w in sheet.items()}
    for other in (given, alone):
        assert {name: w["by_record"] for name, w in other.items()} == first
    assert given["cubic"]["with_sheets"] > 0.98 > 0.96 > sheet["cubic"]["with_sheets"]
    assert [given[name]["source"] for name in ("cubic", "odd_quadratic")] == ["fleet", "run.toml"]
    assert "(odd_quadratic: run.toml)" in text
    assert "(cubic: fleet, odd_quadratic: run.toml)" in prior_text
    assert {w["with_sheets"] for w in alone.values()} == {"NaN"}
    assert "data sheets" not in bare
    improved = CliRunner().invoke(app, ["improve", str(tmp_path / "run.csv"), "--prior", "none", "--json"])
    assert improved.exit_code == 0, improved.output
    assert "data sheets" not in improved.stdout


@pytest.mark.parametrize("command", [["diagnose", "m.json", "run.csv"], ["improve", "run.csv"]])
def test_what_is_no_fleet_is_refused_before_a_recording_is_read(command, sensors, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    next_one = sensors / "s0" / "r0.csv"
    model = CliRunner().invoke(app, ["fit", str(next_one), "-o", "m.json"])
    assert model.exit_code == 0, model.output
    refused = CliRunner().invoke(app, [*command, "--prior", "other.json"])
    assert refused.exit_code == 2
    assert "accelcal fleet FOLDER..." in refused.output.replace("\n", " ")


def test_workers_do_not_change_a_byte_and_nothing_is_computed_twice(sensors, tmp_path):
    two_sensors = partial(run, sensors, sensors=(2, 3))
    answer = two_sensors(tmp_path / "one.sqlite", "--json")
    two = two_sensors(tmp_path / "two.sqlite", "--workers", "2", "--json")
    assert answer.stdout == two.stdout
    again = two_sensors(tmp_path / "two.sqlite", "--json")
    assert again.stdout == two.stdout
    assert "0 recordings fitted, 10 found" in again.stderr
    with LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None) as cluster:
        dask = two_sensors(tmp_path / "dask.sqlite", "--dask", cluster.scheduler_address, "--json")
    assert dask.exit_code == 0, dask.output
    assert dask.stdout == answer.stdout


def test_a_call_that_was_killed_half_way_goes_on(sensors, tmp_path):
    files = [str(path) for i in range(4) for path in sorted((sensors / f"s{i}").glob("*.csv"))]
    whole, half = tmp_path / "whole.sqlite", tmp_path / "half.sqlite"
    campaign.run(fit_of, files, store=whole, parameters={"model": "linear"})

    def killed(done, total):
        if done == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaign.run(fit_of, files, store=half, parameters={"model": "linear"}, batch=1, progress=killed)
    count = len(campaign.load(half).items)
    assert 7 <= count < 20
    done = campaign.run(fit_of, files, store=half, parameters={"model": "linear"})
    assert (done.computed, done.stored) == (20 - count, count)
    count, again = (summarise(campaign.load(store)).to_json() for store in (half, whole))
    assert count == again
    require_published(json.loads(again))


def test_a_fleet_grows_and_tries_again_what_failed(tmp_path):
    rng = np.random.default_rng(3)
    for i in range(2):
        (tmp_path / f"s{i}").mkdir()
        for j in range(2):
            record = ac.simulate("tones", seconds=6.0, rig=CXL02_RIG, parameters={"bias": 0.05}, rng=rng)
            write_recording(record.recording, tmp_path / f"s{i}" / f"r{j}.csv")
    store, good = tmp_path / "f.sqlite", (tmp_path / "s0" / "r1.csv").read_text()
    (tmp_path / "s0" / "r1.csv").write_text("t_s,accel_g\n0,1\n")

    def call(*options):
        names = [str(tmp_path / "s0"), str(tmp_path / "s1"), "--store", str(store), "--json", *options]
        done = CliRunner().invoke(app, ["fleet", *names])
        assert done.exit_code == 0, done.output
        return done.stderr

    assert "4 recordings fitted, 0 found" in call()
    (tmp_path / "s0" / "r1.csv").write_text(good)
    write_recording(record.recording, tmp_path / "s0" / "r0b.csv")  # sorts before others
    assert "1 recordings fitted, 4 found" in call()
    assert "1 recordings fitted, 4 found" in call("--retry")
    assert "0 recordings fitted, 5 found" in (message := call())  # the twin: what has not changed is fitted once
    assert "changed" not in message

    def bias():
        stored = campaign.load(store)
        return stored.values["bias"][stored.items.index(str(tmp_path / "s1" / "r0.csv"))]

    assert bias() == pytest.approx(0.05, abs=0.02)
    simulation = ac.simulate("tones", seconds=6.0, rig=CXL02_RIG, parameters={"bias": 0.45}, rng=rng)
    side = write_recording(simulation.recording, tmp_path / "s1" / "r0.csv")
    assert f"1 recordings have changed since {store} keeps them, {tmp_path / 's1' / 'r0.csv'} first" in (
        message := call()
    )
    assert "1 recordings fitted, 4 found" in message
    assert bias() == pytest.approx(0.45, abs=0.02)
    side.write_text(f"{side.read_text()}# nothing else\n")
    assert "1 recordings fitted, 4 found" in call()
    store.write_bytes(b"")  # as a kill leaves it that came before the first transaction
    assert "5 recordings fitted, 0 found" in call()


def test_the_runs_of_one_sensor_have_limits_of_their_own():
    rng = np.random.default_rng(4)
    y = 0.05 + 0.01 * rng.standard_normal(200)
    assert moving_range(y) == pytest.approx(0.01, rel=0.15)


def test_large_fleets_have_intervals():
    y, std, sensor = drawn(np.random.default_rng(6), sensors=3000)
    result = population(y, std, sensor)
    assert result.run_to_run.low < 1.0 < result.run_to_run.high
    assert result.run_to_run.high - result.run_to_run.low == pytest.approx(2.0 * 1.96 / math.sqrt(2.0 * 9000), rel=0.15)
    assert result.between_sensors.low < 3.0 < result.between_sensors.high


def test_what_cannot_be_a_fleet_is_refused(sensors, tmp_path):
    def message(*names):
        done = CliRunner().invoke(app, ["fleet", *map(str, names), "--store", str(tmp_path / "x.sqlite")])
        assert done.exit_code != 0
        return done.stderr

    assert "expected a folder with the recordings of one sensor" in message(sensors / "s0" / "r0.csv")
    (tmp_path / "s0").mkdir()
    assert "have one name" in message(sensors / "s0", tmp_path / "s0")
    assert "no recording in it" in message(tmp_path / "s0")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "a.csv").write_text("t_s,accel_g\n0,1\n")
    assert "no recording of the fleet could be fitted" in message(tmp_path / "bad")


def test_a_sensor_that_does_not_age_is_not_said_to(sensors):
    """Slopes of 200 charts of chance alone, at a stated rate of 1 % of campaigns of ten."""
    from accelcal.fleet.summary import chart, corrected

    rng, false = np.random.default_rng(5), 0
    for _ in range(60):
        days = np.sort(rng.uniform(0.0, 400.0, 6))
        charts = [
            chart(f"s{k}", "bias", days, 2e-3 * rng.standard_normal(6), np.full(6, 1e-4), 2e-3) for k in range(10)
        ]
        false += any(corrected(figure, 10).p_value < AGEING_ALPHA for figure in charts)
    print(f"{false} of 60 campaigns of ten sensors say that one ages ({AGEING_ALPHA:g} stated)")
    assert false <= stats.binom.ppf(0.975, 60, AGEING_ALPHA)
    assert set(summary.MODELS) == {"linear", "cubic"}
    assert replace(charts[0], p_value=0.0).ages
