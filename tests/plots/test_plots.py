"""Figures contain the numbers that they claim, and say what they leave out."""

import builtins
import itertools
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from accelcal import plots, verbs
from accelcal.estimation.estimate import estimate
from accelcal.model import Model
from accelcal.plots import figure as style
from accelcal.plots.comparison import summary_sentence
from accelcal.plots.figure import Band, Line, Points, share_text, thin
from accelcal.plots.matplotlib import save
from accelcal.plots.residuals import autocorrelation, histogram, normal_quantiles, regions
from accelcal.results import words as formatting
from accelcal.results.words import concise
from accelcal.simulation.sensor import ADXL105_RIG, simulate
from accelcal.validation.comparison import Bins, Evaluation
from accelcal.validation.differences import Comparison
from accelcal.validation.systematic import evaluated

PARAMETERS = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 2e-4}
N = 600


def a_comparison(n=N, **changes):
    """Build a comparison of round numbers; nothing in it comes from a filter."""
    t = np.arange(n) / 100.0
    rng = np.random.default_rng(5)
    residual, third = 1e-6 * rng.standard_normal(n), np.full(3, 1.0 / 3.0)
    bins = (
        Bins("velocity", "m/s", np.linspace(-1, 1, 4), np.array([1e-3, 2e-3, -1e-3]), np.full(3, 1e-3), share=third),
        Bins(
            "acceleration",
            "m/s²",
            np.linspace(-5.0, 5.0, 4),
            np.array([9e-3, 0.0, -9e-3]),
            np.array([1e-3, 0, 1e-3]),
            share=third,
        ),
        Bins("frequency", "Hz", np.linspace(0.0, 30.0, 4), np.array([1.1, 0.9, 1.2]), np.full(3, 0.1)),
    )
    plain = Evaluation(
        recording="bench 3",
        one_step_rms=1e-6,
        nis=1.01,
        k_step_rms={1: 1e-6},
        coast_rms={1.0: 2e-3, 5.0: 9e-3, 10.0: None},
        coast_frozen_rms={1.0: 3e-3, 5.0: 12e-3, 10.0: None},
        coast_floor={1.0: 1e-3, 5.0: 8e-3, 10.0: None},
        coast_starts={1.0: 200, 5.0: 1, 10.0: 0},
        accel_rms=0.02,
        band=12.5,
        simulated=(t, 0.01 * np.sin(t), 0.01 * np.sin(t) + 1e-3 * t),
        simulated_std=1e-4 * (1.0 + t) ** 1.5,
        simulated_rms=2e-3,
        residual=(t, residual),
        residual_std=np.full(n, 1e-6),
        accel_residual=(t, 0.02 * rng.standard_normal(n)),
        measured=np.sin(t),
        bins=bins,
        worst="acceleration between -5 and -1.667 m/s²: mean residual +0.009 m/s² (9.0 sigma)",
        setup_bias=(0.0, 1e-3),
    )
    return replace(plain, **changes)


SHORT = {
    "coast_rms": dict.fromkeys((1.0, 5.0, 10.0)),
    "coast_frozen_rms": dict.fromkeys((1.0, 5.0, 10.0)),
    "coast_floor": dict.fromkeys((1.0, 5.0, 10.0)),
    "coast_starts": dict.fromkeys((1.0, 5.0, 10.0), 0),
}


def alone(fit, evaluation):
    """Comparison of one model with one recording."""
    return Comparison((fit,), ("model",), (evaluation.recording,), ((evaluation,),))


@pytest.fixture(scope="module")
def fitted():
    """Fit a 20 s record, and compare the model with it."""
    record = simulate(
        "tones", seconds=20.0, rig=ADXL105_RIG, parameters=PARAMETERS, rng=np.random.default_rng(3)
    ).recording
    fit = estimate(Model.cubic().freeze(quadratic=0.0), record)
    return record, fit, evaluated(fit, record)


def marks_of(panel, kind):
    return [mark for mark in panel.marks if isinstance(mark, kind)]


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines() if not line.get_label().startswith("_")}


def drawn(line):
    """Return the data of a line without the breaks at holes."""
    x, y = (np.asarray(d, dtype=float) for d in line.get_data())
    remaining = np.isfinite(x)
    return x[remaining], y[remaining]


def texts(figure):
    from matplotlib.text import Text

    return " | ".join(item.get_text() for item in figure.findobj(Text) if item.get_text())


def visible_axes(figure):
    return [axes for axes in figure.axes if axes.get_visible() and axes.axison]


# Data


def test_simulated_position_is_the_array_of_the_comparison():
    c = a_comparison()
    top, bottom = plots.simulated(c).axes
    t, measured, position = c.simulated
    for name, y in (("measured", measured), ("simulated", position)):
        np.testing.assert_array_equal(drawn(lines(top)[name])[0], t)
        np.testing.assert_allclose(drawn(lines(top)[name])[1], y * 1e3, rtol=1e-15)  # one product
    assert top.get_ylabel() == "position (mm)"
    np.testing.assert_allclose(drawn(lines(bottom)["simulated − measured"])[1], (position - measured) * 1e3, rtol=1e-15)


def test_the_overlay_has_measurement_model_and_difference_on_one_axis_of_time():
    c = a_comparison()
    figure = plots.overlay(c)
    output, residual, position = figure.axes
    _, left = c.accel_residual
    label = next(name for name in lines(output) if name.startswith("model, fit "))
    np.testing.assert_array_equal(drawn(lines(output)["measured"])[1], c.measured)
    np.testing.assert_array_equal(drawn(lines(output)[label])[1], c.measured - left)
    difference = max(residual.get_lines(), key=lambda line: len(line.get_xdata()))
    np.testing.assert_allclose(drawn(difference)[1], 1e3 * left, rtol=1e-12)
    assert output.get_xlim() == residual.get_xlim() == position.get_xlim()
    assert label in texts(figure)
    assert "Measured and simulated output: fit " in texts(figure)


def test_the_overlay_of_several_models_names_each_and_shades_the_largest_residual():
    c = a_comparison()
    t, left = c.accel_residual
    left = left.copy()
    left[300:310] += 1.0
    both = [("base", c), ("base + cubic", replace(c, accel_residual=(t, left)))]
    output, _, _ = plots.overlay(both, theme="dark").axes
    names = [text.get_text() for text in output.get_legend().get_texts()]
    assert [name.partition(",")[0] for name in names] == ["measured", "base", "base + cubic", "largest residual"]
    (shade,) = output.patches
    assert shade.get_x() <= t[300] < t[309] <= shade.get_x() + shade.get_width()
    with pytest.raises(ValueError, match="at least one comparison"):
        plots.overlay([])


def test_the_overlay_of_a_short_record_says_so():
    empty = (np.empty(0), np.empty(0))
    figure = plots.overlay(a_comparison(accel_residual=empty, measured=np.empty(0)))
    assert "too short for a residual below 12.5 Hz" in texts(figure).replace("\n", " ")
    assert "too short for a fit in percent" in texts(figure)


def test_band_of_the_simulation_is_two_standard_deviations():
    c = a_comparison()
    _, bottom = plots.simulated(c).axes
    edges = [line for line in bottom.get_lines() if line.get_color() == style.LIGHT.style("band").colour]
    reach = [drawn(line)[1] for line in edges]
    np.testing.assert_allclose(reach, [-2e3 * c.simulated_std, 2e3 * c.simulated_std], rtol=1e-14)  # three products


def test_the_growing_band_does_not_size_the_axis_of_the_motion(fitted):
    _, _, c = fitted
    top, _ = plots.simulated(c).axes
    low, high = top.get_ylim()
    assert low <= 1e3 * c.simulated[2].min()
    assert 1e3 * c.simulated[2].max() <= high < 1e3 * (c.simulated[2] + 2 * c.simulated_std).max()


def test_coasting_curves_are_the_rms_values_and_none_is_absent():
    c = a_comparison()
    (axes,) = plots.coasting(c).axes
    expected = {
        "bias of this run re-estimated": c.coast_rms,
        "all parameters from the fit": c.coast_frozen_rms,
        "noise floor": c.coast_floor,
    }
    assert set(lines(axes)) == set(expected)
    for name, values in expected.items():
        x, y = drawn(lines(axes)[name])
        np.testing.assert_array_equal(x, [1.0, 5.0])
        np.testing.assert_allclose(y, [1e3 * values[1.0], 1e3 * values[5.0]], rtol=1e-15)
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["1\n200 starts", "5\n1 start"]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")


def test_a_record_too_short_to_coast_gets_a_sentence_and_no_curve():
    figure = plots.coasting(a_comparison(**SHORT))
    assert not figure.axes[0].get_lines()
    assert "too short for a drift over 1 s" in texts(figure).replace("\n", " ")


def test_one_step_residuals_and_band_are_those_of_the_comparison():
    c = a_comparison()
    figure = plots.one_step(c)
    (axes,) = figure.axes
    np.testing.assert_allclose(drawn(lines(axes)["residual"])[1], c.residual[1] * 1e6, rtol=1e-15)
    edges = [drawn(line)[1] for line in axes.get_lines() if line.get_color() == style.LIGHT.style("band").colour]
    np.testing.assert_allclose(edges, [np.full(N, -1.96), np.full(N, 1.96)], rtol=1e-14)
    inside = 100.0 * np.mean(np.abs(c.residual[1]) <= 1.96e-6)
    assert f"{inside:.1f} % of 600 inside the 95 % band" in texts(figure)


def test_a_start_transient_does_not_size_the_axis_and_is_counted():
    c = a_comparison()
    std, e = c.residual_std.copy(), c.residual[1].copy()
    std[0], e[0] = 1.0, 0.3
    figure = plots.one_step(replace(c, residual=(c.residual[0], e), residual_std=std))
    assert figure.axes[0].get_ylim()[1] < 10.0
    assert "1 reading beyond the axis" in texts(figure)


def test_imposed_band_is_said():
    for draw in (plots.one_step, plots.histogram):
        assert "not valid" in texts(draw(a_comparison(nis=None))).replace("\n", " ")
        assert "not valid" not in texts(draw(a_comparison())).replace("\n", " ")


def test_regions_come_in_order_of_what_they_explain_with_their_means():
    c = a_comparison()
    figure = regions(c)
    assert [panel.x.label for panel in figure.panels] == ["acceleration (m/s²)", "velocity (m/s)", "frequency (Hz)"]
    assert [panel.y.label for panel in figure.panels] == ["mean residual (mm/s²)"] * 2 + ["density / predicted (1)"]
    by_name = {item.variable: item for item in c.bins}
    for panel, variable, factor in zip(figure.panels[1:], ("velocity", "frequency"), (1e3, 1.0), strict=True):
        (line,) = marks_of(panel, Line)
        np.testing.assert_allclose(line.y, factor * by_name[variable].mean, rtol=1e-15)


def test_a_bin_without_a_standard_deviation_is_not_drawn():
    acceleration = visible_axes(plots.regions(a_comparison()))[0]
    assert np.isnan(lines(acceleration)["residual"].get_ydata()).tolist() == [False, True, False]


def test_band_of_a_region_lies_about_zero_and_of_frequency_about_one():
    shown = visible_axes(plots.regions(a_comparison()))
    for axes, low, high in ((shown[1], -2.0, 2.0), (shown[2], 0.8, 1.2)):
        y = axes.collections[0].get_paths()[0].vertices[:, 1]
        assert (y.min(), y.max()) == pytest.approx((low, high), rel=1e-12)  # a few products


def test_accelerometer_residual_and_its_rms():
    c = a_comparison()
    (axes,) = plots.accel_residual(c).axes
    np.testing.assert_allclose(drawn(lines(axes)["output − model"])[1], 1e3 * c.accel_residual[1], rtol=1e-15)
    assert lines(axes)["± rms"].get_ydata()[0] == pytest.approx(20.0, rel=1e-15)
    assert axes.get_ylabel() == "accelerometer residual (mm/s²)"


def test_histogram_is_a_density_of_all_residuals():
    c = a_comparison()
    left, right = histogram(c).panels
    (steps,) = marks_of(left, Band)
    assert np.trapezoid(steps.high, steps.x) == pytest.approx(1.0, rel=1e-12)  # none of 600 beyond 5 sigma
    assert not steps.low.any()
    (points,) = marks_of(right, Points)
    np.testing.assert_array_equal(points.y, np.sort(c.normalised[1]))


def test_quantiles_of_a_long_record_keep_both_ends():
    y = np.random.default_rng(1).standard_normal(100_000)
    expected, sample = normal_quantiles(y)
    assert len(sample) < 7000
    np.testing.assert_array_equal(sample[:2000], np.sort(y)[:2000])
    np.testing.assert_array_equal(sample[-2000:], np.sort(y)[-2000:])
    assert np.abs(expected - sample)[1000:-1000].max() < 0.05  # Kolmogorov bound 1.95/sqrt(n) over density at 2.3 sigma


def test_autocorrelation_is_that_of_the_residuals():
    c = a_comparison()
    (panel,) = autocorrelation(c).panels
    y = c.normalised[1]
    (points,) = marks_of(panel, Points)
    np.testing.assert_array_equal(points.x, np.arange(1, 41))
    full = np.correlate(y, y, mode="full")[len(y) - 1 :]
    np.testing.assert_allclose(points.y, full[1:41] / full[0], rtol=0, atol=1e-13)  # 600 products of order 1
    assert panel.x.label == "lag (readings)"


def test_parameters_are_drawn_over_their_typical_size(fitted):
    _, result, _ = fitted
    axes = plots.parameters(result).axes[0]
    estimated, fixed = axes.containers
    x = estimated.lines[0].get_xdata()
    scales = {"bias": 0.1, "scale_factor": 0.01, "time_offset": 1e-4, "cubic": 1e-5}
    np.testing.assert_allclose(x, [result[name].value / scale for name, scale in scales.items()], rtol=1e-15)
    half = [np.ptp(path.vertices[:, 0]) / 2.0 for path in estimated.lines[2][0].get_paths()]
    expected = [2.0 * result[name].std / scale for name, scale in scales.items()]
    np.testing.assert_allclose(half, expected, rtol=1e-9)  # a difference of the two ends
    assert fixed.lines[0].get_xdata().tolist() == [0.0]
    assert not fixed.lines[2]
    labels = [tick.get_text() for tick in axes.get_yticklabels()]
    assert labels == ["K0  bias", "k  scale factor", "t0  time offset", "K2  quadratic", "K3  cubic"]
    assert "(fixed)" in texts(axes.figure)
    assert "m/s²" in texts(axes.figure)


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.0123456, 0.000021, "0.012346(21)"),
        (-7.4123, 1.7, "−7.4(17)"),
        (1.2345e-5, 2.1e-7, "1.234(21)e−5"),
        (3e-6, 3.1e-5, "0.3(31)e−5"),
        (0.05, 0.000999, "0.0500(10)"),
        (1234.5, 220.0, "1230(220)"),
        (0.5, 0.0, "0.5"),
    ],
)
def test_concise_notation(value, std, text):
    assert concise(value, std) == text


# Thinning


def test_thinning_keeps_least_and_largest_of_every_column():
    rng = np.random.default_rng(2)
    t = np.sort(rng.uniform(0.0, 60.0, 50_000))
    y = rng.standard_normal(50_000)
    some = thin(t, y, columns=100)
    assert len(some[0]) == len(some[1]) <= 200
    assert np.all(np.diff(some[0]) > 0.0)
    edges = np.linspace(t[0], t[-1], 101)
    for low, high in itertools.pairwise(edges):
        full, remaining = (v[(s > low) & (s < high)] for s, v in ((t, y), some))
        assert (remaining.min(), remaining.max()) == (full.min(), full.max())


def test_a_single_spike_survives_in_a_figure_and_the_thinning_is_said():
    n = 400_000
    c = a_comparison(n=n)
    c.residual[1][123_457] = 9e-6
    figure = plots.one_step(c)
    x, y = drawn(lines(figure.axes[0])["residual"])
    assert y[np.argmin(np.abs(x - 1234.57))] == pytest.approx(9.0, rel=1e-15)
    assert y.min() == 1e6 * c.residual[1].min()
    assert "4 000 of 400 000 points shown" in texts(figure)


def test_a_short_record_is_not_thinned_and_nothing_is_said():
    assert "points shown" not in texts(plots.one_step(a_comparison()))


def test_statistics_come_from_the_full_data():
    c = a_comparison(n=400_000)
    labels = texts(plots.histogram(c))
    assert f"{np.std(c.normalised[1]):.3f}" in labels


def test_a_hole_in_the_record_is_a_break_in_the_line():
    c = a_comparison()
    keep = np.r_[0:200, 400:N]
    t = c.residual[0][keep]
    figure = plots.one_step(replace(c, residual=(t, c.residual[1][keep]), residual_std=c.residual_std[keep]))
    x = np.asarray(lines(figure.axes[0])["residual"].get_xdata())
    assert np.flatnonzero(np.isnan(x)).tolist() == [200]


# Looks


def every_figure(fitted, theme):
    _, result, c = fitted
    of_comparison = (
        plots.simulated,
        plots.coasting,
        plots.one_step,
        plots.regions,
        plots.accel_residual,
        plots.histogram,
        plots.autocorrelation,
    )
    yield from (draw(c, theme=theme) for draw in of_comparison)
    yield plots.parameters(result, theme=theme)
    yield plots.nonlinearity(result, theme=theme)
    yield plots.overview(result, c, theme=theme)


def test_every_axis_title_carries_a_unit(fitted):
    for figure in every_figure(fitted, "light"):
        for axes in visible_axes(figure):
            shared = axes.get_shared_x_axes().get_siblings(axes)
            assert any(a.get_xlabel().endswith(")") for a in shared), axes.get_ylabel()
            named = [tick.get_text() for tick in axes.get_yticklabels()]
            assert axes.get_ylabel().endswith(")") or "K0  bias" in named, axes.get_xlabel()


def test_no_text_leaves_the_page_or_covers_another(fitted):
    for figure in every_figure(fitted, "light"):
        figure.draw_without_rendering()
        boxes = [(item.get_text(), item.get_window_extent()) for item in seen_texts(figure)]
        page = figure.bbox
        for text, box in boxes:
            assert page.x0 - 1 < box.x0 < box.x1 < page.x1 + 1, text
            assert page.y0 - 1 < box.y0 < box.y1 < page.y1 + 1, text
        for (first, a), (two, b) in itertools.combinations(boxes, 2):
            width = min(a.x1, b.x1) - max(a.x0, b.x0)
            height = min(a.y1, b.y1) - max(a.y0, b.y0)
            assert width <= 1.0 or height <= 3.0, (first, two)  # pixels; boxes may touch by the descent of a letter


def seen_texts(figure):
    """Every text that is drawn; of tick labels those inside the limits of their axis."""
    from matplotlib.axis import Tick
    from matplotlib.text import Text

    of_ticks = {label for tick in figure.findobj(Tick) for label in (tick.label1, tick.label2)}
    hidden = {text for axes in figure.axes if not axes.get_visible() for text in axes.findobj(Text)}
    texts = [text for text in figure.findobj(Text) if text not in of_ticks | hidden]
    for axes in visible_axes(figure):
        for place, axis in enumerate((axes.xaxis, axes.yaxis)):
            low, high = sorted(axis.get_view_interval())
            texts += [label for label in axis.get_ticklabels() if low <= label.get_position()[place] <= high]
    return [text for text in texts if text.get_visible() and text.get_text().strip()]


def test_dark_and_light_differ_and_say_the_same(fitted):
    for light, dark in zip(every_figure(fitted, "light"), every_figure(fitted, "dark"), strict=True):
        assert light.get_facecolor() != dark.get_facecolor()
        assert texts(light) == texts(dark)
        for a, b in zip(light.axes, dark.axes, strict=True):
            for first, two in zip(a.get_lines(), b.get_lines(), strict=True):
                np.testing.assert_array_equal(first.get_xydata(), two.get_xydata())


def contrast(a, b):
    """Return the contrast ratio of two colours (WCAG 2, relative luminance)."""
    channels = [np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0 for c in (a, b)]
    linear = [np.where(c <= 0.03928, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) for c in channels]
    dim, bright = sorted(float(c @ [0.2126, 0.7152, 0.0722]) for c in linear)
    return (bright + 0.05) / (dim + 0.05)


@pytest.mark.parametrize("theme", style.THEMES.values(), ids=style.THEMES)
def test_curves_differ_in_two_cues_and_stand_out_from_the_page(theme):
    curves = [theme.style(role) for role in ("measured", "model", "other", "floor")]
    for part in ("colour", "line", "marker"):
        assert len({getattr(look, part) for look in curves}) == len(curves)
    for look in curves:
        assert contrast(look.colour, theme.page) >= 3.0  # WCAG 1.4.11, graphical objects
        assert look.colour in {*style.OKABE_ITO.values(), "#FFFFFF"}
    assert contrast(theme.ink, theme.page) >= 7.0  # WCAG 1.4.6, text


def test_a_figure_is_drawn_into_a_part_of_another(tmp_path):
    from matplotlib.figure import Figure

    page, evaluation = Figure(figsize=(12.0, 4.0), layout="constrained"), a_comparison()
    left, right = page.subfigures(1, 2)
    assert plots.coasting(evaluation, into=left) is page
    plots.histogram(evaluation, into=right)
    alone = plots.coasting(evaluation).axes[0]
    assert [line.get_label() for line in left.axes[0].lines] == [line.get_label() for line in alone.lines]
    assert len(page.axes) == len(left.axes) + len(right.axes)
    page.savefig(tmp_path / "page.png")
    with pytest.raises(TypeError, match="into is an Axes; expected a figure of matplotlib, or one of its subfigures"):
        plots.coasting(evaluation, into=page.axes[0])


def test_unknown_theme_is_named():
    with pytest.raises(ValueError, match="there is no theme 'sepia'; choose one of light, dark"):
        plots.coasting(a_comparison(), theme="sepia")


@pytest.mark.parametrize(
    ("unit", "value", "factor", "shown"),
    [
        ("m", 0.02, 1e3, "mm"),
        ("m", 3.0, 1.0, "m"),
        ("m", 4e-9, 1e9, "nm"),
        ("m/s²", 2e-3, 1e3, "mm/s²"),
        ("K", 2e-3, 1.0, "K"),
        ("m", 0.0, 1.0, "m"),
        ("m", np.nan, 1.0, "m"),
    ],
)
def test_prefixes(unit, value, factor, shown):
    assert formatting.prefixed(unit, value) == (factor, shown)


@pytest.mark.parametrize(
    ("unit", "shown"), [("m/s^2", "a (m/s²)"), ("degC", "a (°C)"), ("1", "a (1)"), ("", "a (no unit given)")]
)
def test_titles_of_axes_say_the_unit_or_that_there_is_none(unit, shown):
    assert formatting.label("a", unit) == shown


# Pages and files


def test_overview_says_the_numbers(fitted):
    _, result, c = fitted
    words = texts(plots.overview(result, c)).replace("\n", " ")
    assert summary_sentence(result, c) in words
    for number in (c.one_step_rms, c.coast_rms[1.0], c.coast_floor[1.0], c.simulated_rms):
        assert formatting.length(number) in words
    assert c.worst in words


def test_overview_of_a_short_record_claims_no_drift(fitted):
    _, result, _ = fitted
    assert "unaided drift: the record is too short" in summary_sentence(result, a_comparison(**SHORT))


def test_a_comparison_without_bins_or_residual_is_drawn_as_sentences(fitted):
    _, result, _ = fitted
    empty = a_comparison(n=6, **SHORT, bins=(), accel_residual=(np.empty(0), np.empty(0)), accel_rms=float("nan"))
    assert "too short" in texts(plots.regions(empty)).replace("\n", " ")
    assert "too short" in texts(plots.accel_residual(empty)).replace("\n", " ")
    assert "nan" not in texts(plots.accel_residual(empty))
    plots.overview(result, empty)
    plots.histogram(empty)
    plots.autocorrelation(empty)


def test_write_makes_every_file_whole_and_again_the_same(fitted, tmp_path):
    record, result, _ = fitted
    c = a_comparison()
    names = [
        *("overview", "overlay", "simulated", "coasting", "one_step", "regions", "accel_residual"),
        *("histogram", "autocorrelation", "parameters", "nonlinearity"),
    ]
    written = plots.write(alone(result, c), tmp_path / "new" / "figures")
    assert written == [tmp_path / "new" / "figures" / f"{name}.{kind}" for name in names for kind in ("png", "svg")]
    assert sorted(written) == sorted((tmp_path / "new" / "figures").iterdir())
    for path in written:
        head = path.read_bytes()[:200]
        assert head.startswith(b"\x89PNG") if path.suffix == ".png" else b"<?xml" in head
    two = verbs.compare([result, result], record)
    first, again = ([p.read_bytes() for p in plots.write(two, tmp_path) if p.suffix == ".png"] for _ in range(2))
    assert first == again
    dark = plots.write(two, tmp_path, theme="dark")
    assert [path.name for path in dark[:2]] == ["overlay-dark.png", "overlay-dark.svg"]
    assert dark[0].read_bytes() != first[0]


def test_a_width_of_eight_inches_is_1280_pixels(tmp_path):
    from matplotlib.image import imread

    save(plots.coasting(a_comparison()), tmp_path / "c.png")
    assert imread(tmp_path / "c.png").shape[1] == 1280


def test_long_traces_are_rasterised_in_svg(tmp_path):
    save(plots.one_step(a_comparison(n=50_000)), tmp_path / "e.svg")
    text = (tmp_path / "e.svg").read_text()
    assert "<image" in text
    assert len(text) < 400_000


# Import


def test_missing_matplotlib_is_one_sentence(monkeypatch, tmp_path, fitted):
    _, result, _ = fitted
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.split(".")[0] == "matplotlib":
            raise ModuleNotFoundError(f"No module named {name!r}")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(plots.MissingExtra) as raised:
        plots.coasting(a_comparison())
    assert str(raised.value) == 'figures need matplotlib; install it with: pip install "accelcal[plot]"'
    with pytest.raises(plots.MissingExtra):
        plots.write(alone(result, a_comparison()), tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_matplotlib_is_not_imported_before_a_figure_is_drawn():
    code = "import sys, accelcal.plots, accelcal.plots.figure; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_pyplot_is_never_imported():
    code = (
        "import sys, accelcal.plots.matplotlib as s, pathlib, tempfile; from accelcal.plots.figure import DARK;"
        "s.save(s.new_figure(2, 2, DARK), pathlib.Path(tempfile.mkdtemp(), 'x.png'));"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(("share", "text"), [(-1e-6, "no change"), (-0.2, "error rises"), (0.4, "40 % of its power")])
def test_what_no_number_of_a_table_shows_is_no_rise(share, text):
    compared = SimpleNamespace(shares=(None, share), at_floor=(False, False))
    assert share_text(compared, 1).startswith(text)
