"""The report holds the numbers of the API, needs nothing from elsewhere, and shows text as text."""

import builtins
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal import report
from accelcal._support.errors import MissingExtra
from accelcal.diagnosis.clean_fit import RejectedReadings
from accelcal.estimation.estimate import estimate
from accelcal.estimation.remarks import Remark
from accelcal.estimation.tracks import Path as PathOverRun
from accelcal.report.content import entries
from accelcal.report.page import script_json
from accelcal.report.view import METHOD, findings, view, volts
from accelcal.results.words import readable
from accelcal.simulation import ADXL105_RIG
from tests.report.conftest import FILE, HOSTILE
from tests.report.reading import Page


@pytest.mark.parametrize("which", ["lacking", "complete", "light"])
def test_a_page_loads_nothing_from_elsewhere(pages, which):
    page = Page(pages[which])
    assert page.count("section") == 11
    assert page.outside() == []
    policy = next(a["content"] for tag, a in page.elements if tag == "meta" and "http-equiv" in a)
    assert policy.startswith("default-src 'none'")


@pytest.mark.parametrize(
    "bad",
    [
        '<script src="https://cdn.example/p.js"></script>',
        '<link rel="stylesheet" href="//fonts.example/a.css">',
        "<style>@import 'x.css';</style>",
        "<p style='background:url(http://a.example/b.png)'>",
        '<img src="picture.png">',
    ],
)
def test_a_page_that_loads_something_is_caught(pages, bad):
    # The sister: the same check on a page with one foreign resource.
    assert len(Page(pages["complete"] + bad).outside()) == 1


def test_numbers_are_those_of_the_api(pages, lacking, complete):
    for which, content in (("lacking", lacking), ("complete", complete)):
        values = Page(pages[which]).values
        rows = np.reshape(values["parameters"][: 3 * len(content.fit.estimates)], (-1, 3))
        assert rows[:, 0].tolist() == [e.value for e in content.fit.estimates]
        assert rows[:, 1].tolist() == [e.std for e in content.fit.estimates]
        assert rows[:, 2].tolist() == [2.0 * e.std for e in content.fit.estimates]
        assert values["falling"] == list(content.nested.errors)
    combined = [x for line in complete.budget.lines for x in (line.combined, line.expanded)]
    assert Page(pages["complete"]).values["budget"] == combined
    electrical = Page(pages["complete"]).values["parameters"][-2:]
    fitted = complete.fit
    assert electrical[0] == pytest.approx(1e3 * 0.1 * (1.0 + fitted["scale_factor"].value) * 9.80665, rel=1e-14)  # mV/g
    assert electrical[1] == pytest.approx(1e3 * (2.5 + 0.1 * fitted["bias"].value), rel=1e-14)  # mV
    combined = {line.estimate.name: line.combined for line in complete.budget.lines}
    of_k, of_zero = (row["std"] for row in volts(complete))
    assert of_k == pytest.approx(1e3 * 0.1 * combined["scale_factor"] * 9.80665, rel=1e-14)
    assert of_zero == pytest.approx(1e3 * 0.1 * combined["bias"], rel=1e-14)
    assert combined["bias"] > 1.1 * fitted["bias"].std  # the declared level, which the fit does not know


def test_every_figure_is_placed_once(complete):
    t = np.linspace(0.0, 20.0, 41)
    moving = PathOverRun("scale_factor", "1", 0.01, 1e-4, 0.01, 1e-4, t, 0.01 + 1e-3 * np.sin(t), np.full(41, 1e-4))
    names = [entry.name for entry in entries(replace(complete, paths=(moving,)))]
    assert "paths" in names
    assert len(set(names)) == len(names)


def test_the_verdict_comes_first(pages, lacking):
    page = Page(pages["lacking"])
    text = page.text
    assert readable(lacking.diagnosis.sentence) in text
    assert text.index(readable(lacking.diagnosis.sentence)) < text.index("Findings")
    assert lacking.diagnosis.verdict in ("named", "tied")
    assert "cubic" in lacking.diagnosis.effects


def test_an_effect_of_the_model_has_its_significance(complete):
    (row,) = [row for row in findings(complete) if row["effect"] == "cubic"]
    estimate = complete.fit["cubic"]
    assert (row["state"], row["snr"]) == ("in the model", pytest.approx(abs(estimate.value) / estimate.std))


def test_the_method_is_the_one_of_the_fit(lacking):
    assert view(lacking)["method"] == list(METHOD)
    weak = view(replace(lacking, fit=replace(lacking.fit, method="weak")))["method"]
    assert not any("Kalman" in sentence for sentence in weak)
    assert weak[2:] == list(METHOD[2:])


def test_suspect_data_are_said_before_the_verdict(lacking):
    hit = Remark("rail_hit", "output: 3 samples hit the rail", {})
    diagnosis = replace(lacking.diagnosis, remarks=(hit,))
    text = Page(report.light(replace(lacking, diagnosis=diagnosis))).text
    assert text.index("3 samples hit the rail") < text.index(readable(diagnosis.sentence))


def test_text_from_files_is_text(pages):
    for which in ("lacking", "complete", "light"):
        page = Page(pages[which])
        assert FILE in page.text
        assert HOSTILE in page.text
        assert not [a for _, a in page.elements if any(name.startswith("on") for name in a)]
        assert not [a for tag, a in page.elements if tag == "img" and not a["src"].startswith("data:image/svg+xml")]
    plots = [a for tag, a in Page(pages["lacking"]).elements if tag == "div" and a.get("class") == "plot"]
    assert Page(pages["lacking"]).count("script") == len(plots) + 2  # their data, plotly.js, and what draws
    assert Page(pages["light"]).count("script") == 0
    assert "accelcal report <m>.json" in Page(pages["lacking"]).text


def test_no_text_ends_the_script_that_holds_it():
    hostile = {"a": "</script><script>alert(1)</script>", "b": "<!--", "c": "&amp;"}
    text = script_json(hostile)
    assert not re.search("[<>&]", text)
    assert json.loads(text) == hostile


def test_figures_show_file_text_without_markup(lacking):
    from accelcal.plots import interactive

    text = interactive.regions(lacking.diagnosis.where).to_json()
    assert "&lt;script&gt;" in text
    assert "<script>" not in text


def test_the_coverage_factor_is_spelled_out(pages):
    for which in ("lacking", "complete", "light"):
        text = Page(pages[which]).text
        assert "coverage factor 2" in text
        assert not re.search(r"\bk\s*=\s*2\b", text)


def test_the_budget_is_withheld_while_something_is_undeclared(pages):
    text = Page(pages["lacking"]).text
    assert "Withheld" in text
    for key in ("encoder_scale", "level", "misalignment"):
        assert f"uncertainty.{key}" in text
    declared = Page(pages["complete"]).text
    assert "Withheld" not in declared
    assert "level of the stage axis" in declared


def test_the_falling_error_falls_on_the_page(lacking, complete):
    for content in (lacking, complete):
        nested = content.nested
        assert nested.names == ("base", "+ cubic")
        assert nested.errors[1] < 0.6 * nested.errors[0]  # the cubic is 40 sigma; noise moves each by a tenth
        before, after = (error**2 for error in nested.errors)
        floor = nested.floor.value**2
        if nested.headline.band is not None:  # the power of noise is taken off already
            before, after, floor = *(interval.value**2 for interval in nested.intervals), 0.0
        assert nested.shares[1] == pytest.approx((before - after) / (before - floor), rel=1e-12)
    assert (lacking.lacking, complete.lacking) == (1, 0)
    assert not lacking.nested.same_run
    assert complete.nested.same_run


def test_thinned_traces_say_how_many_points_are_shown(pages, lacking):
    n = len(lacking.recording.accel)
    assert n > 4000
    assert f"4 000 of {n // 1000} {n % 1000:03d} points shown" in pages["lacking"]


def test_a_record_too_short_for_a_verdict_has_a_report(tmp_path):
    truth = {"bias": 0.05, "scale_factor": 0.01}
    run = ac.simulate("tones", seconds=0.6, rig=ADXL105_RIG, parameters=truth, rng=np.random.default_rng(6)).recording
    content = report.gather(estimate(ac.Model.linear(), run), run)
    assert content.diagnosis.verdict == "too_short"
    for text in (report.html(content), report.light(content)):
        page = Page(text)
        assert "too short for a verdict" in page.text
        assert "the record is too short to search for further effects" in page.text
        assert page.values["parameters"][0] == content.fit["bias"].value
    report.pdf(content, tmp_path / "short.pdf")
    assert (tmp_path / "short.pdf").stat().st_size > 10_000


def test_what_a_diagnosis_says_beside_its_verdict_is_on_the_page(lacking):
    rejected = RejectedReadings("run.csv", "accel", 3, 900)
    rig = replace(lacking.diagnosis.fit.rig, tolerance=1e-3)
    diagnosis = replace(lacking.diagnosis, dropped=(rejected,), fit=replace(lacking.diagnosis.fit, rig=rig))
    text = Page(report.light(replace(lacking, diagnosis=diagnosis))).text
    assert rejected.sentence in text
    assert "goes beyond the trained range: " in text
    assert "Declared tolerance 0.001 m/s², exceeded by cubic" in text
    assert "Declared tolerance" not in Page(report.light(lacking)).text


def test_page_sizes(pages):
    assert len(pages["lacking"].encode()) < 7e6
    assert len(pages["light"].encode()) < 1.25e6


def test_pdf_has_pages(lacking, tmp_path):
    path = tmp_path / "run.pdf"
    report.pdf(lacking, path)
    content = path.read_bytes()
    assert content.startswith(b"%PDF-")
    counts = [int(n) for n in re.findall(rb"/Count (\d+)", content)]
    assert max(counts) >= 3
    assert list(tmp_path.iterdir()) == [path]


def test_method_is_five_sentences(lacking):
    assert len(METHOD) == 5
    assert all(sentence.endswith(".") and sentence.count(". ") == 0 for sentence in METHOD)
    assert view(lacking)["method"] == list(METHOD)


def test_provenance_names_files_version_and_command(pages, lacking):
    text = Page(pages["lacking"]).text
    for run in (lacking.recording, lacking.holdout):
        assert run.digest in text
    from accelcal import __version__

    assert f"accelcal {__version__}" in text


@pytest.mark.parametrize(("package", "extra"), [("plotly", "report"), ("jinja2", "report"), ("typst", "pdf")])
def test_a_missing_extra_is_named(lacking, tmp_path, monkeypatch, package, extra):
    real = builtins.__import__

    def refuse(name, *rest):
        if name.split(".")[0] == package:
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    work = {"plotly": report.html, "jinja2": report.light, "typst": lambda c: report.pdf(c, tmp_path / "a.pdf")}[
        package
    ]
    with pytest.raises(MissingExtra, match=rf"pip install \"accelcal\[{extra}\]\""):
        work(lacking)
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_worked_out_is_said(lacking):
    content = replace(lacking, nested=None, power=None, track=None, applied=None, remarks=("the tracks: no motion",))
    text = Page(report.light(content)).text
    assert "the tracks: no motion" in text
    assert "cannot be inverted" in text
    assert math.isfinite(Page(report.light(content)).values["parameters"][0])
