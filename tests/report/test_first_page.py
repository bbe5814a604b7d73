"""The first page of a report: one A4 with everything that a customer needs, the same on page and paper."""

import io
import json
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest
import typst
from matplotlib import image

from accelcal.data.recording import RunLabels
from accelcal.diagnosis.findings import Confounded
from accelcal.report.page import paper, sources, typeset
from accelcal.report.view import MOST_PARAMETERS, first_page, view
from tests.report.reading import Page

A4 = 210.0 / 297.0
FILLED = 0.6
"""Least share of the height of a page that is used, but for the last one."""


@pytest.fixture(scope="module")
def labelled(complete):
    """Return a report whose recording says when, how and by whom."""
    run = replace(complete.recording, labels=RunLabels(20760.0, "holder 2", "A. Meier"))
    return replace(complete, recording=run)


@pytest.fixture(scope="module")
def sheets(lacking):
    """Return the pages of the PDF as grey images."""
    pages = typeset("paper.typ", *paper(lacking), form="png")
    return [image.imread(io.BytesIO(page))[:, :, :3].mean(axis=2) for page in pages]


def many(content):
    """Return a report with more parameters, names and remarks than a page holds."""
    more = tuple(replace(e, run=0) for e in content.fit.estimates for _ in range(20))
    runs = tuple(replace(content.fit.runs[0], name=f"a_rather_long_name_of_a_file_{i}.csv") for i in range(30))
    return replace(content, fit=replace(content.fit, estimates=more, runs=runs), shapes=())


@pytest.mark.parametrize("crowd", [False, True])
def test_the_first_page_is_one_a4(complete, crowd):
    content = many(complete) if crowd else complete
    with sources("paper.typ", *paper(content)) as settings:
        assert json.loads(typst.query(selector="<details>", field="value", **settings)) == [2]


def test_pages_are_a4_and_none_is_half_empty(sheets):
    for sheet in sheets:
        assert sheet.shape[1] / sheet.shape[0] == pytest.approx(A4, rel=2e-3)
    body = [sheet[: int(0.93 * sheet.shape[0])] for sheet in sheets[:-1]]
    used = [np.flatnonzero(part.min(axis=1) < 0.7)[-1] / part.shape[0] for part in body]
    assert min(used) > FILLED, used


def test_an_empty_page_is_caught(sheets):
    # The sister: the same measure on a page that is blank below its middle.
    sheet = sheets[0].copy()
    sheet[sheet.shape[0] // 2 :] = 1.0
    assert np.flatnonzero(sheet.min(axis=1) < 0.7)[-1] / sheet.shape[0] < FILLED


def test_there_is_one_typeface(complete):
    pdf = typeset("paper.typ", *paper(complete))
    streams = re.findall(rb"stream\r?\n(.*?)endstream", pdf, flags=re.DOTALL)
    text = pdf + b"".join(zlib.decompressobj().decompress(s) for s in streams if s.startswith(b"x"))
    names = set(re.findall(rb"/FontName\s*/\w+\+(\w+)", text))
    assert names
    assert all(name.startswith(b"DejaVuSans") and b"Mono" not in name for name in names), names


def test_page_and_paper_say_the_same(lacking, pages):
    page, shown = Page(pages["light"]), view(lacking)["page"]
    for row in shown["parameters"]:
        assert row["shown"] in page.text
        assert row["si"] in page.text
    for name, value in shown["conditions"]:
        assert f"{name} {value}" in page.text
    for sentence in (*shown["unknown"], shown["coverage"]):
        assert sentence in page.text
    assert page.values["first"] == [row["value"] for row in shown["parameters"]]


def test_conditions_are_those_of_the_recording(labelled, lacking):
    conditions = dict(first_page(labelled)["conditions"])
    assert conditions["date"] == "2026-11-03"
    assert (conditions["operator"], conditions["mounting"]) == ("A. Meier", "holder 2")
    run = labelled.recording
    assert f"{len(run.accel) // 1000} {len(run.accel) % 1000:03d} samples" in conditions["sampling"]
    assert conditions["temperature"] == "not recorded"
    assert dict(first_page(lacking)["conditions"])["operator"] == "not declared"
    digests = [entry["digest"] for entry in first_page(lacking)["files"]]
    assert digests == [lacking.recording.digest, lacking.holdout.digest]


def test_the_expanded_uncertainty_is_that_of_the_budget(complete, lacking):
    rows = {row["name"]: row for row in first_page(complete)["parameters"]}
    for line in complete.budget.lines:
        assert rows[line.estimate.name.replace("_", " ")]["expanded"] == line.expanded
    assert "coverage factor 2" in first_page(complete)["coverage"]
    alone = first_page(lacking)
    assert alone["parameters"][0]["expanded"] == 2.0 * lacking.fit["bias"].std
    assert "encoder scale, level, misalignment" in alone["coverage"]


def test_what_is_not_known_is_said(complete, lacking):
    text = " ".join(first_page(complete)["unknown"])
    for part in ("Inseparable in this set-up", "Detection limits", "temperature", "mountings and between days"):
        assert part in text
    assert "the fit has not used" in text
    assert "the fit has not used" not in " ".join(first_page(lacking)["unknown"])
    assert "Detection limits (" not in " ".join(first_page(lacking)["unknown"])
    assert "Confounded" not in " ".join(first_page(lacking)["unknown"])  # the nearest rival is far weaker
    tied = replace(lacking.diagnosis, classes=(Confounded("cubic", ("cubic", "creep"), "two amplitudes"),))
    assert "Confounded on this record: cubic, creep." in first_page(replace(lacking, diagnosis=tied))["unknown"]


def test_parameters_beyond_the_page_are_counted(complete):
    crowd = many(complete)
    shown = first_page(crowd)
    assert len(shown["parameters"]) == MOST_PARAMETERS
    assert shown["further"] == len(crowd.fit.estimates) - MOST_PARAMETERS
    assert len(shown["files"]) == 5


def test_the_conditions_name_the_reference_that_was_read(complete):
    """A velocity is no position, neither as the reference nor in what was sampled."""
    assert "position" in dict(first_page(complete)["conditions"])["sampling"]
    read = replace(complete.recording.position, name="velocity", unit="m/s")
    table = dict(first_page(replace(complete, recording=replace(complete.recording, reference=read)))["conditions"])
    assert table["reference"] == "velocity"
    assert "velocity" in table["sampling"]
    assert "position" not in table["sampling"]
    assert "position reference" not in table
