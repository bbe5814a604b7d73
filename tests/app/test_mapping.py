"""The mapping of columns to the parts of an orientation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal.app import mapping
from accelcal.app.mapping import Axis, Choice

UNITS = {"time": "s", "accel": "m/s^2", "position_e": "m", "position_n": "m", "position_u": "m"}
COLUMNS = ("t", "a", "e", "n", "u", "qw", "qx", "qy", "qz")


def chosen() -> list[Choice]:
    names = (*UNITS, "q_w", "q_x", "q_y", "q_z")
    return [Choice(column, name, UNITS.get(name, "")) for column, name in zip(COLUMNS, names, strict=True)]


def test_place_and_attitude_are_mapped_by_hand(tmp_path: Path) -> None:
    t = np.arange(0.0, 2.0, 0.01)
    still, along = np.zeros_like(t), 0.1 * np.sin(7.0 * t)
    rows = np.column_stack([t, -4.9 * np.sin(7.0 * t), along, still, still, 1.0 + still, still, still, still])
    path = tmp_path / "run.csv"
    lines = [",".join(COLUMNS), *(",".join(f"{x:.9g}" for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    text = mapping.sidecar_from(io.template(path), chosen(), Axis("x", "sensor to ENU"))
    path.with_suffix(".toml").write_text(text)
    recording = io.load(path)
    np.testing.assert_allclose(np.diff(recording.position.y), np.diff(along), atol=1e-6)
    assert [c.channel for c in mapping.choices(COLUMNS, text, io.template(path))] == [c.channel for c in chosen()]
    # Mapped again without a word on the axis, everything stays.
    assert mapping.sidecar_from(text, chosen()) == text


def test_a_part_of_a_quaternion_or_no_direction_is_refused() -> None:
    with pytest.raises(ac.RecordingError, match="no column is q_z; an attitude needs q_w, q_x, q_y, q_z"):
        mapping.sidecar_from("", chosen()[:-1])
    with pytest.raises(ac.RecordingError, match='input axis "0, up": expected x, y, z or three numbers'):
        mapping.sidecar_from("", chosen(), Axis("0, up", "sensor to ENU"))
    with pytest.raises(ac.RecordingError, match="say what the quaternion maps: sensor to ENU, or ENU to sensor"):
        mapping.sidecar_from("", chosen(), Axis("x"))
    made = mapping.sidecar_from("", chosen(), Axis("0, 0.6, 0.8", "sensor to ENU"))
    assert "input_axis = [0.0, 0.6, 0.8]" in made
