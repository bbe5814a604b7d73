"""Comparison with other filters: disagreement and missed bars are reported; accelcal agrees with NumPy."""

import numpy as np
import pytest

from benches.peers import ours, plain, table
from benches.peers.comparison import FUSED, TOLERANCE, Found, Result, deviation
from benches.peers.workload import WORKLOADS, Ended, draw

SAME, OTHER = TOLERANCE / 10.0, TOLERANCE * 10.0


def results_of(*results: Result) -> Found:
    return Found([Result(FUSED, "W1", SAME, 10.0), Result(FUSED, "W3", SAME, 20.0), *results], {"Eigen": "no compiler"})


@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda w: w.name)
def test_the_python_interface_agrees_with_the_reference(workload):
    given, data = workload.as_published, draw(workload, 300)
    expected = plain.follow(given, data)
    for way in (ours.record, ours.stream)[: 1 if workload.runs > 1 else 2]:
        assert deviation(way(given, data)(), *expected) < 1e-9  # both double, 300 steps


def test_another_filter_is_distinguished():
    # The sister: noise at the output instead of at the acceleration, which differs by the slope 0.99.
    workload = WORKLOADS[0]
    data = draw(workload, 300)
    ended = Ended(0.0, *plain.follow(workload.as_published, data))
    assert deviation(ended, *plain.follow(workload, data)) > 10.0 * TOLERANCE


def test_a_peer_that_disagrees_is_listed_and_has_no_time():
    text = table.markdown(results_of(Result("FilterPy 2", "W1", OTHER, 1e5)))
    assert "| FilterPy 2 | **disagrees by 1e-05** |" in text
    assert "Not installed: Eigen (no compiler)." in text


def test_bars_take_the_smallest_ratio_and_say_what_is_missed():
    text = table.markdown(results_of(Result("JAX 1", "W1", SAME, 500.0), Result("JAX 1", "W3", SAME, 400.0)))
    assert "| JAX 1 | 500 (50.0) | 400 (20.0) |" in text
    assert "| JAX, W1 W2 W3 W4 | 20.0 | 30.0 | **missed** |" in text
    assert "FilterPy" not in text  # a peer that is not here has no row


def test_the_page_is_changed_between_its_marks_alone(tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{table.START}old\n{table.END}after\n")
    monkeypatch.setattr(table, "PAGE", page)
    table.write("new\n")
    assert page.read_text() == f"before\n{table.START}\nnew\n\n{table.END}after\n"
    page.write_text("no marks\n")
    with pytest.raises(ValueError, match="put them back"):
        table.write("new\n")


def test_the_product_s_page_has_its_marks():
    text = table.PAGE.read_text(encoding="utf-8")
    assert text.count(table.START) == text.count(table.END) == 1


def test_figures_keep_three_digits():
    assert [table.figures(x) for x in (0.123, 9.876, 12.34, 123456.0)] == ["0.12", "9.88", "12.3", "123 000"]
    assert np.isnan(table.BARS[0].ratio)
