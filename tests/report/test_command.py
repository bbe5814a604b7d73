"""`accelcal report` as a user meets it."""

import numpy as np
import pytest

import accelcal as ac
from accelcal.cli import write_recording
from accelcal.estimation.estimate import estimate
from accelcal.results import model_file
from accelcal.simulation import ADXL105_RIG
from tests.commands import accelcal
from tests.report.reading import Page


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("run")
    truth = {"bias": 0.05, "scale_factor": 0.01}
    run = ac.simulate("tones", seconds=12.0, rig=ADXL105_RIG, parameters=truth, rng=np.random.default_rng(1))
    write_recording(run.recording, path / "run.csv")
    model_file.save(estimate(ac.Model.linear(), ac.load(path / "run.csv")), path / "m.json")
    return path


def test_report_writes_page_and_paper(folder):
    done = accelcal("report", "m.json", "run.csv", "--light", "--pdf", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    page = Page((folder / "run.html").read_text(encoding="utf-8"))
    assert page.count("script") == 0
    assert "accelcal report m.json run.csv --light --pdf" in page.text
    fitted = model_file.load(folder / "m.json")
    assert page.values["parameters"][::3][:3] == [e.value for e in fitted.estimates]
    assert (folder / "run.pdf").read_bytes().startswith(b"%PDF-")
    assert not list(folder.glob(".*.part"))


def test_other_endings_are_refused_before_any_work(folder):
    done = accelcal("report", "m.json", "run.csv", "-o", "run.docx", cwd=folder)
    assert done.returncode == 2
    assert "ends in .html or .pdf" in done.stderr
    assert not (folder / "run.docx").exists()


def test_help_has_an_example(folder):
    done = accelcal("report", "-h", cwd=folder)
    assert done.returncode == 0
    assert "accelcal report m.json run12.csv --holdout run13.csv" in " ".join(done.stdout.replace("│", " ").split())


def test_two_calibrations_are_compared(folder):
    model_file.save(estimate(ac.Model.linear(), ac.load(folder / "run.csv"), end=6.0), folder / "n.json")
    done = accelcal("report", "m.json", "n.json", "--compare", "--pdf", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "not independent" in done.stdout
    page = Page((folder / "n.html").read_text(encoding="utf-8"))
    assert "Comparison of two calibrations: m.json and n.json" in page.text
    assert (folder / "n.pdf").read_bytes().startswith(b"%PDF-")
    refused = accelcal("report", "--compare", "m.json", "n.json", "--holdout", "run.csv", cwd=folder)
    assert refused.returncode == 2
    assert "leave out --holdout" in refused.stderr
