"""The section on the frequency response: there where the motion is steps of sines, the same on page and paper."""

import json

import numpy as np
import pytest

import accelcal as ac
from accelcal import report
from accelcal.estimation.estimate import estimate
from accelcal.plots.response import RESPONSE_HEAD, response_rows
from accelcal.report.page import paper
from accelcal.response import frequency_response
from accelcal.simulation.motion import sine_steps
from tests.report.reading import Page


@pytest.fixture(scope="module")
def shaken():
    """Return the report of a run of steps of sines."""
    motion = sine_steps([8.0, 15.0, 30.0, 60.0], 5.0, 3.0)
    rig = ac.Rig(sensor=ac.Sensor(noise=1e-3, range=50.0))
    truth = {"scale_factor": 0.01, "time_offset": 1e-4}
    rng = np.random.default_rng(4)
    simulation = ac.simulate(motion, seconds=motion.seconds, rig=rig, parameters=truth, rng=rng, position_noise=1e-8)
    run = simulation.recording
    return report.gather(estimate(ac.Model.linear(), run), run)


def test_the_section_has_figure_table_fits_and_cross_check(shaken):
    page = Page(report.html(shaken))
    ids = [attributes.get("id") for tag, attributes in page.elements]
    assert "response" in ids
    assert "figure-sensitivity" in ids
    response = frequency_response(shaken.recording)
    for row in response_rows(response):
        for cell in row:
            assert cell in page.text
    assert "gain and delay" in page.text
    assert "not separated" not in page.text or "one class here" in page.text
    assert "Time-domain fit: 1 + k = 1.0" in page.text
    assert "Amplitude linearity" in page.text
    assert page.outside() == []


def test_page_and_paper_say_the_same(shaken, tmp_path):
    texts, drawn = paper(shaken)
    assert "sensitivity.svg" in drawn
    page = Page(report.light(shaken)).text
    shown = texts["response"]
    for text in (
        *shown["sentences"],
        *RESPONSE_HEAD,
        shown["note"],
        *(cell for row in shown["fits"]["rows"] for cell in row),
    ):
        assert " ".join(text.split()) in page
    json.dumps(shown, allow_nan=False)
    report.pdf(shaken, tmp_path / "report.page")
    assert (tmp_path / "report.page").read_bytes().startswith(b"%PDF")


def test_other_motions_have_no_such_section(complete):
    assert complete.response is None
    assert "Frequency response" not in Page(report.light(complete)).text
    assert paper(complete)[0]["response"] is None
