"""Figures of a frequency response: plain numbers in Hz, deviations with their uncertainties, where the fit fails."""

import math

import numpy as np
import pytest

from accelcal.plots import figure as style, interactive, response, sensitivity
from accelcal.plots.figure import Points
from accelcal.plots.response import FAILS, MEASURED, fit_rows, response_rows, response_sentences
from accelcal.response import FrequencyResponse, Point, fit_response

FREQUENCIES = np.geomspace(10.0, 320.0, 12)
ODD = 7
"""Number of the point that no structure describes."""


def responded(*, odd=True):
    """A low-pass and delay at exact points, one of them 0.08 % beside the curve."""
    s = 2j * math.pi * FREQUENCIES
    value = 1.02 * np.exp(-5e-5 * s) / (1.0 + s / (2.0 * math.pi * 500.0))
    if odd:
        value[ODD] *= 1.0008
    rng = np.random.default_rng(2)
    value += 1e-4 * (rng.standard_normal(12) + 1j * rng.standard_normal(12))
    points = tuple(
        Point(float(f), complex(h), 1e-4, 32.0, 5.0 + 0j, "sine", float(i), i + 1.0)
        for i, (f, h) in enumerate(zip(FREQUENCIES, value, strict=True))
    )
    return FrequencyResponse("shaker.csv", points, fit_response(points), (), None)


@pytest.fixture(scope="module")
def result():
    return responded()


def points(panel):
    """Frequency, value and uncertainty of every point of a panel, by frequency; which of them fail."""
    several = [mark for mark in panel.marks if isinstance(mark, Points)]
    x, y, error = (np.concatenate([getattr(mark, key) for mark in several]) for key in ("x", "y", "error"))
    fails = np.concatenate([np.full(len(mark.x), mark.name == FAILS) for mark in several])
    order = np.argsort(x)
    return x[order], y[order], error[order], fails[order]


def test_deviations_are_those_from_the_fit_with_the_uncertainty_of_the_point(result):
    figure = response.sensitivity(result)
    (f, size, wide, fails), (_, relative, spread, _), (_, phase, _, _), (_, turned, _, _) = map(points, figure.panels)
    fitted = result.model.best.response(f)
    np.testing.assert_allclose(relative, 100.0 * (size / np.abs(fitted) - 1.0), atol=1e-9)
    np.testing.assert_allclose(turned, phase - np.degrees(np.unwrap(np.angle(fitted))), atol=1e-9)
    np.testing.assert_allclose(spread, 100.0 * wide / np.abs(fitted))
    assert fails[ODD]
    assert f"fails at {FREQUENCIES[ODD]:.4g} Hz" in figure.headline
    assert relative[ODD] == pytest.approx(0.08, abs=0.03)
    plain = response.sensitivity(responded(odd=False))
    assert not points(plain.panels[0])[3].any()
    assert "fails at none of 12 points" in plain.headline


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_still_figure_has_plain_frequencies_and_marks_what_fails(result, theme):
    figure = sensitivity(result, theme=theme)
    figure.draw_without_rendering()
    last = figure.axes[-1]
    low, high = last.get_xlim()
    shown = [label.get_text() for label in last.get_xticklabels() if low <= label.get_position()[0] <= high]
    assert shown == ["10", "20", "50", "100", "200"]
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "magnitude (1)",
        "deviation (%)",
        "phase (°)",
        "deviation (°)",
    ]
    palette = style.theme_of(theme)
    for axes in figure.axes:
        several = {c.lines[0].get_color(): c.lines[0] for c in axes.containers}
        assert several[palette.style("other").colour].get_xdata().tolist() == [FREQUENCIES[ODD]]
        assert len(several[palette.style("model").colour].get_xdata()) == 11
    assert {MEASURED, FAILS} <= {text.get_text() for text in figure.axes[0].get_legend().get_texts()}


def test_both_kinds_of_figures_draw_the_same_numbers(result):
    still, moving = sensitivity(result), interactive.sensitivity(result)
    for row, axes in enumerate(still.axes):
        several = [t for t in moving.data if t.mode == "markers" and t.yaxis == (f"y{row + 1}" if row else "y")]
        for trace, container in zip(several, axes.containers, strict=True):
            np.testing.assert_allclose(np.asarray(trace.y, dtype=float), container.lines[0].get_ydata())


def test_one_point_alone_is_drawn_without_a_fit(result):
    alone = FrequencyResponse("shaker.csv", result.points[:1], None, (), None)
    assert len(sensitivity(alone).axes) == 2
    assert len(interactive.sensitivity(alone).data) == 2
    assert response_rows(alone)[0][-1] == ""
    assert fit_rows(alone) == []
    assert response_sentences(alone) == ["Too few points for a parametric fit."]


def test_rows_say_the_numbers_to_the_digits_of_their_uncertainty(result):
    row, point = response_rows(result)[ODD], result.points[ODD]
    assert float(row[1]) == pytest.approx(point.magnitude, abs=0.1 * point.expanded)
    assert row[6].endswith(", fails")
    assert sum("fails" in cells[6] for cells in response_rows(result)) == len(result.model.failing)
    assert fit_rows(result)[0][0] == result.model.best.structure.name
    assert fit_rows(result)[0][5] == "chosen"
    assert "It fails at" in response_sentences(result)[0]
