"""Mechanisms: columns in closed form, names by pattern, told from processes, stored, tracked live, drawn as paths."""

import itertools
import json
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

import accelcal as ac
from accelcal.diagnosis.findings import Confounded, chosen, in_model
from accelcal.effects import BUILT_IN, CATALOGUE, find, from_expression, side_channel, side_channels, spelled
from accelcal.effects.mechanisms import AMPLITUDES, CARRIERS, DRIVERS, channel_of, mechanisms_of, memory
from accelcal.filters.live_model import LiveModel
from accelcal.model import Model
from accelcal.plots.signature import typical_shape
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG
from benches.mechanisms import BEFORE, OVER, RATE, scene, write

from .motions import moves, sines

SAG, TAU = -0.02, 0.4
NAME = "scale_factor_follows_abs_a"
SOME = 30_000
"""Samples that are followed live."""


def recorded(folder, law, seed):
    """A record of the bench's rig with an addition to the output."""
    rng = np.random.default_rng(seed)
    s = scene(rng)
    return ac.load(write(s, law(s), rng, folder / f"{seed}.csv"))


def sagging(s):
    return SAG * s.a * s.memory(np.abs(s.a), TAU)


@pytest.mark.parametrize("driver", ["abs_a", "a2", "abs_v", "v2"])
def test_a_memory_is_the_product_when_short_and_the_integral_when_long(driver):
    s = moves()  # begins at rest
    effect, h = find(f"velocity_follows_{driver}"), DRIVERS[driver].of(s)
    short = effect.column(s, tau=1e-6, start=0.0)
    np.testing.assert_allclose(short, s.v * h, atol=1e-3 * np.max(np.abs(s.v * h)))
    tau = 1e6
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (h[1:] + h[:-1]))]) * s.step / tau
    np.testing.assert_allclose(memory(s, DRIVERS[driver], tau), integral, atol=1e-4 * integral[-1])


def test_a_memory_begins_at_rest_or_at_the_mean_or_where_a_channel_begins():
    resting, moving = moves(), sines()
    assert memory(resting, DRIVERS["abs_a"], 3.0)[0] == 0.0
    assert memory(moving, DRIVERS["abs_a"], 30.0)[0] == pytest.approx(float(np.mean(np.abs(moving.a))))
    warm = replace(moving, side={"temperature": 20.0 + 0.1 * moving.t})
    u, decay = memory(warm, DRIVERS["temperature"], 3.0), np.exp(-moving.t / 3.0)
    np.testing.assert_allclose(u, warm.temperature - 0.3 * (1.0 - decay), atol=1e-6)  # 0.1 K/s lags by 3 s
    np.testing.assert_allclose(memory(warm, DRIVERS["temperature"], 3.0, 1.0) - u, decay, atol=1e-6)


def test_every_carrier_follows_every_driver_and_channel():
    side_channel("supply", "V")
    s = sines(n=2000, side={"temperature": np.linspace(0.0, 1.0, 2000), "supply": np.ones(2000)})
    for carrier in (*CARRIERS, "encoder_scale", "cubic"):
        for driver in (*DRIVERS, "supply"):
            effect = find(f"{carrier}_follows_{driver}")
            assert effect.column(s, tau=0.5, start=0.0).shape == s.t.shape
            assert effect.port == find(carrier).port
            assert effect.card.count("\n") > 4
    assert find("time_offset_follows_supply").unit == "s/V"
    assert find("bias_follows_a2") is find("self_heating")
    assert spelled("scale_factor_follows_abs_a.tau") == "scale factor follows |a|.tau"
    for wrong in (
        "bias_follows_nothing",
        "nothing_follows_a2",
        "creep_follows_a2",
        "hysteresis_follows_a2_follows_a2",
    ):
        with pytest.raises(ValueError, match=r"no effect|time constant"):
            find(wrong)


MEMBERS = json.loads((Path(__file__).parent / "members.json").read_text(encoding="utf-8"))
"""A model file and rows of effects, written while each of them was a function of its own."""


def with_supply(n=600):
    s = sines(n=n)
    return replace(s, side={**s.side, "supply": 5.0 + np.sin(0.3 * s.t)})


def test_a_model_that_was_stored_while_members_were_functions_gives_the_same_numbers():
    fit, s = model_file.from_dict(MEMBERS["model"]), with_supply()
    held = {name: value for name, value in fit.model.fixed.items() if "." not in name}
    assert len(held) == 24
    assert set(held) <= set(MEMBERS["rows"])
    again = model_file.to_dict(fit)
    for part in ("model", "stands_for"):
        assert again[part] == MEMBERS["model"][part]
    for part in ("estimates", "shapes"):  # stored before a sensor had axes
        assert again[part] == [{**e, "axis": ""} for e in MEMBERS["model"][part]]
    sizes = {estimate["name"]: estimate for estimate in MEMBERS["model"]["estimates"]}
    for name, row in MEMBERS["rows"].items():
        effect, shape = find(name), MEMBERS["shapes"].get(name, {})
        y = effect.column(s, **shape)
        y = y if effect.width == 1 else y @ np.arange(1.0, effect.width + 1.0)
        np.testing.assert_allclose(y[::60], row, rtol=1e-12, atol=1e-12 * np.max(np.abs(row)), err_msg=name)
        if name in held:
            declared = effect.name, effect.symbol, effect.unit, effect.owner
            assert declared == tuple(sizes[name][key] for key in ("name", "symbol", "unit", "owner"))
            assert fit.model.shapes.get(name, {}) == shape


@pytest.mark.parametrize("name", ["supply", "position", "velocity", "t"])
def test_a_channel_that_is_called_as_a_variable_of_the_motion_stays_a_channel(name):
    with CATALOGUE.apart():
        model = Model.linear().add(side_channel(name, "V").name, side_channel(name, "V", "scale_factor").name)
        assert {channel.channel for channel in model.side_channels.values()} == {name}
        assert {channel.of for channel in model.side_channels.values()} == {"output", "scale_factor"}
        assert [
            channel_of(find(built_in)) for built_in in ("rail_slope", "bias_drift", "temperature_bias", "cross_axis")
        ] == [""] * 4
        assert (find(f"bias_follows_{name}").needs == ()) == (name == "position")


def duplicates(effects, s):
    """Pairs of effects that say the same of a motion, up to a factor."""
    columns = {effect.name: effect.column(s, **typical_shape(effect, s)) for effect in effects}
    units = {name: y / np.linalg.norm(y) for name, y in columns.items() if np.any(y)}
    pairs = itertools.combinations(units, 2)
    return [(a, b) for a, b in pairs if abs(float(units[a] @ units[b])) > 1.0 - 1e-9]


def test_no_member_is_tried_under_two_names():
    s, channels = with_supply(6000), side_channels([("supply", "V")])
    offered = [*BUILT_IN, *channels, *(e for e in mechanisms_of(CARRIERS, s.side) if e not in BUILT_IN)]
    output = [e for e in offered if e.port == "output" and e.width == 1 and e.traits.visible]
    assert len(output) > 70
    assert len({e.name for e in offered}) == len(offered)
    assert duplicates(output, s) == []
    twin = replace(find("bias"), name="temperature_by_another_name", function=lambda s: 2.0 * s.temperature)
    assert duplicates([*output, twin], s) == [("temperature_bias", "temperature_by_another_name")]


@pytest.fixture(scope="module")
def sag(tmp_path_factory):
    run = recorded(tmp_path_factory.mktemp("sag"), sagging, 3)
    return run, ac.fit(run)


def test_a_supply_that_sags_is_a_mechanism_and_not_a_process(sag):
    run, fit = sag
    diagnosis = ac.diagnose(fit, run)
    assert NAME in diagnosis.effects
    assert diagnosis.effects[-1] == NAME
    assert diagnosis.verdict == "named"  # amplitudes span more than a factor of two: no other driver is as good
    grown = ac.add(fit, run, NAME)
    by_name = {e.name: e for e in (*grown.estimates, *grown.shapes)}
    assert abs(by_name[NAME].value - SAG) < 4.0 * by_name[NAME].std < 0.2 * abs(SAG)
    assert abs(by_name[f"{NAME}.tau"].value - TAU) < 4.0 * by_name[f"{NAME}.tau"].std < 0.5 * TAU
    assert ac.diagnose(grown, run).effects == ("time_offset",)


def test_a_process_is_no_cause_and_nothing_on_an_honest_record(tmp_path):
    honest = recorded(tmp_path, lambda s: 0.0 * s.a, 5)
    assert [name for name in ac.diagnose(ac.fit(honest), honest).effects if "follows" in name] == []
    run, _ = with_process(tmp_path)
    diagnosis = ac.diagnose(ac.fit(run), run)
    assert find(diagnosis.effects[-1]).traits.changes == "scale_factor"
    assert "That is no cause: scale_factor varies by" in diagnosis.sentence
    assert "no recorded quantity explains it" in diagnosis.sentence


def with_process(folder):
    """A record whose scale factor is a Gauss-Markov process of 1.5 s, and that scale factor over t."""
    paths = {}

    def varying(s):
        keep = np.exp(-s.step / 1.5)
        shocks = np.random.default_rng(8).standard_normal(len(s.t)) * np.sqrt(1.0 - keep**2)
        path = 6e-3 * lfilter([1.0], [1.0, -keep], shocks)
        paths.update(t=s.t - BEFORE, value=0.004 + path)
        return s.a * path

    return recorded(folder, varying, 6), paths


def test_the_band_of_a_path_holds_what_is_faster_than_the_cosines(tmp_path):
    run, truth = with_process(tmp_path)
    grown = ac.add(ac.fit(run), run, "scale_gauss_markov")
    (path,) = grown.paths(run)
    away = path.value - np.interp(path.t, truth["t"], truth["value"])
    # some 40 correlation times: a share of 0.95 has a standard deviation of 0.035, false alarm below 1 in 300
    assert np.mean(np.abs(away) < 1.96 * path.std) > 0.85
    finding = in_model(grown, Confounded("scale_gauss_markov", ("scale_gauss_markov",), ""), {})
    assert "no cause: scale_factor varies by 0.00" in finding.particulars  # in a model it is none either


def test_the_path_of_a_process_ranks_what_it_follows(sag):
    run, fit = sag
    (path,) = ac.add(fit, run, "scale_gauss_markov").paths(run)
    assert path.coefficient == "scale_factor"
    assert path.followers[0].mechanism in (NAME, "scale_factor_follows_a2")
    assert path.followers[0].share > 0.7 > path.followers[-1].share
    assert "scale factor follows |a|" in str(path)
    (message,) = ac.add(fit, run, NAME).paths(run)
    assert message.followers == ()
    assert message.itself == pytest.approx(0.004, abs=5e-4)
    assert np.mean(message.value) < 0.0 < message.itself  # the mean of this run is another one
    assert list(path.to_dataframe().columns)[:2] == ["value", "std"]
    assert "scale_factor_follows_v2" in path.to_xarray()
    assert fit.paths(run) == ()


def steady(rng):
    """The scene with one tone of one amplitude."""
    s = scene(rng)
    p = 0.01 * np.sin(2.0 * np.pi * 1.7 * s.t + rng.uniform(0.0, 6.28))
    v = np.gradient(p, s.step)
    return replace(s, p=p, v=v, a=np.gradient(v, s.step))


def test_one_amplitude_throughout_ties_drivers_and_the_run_that_separates_them_is_named(tmp_path):
    rng = np.random.default_rng(71_300)
    s = steady(rng)
    run = ac.load(write(s, 3.0 * SAG * s.a * s.memory(np.abs(s.a), TAU), rng, tmp_path / "steady.csv"))
    diagnosis = ac.diagnose(ac.fit(run), run)  # the ripple within a period shows that something follows the motion
    assert diagnosis.verdict == "tied"
    assert {NAME, "scale_factor_follows_a2"} <= set(diagnosis.classes[-1].members)
    assert AMPLITUDES in diagnosis.sentence


def test_a_memory_longer_than_a_period_of_one_amplitude_is_all_of_the_coefficient(tmp_path):
    for seed in (71_301, 71_302):
        rng = np.random.default_rng(seed)
        s = steady(rng)
        run = ac.load(write(s, SAG * s.a * s.memory(np.abs(s.a), 10.0 * TAU), rng, tmp_path / "steady.csv"))
        fit = ac.add(ac.fit(run), run, NAME)
        (note,) = (note for note in fit.remarks if note.code == "barely_shown")
        assert AMPLITUDES in note.sentence
        (mean,), rest = fit.at_mean, fit["scale_factor"]
        assert abs(mean.value - (0.004 + SAG * 2.0 / np.pi * np.max(np.abs(s.a)))) < 4.0 * mean.std
        assert abs(rest.value - 0.004) < 4.0 * rest.std
        assert rest.std > 100.0 * mean.std  # the one is known, the other is not


def test_a_mechanism_takes_the_place_of_the_process_of_its_coefficient_alone(sag):
    run, fit = sag
    random = ac.add(fit, run, "scale_gauss_markov", "bias_random_walk")
    grown = ac.add(random, run, NAME)
    assert grown.model.added == ("bias_random_walk", NAME)
    (sentence,) = (remark.sentence for remark in grown.remarks if remark.code == "replaced")
    assert sentence == f"scale_gauss_markov was taken out: {NAME} explains what it did"
    straight = ac.add(fit, run, "bias_random_walk", NAME)
    for name in ("scale_factor", NAME, f"{NAME}.tau"):
        assert abs(grown[name].value - straight[name].value) < 0.3 * straight[name].std
    assert ac.add(fit, run, "scale_gauss_markov", NAME).model.added == (
        "scale_gauss_markov",
        NAME,
    )  # both are asked for


def unsteady_bias(s):
    """A bias that is a random process and follows nothing."""
    keep = np.exp(-s.step / 5.0)
    shocks = np.random.default_rng(81).standard_normal(len(s.t)) * np.sqrt(1.0 - keep**2)
    return 2e-3 * lfilter([1.0], [1.0, -keep], shocks)


def test_a_true_process_stays_beside_a_mechanism_that_does_not_explain_it(tmp_path):
    run = recorded(tmp_path, unsteady_bias, 82)
    random = ac.add(ac.fit(run), run, "bias_gauss_markov")
    both = ac.add(random, run, "bias_follows_abs_v")
    assert both.model.added == ("bias_gauss_markov", "bias_follows_abs_v")
    assert "replaced" not in {remark.code for remark in both.remarks}


def test_a_process_with_nothing_to_do_beside_another_has_a_remark(tmp_path):
    run = recorded(tmp_path, unsteady_bias, 83)
    both = ac.add(ac.fit(run), run, "bias_gauss_markov", "scale_random_walk")
    idle = [remark.values["effect"] for remark in both.remarks if remark.code == "beside_others"]
    assert idle == ["scale_random_walk"]


RECORDS = 8
"""Records whose z is judged by the exact 99 % interval of its rms: false alarms 1 in 100 for each quantity."""


def test_a_coefficient_at_rest_and_at_the_mean_of_the_run_are_estimated_with_their_joint_uncertainty(tmp_path):
    low, high = (float(np.sqrt(chi2.ppf(p, RECORDS) / RECORDS)) for p in (0.005, 0.995))
    z = np.empty((RECORDS, 3))
    for row, seed in zip(z, range(51_700, 51_700 + RECORDS), strict=True):
        rng = np.random.default_rng(seed)
        s = scene(rng)
        u = s.memory(np.abs(s.a), TAU)
        run = ac.load(write(s, SAG * s.a * u, rng, tmp_path / "run.csv"))
        fit = ac.add(ac.fit(run), run, NAME)
        rest, c, (mean,) = fit["scale_factor"], fit[NAME], fit.at_mean
        off = mean.value - (0.004 + SAG * float(np.mean(u[int(BEFORE * RATE) * OVER :])))
        apart = np.hypot(rest.std, c.std * (mean.value - rest.value) / c.value)  # as if nothing was correlated
        row[:] = (rest.value - 0.004) / rest.std, off / mean.std, off / apart
    rest_rms, mean_rms, twin = np.sqrt(np.mean(z**2, axis=0))
    print(f"rms z at rest {rest_rms:.2f}, at the mean {mean_rms:.2f} of {low:.2f}-{high:.2f}; uncorrelated {twin:.2f}")
    assert low < rest_rms < high
    assert low < mean_rms < high
    assert twin < low


def test_the_mean_of_the_run_is_that_of_the_path_and_of_straight_algebra(sag):
    run, fit = sag
    held = {f"{NAME}.tau": TAU, f"{NAME}.start": 0.0}
    model = fit.model.add(NAME, shapes={NAME: {"tau": TAU, "start": 0.0}}).freeze(**held)
    with_mechanism = ac.fit(run, model)
    (mean,), names = with_mechanism.at_mean, [e.name for e in with_mechanism.free]
    i, j = names.index("scale_factor"), names.index(NAME)
    u = (mean.value - with_mechanism["scale_factor"].value) / with_mechanism[NAME].value
    P = with_mechanism.covariance
    assert mean.std == pytest.approx(np.sqrt(P[i, i] + 2.0 * u * P[i, j] + u**2 * P[j, j]), rel=1e-9)
    s = scene(np.random.default_rng(3))  # the motion of the record
    assert u == pytest.approx(float(np.mean(s.memory(np.abs(s.a), TAU)[int(BEFORE * RATE) * OVER :])), rel=0.01)
    (path,) = with_mechanism.paths(run)
    assert (path.mean, path.mean_std) == pytest.approx((mean.value, mean.std), rel=1e-6)
    assert (path.itself, path.itself_std) == pytest.approx(
        (with_mechanism["scale_factor"].value, with_mechanism["scale_factor"].std)
    )


def test_a_mechanism_is_named_by_what_is_sure_at_its_memory_though_its_size_goes_with_the_memory(tmp_path):
    """One tone of one amplitude: the ripple of the memory is seen plainly, how long the memory is hardly."""
    rng = np.random.default_rng(84)
    s = scene(rng)
    p = 6e-3 * np.sin(2.0 * np.pi * 3.0 * s.t)
    v = np.gradient(p, s.step)
    s = replace(s, p=p, v=v, a=np.gradient(v, s.step))
    run = ac.load(write(s, 0.5 * sagging(s), rng, tmp_path / "tone.csv"))
    grown = ac.add(ac.fit(run), run, NAME)
    e = grown[NAME]
    std_at_shapes = grown.at_shapes[grown.free.index(e)]
    assert abs(e.value) / e.std < 2.0 < 6.0 < abs(e.value) / std_at_shapes
    shapes = {shape.name: shape.value for shape in grown.shapes}
    held = ac.fit(run, grown.model.freeze(**shapes))
    assert held[NAME].std == pytest.approx(std_at_shapes, rel=0.02)
    assert not {"chosen", "barely_shown"} & {note.code for note in grown.remarks}
    assert [note.code for note in chosen(replace(grown, at_shapes=()), {NAME: 0.5})] == ["chosen"]


def test_every_face_tells_the_coefficient_at_rest_and_at_the_mean(tmp_path, sag):
    run, fit = sag
    with_mechanism = ac.add(fit, run, NAME)
    assert "scale_factor, at rest" in str(with_mechanism)
    assert "scale_factor, at the mean of this run" in str(with_mechanism)
    frame = with_mechanism.to_dataframe()
    assert frame.loc["scale_factor", "value"] == with_mechanism["scale_factor"].value
    assert frame.loc["scale_factor, at the mean of this run", "std"] == with_mechanism.at_mean[0].std
    model_file.save(with_mechanism, tmp_path / "m.json")
    content = json.loads((tmp_path / "m.json").read_text())
    assert content["at_mean"][0]["value"] == with_mechanism.at_mean[0].value
    assert ac.load_model(tmp_path / "m.json").at_mean == with_mechanism.at_mean
    for key, wrong in (("name", "bias"), ("run", 1), ("unit", "s"), ("std", -1.0)):
        damaged = {**content, "at_mean": [{**content["at_mean"][0], key: wrong}]}
        with pytest.raises(model_file.ModelFileError, match=r"at_mean\[0\]"):
            model_file.from_dict(damaged)
    with pytest.raises(model_file.ModelFileError, match="at_shapes: found 2 numbers, expected one for each of bias"):
        model_file.from_dict({**content, "at_shapes": [1.0, 2.0]})
    del content["at_mean"], content["at_shapes"]  # as files of schema 5 began
    assert model_file.from_dict(content).at_mean == ()
    assert "at rest" not in str(fit)
    upright = replace(with_mechanism, rig=replace(with_mechanism.rig, axis="up"))
    assert "scale_factor, at |a| = 0" in str(upright)
    warm = fit.model.add("bias_follows_temperature", shapes={"bias_follows_temperature": {"tau": 1.0, "start": 0.0}})
    degrees = f"{run.side['temperature'].y.mean():.1f} °C"
    for model in (warm, fit.model.add("temperature_bias")):
        assert f"bias, at {degrees} " in str(ac.fit(run, model))
    assert "°C" not in str(ac.fit(run, fit.model.add("temperature_scale"))).partition("scale_factor")[0]
    drag = {"velocity_follows_abs_v": {"tau": 1.0, "start": 0.0}}  # a carrier that the model lacks
    assert "velocity, at the mean of this run" in str(ac.fit(run, fit.model.add(*drag, shapes=drag)))


@pytest.mark.parametrize(
    "name", ["scale_factor_follows_supply", "scale_factor_follows_duty", "fifth_of_own_follows_abs_a"]
)
def test_a_stored_mechanism_is_known_to_another_process(tmp_path, sag, name):
    run, fit = sag
    duty = replace(run.side["supply"], unit="1", name="duty")
    run = replace(run, side={**run.side, "duty": duty}, digest="with duty")
    side_channel("supply", "V")
    side_channel("duty", "1")
    if name.startswith("fifth") and "fifth_of_own" not in CATALOGUE:
        from_expression("fifth_of_own", "a*abs(v)*v")
    model = fit.model.add(name, shapes={name: {"tau": 0.5, "start": 0.0}}).freeze(**{f"{name}.tau": 0.5})
    path = tmp_path / "m.json"
    model_file.save(ac.fit(run, model), path)
    code = f"import accelcal as ac; print(ac.load_model({str(path)!r}).model.effects[-1])"
    read = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert read.stdout.split()[-1:] == [name], read.stderr[-500:]


def test_a_pickled_mechanism_of_a_channel_is_known_to_another_process():
    side_channel("supply", "V")
    packed = pickle.dumps([find("bias_follows_supply"), side_channel("supply", "V"), find("cubic")])
    assert pickle.loads(packed)[0] is find("bias_follows_supply")
    code = f"import pickle; print([e.unit for e in pickle.loads({packed!r})])"
    read = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert read.stdout.strip() == "['m/s²/V', 'm/s²/V', '(m/s²)⁻²']", read.stderr[-300:]


def test_paths_ask_for_the_channel_and_survive_a_process_of_no_size(sag):
    run, fit = sag
    side_channel("supply", "V")
    name = "scale_factor_follows_supply"
    model = fit.model.add(name, shapes={name: {"tau": 0.5, "start": 0.0}})
    with pytest.raises(ac.AccelcalError, match="needs the channel supply"):
        ac.fit(run, model).paths(replace(run, side={}, digest="without"))
    flat = fit.model.add("bias_random_walk", shapes={"bias_random_walk": {"start": 0.0, "length": 60.0}})
    flat = flat.freeze(**{term.name: 0.0 for term in flat.terms if term.effect.port == "process"})
    (path,) = ac.fit(run, flat).paths(run)
    assert np.ptp(path.value) == 0.0
    assert {follower.share for follower in path.followers} == {0.0}


def test_a_pattern_with_a_name_of_its_own_enters_under_that(sag):
    run, fit = sag
    model = fit.model.add("bias_follows_a2", shapes={"bias_follows_a2": {"tau": 5.0, "start": 0.0}})
    assert model.effects[-1] == "self_heating"
    assert "self_heating.tau" in {e.name for e in ac.fit(run, model).shapes}


def test_a_mechanism_is_tracked_live(sag):
    run, fit = sag
    readings = np.full(len(run.accel.t), np.nan)
    readings[np.searchsorted(run.accel.t, run.position.t).clip(0, len(readings) - 1)] = run.position.y
    rate = 1.0 / float(np.median(np.diff(run.accel.t)))
    q, r = fit.noise().q, fit.noise().r
    sizes = []
    for tau in (TAU, 1e-3):  # without its memory it is another effect
        given = Model.linear().add(NAME, shapes={NAME: {"tau": tau, "start": 0.0}})
        live = LiveModel(given, run.rig, rate=rate, q=q, r_position=r, position=float(run.position.y[0]), order=2)
        live.run(run.accel.y[:SOME], readings[:SOME])
        sizes.append(live[NAME])
    right, wrong = sizes
    assert abs(right.value - SAG) < 4.0 * right.std < 0.2 * abs(SAG)
    assert abs(wrong.value - SAG) > 0.3 * abs(SAG)


def test_a_mechanism_of_a_channel_or_its_rate_is_tracked_live():
    side_channel("supply", "V")
    for name in ("scale_factor_follows_temperature_rate", "bias_follows_supply"):
        model = Model.linear().add(name, shapes={name: {"tau": 1.0, "start": 0.0}})
        live = LiveModel(model, CXL02_RIG, rate=100.0, q=1e-8, r_position=1e-12, position=0.0)
        assert live.names[-1] == name


def test_friction_that_builds_up_over_a_distance_is_dahls():
    s, length = moves(), 2e-3
    z, by_hand = 0.0, np.empty(len(s.p))
    for i, way in enumerate(np.diff(s.p, prepend=s.p[0]) / length):
        z = z + way - abs(way) * z
        by_hand[i] = z
    np.testing.assert_allclose(find("presliding").column(s, length=length), by_hand, atol=0.06)
    assert find("presliding") in BUILT_IN
