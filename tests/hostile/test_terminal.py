"""Names and sentences with escapes: shown in a terminal, in JSON and in model files, never obeyed."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal._support.errors import OBEYED, visible
from accelcal.cli import common
from accelcal.cli.common import say, say_line, show_table
from accelcal.cli.printing import show_comparison, show_fit
from accelcal.data.rig import Sensor
from accelcal.results import json as results_json, model_file
from accelcal.verbs import compare

from .model_files import bases, enter_own_effect, record

HOSTILE = (
    "\x1b[2J\x1b]0;owned\x07",
    "\x9b31m",
    "\u202egpj.exe",
    "a\rb",
    "\x7f",
    "\u2028",
    "[/bold]",
    "[bold]x",
    ":x:",
)
"""Escapes of C0 and C1, marks of direction, and the mark-up of the library that prints."""


@pytest.mark.parametrize("text", HOSTILE)
def test_text_is_shown_and_not_obeyed(capsys, text):
    say(f"say {text}", style="bold")
    say_line(f"line {text}")
    show_table((f"head {text}", "b"), [(f"cell {text}", "1")])
    show_table(("a", "b"), [(f"cell {text}", "1")], wrapped=True)
    common.print_status(f"status {text}")
    with pytest.raises(SystemExit):
        common.exit_with(f"error {text}", 3)
    out, err = capsys.readouterr()
    assert out.count(visible(text)) == 5
    assert err.count(visible(text)) == 2
    assert not OBEYED.search(out + err)


@pytest.mark.parametrize("text", HOSTILE)
def test_names_of_a_recording_and_its_sensor_reach_no_terminal_as_escapes(capsys, tmp_path, text):
    name = f"{text}\n.csv"
    rig = replace(record().rig, sensor=Sensor(model=text, serial="x" * 10_000))
    hostile = replace(record(), name=name, rig=replace(rig, assumptions=(f"assumed {text}",)))
    fit = ac.fit(hostile)
    show_fit(fit, hostile)
    comparison = compare(fit, hostile)
    show_comparison(comparison)
    common.print_json(results_json.content(comparison))
    model_file.save(fit, tmp_path / "m.json")  # and can be read again
    again = model_file.load(tmp_path / "m.json")
    assert again.rig.sensor.model == visible(text, one_line=True)
    assert again.runs[0].name == visible(name, one_line=True)
    out, err = capsys.readouterr()
    assert not OBEYED.search(out + err)
    assert not OBEYED.search((tmp_path / "m.json").read_text())


def test_json_escapes_what_a_terminal_obeys_and_reads_the_same():
    content = {"name": "\x1b\x7f\x9b\u202e K³ µ", "values": [1.0, np.nan, np.inf]}
    text = model_file.dumps(content)
    assert not OBEYED.search(text)
    assert json.loads(text) == {"name": content["name"], "values": [1.0, None, None]}
    assert "K³ µ" in text


def test_a_fit_of_every_kind_is_written_so_that_it_can_be_read(tmp_path):
    enter_own_effect()
    for k, content in enumerate(bases()):
        fit = model_file.from_dict(content)
        model_file.save(fit, tmp_path / f"{k}.json")
        assert model_file.to_dict(model_file.load(tmp_path / f"{k}.json")) == model_file.to_dict(fit)
