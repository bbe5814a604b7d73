"""What stands in a terminal: whole numbers in narrow windows, units, digits that the uncertainty supports."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given, strategies as st

import accelcal as ac
from accelcal.cli import app
from accelcal.cli.common import show_table
from accelcal.cli.overwriting import Writing, writing
from accelcal.cli.printing import show_fit, show_improvement
from accelcal.estimation.estimate import estimate
from accelcal.results.table import as_sentence
from accelcal.results.words import interval
from accelcal.simulation import CXL02_RIG
from accelcal.verbs import improve

TRUTH = {"bias": 0.05, "cubic": 1e-3}


@pytest.fixture(scope="module")
def recording():
    rng = np.random.default_rng(21)
    return ac.simulate("interleaved", seconds=40.0, rig=CXL02_RIG, parameters=TRUTH, rng=rng).recording


@pytest.fixture(autouse=True)
def narrow(monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")


def test_a_table_that_is_wider_than_the_terminal_keeps_every_number(capsys):
    cells = [f"{k}.23456789e-0{k}" for k in range(8)]
    show_table(tuple(f"head {k}" for k in range(8)), [tuple(cells)])
    head, row = capsys.readouterr().out.splitlines()
    assert row.split() == cells
    assert head.split("  ")[0] == "head 0"


def test_a_fit_is_printed_with_units_and_the_sums_that_its_parameters_estimate(recording, capsys):
    fit = estimate(ac.Model.cubic(), recording)
    show_fit(fit, recording)
    out = capsys.readouterr().out
    for parameter in fit.estimates:
        row = next(line for line in out.splitlines() if line.startswith(parameter.name))
        assert parameter.unit == "1" or parameter.unit in row.split()
        assert "…" not in row
    assert "K0 + g0 tilt + g0 misalignment" not in out  # that of the rig, once and on request
    out = " ".join(out.split())
    assert re.search(r"Noise: [\d.]+ ± [\d.]+ µg/√Hz, encoder [\d.]+ ± [\d.]+ µm", out)


def test_a_fit_is_one_screen_and_the_rig_is_explained_on_request(recording, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    declared = dataclasses.replace(recording, rig=dataclasses.replace(recording.rig, assumptions=("it is level",)))
    fit = estimate(ac.Model.cubic(), declared)
    show_fit(fit, declared)
    brief = capsys.readouterr().out.splitlines()
    assert len(brief) <= 20  # of 24: two lines follow, what was written and the next step
    assert max(map(len, brief)) <= 100
    assert not any("it is level" in line for line in brief)
    token = writing.set(Writing(explain=True))
    show_fit(fit, declared)
    writing.reset(token)
    text = " ".join(capsys.readouterr().out.split())
    assert "Assumed: it is level." in text
    assert "K0 + g0 tilt + g0 misalignment" in text


@pytest.mark.parametrize("text", ["i.json is better", "data/a.csv: cut", "scale_step: none"])
def test_a_name_keeps_its_letters_where_a_sentence_begins_with_it(text):
    assert as_sentence(text) == f"{text}."
    assert as_sentence("drift is smaller") == "Drift is smaller."  # the sister


def moved(times, seed):
    """Record of a slow and a fast sine of known size, of a sensor with white noise."""
    rng, t = np.random.default_rng(seed), np.arange(20_000) / 1000.0
    parts = [(times * g, 2.0 * np.pi * f) for f, g in ((0.7, 0.4), (3.1, 1.6))]
    p, a = sum(-g / w**2 * np.sin(w * t) for g, w in parts), sum(g * np.sin(w * t) for g, w in parts)
    u = 0.08 + 0.988 * a + rng.normal(0.0, 0.01, t.size)
    z = p + rng.normal(0.0, 1e-7, t.size)
    return ac.Recording.from_arrays(t, u, z, units={"accel": "m/s^2", "position": "m"}, name="B.csv")


def test_motion_beyond_the_trained_range_is_one_line():
    fit = ac.fit(moved(1.0, 301))
    lines = {times: ac.compare(fit, moved(times, 302))[0].table().notes for times in (0.8, 2.5)}
    (beyond,) = [note for note in lines[2.5] if "beyond the trained range" in note]
    assert beyond.startswith("B.csv goes")
    for key in "avp":
        assert float(re.search(rf"{key} ([\d.]+)×", beyond)[1]) == pytest.approx(2.5, abs=0.15)
    assert not [note for note in lines[0.8] if "beyond" in note]  # the sister


def test_the_loop_prints_what_it_found_with_its_uncertainty(recording, capsys):
    improvement = improve(recording)
    show_improvement(improvement)
    out = capsys.readouterr().out
    assert improvement.effects[0] in " ".join(out.split())[:300]
    row = next(line for line in out.splitlines() if line.startswith(improvement.effects[0]) and "±" in line)
    assert improvement.diagnosis.fit[improvement.effects[0]].unit in row


@given(value=st.floats(-1e3, 1e3), std=st.floats(1e-6, 1e2))
def test_an_interval_is_rounded_to_two_digits_of_the_deviation(value, std):
    shown = interval(value, std).replace("−", "-")
    factor = float(f"1{shown.partition(')')[2]}") if shown.startswith("(") else 1.0
    ends = shown.partition(")")[0].lstrip("(").split(" .. ")
    assert len({len(end.partition(".")[2]) for end in ends}) == 1  # both to the same place
    low, high = (factor * float(end) for end in ends)
    last = 10.0 ** (math.floor(math.log10(std)) - 1)
    assert low == pytest.approx(value - 1.96 * std, abs=0.51 * last)
    assert high == pytest.approx(value + 1.96 * std, abs=0.51 * last)


def test_a_simulation_prints_its_true_values_with_units(tmp_path, capsys):
    with pytest.raises(SystemExit):
        app(["simulate", "-o", str(tmp_path / "run.csv"), "--seconds", "5", "--cubic", "1e-3", "--scale-factor", "0"])
    assert "true values: bias 0.05 m/s², cubic 0.001 (m/s²)⁻²" in capsys.readouterr().err
