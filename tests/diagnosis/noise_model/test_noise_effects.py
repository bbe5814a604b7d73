"""Effects that act on noise, added to a model: coefficients, intervals, log score on held-out data, model files."""

import numpy as np
import pytest
from scipy import stats

import accelcal as ac
from accelcal.effects import BUILT_IN
from accelcal.results import model_file
from accelcal.simulation import ADXL105_RIG
from tests.worlds import Hidden, World
from tests.worlds.world import pass_through

SIZES = {
    "vibration": 0.3,
    "timing_jitter": 3e-4,
    "accelerometer_outliers": 1.5,
    "encoder_outliers": 3e-5,
    "quantisation": 0.3,
}
OF_NOISE = [effect.name for effect in BUILT_IN if effect.port == "noise"]


def halves(name, tmp_path, seed=20, size=None, motion="tones"):
    """A world with the effect, what is fitted of it and what is held out."""
    hidden = (Hidden(name, SIZES[name] if size is None else size, {}),) if name else ()
    world = World(motion, "ADXL105", hidden, seed=seed).settled()
    run = ac.load(world.record().write(tmp_path, f"{name or 'nothing'}-{seed}"))
    last = float(run.position.t[-1])
    return world, run.part(0.0, 0.7 * last), run.part(0.7 * last, last)


def hidden_coefficient(world, name):
    """In the unit of the effect."""
    chain = pass_through(world)
    if name == "vibration":
        return (world.hidden[0].magnitude / np.max(np.abs(chain.scene.v)) ** 2) ** 2
    return world.hidden[0].magnitude ** 2 * chain.shapes[0].get("share", 1.0)


@pytest.mark.parametrize("name", sorted(SIZES))
def test_an_effect_on_noise_is_found_added_and_gains_on_held_out_data(name, tmp_path):
    """Four standard deviations: one false alarm in 16 000."""
    world, train, held = halves(name, tmp_path)
    base = ac.fit(train)
    assert name in ac.diagnose(base, train).effects
    grown = ac.add(base, train, name)
    effect = grown.noise_effects[0]
    assert effect.name == name
    assert abs(effect.value - hidden_coefficient(world, name)) <= 4.0 * effect.std + 1e-6 * effect.value
    (score,) = ac.compare(grown, held)[0].noise_scores
    assert score.gained, score.sentence
    assert 0.4 < score.ratio < 2.0  # events are few, and Poisson
    after = ac.diagnose(grown, train)
    assert name not in after.effects
    assert name not in {test.effect for test in after.channels}
    # the parameters of the mean stay where they were
    for parameter in ("bias", "scale_factor", "time_offset"):
        assert abs(grown[parameter].value - base[parameter].value) < 3.0 * base[parameter].std


@pytest.mark.parametrize("name", ["vibration", "timing_jitter", "accelerometer_outliers", "quantisation"])
def test_what_a_record_does_not_show_is_refused_with_the_size_that_would_show(name, tmp_path):
    """At 1 %: of four effects one is let in by chance in 4 % of records; this seed has none."""
    _, train, _ = halves("", tmp_path, seed=21)
    base = ac.fit(train)
    with pytest.raises(ValueError, match=f"'{name}' cannot be added: this record does not show it"):
        ac.add(base, train, name)


@pytest.mark.parametrize("name", ["vibration", "timing_jitter", "accelerometer_outliers", "encoder_outliers"])
def test_a_score_of_a_record_without_the_effect_falls(name, tmp_path):
    """The twin: an effect that the fitted record has and the other has not is no gain."""
    _, train, _ = halves(name, tmp_path, seed=22)
    _, other, _ = halves("", tmp_path, seed=22)
    grown = ac.add(ac.fit(train), train, name)
    (score,) = ac.compare(grown, other)[0].noise_scores
    assert not score.gained
    assert score.ratio < 0.8


def test_intervals_of_jitter_cover_over_records(tmp_path):
    """Sum of squares of 5 normalised errors within the 99.9 % region; twice the variance, the twin, is outside."""
    z = []
    for seed in range(5):
        world, train, _ = halves("timing_jitter", tmp_path, seed=300 + seed)
        effect = ac.add(ac.fit(train), train, "timing_jitter").noise_effects[0]
        z.append((effect.value - hidden_coefficient(world, "timing_jitter")) / effect.std)
    low, high = stats.chi2.ppf([0.0005, 0.9995], len(z))
    assert low < np.sum(np.square(z)) < high
    relative = effect.std / effect.value
    assert np.sum(np.square(np.array(z) + 1.0 / relative)) > high


def test_two_effects_share_the_noise_without_counting_it_twice(tmp_path):
    """Jitter of the vibration itself is white and grows with v⁴ too; here it is 2 % of the vibration."""
    hidden = (Hidden("vibration", 0.3, {}), Hidden("timing_jitter", 1e-4, {}))
    world = World("interleaved", "ADXL105", hidden, seed=31).settled()
    run = ac.load(world.record().write(tmp_path, "both"))
    both = ac.add(ac.fit(run), run, "vibration", "timing_jitter")
    chain = pass_through(world)
    expected = {"vibration": (0.3 / np.max(np.abs(chain.scene.v)) ** 2) ** 2, "timing_jitter": 1e-8}
    for noise_effect in both.noise_effects:
        assert abs(noise_effect.value - expected[noise_effect.name]) < 4.0 * noise_effect.std
    alone = ac.add(ac.fit(run), run, "vibration").noise_effects[0]
    assert alone.value > both.noise_effects[0].value + 2.0 * alone.std  # the jitter passes for vibration at all heights


def test_a_model_file_holds_all_of_it(tmp_path):
    _, train, held = halves("vibration", tmp_path, seed=23)
    grown = ac.add(ac.fit(train), train, "vibration")
    again = model_file.from_dict(model_file.to_dict(grown))
    assert again.noise() == grown.noise()
    assert ac.compare(again, held)[0].noise_scores == ac.compare(grown, held)[0].noise_scores
    dropped = ac.drop(again, train, "vibration")
    assert dropped.noise_effects == ()
    assert dropped.noise().growth == ()


def test_a_fit_that_sees_no_outliers_is_compared_and_printed(tmp_path):
    """A model with an effect that a record lacks, fitted and not added."""
    _, train, held = halves("", tmp_path, seed=24)
    fit = ac.fit(train, ac.Model.linear().add("encoder_outliers", "accelerometer_outliers", "quantisation"))
    assert [noise_effect.value for noise_effect in fit.noise_effects][:2] == [0.0, 0.0]
    assert all(np.isfinite(score.gain) for score in ac.compare(fit, held)[0].noise_scores)
    with pytest.raises(KeyError, match="encoder_outliers' acts on noise"):
        fit["encoder_outliers"]
    with pytest.raises(ValueError, match="'encoder_outliers' acts on noise: it has no value to hold"):
        fit.model.freeze(encoder_outliers=1e-12)


def test_predicted_noise_holds_the_growth(tmp_path):
    """No region of the residual stands out of the noise of a model that has jitter of 1 ms (5 standard deviations)."""
    _, train, held = halves("timing_jitter", tmp_path, seed=25, size=1e-3)
    base = ac.fit(train)
    grown = ac.add(base, train, "timing_jitter")
    assert grown.noise().usual.q == pytest.approx(base.noise().q, rel=0.1)
    assert "no region stands out" in ac.compare(grown, held)[0].worst


def test_a_damaged_spectrum_is_refused(tmp_path):
    _, train, _ = halves("vibration", tmp_path, seed=23)
    content = model_file.to_dict(ac.add(ac.fit(train), train, "vibration"))
    content["noise_effects"][0]["spectrum"]["floor"].pop()
    with pytest.raises(ValueError, match="values each, as there are frequencies"):
        model_file.from_dict(content)


@pytest.mark.parametrize("name", OF_NOISE)
def test_a_live_filter_has_an_effect_on_noise_in_its_noises(name):
    live = ac.LiveModel(ac.Model.linear().add(name), ADXL105_RIG, rate=1e3, q=1e-6, r_position=1e-12, position=0.0)
    assert live.names == ("scale_factor", "bias", "time_offset")


def test_an_export_says_that_noise_is_no_part_of_the_characteristic(tmp_path):
    from accelcal.calibration.characteristic import characteristic

    _, train, _ = halves("vibration", tmp_path, seed=23)
    base = ac.fit(train)
    grown = ac.add(base, train, "vibration")
    assert [item.effect for item in characteristic(grown).left_out] == ["time_offset", "vibration"]
    assert characteristic(grown).coefficients.keys() == characteristic(base).coefficients.keys()
