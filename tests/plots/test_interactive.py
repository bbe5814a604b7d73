"""Figures carry the numbers of the API, units on every axis, and colours that everyone tells apart, in plotly too."""

import base64
import itertools
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.experiment import power
from accelcal.diagnosis.findings import Confounded
from accelcal.diagnosis.noise.noise_test import NoiseTest
from accelcal.diagnosis.search.confounding import Weights
from accelcal.diagnosis.select.improvement import nested_fits
from accelcal.estimation.estimate import estimate
from accelcal.estimation.tracks import Follower, Path, shapes, track
from accelcal.live.session import LiveEvent, LiveHistory, LiveState
from accelcal.live.tracker import Alarm, Innovation, Interval
from accelcal.model import Estimate
from accelcal.plots import (
    comparison,
    diagnosis,
    diagnosis as findings,
    figure as style,
    interactive,
    matplotlib,
    model as models,
    plotly,
    residuals,
    timeline,
    timeline as over_time,
)
from accelcal.plots.diagnosis import chosen
from accelcal.plots.figure import Bars, Level, Line, Points, Text, decades, thin
from accelcal.plots.response import sensitivity
from accelcal.plots.timeline import Marks
from accelcal.results import words as formatting
from accelcal.results.diagnoses import candidate_groups
from accelcal.simulation.sensor import CXL02_RIG, simulate
from accelcal.validation.comparison import Bins, RmsInterval
from accelcal.validation.consistency import cumulative_periodogram
from accelcal.validation.differences import Comparison
from accelcal.validation.evaluation import accel_spectrum, compare, one_step_spectrum
from accelcal.validation.regions import worst_stretches
from accelcal.verbs import diagnose
from tests.plots.test_plots import SHORT, a_comparison
from tests.plots.test_sensitivity import responded

THEMES = ("light", "dark")
LIVE = (("bias", "m/s^2"), ("scale_factor", "1"))
LINE = NoiseTest("tone", 50.0, 1e-9, 2e-3, "m/s²", 1e-4, "a line", {"frequency": 12.5})


class Example:
    """Everything that figures are drawn from, for one record with a hidden cubic."""

    def __init__(self):
        truth = {"bias": 0.05, "scale_factor": 0.01, "cubic": 2e-3}
        self.run, self.other = (
            simulate(
                "interleaved", seconds=20.0, rig=CXL02_RIG, parameters=truth, rng=np.random.default_rng(s)
            ).recording
            for s in (1, 2)
        )
        self.fit = estimate(ac.Model.linear(), self.run)
        self.diagnosis = diagnose(self.fit, self.run)
        self.evaluation = self.diagnosis.where
        self.grown = nested_fits(self.fit, [self.run], self.diagnosis.scan.detected)
        self.nested = ac.compare(self.grown.fits, self.other, names=self.grown.names)
        self.power = power(ac.Model.linear(), self.run)
        self.track = track(self.fit, self.run)
        self.marks = timeline.marks(self.run)
        shaped = ac.Model.linear().add("shape_of_position", shapes=self.ends)
        self.shaped = estimate(shaped.freeze(**{"shape_of_position.p1": 0.0}), self.run)

    @property
    def ends(self):
        low, high = self.fit.validity["p"]
        return {"shape_of_position": {"low": low - self.fit.origins.p, "high": high - self.fit.origins.p}}

    def figures(self):
        figure_seen = self.evaluation
        return {
            "simulated": comparison.simulated(figure_seen),
            "coasting": comparison.coasting(figure_seen),
            "one_step": comparison.one_step(figure_seen, previous=figure_seen),
            "accel_residual": comparison.accel_residual(figure_seen, previous=figure_seen),
            "residual_of_axes": comparison.residual_of_axes({"x": figure_seen, "y": figure_seen}),
            "coasting_of_axes": comparison.coasting_of_axes({"x": figure_seen, "y": figure_seen}),
            "regions": residuals.regions(figure_seen),
            "before_after": residuals.before_after(
                self.nested.evaluations[0][0], self.nested.evaluations[0][-1], "adding it"
            ),
            "spectrum": residuals.spectrum(self.fit, figure_seen, [LINE]),
            "whiteness_plot": residuals.whiteness_plot(figure_seen),
            "quantile_plot": residuals.quantile_plot(figure_seen),
            "tiles": residuals.tiles(figure_seen),
            "tracks": over_time.tracks(self.track),
            "paths": over_time.paths([a_path()]),
            "ranking": findings.ranking(self.diagnosis),
            "signatures": diagnosis.signatures(self.power),
            "error_reduction": findings.error_reduction(self.nested, lacking=self.grown.lacking),
            "fitted_curve": over_time.fitted_curve(shapes(self.shaped)),
            "detectable_sizes": diagnosis.detectable_sizes(self.power),
            "drift_limits": diagnosis.drift_limits(self.power.drift),
            "timeline": timeline.timeline(self.run, self.marks),
            "overlay": timeline.overlay(list(zip(self.nested.names, self.nested, strict=True))),
            "live_tracks": over_time.live_tracks(followed()),
            "sensitivity": sensitivity(responded()),
            "linked": timeline.linked(self.run, figure_seen, previous=figure_seen, marked=[(3.0, 4.0, "chosen")]),
            "parameters": models.parameters(self.fit),
            "nonlinearity": models.nonlinearity(self.fit),
            "allan": models.allan(at_rest()),
        }


def at_rest():
    """Noise of a sensor that warms up, with a random walk."""
    rng, t, nothing = np.random.default_rng(1), np.arange(20_000.0), np.empty(0)
    warmth = 25.0 + 10.0 * (1.0 - np.exp(-t / 3000.0))
    y = 1e-3 * warmth + 0.01 * rng.standard_normal(len(t)) + 5e-5 * np.cumsum(rng.standard_normal(len(t)))
    accel, position = ac.Channel("accel", t, y, "m/s^2"), ac.Channel("position", nothing, nothing, "m")
    temperature = ac.Channel("temperature", t, warmth, "degC")
    return ac.rest(ac.Recording(accel, position, ac.Rig(), {"temperature": temperature}))


def followed():
    """A live view over ten moments, with an alarm at the seventh."""
    history = LiveHistory()
    for i in range(10):
        std = 1e-3 / (i + 1)
        estimates = tuple(Estimate(name, name, unit, 0.01, std, "sensor") for name, unit in LIVE)
        newest, nis = Innovation(0.5 * i, 1e-7, 4e-14), Interval(1.0, 0.9, 1.1, 100)
        state = LiveState(0.5 * i, estimates, innovation=newest, nis=nis)
        history.add(LiveEvent("state", "lines", state))
    history.add(LiveEvent("alarm", "lines", state, Alarm(4.0, "noise", 2.0, 0.9, 1.1, 100, since=3.0)))
    return history


@pytest.fixture(scope="module")
def example():
    return Example()


def a_path():
    """A scale factor that wanders within its band, and what it follows."""
    t = np.linspace(0.0, 60.0, 61)
    value = 1e-3 * np.sin(0.2 * t)
    follower = Follower("scale_factor_follows_abs_a", 0.9, 0.4, 0.9 * value)
    return Path("scale_factor", "1", 0.0, 1e-4, float(np.mean(value)), 1e-4, t, value, np.full(61, 2e-4), (follower,))


@pytest.fixture(scope="module")
def defined(example):
    return example.figures()


@pytest.fixture(scope="module")
def drawn(defined):
    return {theme: {name: plotly.as_dict(f, theme) for name, f in defined.items()} for theme in THEMES}


def marks(figure, kind):
    return [mark for panel in figure.panels for mark in panel.marks if isinstance(mark, kind)]


def named(figure, name):
    return next(m for m in marks(figure, Line | Points | Level) if m.name == name)


def decoded(values):
    """Numbers of a trace as plotly.js reads them."""
    if isinstance(values, dict):
        return np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"]).astype(float)
    return np.array(values, dtype=float)


def test_every_figure_is_offered_to_notebooks(defined):
    assert set(interactive.__all__) == set(defined)
    figure = interactive.coasting(a_comparison(), theme="dark")
    assert figure.layout.paper_bgcolor == style.DARK.page
    assert {trace.name for trace in figure.data} == {
        m.name for m in comparison.coasting(a_comparison()).panels[0].marks
    }


def test_every_axis_carries_its_unit(defined):
    names = ("tiles", "signatures", "ranking", "detectable_sizes", "parameters")  # of variables, effects and models
    for name, figure in defined.items():
        for panel in figure.panels:
            assert name == "error_reduction" or re.search(r"\(.+\)", panel.x.label), name
            assert name in names or re.search(r"\(.+\)", panel.y.label), name


@pytest.mark.parametrize("theme", THEMES)
def test_plotly_draws_every_title_of_an_axis(defined, drawn, theme):
    for name, figure in defined.items():
        axes = {k: v["title"].get("text") for k, v in drawn[theme][name]["layout"].items() if re.match("[xy]axis", k)}
        assert len(axes) == 2 * len(figure.panels)
        for number, panel in enumerate(figure.panels, 1):
            at = "" if number == 1 else number
            assert axes[f"yaxis{at}"] == panel.y.label, name
            label = panel.x.label if not figure.shared_x or number == len(figure.panels) else None
            assert axes[f"xaxis{at}"] == label, name


@pytest.mark.parametrize("theme", THEMES)
def test_colours_are_those_of_the_palette(drawn, theme):
    look = style.theme_of(theme)
    allowed = {c.upper() for c in (*style.OKABE_ITO.values(), look.page, look.ink, look.grid, "#FFFFFF")}
    for name, figure in drawn[theme].items():
        colours = set(re.findall(r"#[0-9A-Fa-f]{6}", json.dumps(figure)))
        assert {c.upper() for c in colours} - allowed == set(), name


def test_themes_differ_in_looks_alone(drawn):
    for name in drawn["light"]:
        day, night = drawn["light"][name], drawn["dark"][name]
        assert day["layout"]["paper_bgcolor"] != night["layout"]["paper_bgcolor"]
        assert [a["text"] for a in day["layout"]["annotations"]] == [a["text"] for a in night["layout"]["annotations"]]
        for a, b in zip(day["data"], night["data"], strict=True):
            assert all(a.get(key) == b.get(key) for key in ("x", "y", "z", "name", "text", "customdata")), name


def test_plotly_holds_the_numbers_of_every_line(defined, drawn):
    for name, figure in defined.items():
        # Those of bands have no text for the pointer.
        traces = [t for t in drawn["light"][name]["data"] if "lines" in t.get("mode", "") and "hovertemplate" in t]
        for trace, line in zip(traces, marks(figure, Line), strict=True):
            np.testing.assert_allclose(decoded(trace["y"]), line.drawn[1], rtol=1e-6, atol=1e-300, err_msg=name)  # f4


def test_matplotlib_draws_every_figure(defined):
    for name, figure in defined.items():
        drawing = matplotlib.draw(figure)
        drawing.draw_without_rendering()
        assert len(drawing.axes) >= len(figure.panels), name
        assert all(box.get_window_extent().width <= drawing.bbox.width for box in drawing.legends), name


def test_text_of_a_file_is_no_markup_in_plotly(defined):
    hostile = replace(defined["coasting"], headline="<b>run</b>", note="<i>")
    text = json.dumps(plotly.as_dict(hostile))
    assert "&lt;b&gt;run" in text
    assert "<b>" not in text


def test_an_unknown_theme_is_refused():
    with pytest.raises(ValueError, match="there is no theme 'sepia'"):
        interactive.coasting(a_comparison(), theme="sepia")


def test_one_step_keeps_extremes_and_states_statistics_of_all_data(example, drawn, defined):
    t, e = example.evaluation.residual
    figure = defined["one_step"]
    shown = named(figure, "residual").drawn[1]
    assert len(t) > 2 * len(shown)
    assert np.nanmax(shown) == pytest.approx(1e6 * e.max(), rel=1e-15)  # one product, in µm
    assert np.nanmin(shown) == pytest.approx(1e6 * e.min(), rel=1e-15)
    inside = np.mean(np.abs(e) <= 1.96 * example.evaluation.residual_std)
    assert f"{100 * inside:.1f} % of" in figure.headline
    assert f"4 000 of {formatting.grouped(len(t))} points shown" in figure.small_print


def test_coasting_shows_drift_and_floor(example, defined):
    figure = defined["coasting"]
    for name, result in (
        ("bias of this run re-estimated", example.evaluation.coast_rms),
        ("all parameters from the fit", example.evaluation.coast_frozen_rms),
        ("noise floor", example.evaluation.drift_floors),
    ):
        line = named(figure, name)
        factor = line.y[0] / result[line.x[0]]
        assert factor in (pytest.approx(1e3), pytest.approx(1e6))
        np.testing.assert_allclose(line.y, [factor * result[h] for h in line.x], rtol=1e-12)  # one product


def test_regions_come_in_the_order_of_what_they_explain(example, defined):
    result = residuals.ordered(example.evaluation)
    shares = [share for _, share in result]
    assert shares == sorted(shares, reverse=True)
    assert result[0][0].variable == "acceleration"  # a cubic is a function of acceleration
    recent = {"recent velocity", "recent acceleration", "distance since reversal"}
    assert recent | {"time", "position", "velocity", "acceleration", "jerk", "time since reversal"} == {
        b.variable for b, _ in result
    }
    titles = [panel.title.split(":")[0] for panel in defined["regions"].panels]
    assert titles == [*(b.variable for b, _ in result), "frequency"]


def test_explained_share_of_a_pure_function_and_of_noise():
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.0, 1.0, 60_000)
    bins = np.clip(((x + 1.0) * 6.0).astype(int), 0, 11)
    count = np.bincount(bins)
    for y, low, high in ((np.sin(3.0 * x), 0.9, 1.0), (rng.standard_normal(len(x)), 0.0, 0.002)):
        mean = np.bincount(bins, weights=y) / count
        bins_of_x = Bins("x", "m", np.linspace(-1, 1, 13), mean, np.std(y) / np.sqrt(count), share=count / len(x))
        # Twelve bins hold 99 % of a sine; of noise they hold 12/60 000 by chance, taken off. False alarm below 1e-6.
        assert low <= bins_of_x.explained(float(np.sqrt(np.mean(y**2)))) <= high


def test_spectrum_names_lines_and_keeps_its_band(example, drawn, defined):
    figure = defined["spectrum"]
    assert "tone at 12.5 Hz" in figure.small_print
    assert [(m.at, m.text, m.upright) for m in marks(figure, Level)] == 2 * [(12.5, "tone 12.5 Hz", True)]
    labels = [a for a in drawn["light"]["spectrum"]["layout"]["annotations"] if a["text"] == "tone 12.5 Hz"]
    assert [a["x"] for a in labels] == 2 * [pytest.approx(np.log10(12.5))]  # on a logarithmic axis


def test_spectrum_of_white_residuals_stays_in_its_region():
    # 95 % of 1000 correlated frequencies: between 92 and 98 % is four sigma even if only a quarter are independent.
    white = a_comparison(n=48_000)
    result = one_step_spectrum(white)
    ratio = result.density / result.predicted
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.02)  # 24 000 exponential ordinates: 0.0065
    assert 0.92 < np.mean((ratio > result.low) & (ratio < result.high)) < 0.98
    # The sister: residuals with a line leave it.
    t, e = white.residual
    with_line = replace(white, residual=(t, e + 1e-6 * np.sin(2.0 * np.pi * 10.0 * t)))
    result = one_step_spectrum(with_line)
    peak = np.argmax(result.density / result.predicted)
    assert result.frequency[peak] == pytest.approx(10.0, abs=0.1)
    assert result.density[peak] / result.predicted[peak] > 10 * result.high


def test_predicted_noise_is_that_of_a_good_model(example):
    cubic = estimate(ac.Model.linear().add("cubic"), example.run)
    result = accel_spectrum(cubic, compare(cubic, example.other))
    middle = result.frequency < 0.7 * result.frequency[-1]
    ratio = result.density[middle] / result.predicted[middle]
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.15)  # five sigma of 24 segments over some ten bands
    lacking = accel_spectrum(example.fit, compare(example.fit, example.other))
    short = lacking.density / lacking.predicted
    assert np.mean((short < lacking.low) | (short > lacking.high)) > 0.3  # the sister: a model that lacks the cubic


def test_cumulative_periodogram_tells_white_from_coloured():
    rng = np.random.default_rng(11)
    rejected = [
        result.distance > result.limit
        for result in (cumulative_periodogram(rng.standard_normal(500)) for _ in range(400))
    ]
    assert 4 <= sum(rejected) <= 40  # 20 expected at 5 %: beyond four sigma below 1e-4
    coloured = np.convolve(rng.standard_normal(600), np.ones(3), mode="valid")
    periodogram = cumulative_periodogram(coloured)
    assert periodogram.distance > 2.0 * periodogram.limit
    with pytest.raises(ValueError, match="at least 16"):
        cumulative_periodogram(np.ones(8))
    with pytest.raises(ValueError, match="constant"):
        cumulative_periodogram(np.ones(40))


def test_quantiles_are_those_of_all_residuals(example, defined):
    y = np.sort(example.evaluation.normalised[1])
    shown = named(defined["quantile_plot"], "residuals").y
    assert (shown[0], shown[-1]) == (y[0], y[-1])


def test_tiles_hold_scores(example):
    tiles = residuals.tiles_of(example.evaluation)
    for row, sigma in zip(tiles.rows, tiles.z, strict=True):
        first = next(b for b in example.evaluation.bins if row.startswith(f"{b.variable},"))
        sampled = first.std > 0.0
        np.testing.assert_array_equal(sigma[sampled], first.score[sampled])
        assert np.all(np.isnan(sigma[~sampled]))
    assert tiles.rows[0].startswith("acceleration")


def test_tracks_end_where_the_fit_ends(example):
    for i, name in enumerate(example.track.names):
        assert example.track.values[-1, i] == pytest.approx(example.fit[name].value, rel=1e-9, abs=1e-12)  # same solve
        assert example.track.std[-1, i] == pytest.approx(example.fit[name].std, rel=1e-9)
    late = example.track.std[20:]
    assert np.all(np.diff(late, axis=0) <= 1e-12 * late[:-1])  # information only grows


def test_a_track_equals_a_fit_of_the_first_part():
    # Noise and smoothed motion are those of the whole record, so only nearly: a tenth of a standard deviation.
    truth = {"bias": 0.05, "scale_factor": 0.01}
    run = simulate("tones", seconds=20.0, rig=CXL02_RIG, parameters=truth, rng=np.random.default_rng(4)).recording
    whole = estimate(ac.Model.linear(), run)
    result = track(whole, run, points=20)
    half = estimate(ac.Model.linear(), run, end=float(result.t[9]), origins=whole.origins)
    for i, name in enumerate(result.names):
        assert result.std[9, i] == pytest.approx(half[name].std, rel=0.05)
        assert abs(result.values[9, i] - half[name].value) < 0.3 * half[name].std
        assert result.std[9, i] > 1.1 * result.std[-1, i]


def test_ranking_draws_every_candidate_and_brackets_ties(example, defined):
    groups = candidate_groups(example.diagnosis)
    flat = [c.effect for group in groups for c in group]
    assert sorted(flat) == sorted(c.effect for c in example.diagnosis.scan.candidates[:12])
    (bars,) = marks(defined["ranking"], Bars)
    assert sorted(bars.y) == sorted(c.snr for c in example.diagnosis.scan.candidates[:12])
    assert list(bars.solid) == [c.p_value < example.diagnosis.alpha for group in groups for c in group]
    several = sum(1 for group in groups if len(group) > 1)
    assert [m.text for m in marks(defined["ranking"], Text)] == several * ["confounded"]
    assert len(marks(defined["ranking"], Line)) == several


def test_a_ranking_without_ties_leaves_no_room_for_brackets(example):
    alone = tuple(replace(c, weights={}) for c in example.diagnosis.scan.candidates)
    figure = findings.ranking(replace(example.diagnosis, scan=replace(example.diagnosis.scan, candidates=alone)))
    assert figure.panels[0].x.range[1] < 1.5 * max(c.snr for c in alone)


def test_a_tie_is_bracketed(example):
    first, second, *rest = example.diagnosis.scan.candidates
    tied = (
        replace(first, weights=dict.fromkeys((first.effect, second.effect), Weights())),
        replace(second, p_value=1e-9),
        *rest,
    )
    diagnosis = replace(
        example.diagnosis,
        scan=replace(example.diagnosis.scan, candidates=tied),
        classes=(Confounded(first.effect, (first.effect, second.effect), "x"),),
    )
    assert [c.effect for c in candidate_groups(diagnosis)[0]] == [first.effect, second.effect]
    unsure = (replace(tied[0], p_value=0.5), *tied[1:])
    assert len(candidate_groups(replace(diagnosis, scan=replace(diagnosis.scan, candidates=unsure)))[0]) == 1
    alone = replace(
        diagnosis, scan=replace(diagnosis.scan, candidates=(replace(first, weights={first.effect: Weights()}), *rest))
    )
    assert [c.effect for c in candidate_groups(alone)[0]] == [first.effect]


def test_signatures_are_the_correlations_of_the_record(example):
    chosen_effects = chosen(example.power, ["cubic", "odd_quadratic"])
    assert {"cubic", "odd_quadratic"} <= set(chosen_effects.names)
    np.testing.assert_allclose(np.diag(chosen_effects.correlation), 1.0, rtol=1e-9)  # of unit signatures
    np.testing.assert_allclose(chosen_effects.correlation, chosen_effects.correlation.T, rtol=1e-9, atol=1e-12)
    ties = [{a, b} for g in example.power.ties for a, b in itertools.combinations(g.members, 2) if a == g.members[0]]
    for i, j in itertools.combinations(range(len(chosen_effects.names)), 2):
        rho = abs(chosen_effects.correlation[i, j])
        assert rho <= 1.0 + 1e-9
        if rho > 0.955:  # said to be tied, unless another trial shape of the rival comes nearer
            assert {chosen_effects.names[i], chosen_effects.names[j]} in ties or len(
                example.power[chosen_effects.names[i]].members
            ) > 1


def test_falling_draws_errors_floor_and_shares(example, drawn, defined):
    figure = defined["error_reduction"]
    (bars,), floor = marks(figure, Bars), example.nested.floor
    factor = bars.y[0] / example.nested.errors[0]
    np.testing.assert_allclose(bars.y, np.array(example.nested.errors) * factor, rtol=1e-12)  # one product
    intervals = [(i.low * factor, i.high * factor) for i in example.nested.intervals]
    np.testing.assert_allclose(np.column_stack([bars.low, bars.high]), intervals, rtol=1e-12)
    line = named(figure, "limit of detection")
    expected = np.array([floor.value, floor.low, floor.high]) * factor
    np.testing.assert_allclose((line.at, line.low, line.high), expected, rtol=1e-12)
    assert f"{100 * example.nested.shares[1]:.0f} % of its power" in bars.text[1]
    assert "declared noise density" in figure.headline
    assert example.nested.errors[1] < 0.6 * example.nested.errors[0]
    content = drawn["light"]["error_reduction"]
    assert "not in the model yet" in {t.get("name") for t in content["data"]}
    assert [y for t in content["data"] if t["type"] == "bar" for y in t["y"]] == bars.y.tolist()
    (region,) = (shape for shape in content["layout"]["shapes"] if shape["type"] == "rect")
    assert (region["y0"], region["y1"]) == (line.low, line.high)


def test_a_base_at_the_floor_explains_nothing(example):
    last = example.nested[1]
    high = RmsInterval(1.0, 0.5, 2.0)
    loud = replace(last.noise_floor, drift=dict.fromkeys(last.noise_floor.drift, high))
    short = replace(last, noise_floor=loud, resolved=())
    poor = Comparison(example.nested.fits[1:], ("base",), ("run",), ((short,),))
    assert (poor.shares, poor.at_floor) == ((None,), (True,))


def test_the_overlay_draws_measurement_every_model_and_their_difference(example, drawn, defined):
    name, nested = example.nested.names[-1], example.nested[1]
    mine = [t for t in drawn["light"]["overlay"]["data"] if t.get("name", "").startswith(f"{name}, fit")]
    assert len(mine) == 3  # output, residual, position
    assert len({t["legendgroup"] for t in mine}) == 1
    assert [t["showlegend"] for t in mine] == [True, False, False]
    measured = named(defined["overlay"], "measured").drawn[1]
    assert np.nanmax(np.abs(measured)) == np.max(np.abs(nested.measured))  # thinned
    share = np.linalg.norm(nested.accel_residual[1]) / np.linalg.norm(nested.measured - nested.measured.mean())
    assert nested.fit_percent == pytest.approx(100.0 * (1.0 - share))
    assert 90.0 < nested.fit_percent < 100.0


def test_the_worst_stretch_is_where_the_residual_is_largest():
    t = np.linspace(0.0, 40.0, 4001)
    residual = np.sin(2.0 * np.pi * t)
    residual[2510:2590] *= 9.0
    ((begin, end),) = worst_stretches(t, residual)
    assert begin == pytest.approx(25.0, abs=0.02)
    assert end == pytest.approx(26.0, abs=0.02)
    assert worst_stretches(t, np.sin(2.0 * np.pi * t)) == []


def test_the_finer_form_of_a_shape_has_a_name_of_its_own(example):
    class Entered:
        effect = "shape_of_position"

        def enter(self, model):
            return model if "shape_of_position" in model.added else model.add("shape_of_position", shapes=example.ends)

    grown = nested_fits(example.fit, [example.run], [Entered(), Entered()])
    assert grown.names == ("base", "+ shape of position", "+ shape of position, finer")


def test_recovered_shape_is_the_fitted_function(example):
    (shape,) = shapes(example.shaped)
    effect = "shape_of_position"
    from scipy.interpolate import BSpline
    from scipy.special import eval_legendre

    low, high = example.ends[effect]["low"], example.ends[effect]["high"]
    knots = low + (high - low) / 7.0 * np.arange(-3, 11)
    x = shape.x - example.shaped.origins.p
    share = 2 * (x - low) / (high - low) - 1
    weights = [0.0, 0.0, *(example.shaped[f"{effect}.s{j}"].value for j in range(3, 9)), 0.0, 0.0]
    spline = BSpline(knots, weights, 3)
    independent = spline(x) - spline.integrate(low, high) / (high - low)  # a curve holds no constant
    for degree in range(1, 4):
        independent += example.shaped[f"{effect}.p{degree}"].value * eval_legendre(degree, share)
    inside = slice(1, -1)  # the ends stand on a knot
    np.testing.assert_allclose(shape.value[inside], independent[inside], rtol=1e-8, atol=1e-12)  # same polynomials
    assert np.all(shape.std > 0.0)


def test_power_shows_contributions_by_port(example, defined):
    shown = {
        name: x
        for panel in defined["detectable_sizes"].panels
        for x, name in zip(panel.marks[0].x, panel.y.ticks[1], strict=True)
    }
    for name, x in shown.items():
        assert x == example.power[name.replace(" ", "_")].largest
    assert {"cubic", "encoder cyclic"} <= set(shown)


def test_breaks_and_faults_are_marked(example):
    figure = timeline.timeline(example.run, Marks(0.0, 12.0, (12.0,), (), ((1.0, 2.0),)))
    assert "1 break, no fault" in figure.headline
    layout = plotly.as_dict(figure)["layout"]
    assert [s["x0"] for s in layout["shapes"] if s["type"] == "line"] == [12.0, 12.0]
    assert any("break at 12 s" in a["text"] for a in layout["annotations"])
    assert [(s["x0"], s["x1"]) for s in layout["shapes"] if s["type"] == "rect"] == [(1.0, 2.0)]


@pytest.mark.parametrize("theme", THEMES)
def test_records_too_short_are_said_in_place_of_figures(theme):
    short = a_comparison(n=40, bins=(), accel_residual=(np.empty(0), np.empty(0)), measured=np.empty(0), **SHORT)
    for define in (
        comparison.coasting,
        residuals.regions,
        residuals.tiles,
        comparison.accel_residual,
        timeline.overlay,
    ):
        texts = " ".join(a["text"] for a in plotly.as_dict(define(short), theme)["layout"]["annotations"])
        assert "too short" in texts
    assert residuals.whiteness_plot(a_comparison(n=12)).panels[0].sentence


def test_a_band_below_every_frequency_leaves_no_spectrum(example):
    assert accel_spectrum(example.fit, replace(example.evaluation, band=1e-3)) is None
    assert len(residuals.spectrum(example.fit, replace(example.evaluation, band=1e-3)).panels) == 1


def test_power_of_few_effects_is_drawn(example):
    few = replace(
        example.power,
        detectabilities=tuple(s for s in example.power.detectabilities if s.effect in ("cubic", "quadratic")),
    )
    assert [sorted(panel.y.ticks[1]) for panel in diagnosis.detectable_sizes(few).panels] == [["cubic", "quadratic"]]
    none = diagnosis.detectable_sizes(replace(example.power, detectabilities=()))
    assert "No effect is detectable" in none.panels[0].sentence


def test_previous_residuals_are_drawn_pale(example):
    before, now = marks(comparison.accel_residual(example.evaluation, previous=example.evaluation), Line)
    assert (before.name, now.name) == ("before", "output − model")
    assert before.opacity < 0.5


def test_thinning_keeps_extremes_and_leaves_short_traces_alone():
    t = np.arange(100_000.0)
    y = np.sin(t / 900.0)
    y[54_321], y[60_000:61_000] = 7.0, np.nan
    at, shown = thin(t, y)
    assert np.nanmax(shown) == 7.0
    assert len(at) == len(shown) <= 4000
    assert len(thin(t[:100], y[:100])[0]) == 100
    assert len(thin(t, np.ones(100_000))[0]) == 2000  # of a flat line one point in each column


def test_ticks_of_logarithmic_axes():
    assert decades(0.9, 30.0)[0] == pytest.approx([1, 2, 5, 10, 20])
    assert decades(1e-7, 1e-1)[1] == ["10⁻⁷", "10⁻⁶", "10⁻⁵", "10⁻⁴", "0.001", "0.01", "0.1"]
