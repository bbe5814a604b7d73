"""One page on three outputs of one sensor: parameters, matrix, residuals and drift side by side, each output folded."""

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal import report
from accelcal.calibration.export import SensorMatrix
from accelcal.data import RecordingError
from accelcal.plots import matplotlib
from accelcal.plots.comparison import accel_residual, coasting, coasting_of_axes, residual_of_axes
from accelcal.report.content import AxesContent, entries
from accelcal.report.page import paper
from accelcal.report.view import view
from accelcal.results.table import as_view
from tests.estimation.triads import Triad
from tests.report.reading import Page

CUBIC = 1e-4
"""(m/s²)⁻² on y, tens of standard deviations on this record."""


@pytest.fixture(scope="module")
def axes(tmp_path_factory):
    triad = Triad(71, seconds=30.0, rate=100.0, law=lambda t, f, warm: CUBIC * f**3, hidden=1)
    return ac.load_axes(triad.write(tmp_path_factory.mktemp("triads")))


@pytest.fixture(scope="module")
def content(axes):
    """Return the content of a page on three outputs, of which y lacks a cubic."""
    content = report.gather(ac.fit(axes), axes, command="accelcal report m.json <run>.csv")
    assert isinstance(content, AxesContent)
    return content


@pytest.fixture
def undrawn(monkeypatch):
    """Let figures be defined and not drawn, which takes seconds each."""
    monkeypatch.setattr(matplotlib, "draw", lambda figure, theme="light": None)
    monkeypatch.setattr(matplotlib, "svg", lambda drawn: b"<svg/>")


def test_parameters_stand_side_by_side_and_shared_ones_once(content):
    shown = view(content)["parameters"]
    assert shown["head"] == ("parameter", "symbol", "x", "y", "z", "all outputs")
    fit = content.fit
    assert len(shown["rows"]) == len({e.name for e in fit.estimates})
    delay = next(row for row in shown["rows"] if row[0] == "time offset")
    assert delay[2:5] == ("", "", "")
    assert delay[5] != ""
    values = [value for row in shown["exact"] for value in row if value is not None]
    assert sorted(values) == sorted(e.value for e in fit.estimates)
    with pytest.raises(ac.AccelcalError, match="no table 'axes'"):  # the twin: one output has no columns
        fit.of_axis("x").table("axes")


def test_the_page_has_matrix_and_verdicts_and_folds_each_output(content, undrawn):
    text = report.light(content)
    page = Page(text)
    assert view(content)["matrix"] == as_view(SensorMatrix.of(content.fit).table())
    for axis, alone in content.by_axis.items():
        assert f"Output {axis}" in page.text
        assert f'id="verdict-{axis}"' in text
        assert view(content)["axes"][axis]["verdict"] == alone.diagnosis.verdict
    assert page.count("details") == 3
    assert text.index('id="figure-residuals"') < text.index("<details") < text.index('id="figure-overlay-x"')
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert "<run>" not in text  # a name is text
    assert Page(report.light(content.by_axis["x"])).count("details") == 0  # the twin


def test_axes_are_examined_at_one_false_alarm_rate(content, axes):
    # The cubic is tens of sigma; without one false-alarm rate over all axes each would have its own of 0.5 %.
    assert content.by_axis["y"].diagnosis.verdict in ("named", "tied")
    assert "cubic" in content.by_axis["y"].diagnosis.effects
    alone = ac.diagnose(content.fit.of_axis("x"), axes[0])
    assert content.by_axis["x"].diagnosis.alpha == pytest.approx(alone.alpha / 3.0)


def test_panels_have_one_unit_one_ordinate_and_one_band(content):
    for draw, alone in ((residual_of_axes, accel_residual), (coasting_of_axes, coasting)):
        figure = draw(content.judged)
        assert len(figure.panels) == 3
        assert len({(panel.y.unit, panel.y.range) for panel in figure.panels}) == 1
        assert [panel.title[0] for panel in figure.panels] == ["x", "y", "z"]
        apart = [alone(evaluation).panels[0] for evaluation in content.judged.values()]
        assert len({(panel.y.unit, panel.y.range) for panel in apart}) > 1 or draw is residual_of_axes  # the twin
    assert len({evaluation.band for evaluation in content.judged.values()}) == 1
    first = content.judged["x"]
    grown = replace(first, accel_residual=(first.accel_residual[0], 10.0 * first.accel_residual[1]))
    low, high = residual_of_axes({"x": first, "y": grown}).panels[0].y.range
    factor = high / (1.05 * np.abs(grown.accel_residual[1]).max())
    assert low == -high
    assert factor == pytest.approx(10.0 ** round(np.log10(factor)))  # that of a prefix
    assert residual_of_axes({"": first}).headline == accel_residual(first).headline


def test_page_and_paper_show_the_same_figures(content, undrawn):
    texts, drawn = paper(content)
    stills = [entry.name for entry in entries(content) if entry.still is not None]
    assert [figure["file"] for figure in texts["figures"]] == [f"{name}.svg" for name in stills] == list(drawn)
    assert {"residuals", "drifts", "tiles-x", "tiles-y", "tiles-z"} <= set(stills)


def test_a_held_out_recording_must_have_the_same_outputs(content, axes):
    for recordings, holdout in ((axes, axes[:2]), (axes, axes[0]), ([*axes, axes[0]], None), ([], None)):
        with pytest.raises(RecordingError, match="expected one recording with every output"):
            report.gather(content.fit, recordings, holdout=holdout)
