"""Recordings for the workbench: one with a hidden cubic, one where nothing is missing, and files nobody understands."""

import numpy as np
import pytest

import accelcal as ac
from accelcal import io
from accelcal.simulation.sensor import Vibration

TRUTH = {"bias": 0.05, "scale_factor": 0.01}


def write(path, seed, seconds=40.0, vibration=None, **more):
    """Write a simulated run with its sidecar."""
    made = ac.simulate(
        "interleaved",
        seconds=seconds,
        rig=ac.CXL02_RIG,
        parameters=TRUTH | more,
        rng=np.random.default_rng(seed),
        vibration=vibration,
    ).recording
    io.write_sidecar(made.rig, io.write_csv(made, path), io.sidecar_of(path))
    return path


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """Return the folder of all files."""
    folder = tmp_path_factory.mktemp("files")
    write(folder / "cubic.csv", 21, cubic=4e-3)
    write(folder / "other.csv", 22, cubic=4e-3)
    write(folder / "null.csv", 23)
    write(folder / "shaken.csv", 25, vibration=Vibration(0.5))
    write(folder / "long.csv", 24, seconds=200.0, cubic=1e-3)
    (folder / "bad.csv").write_text("t_s,accel_g,position_mm\n0.0,0.1,0.0\n0.1,x,1.0\n0.2,0.1,1.0\n")
    (folder / "binary.csv").write_bytes(bytes(range(256)) * 10)
    made = io.load(folder / "other.csv")
    t, y = made.position.t, made.position.y
    u = np.interp(t, made.accel.t, made.accel.y)
    rows = "\n".join(f"{a:.6f},{b:.8g},{c:.9g}" for a, b, c in zip(t, u, 1e3 * y, strict=True))
    (folder / "odd.csv").write_text(f"stamp,sensor,scale\n{rows}\n")
    return folder
