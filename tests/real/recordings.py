"""Real recordings. They are not part of this repository: ACCELCAL_REAL_DATA names the folder that holds them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from accelcal import io
from accelcal.data.recording import Recording

HERE = Path(__file__).parent


def file_of(name: str) -> Path:
    """The file of a recording; the test is skipped where it is not at hand."""
    folder = os.environ.get("ACCELCAL_REAL_DATA")
    if not folder:
        pytest.skip("ACCELCAL_REAL_DATA is not set: real recordings are not at hand")
    ordered = sorted(Path(folder).rglob(f"{name}.csv"))
    if not ordered:
        pytest.skip(f"{name}.csv is not under {folder}")
    return ordered[0]


def recording(name: str, sidecar: str | None = None) -> Recording:
    """A recording under a sidecar of this folder, by default the one of its name."""
    return io.load(file_of(name), rig=HERE / f"{sidecar or name}.toml")
