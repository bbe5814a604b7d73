"""Names of channels that no model file can hold are refused where a recording is read, by file and column."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal.data.recording import RecordingError, require_same_sensor
from accelcal.effects import side_channels
from accelcal.effects.guard import LONGEST
from accelcal.results import model_file

from .case import case_rng, cases
from .workbench import write

ODD = ["a\x1b[2J", "a\x00b", "a\rb", "a\tb", "a\x9bb", "a\u202eb", "a\u2028b", "a\ufeffb", "\x7f"]


def with_column(folder: Path, name: str) -> Path:
    """A recording with a column more, and no sidecar."""
    path = folder / "run.npz"
    t = np.linspace(0.0, 2.0, 2001)
    columns = {"t_s": t, "accel_m_per_s2": np.sin(t), "position_m": -np.sin(t), name: np.cos(t)}
    np.savez(path, **columns)
    return path


@pytest.mark.parametrize("name", ODD, ids=ascii)
def test_a_column_with_characters_that_are_not_shown_is_no_channel(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "run.csv", 1, 3.0)
    text = path.with_suffix(".toml").read_text()
    columns = path.read_text().partition("\n")[0].split(",")
    assert "[channels]" in text or "[channels." in text, text
    path.with_suffix(".toml").write_text(
        text.replace(
            "[channels]", f"[channels]\n{json.dumps(name)} = {{ column = {json.dumps(columns[-1])}, unit = 'V' }}", 1
        )
    )
    with pytest.raises(RecordingError, match=r"cannot be a channel: its name .* holds characters") as caught:
        io.load(path)
    message = str(caught.value)
    assert str(path) in message
    assert columns[-1] in message
    assert message.isprintable()


def test_a_name_of_a_container_is_refused_or_fits_into_a_model(tmp_path: Path) -> None:
    refused, numbers = 0, cases(12, 400)
    for number in numbers:
        rng = case_rng("channel names", number)
        letters = rng.choice(["a", "é", "标", " ", ".", "\x1b", "\u200e", "\x85", "x" * 60], int(rng.integers(1, 6)))
        path = with_column(tmp_path, f"{''.join(letters)}_V")
        try:
            recording = io.load(path)
        except RecordingError as error:
            refused += f"{path}: column" in str(error) and "cannot be a channel" in str(error)
            continue
        for effect in side_channels((c.name, c.unit) for c in recording.side.values()):
            assert len(effect.name) <= LONGEST
            assert effect.name.isprintable()
    print(f"channel names: {len(numbers)}, {refused} refused by name")
    assert refused > 0


def test_a_long_name_is_refused_by_its_length(tmp_path: Path) -> None:
    with pytest.raises(
        RecordingError, match=r'column "x+_V" cannot be a channel: .*181 characters, expected at most 180'
    ):
        io.load(with_column(tmp_path, "x" * 181 + "_V"))
    assert "x" * 180 in io.load(with_column(tmp_path, "x" * 180 + "_V")).side


@pytest.mark.parametrize("name", ["a\u2028b", "\u202eb", "a\tb"], ids=ascii)
def test_a_sensor_of_any_name_is_that_of_its_model(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "run.csv", 1, 3.0)
    declared = path.with_suffix(".toml").read_text()
    recordings = []
    for serial in (name, f"{name}2"):
        path.with_suffix(".toml").write_text(declared.replace("[sensor]", f"[sensor]\nserial = {json.dumps(serial)}"))
        recordings.append(io.load(path))
        assert recordings[-1].rig.sensor.serial == serial
    model_file.save(ac.fit(recordings[0], ac.Model.linear()), tmp_path / "m.json")
    stored = model_file.load(tmp_path / "m.json")
    require_same_sensor(recordings[0], stored.rig, "the model")
    with pytest.raises(RecordingError, match="expected one sensor"):  # the twin: another sensor
        require_same_sensor(recordings[1], stored.rig, "the model")
