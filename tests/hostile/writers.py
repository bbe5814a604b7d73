"""Every command that writes, on small recordings: what it is called with, and which files it makes."""

from __future__ import annotations

import io
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import parquet

import accelcal as ac
from accelcal.cli import write_recording
from accelcal.estimation.estimate import estimate
from accelcal.results import model_file
from accelcal.simulation import ADXL105_RIG, CXL02_RIG
from accelcal.simulation.motion import Motion, Tones

PLOTS = tuple(
    f"plots/{name}.{kind}"
    for name in (
        *("overview", "overlay", "simulated", "coasting", "one_step", "regions", "accel_residual", "histogram"),
        *("autocorrelation", "parameters", "nonlinearity"),
    )
    for kind in ("png", "svg")
)


@dataclass(frozen=True)
class Writer:
    """A command with its outputs, which appear together or, where that is not promised, each by itself."""

    arguments: tuple[str, ...]
    outputs: tuple[str, ...]
    together: bool = True
    grows: bool = False
    """Whether what is written before an interruption stays: the first rows of a recording."""
    heavy: bool = False
    """Takes more than some seconds: not in the slice."""


def _plan() -> tuple[str, ...]:
    return ("plan", "--effects", "cubic", "--stroke", "0.2 m", "--vmax", "0.1 m/s", "--amax", "20 m/s^2")


WRITERS: Mapping[str, Writer] = {
    "simulate": Writer(("simulate", "--seconds", "5", "-o", "made.csv"), ("made.csv", "made.toml")),
    "cut": Writer(("cut", "run.csv", "--only", "1:9", "-o", "part.parquet"), ("part.parquet", "part.toml")),
    "init": Writer(("init", "bare.csv"), ("bare.toml",)),
    "fit": Writer(("fit", "run.csv", "-o", "made.json"), ("made.json",)),
    "live": Writer(
        ("live", "--file", "run.csv", "--rig", "run.toml", "-o", "got.parquet"),
        ("got.parquet", "got.toml"),
        together=False,
        grows=True,
    ),
    "freeze": Writer(("freeze", "m.json", "run.csv", "--at", "bias=0.05", "-o", "held.json"), ("held.json",)),
    "export": Writer(("export", "m.json", "--c", "a.h", "--rust", "a.rs", "--dcc", "a.xml"), ("a.h", "a.rs", "a.xml")),
    "dwells": Writer(
        ("dwells", "tumble.csv", "--least", "1 s", "--yes", "-o", "rests.csv"), ("rests.csv", "rests.toml")
    ),
    "add": Writer(("add", "m.json", "run.csv", "--effect", "cubic", "-o", "cubic.json"), ("cubic.json",)),
    "drop": Writer(("drop", "m2.json", "run.csv", "--effect", "cubic", "-o", "less.json"), ("less.json",), heavy=True),
    "compare": Writer(
        ("compare", "m.json", "other.csv", "-o", "seen.json", "--plots", "plots"), ("seen.json", *PLOTS), heavy=True
    ),
    "diagnose": Writer(("diagnose", "m.json", "run.csv", "-o", "found.json"), ("found.json",), heavy=True),
    "improve": Writer(
        ("improve", "run.csv", "--holdout", "other.csv", "--max-effects", "1", "-o", "best.json"),
        ("best.json",),
        heavy=True,
    ),
    "formula": Writer(
        ("formula", "m3.json", "curved.csv", "--curve", "shape_of_acceleration", "-o", "own.py"),
        ("own.py",),
        heavy=True,
    ),
    "plan": Writer((*_plan(), "--seconds", "10", "-o", "motion.csv"), ("motion.csv", "motion.toml"), heavy=True),
    "next": Writer(
        ("next", "m4.json", "tied.csv", *_plan()[3:], "--motion", "next.csv"), ("next.csv", "next.toml"), heavy=True
    ),
    "report": Writer(
        ("report", "m.json", "run.csv", "--light", "--pdf", "-o", "run.html"), ("run.html", "run.pdf"), heavy=True
    ),
    "demo": Writer(
        ("demo", "-o", "demo"),
        tuple(
            f"demo/{name}"
            for name in (
                "run1.csv",
                "run1.toml",
                "run2.csv",
                "run2.toml",
                "m.json",
                "best.json",
                "answer.json",
                "demo.png",
            )
        ),
        together=False,
        heavy=True,
    ),
    "response": Writer(
        ("response", "shaker.csv", "--csv", "table.csv", "--dcc", "table.xml", "--figure", "table.svg"),
        ("table.csv", "table.xml", "table.svg"),
        heavy=True,
    ),
    "rest": Writer(("rest", "still.csv", "--figure", "rest.svg"), ("rest.svg",), heavy=True),
    "fleet": Writer(("fleet", "sensors/a", "--workers", "2", "-o", "fleet.html"), ("fleet.html",), heavy=True),
}
"""By name of the command."""


def make_inputs(folder: Path) -> None:
    """Write what the commands read."""
    still = 0.01 * np.random.default_rng(4).standard_normal(4000)
    rows = (f"{0.01 * k:.2f},{y:.6f}" for k, y in enumerate(still.tolist()))
    (folder / "still.csv").write_text("\n".join(["t_s,accel_m/s^2", *rows]) + "\n", encoding="utf-8")
    for name, seed, cubic in (("run", 1, 0.0), ("other", 2, 0.0), ("curved", 3, 0.01)):
        truth = {"bias": 0.05, "cubic": cubic}
        rng = np.random.default_rng(seed)
        simulation = ac.simulate("tones", seconds=10.0, rig=ADXL105_RIG, parameters=truth, rng=rng)
        write_recording(simulation.recording, folder / f"{name}.csv")
        if name == "run":
            model_file.save(estimate(ac.Model.linear(), simulation.recording), folder / "m.json")
            model_file.save(estimate(ac.Model.cubic(), simulation.recording), folder / "m2.json")
        if name == "curved":
            model_file.save(estimate(ac.Model.linear(), simulation.recording), folder / "m3.json")
    rng = np.random.default_rng(4)
    steps = ac.simulate("sine_steps", seconds=20.0, rig=ADXL105_RIG, parameters={}, rng=rng)
    write_recording(steps.recording, folder / "shaker.csv")
    (folder / "bare.csv").write_bytes((folder / "other.csv").read_bytes())
    (folder / "sensors" / "a").mkdir(parents=True)
    for seed in (1, 2):
        simulation = ac.simulate(
            "tones",
            seconds=5.0,
            rig=ADXL105_RIG,
            parameters={"bias": 0.05},
            rng=np.random.default_rng(seed),
        )
        write_recording(simulation.recording, folder / "sensors" / "a" / f"r{seed}.csv")
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 20.0, 0.01)
    position = np.floor(t / 2.5)
    moving = np.where(np.mod(t, 2.5) > 2.0, 3.0 * rng.standard_normal(len(t)), 0.0)
    y = 9.8 * np.cos(0.8 * position) + 0.01 * rng.standard_normal(len(t)) + moving
    rows = "\n".join(f"{when!r},{value!r}" for when, value in zip(t.tolist(), y.tolist(), strict=True))
    (folder / "tumble.csv").write_text(f"t_s,accel_m_per_s2\n{rows}\n")
    tone = Motion((Tones(np.array([2.0 / (6.0 * np.pi) ** 2]), np.array([3.0]), np.zeros(1)),), 20.0, name="tone")
    truth, rng = {"bias": 0.05, "quadratic": 1e-3}, np.random.default_rng(1)
    tied = ac.simulate(tone, seconds=20.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
    write_recording(tied, folder / "tied.csv")
    model_file.save(estimate(ac.Model.linear(), tied), folder / "m4.json")


def is_whole(path: Path, reference: bytes, *, grows: bool = False) -> bool:
    """Whether a file is what the command writes when nothing interrupts it, but for dates; of one that grows a part."""
    content = path.read_bytes()
    if grows and path.suffix == ".parquet":
        return is_beginning(content, reference)
    try:
        match path.suffix:
            case ".json":
                return bool(json.loads(content))
            case ".toml":
                return bool(tomllib.loads(content.decode()))
    except ValueError:
        return False
    endings = {".html": b"</html>", ".pdf": b"%%EOF", ".png": b"IEND\xaeB`\x82", ".svg": b"</svg>"}
    if path.suffix in endings:
        return content.rstrip(b"\n").endswith(endings[path.suffix])
    return content == reference


def is_beginning(content: bytes, reference: bytes) -> bool:
    """Whether a Parquet file holds the first rows of another."""
    try:
        some, every = (parquet.ParquetFile(io.BytesIO(item)).read() for item in (content, reference))
    except pa.ArrowInvalid:
        return False
    return some.num_rows > 0 and bool(some.equals(every.slice(0, some.num_rows)))
