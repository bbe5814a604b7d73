"""Models with effects that a `LiveFilter` does not have, on a stream: what runs, what is held, and what it finds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.calibration.export import filter_files, live_filter
from accelcal.data import DERIVED, RecordingError
from accelcal.data.rig import Rig, Sensor
from accelcal.effects import BUILT_IN, find
from accelcal.estimation.estimate import Fit
from accelcal.filters.live_model import state_names
from accelcal.filters.stream import Readings
from accelcal.io.stream import Rows
from accelcal.live.tracker import LiveSettings, ModelTracker, Tracker, running, settings_of
from accelcal.model import Estimate, Model, Prior
from accelcal.simulation import ADXL105_RIG
from tests.commands import accelcal
from tests.docs.pages import DOCS
from tests.docs.printed import with_printed
from tests.filters.test_live import SMALL, model_with, small_record
from tests.live.streams import BIAS, NOISE, RATE, RESOLUTION, RIG, SCALE, stream

STREAM_RIG = Rig(Sensor(noise=NOISE), resolution=RESOLUTION)


def settings_with(model: Model, rig: Rig = STREAM_RIG) -> LiveSettings:
    """A model as of a fit to little data."""
    names = state_names(model)
    wide = {name: find(name.split(".")[0]).prior.typical * 5.0 for name in names}
    spread = np.diag([(model.priors[name].std if name in model.priors else wide[name]) ** 2 for name in names])
    return replace(settings_of(rig), model=model, spread=spread)


def fed(tracker: Tracker, rows: Rows, seed: int = 1) -> np.ndarray:
    """Fed in pieces of random length."""
    rng, readings, i = np.random.default_rng(seed), list[Readings](), 0
    while i < len(rows):
        j = i + int(rng.integers(1, 60))
        side = {name: y[i:j] for name, y in rows.side.items()}
        readings.append(tracker.feed(Rows(rows.t[i:j], rows.accel[i:j], rows.position[i:j], side)))
        i = j
    readings.append(tracker.finish())
    return np.concatenate([of.table[:, [0, 2, 3]] for of in readings]).T


def test_nine_in_ten_effects_run_everywhere_and_the_rest_has_a_reason() -> None:
    for place in ("LiveModel", "live", "export"):
        of_axis = [effect for effect in BUILT_IN if not set(effect.needs) & set(DERIVED)]
        answers = {effect.name: running(effect, place) for effect in of_axis}
        runs = sum(answer.how == "runs" for answer in answers.values())
        rest = {name: answer for name, answer in answers.items() if answer.how != "runs"}
        print(f"{place}: {runs} of {len(of_axis)} run, at least 90 %; {rest}")
        assert runs >= 0.9 * len(of_axis)
        assert all(answer.reason for answer in rest.values())


def test_what_a_memory_holds_at_first_is_left_to_the_record_in_code() -> None:
    assert [running(find(name), "export").how for name in ("creep", "ac_coupling")] == ["runs", "runs"]


def test_the_page_says_what_becomes_of_each_effect() -> None:
    page = (DOCS / "live.md").read_text(encoding="utf-8")
    assert with_printed("live.md", page) == page, "run make pages"
    assert with_printed("live.md", page.replace("| creep |", "| crept |")) == page


@pytest.mark.parametrize("name", [effect.name for effect in BUILT_IN if running(effect, "live").how == "runs"])
def test_what_is_said_to_run_on_a_stream_runs_and_its_estimate_moves(name: str) -> None:
    effect = find(name)
    tracker = ModelTracker(settings_with(model_with(name)))
    before = {e.name: e for e in tracker.estimates}
    u, z, side = small_record(effect.needs)
    innovations = fed(tracker, Rows(np.arange(len(u)) / SMALL, u, z, side))
    assert tracker.refused == 0, tracker.refusal
    assert innovations.shape[1] > 0.9 * len(u)
    assert np.all(np.isfinite([(e.value, e.std) for e in tracker.estimates]))
    tracked = [e for e in tracker.estimates if e.name.split(".")[0] == name]
    assert bool(tracked) == (effect.port != "noise")
    moved = [before[e.name].value != e.value for e in tracked]
    assert all(moved) if effect.width == 1 else any(moved) or not tracked


@pytest.mark.parametrize("offset", [0.0, 0.9e-3, -1.6e-3])
@pytest.mark.parametrize("apart", [0.0, 1.3e-4], ids=["one row", "rows of their own"])
def test_an_effect_is_found_on_a_stream_of_any_stamps(offset: float, apart: float) -> None:
    """Lost rows, jitter of the stamps, readings between outputs, outputs that are late; and a wave of the encoder."""
    samples, rng = stream(12.0, seed=5), np.random.default_rng(3)
    jittered = samples.t + 5e-5 * rng.standard_normal(len(samples.t))
    tones = ((2.0, 12.0), (5.0, 31.0))
    a = sum(size * np.sin(w * jittered) for size, w in tones)
    u = BIAS + (1.0 + SCALE) * a + NOISE * np.sqrt(RATE / 2.0) * rng.standard_normal(len(a))
    read = samples.t[::2] + apart
    p = -sum(size / w**2 * np.sin(w * read) for size, w in tones)
    z = p + RESOLUTION * (rng.random(len(p)) - 0.5) + 3e-6 * np.sin(2.0 * np.pi * p / 2e-3)
    t = np.concatenate([jittered + offset, read])
    none = np.full(len(t), np.nan)
    rows = np.stack([t, none, none])
    rows[1, : len(u)], rows[2, len(u) :] = u, z
    rows = rows[:, np.argsort(t)][:, rng.random(len(t)) > 0.02]
    model = Model.linear().freeze(time_offset=0.0).add("encoder_cyclic", shapes={"encoder_cyclic": {"period": 2e-3}})
    tracker = ModelTracker(replace(settings_with(model), offset=offset))
    innovations = fed(tracker, Rows(*rows))
    results = {e.name: e for e in tracker.estimates}
    truth = {"bias": BIAS, "scale_factor": SCALE, "encoder_cyclic.sin": 3e-6, "encoder_cyclic.cos": 0.0}
    errors = {name: (results[name].value - value) / results[name].std for name, value in truth.items()}
    nis = float(np.mean(innovations[1, 200:] ** 2 / innovations[2, 200:]))
    print(f"offset {offset:g}, apart {apart:g}: errors {errors}, NIS {nis:.3f}, {tracker.refused} refused")
    assert tracker.refused == 0
    assert max(map(abs, errors.values())) < 5.0
    assert 0.8 < nis < 1.3


def test_a_hole_begins_the_motion_anew_and_keeps_the_coefficients() -> None:
    samples = stream(12.0, seed=6)
    there = (samples.t < 5.0) | (samples.t > 6.3)
    model = Model.linear().freeze(time_offset=0.0).add("velocity")
    tracker = ModelTracker(settings_with(model))
    innovations = fed(tracker, Rows(samples.t[there], samples.u[there], samples.z[there]))
    t, e, variance = innovations
    behind = e[t > 6.4] / np.sqrt(variance[t > 6.4])
    assert tracker.refused == 0
    assert np.mean(np.square(behind)) < 1.3
    results = {e.name: e for e in tracker.estimates}
    for name, truth in {"bias": BIAS, "scale_factor": SCALE}.items():
        assert abs(results[name].value - truth) < 5.0 * results[name].std, (results[name], truth)


def test_behind_an_output_that_is_refused_innovations_are_as_expected() -> None:
    samples = stream(6.0, seed=9)
    u = samples.u.copy()
    u[6001:6009] = 1e8  # one alone is left out before the filter
    tracker = ModelTracker(settings_with(Model.linear().freeze(time_offset=0.0).add("velocity")))
    t, e, variance = fed(tracker, Rows(samples.t, u, samples.z))
    behind = t > samples.t[6001]
    nis = float(np.mean(e[behind] ** 2 / variance[behind]))
    print(f"{tracker.refused} refused, {behind.sum()} readings behind it, NIS {nis:.3f}, at most 1.3")
    assert tracker.refused > 0
    assert behind.sum() > 2900
    assert nis < 1.3


def test_readings_without_an_output_do_not_pile_up() -> None:
    samples = stream(8.0, seed=4)
    none = np.full_like(samples.t, np.nan)
    for first in (0, 20):
        u = np.where((np.arange(len(samples.t)) < first) | (samples.t >= 4.0), samples.u, none)
        temperature = np.where(np.arange(len(samples.t)) % 10 == 0, 25.0, none)
        tracker, most = ModelTracker(settings_with(model_with("temperature_bias"))), 0
        for rows in np.array_split(np.stack([samples.t, u, samples.z, temperature], axis=1), 200):
            tracker.feed(Rows(*rows.T[:3], {"temperature": rows[:, 3]}))
            most = max(most, len(tracker._ahead), len(tracker._readings))
        tracker.finish()
        print(f"{first} outputs first: at most {most} events wait")
        assert most < 400
        assert tracker.refused == 0
        assert tracker.readings == np.isfinite(samples.z).sum()
        assert tracker.outputs == np.isfinite(u).sum()


@pytest.fixture(scope="module")
def cubic() -> Fit:
    truth = {"bias": 0.05, "scale_factor": 0.01, "cubic": 1e-3}
    simulation = ac.simulate("tones", seconds=10.0, rig=ADXL105_RIG, parameters=truth, rng=np.random.default_rng(1))
    return ac.fit(simulation.recording, ac.Model.linear().add("cubic"))


def test_nothing_is_shown_that_is_not_estimated(cubic: Fit) -> None:
    tracker = Tracker(settings_of(cubic.rig, cubic))
    assert [e.name for e in tracker.estimates] == ["scale_factor", "bias", "cubic"]
    assert all(e.std > 0.0 for e in tracker.estimates)


def with_effects(fit: Fit, model: Model) -> Fit:
    """A fit as another model would have it, its coefficients of typical size."""
    added = [term for term in model.terms if term.effect.name not in fit.model.effects]
    sizes = [t.effect.prior.typical for t in added]
    new = tuple(Estimate(t.name, t.symbol, t.unit, c, 0.1 * c, t.owner) for t, c in zip(added, sizes, strict=True))
    n, m = len(fit.free), len(new)
    covariance = np.zeros((n + m, n + m))
    covariance[:n, :n], covariance[n:, n:] = fit.covariance, np.diag([e.std**2 for e in new])
    return replace(fit, model=model, estimates=(*fit.estimates, *new), covariance=covariance)


def test_what_there_is_no_room_for_is_held_and_subtracted(cubic: Fit) -> None:
    curves = ("shape_of_position", "shape_of_velocity")
    model = cubic.model.add(*curves, shapes={name: {"low": -1.0, "high": 1.0} for name in curves})
    settings = settings_of(cubic.rig, with_effects(cubic, model))
    assert settings.model is not None
    assert len(state_names(settings.model)) <= 16
    held = set(settings.model.fixed) - {"time_offset"}
    assert len(held) == find(curves[0]).width
    assert all(settings.model.fixed[name] == find(curves[0]).prior.typical for name in held)
    assert "held at the fitted value, and what it adds is subtracted" in settings.remarks[-1]


def test_a_column_that_the_model_holds_stays_where_it_is(cubic: Fit) -> None:
    curves = ("shape_of_position", "shape_of_velocity")
    model = cubic.model.add(*curves, shapes={name: {"low": -1.0, "high": 1.0} for name in curves})
    fitted = with_effects(cubic, model)
    given = {f"{curves[0]}.p1": 0.03, f"{curves[1]}.p1": 0.04}
    free = [i for i, e in enumerate(fitted.free) if e.name not in given]
    frozen = replace(fitted, model=model.freeze(**given), covariance=fitted.covariance[np.ix_(free, free)])
    settings = settings_of(cubic.rig, frozen)
    assert settings.model is not None
    assert settings.model.fixed.items() >= given.items()
    assert len(settings.model.fixed) > len(given) + 1


def test_what_belongs_to_one_record_and_has_no_room_is_said_to_be_held_at_zero(cubic: Fit) -> None:
    curves = ("shape_of_time", "shape_of_velocity")
    model = cubic.model.add(
        *curves, shapes={curves[0]: {"start": 0.0, "length": 10.0}, curves[1]: {"low": -1.0, "high": 1.0}}
    )
    settings = settings_of(cubic.rig, with_effects(cubic, model))
    assert settings.model is not None
    held = {name for name in settings.model.fixed if name.startswith(curves[0])}
    assert held
    assert {settings.model.fixed[name] for name in held} == {0.0}
    remarks = [text for text in settings.remarks if text.startswith(curves[0])]
    assert len(remarks) == 1
    assert "held at zero, as its clock is that of the fitted record" in remarks[0]


def test_more_processes_than_there_is_room_for_are_refused(cubic: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("accelcal.live.tracker.MOST_EFFECTS", 0)
    model = cubic.model.add("bias_random_walk", shapes={"bias_random_walk": {"start": 0.0, "length": 10.0}})
    priors = {term.name: Prior(0.0, 1e-3) for term in model.terms if term.effect.port == "process"}
    with pytest.raises(RecordingError, match="more random processes, none of which can be held"):
        settings_of(cubic.rig, with_effects(cubic, replace(model, priors={**model.priors, **priors})))


def test_a_memory_is_said_to_begin_as_after_a_long_rest(cubic: Fit) -> None:
    model = cubic.model.add("creep", shapes={"creep": {"tau": 2.0, "start": 1.0}})
    settings = settings_of(cubic.rig, with_effects(cubic, model))
    assert settings.remarks[-1] == "creep: begins on this recording as after a long rest"


def test_what_belongs_to_the_fitted_record_is_estimated_anew(cubic: Fit) -> None:
    model = cubic.model.add("bias_step", shapes={"bias_step": {"instant": 4.0}})
    fitted = with_effects(cubic, model)
    settings = settings_of(cubic.rig, fitted)
    assert settings.model is not None
    assert settings.model.priors["bias_step"] == Prior(0.0, find("bias_step").prior.scale)
    assert settings.remarks[0].startswith("bias_step: its clock is that of the fitted record")
    tracker = ModelTracker(settings)
    samples = stream(3.0)
    fed(tracker, Rows(samples.t, samples.u, samples.z))
    saved = tracker.fitted(fitted)
    assert saved["bias_step"] == fitted["bias_step"]
    assert saved["bias"] != fitted["bias"]
    assert np.all(np.linalg.eigvalsh(saved.covariance) > 0.0)


@pytest.mark.parametrize(("name", "start"), [("bias_gauss_markov", 1e-3), ("bias_random_walk", 0.0)])
def test_a_process_starts_as_wide_as_it_is(cubic: Fit, name: str, start: float) -> None:
    shape = {"start": 0.0, "length": 10.0} | ({"tau": 3.0} if start else {})
    model = cubic.model.add(name, shapes={name: shape})
    std = {term.name: Prior(0.0, 1e-3) for term in model.terms if term.effect.name == name}
    tracker = ModelTracker(settings_of(cubic.rig, with_effects(cubic, replace(model, priors={**model.priors, **std}))))
    assert {e.name: e.std for e in tracker.estimates}.get(name, 0.0) == pytest.approx(start)


def test_an_exported_filter_begins_like_a_live_one(cubic: Fit) -> None:
    model = cubic.model.add("bias_step", "velocity", "lowpass_error", shapes={"bias_step": {"instant": 4.0}})
    fitted = with_effects(cubic, model)
    tracker = ModelTracker(settings_of(cubic.rig, fitted))
    begun, exported = tracker._begun(1000.0, 0.0), live_filter(fitted, 1000.0)
    assert exported.settings["q"] == pytest.approx(cubic.noise().usual.q * (1.0 + cubic["scale_factor"].value) ** 2)
    assert exported.settings["q"] == begun.settings["q"]
    declared = 0.0 if cubic.rig.lowpass is None else cubic.rig.lowpass.tau
    assert exported.settings["tau"] == pytest.approx(declared + find("lowpass_error").prior.scale)
    assert exported.settings["tau"] == begun.settings["tau"]
    assert set(exported.names) == {*begun.names, "time_offset"}
    here = [exported.names.index(name) for name in begun.names]
    np.testing.assert_array_equal(exported.values[here], begun.values)
    np.testing.assert_allclose(exported.covariance[np.ix_(here, here)], begun.covariance, rtol=1e-9)
    assert exported["bias_step"].value == 0.0
    assert exported["velocity"].value == find("velocity").prior.scale
    assert exported._signals.origins == begun._signals.origins
    text = " ".join(filter_files(exported, "cal", "c", "f64")["cal.h"].replace("\n *", " ").split())
    assert "Of one record, estimated anew on the device: bias_step." in text


def test_what_no_stream_brings_is_refused_by_name(cubic: Fit) -> None:
    with pytest.raises(
        RecordingError, match="gyroscope_tilt cannot run on a stream: its channels follow from an orien"
    ):
        settings_of(cubic.rig, with_effects(cubic, cubic.model.add("gyroscope_tilt")))


@pytest.fixture
def warm(tmp_path: Path) -> Path:
    """Two recordings with temperature, and a sidecar that declares one channel that no model needs."""
    for seed, name in ((1, "one"), (2, "two")):
        samples, rng = stream(20.0, seed=seed), np.random.default_rng(seed)
        T = 25.0 + 4.0 * np.sin(0.5 * samples.t + seed)
        u = samples.u + 0.02 * (T - 25.0)
        rows = zip(
            samples.t, u, samples.z, T + 1e-3 * rng.standard_normal(len(T)), rng.standard_normal(len(T)), strict=True
        )
        lines = (f"{t!r},{u!r},{'' if z != z else repr(1e3 * z)},{T!r},{y!r}" for t, u, z, T, y in map(list, rows))
        lines = (line.replace("np.float64(", "").replace(")", "") for line in lines)
        (tmp_path / f"{name}.csv").write_text("\n".join(["t,accel,position,T,supply", *lines]) + "\n")
        more = 'temperature = { column = "T", unit = "degC" }\nsupply = { column = "supply", unit = "V" }\n'
        (tmp_path / f"{name}.toml").write_text(RIG + more)
    return tmp_path


def test_the_sidecar_of_a_recording_and_a_model_with_temperature_are_followed(warm: Path) -> None:
    accelcal("fit", "one.csv", "-o", "m.json", cwd=warm, check=True)
    accelcal("add", "m.json", "one.csv", "--effect", "temperature_bias", "-o", "T.json", cwd=warm, check=True)
    words = (
        "live",
        "--file",
        "two.csv",
        "--rig",
        "two.toml",
        "--model",
        "T.json",
        "--save",
        "T2.json",
        "-o",
        "got.parquet",
    )
    followed = accelcal(*words, cwd=warm)
    assert followed.returncode == 0, followed.stderr
    assert "two.toml: supply: not needed by a live view, left out" in followed.stderr
    assert " 0 ± 0" not in followed.stdout
    before, after = (ac.load_model(warm / name)["temperature_bias"] for name in ("T.json", "T2.json"))
    assert after.std < 0.9 * before.std
    assert abs(after.value - 0.02) < 5.0 * after.std
    recording = ac.load(warm / "got.parquet")
    assert recording.side["temperature"].unit == "degC"
    assert len(recording.accel) == len(recording.side["temperature"])
    plain = accelcal("live", "--file", "two.csv", "--rig", "two.toml", cwd=warm)
    assert plain.returncode == 0, plain.stderr
    assert "two.toml: temperature, supply: not needed by a live view, left out" in plain.stderr
