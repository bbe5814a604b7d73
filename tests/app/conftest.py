"""Recordings for the workbench: one with a hidden cubic, one where nothing is missing, and files nobody understands."""

import numpy as np
import pytest
from scipy.signal import lfilter

import accelcal as ac
from accelcal import io
from accelcal.data.rig import STANDARD_GRAVITY
from accelcal.simulation import CXL02_RIG
from accelcal.simulation.sensor import Vibration

TRUTH = {"bias": 0.05, "scale_factor": 0.01}


def write(path, seed, seconds=20.0, vibration=None, **more):
    """Write a simulated run with its sidecar."""
    recording = ac.simulate(
        "interleaved",
        seconds=seconds,
        rig=CXL02_RIG,
        parameters=TRUTH | more,
        rng=np.random.default_rng(seed),
        vibration=vibration,
    ).recording
    io.write_sidecar(recording.rig, io.write_csv(recording, path), io.sidecar_of(path))
    return path


def with_delay(path, cutoff=None, shift=0.0, seed=72):
    """Slow and fast sines whose output has a cubic and then passes an RC, or a clock that is ahead."""
    rng, fine = np.random.default_rng(seed), np.arange(16 * 40_000) / 32_000.0
    p, a = np.zeros_like(fine), np.zeros_like(fine)
    for f, g in ((0.4, 0.6), (1.7, 2.1), (9.3, 6.0)):
        w, phase = 2.0 * np.pi * f, rng.uniform(0.0, 6.28)
        p, a = p + g / w**2 * np.sin(w * fine + phase), a - g * np.sin(w * (fine + shift) + phase)
    u = 0.05 + 1.01 * a + 1e-3 * a**3
    if cutoff is not None:  # the trapezoidal rule at sixteen times the rate
        c = 32_000.0 / (np.pi * cutoff)
        u = lfilter([1.0, 1.0], [1.0 + c, 1.0 - c], u - u[0]) + u[0]
    t, u, p = fine[::16], u[::16] + 0.01 * rng.standard_normal(40_000), p[::16] + 1e-7 * rng.standard_normal(40_000)
    rows = "\n".join(f"{a:.5f},{b:.7f},{c:.10f}" for a, b, c in zip(t, u, p, strict=True))
    path.write_text(f"t_s,accel_m_per_s2,position_m\n{rows}\n")
    return path


SAG, TAU = -0.03, 0.4
"""Of the scale factor per m/s² of the memory of |a|, and that memory, s."""
SIDECAR = """sensor.noise = "20 ug/sqrt(Hz)"
rig.axis = "level"
[channels]
time = { column = "t", unit = "s" }
accel = { column = "accel", unit = "m/s^2" }
position = { column = "position", unit = "m", resolution = "1 um" }
"""


def sagging(path, size=SAG, seed=4711, seconds=45, rate=1000, over=8):
    """Write tones of slowly changing amplitudes, measured with a gain that falls with the last 0.4 s of |a|."""
    rng, t = np.random.default_rng(seed), np.arange(-5 * rate * over, seconds * rate * over) / (rate * over)
    a, p = np.zeros_like(t), np.zeros_like(t)
    for f in (0.6, 1.3, 2.4, 4.1):
        slow, phases, w = rng.uniform(0.02, 0.06), rng.uniform(0.0, 6.28, 2), 2.0 * np.pi * f
        p += 0.6 / w**2 * (1.0 + 0.8 * np.sin(2.0 * np.pi * slow * t + phases[0])) * np.sin(w * t + phases[1])
    a = np.gradient(np.gradient(p, t), t)
    weight = 1.0 - np.exp(-1.0 / (rate * over * TAU))
    memory = lfilter([weight], [1.0, weight - 1.0], np.abs(a))
    u, p = (0.05 + (1.004 + size * memory) * a)[5 * rate * over :: over], p[5 * rate * over :: over]
    u = u + 20e-6 * STANDARD_GRAVITY * np.sqrt(0.5 * rate) * rng.standard_normal(len(u))
    rows = (f"{k / rate:.4f},{x:.7f},{1e-6 * round(y / 1e-6):.6f}\n" for k, (x, y) in enumerate(zip(u, p, strict=True)))
    path.write_text("t,accel,position\n" + "".join(rows))
    path.with_suffix(".toml").write_text(SIDECAR)
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
    recording = io.load(folder / "other.csv")
    t, y = recording.position.t, recording.position.y
    u = np.interp(t, recording.accel.t, recording.accel.y)
    rows = "\n".join(f"{a:.6f},{b:.8g},{c:.9g}" for a, b, c in zip(t, u, 1e3 * y, strict=True))
    (folder / "odd.csv").write_text(f"stamp,sensor,scale\n{rows}\n")
    return folder


@pytest.fixture(scope="session")
def several(tmp_path_factory):
    """Return a folder with three runs of one sensor with a hidden cubic, a table of dwells of it, and sidecars."""
    folder = tmp_path_factory.mktemp("several")
    for number in range(3):
        write(folder / f"run{number}.csv", 30 + number, seconds=12.0, cubic=4e-3)
    (folder / "run1.toml").unlink()  # it has the rig of the first
    angles = np.radians(np.arange(0.0, 360.0, 45.0))
    force = STANDARD_GRAVITY * np.sin(angles)
    output = TRUTH["bias"] + (1.0 + TRUTH["scale_factor"]) * force + 4e-3 * force**3
    output += 1e-4 * np.random.default_rng(5).standard_normal(len(output))
    rows = "".join(
        f"{angle:.0f},{mean:.6f},0.01,60,6000,0\n" for angle, mean in zip(np.degrees(angles), output, strict=True)
    )
    (folder / "dwells.csv").write_text(f"attitude_deg,mean,std,duration_s,samples,group\n{rows}")
    (folder / "dwells.toml").write_text("[channels]\naccel = { column = 'mean', unit = 'm/s^2' }\n")
    return folder
