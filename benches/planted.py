"""Effects planted in real recordings: is each found in its class, and is the held-out error back where it was?

This file imports nothing of the product: motion, regression, noise and the size of what is planted are its own, and the
product is run as a user runs it, by its command line on files. Recordings are those of ACCELCAL_REAL_DATA.

    python -m benches.planted                         # every recording, effect and size
    python -m benches.planted --recording drive --effect cubic --d 20
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from benches.outcomes import Outcome, run_all

Array = NDArray[np.float64]
Table = dict[str, Array]

SIDECARS = Path("tests/real")
GRAVITY = 9.80665
SIZES = (10.0, 20.0)
EDGE = 2.0
"""Periods of the band at either end that a filter spoils."""
BACK = 1.05
"""Held-out error over that of the unplanted recording that counts as back."""
HELD_OUT = 0.3
"""Share of the record at its end that is held out."""
IN_CLASS = {
    "quadratic": {"quadratic", "odd_quadratic", "scale_asymmetry", "shape_of_acceleration", "vibration_rectification"},
    "cubic": {"cubic", "shape_of_acceleration", "saturation", "dead_zone"},
    "velocity": {"velocity", "velocity_odd", "shape_of_velocity", "coulomb", "ac_coupling", "creep"},
    "bias_step": {"bias_step", "bias_drift", "warm_up", "shape_of_time"},
    "time_offset_step": {"time_offset_step", "clock_skew"},
    "sensor_lag": {"sensor_lag", "time_offset", "encoder_lag", "sensor_resonance", "shape_of_jerk"},
    "cross_axis": {"a_x", "bnz"},
    "jerk_magnitude": {"shape_of_jerk", "unexplained"},
}
"""Names that are right for what is planted, beside its own; a cross axis goes by the name of its side channel."""


@dataclass(frozen=True, slots=True)
class Subject:
    """A real recording whose true model is known."""

    file: str
    sidecar: str
    span: tuple[float, float]
    """Part that is used, s."""
    band: tuple[float, float]
    """Where a regression has shown the model to be true, Hz."""
    output: str
    """Column of the output."""
    across: str
    """Column of another axis of the sensor; empty where none is recorded."""
    reference: str
    """How motion is found: "position", "attitude" or "gyroscope"."""


SUBJECTS = {
    "cyberdiver_ext_ret_trial1": Subject(
        "cyberdiver_ext_ret_trial1",
        "cyberdiver_ext_ret_trial1",
        (0.005, 0.185),
        (0.0, 300.0),
        "accel",
        "accel_x",
        "position",
    ),
    "cyberdiver_ext_ret_trial2": Subject(
        "cyberdiver_ext_ret_trial2",
        "cyberdiver_ext_ret_trial2",
        (0.005, 0.185),
        (0.0, 300.0),
        "accel",
        "accel_x",
        "position",
    ),
    "bpaw_e": Subject("bpaw_e", "bpaw_e", (135.0, 240.0), (0.2, 2.6), "accel", "bnz", "position"),
    "bpaw_n": Subject("bpaw_n", "bpaw_n", (135.0, 240.0), (0.2, 2.6), "accel", "bnz", "position"),
    "slow_x": Subject("broad_trial10", "turning/broad_x", (0.0, 1e3), (0.0, 10.0), "accel_x", "", "attitude"),
    "slow_z": Subject("broad_trial10", "turning/broad_z", (0.0, 1e3), (0.0, 10.0), "accel", "", "attitude"),
    "fast_x": Subject("broad_trial15", "turning/broad_x", (0.0, 1e3), (0.0, 10.0), "accel_x", "", "attitude"),
    "fast_z": Subject("broad_trial15", "turning/broad_z", (0.0, 1e3), (0.0, 10.0), "accel", "", "attitude"),
    "drive": Subject("drive", "turning/car_gyroscope", (0.0, 60.0), (0.0, 1.0), "accel", "", "gyroscope"),
}


@dataclass(frozen=True, slots=True)
class Trial:
    """One effect in one recording; without an effect the recording as it is."""

    subject: str
    effect: str
    d: float

    @property
    def key(self) -> str:
        """Identifier."""
        return f"{self.subject}/{self.effect}/{self.d:g}"


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion on the times of the output, below the band, (n,) each."""

    t: Array
    v: Array
    sensed: Array
    """Specific force along the axis, m/s²."""
    nuisances: Array
    """Columns of the true model beside specific force, (n, k)."""


@cache
def table(file: str) -> Table:
    """Columns of a recording, nan where a cell is empty."""
    ordered = sorted(Path(os.environ["ACCELCAL_REAL_DATA"]).rglob(f"{file}.csv"))
    with ordered[0].open(encoding="utf-8") as stream:
        rows = csv.reader(stream)
        names = next(rows)
        cells = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
    return dict(zip(names, cells.T, strict=True))


def uniform(t: Array, y: Array, at: Array) -> Array:
    """Samples that exist, by straight lines at other times."""
    measured = np.isfinite(y)
    return np.interp(at, t[measured], y[measured])


def low_pass(y: Array, rate: float, band: float, kind: str = "lowpass") -> Array:
    """Zero-phase Butterworth filter of samples, about the line through their ends."""
    line = np.linspace(y[0], y[-1], len(y)) if kind == "lowpass" else 0.0
    sections = scipy.signal.butter(4, band, kind, fs=rate, output="sos")
    pad = min(len(y) - 1, int(EDGE * rate / band))
    return np.asarray(scipy.signal.sosfiltfilt(sections, y - line, padlen=pad) + line)


def motion_of(subject: Subject) -> Motion:
    """Motion of a recording by splines through its reference, on a uniform grid below the band."""
    data = table(subject.file)
    t = data["t"][np.isfinite(data[subject.output])]
    t = t[(t >= subject.span[0]) & (t <= subject.span[1])]
    band = subject.band[1]
    rate = min(1.0 / float(np.median(np.diff(t))), 50.0 * band)
    grid = np.arange(t[0], t[-1], 1.0 / rate)

    def derivatives(name: str) -> tuple[Array, Array]:
        p = low_pass(uniform(data["t"], data[name], grid), rate, band)
        v = np.gradient(p, grid, edge_order=2)
        return v, low_pass(np.gradient(v, grid, edge_order=2), rate, band)

    nuisances = [np.ones_like(grid)]
    if subject.reference == "attitude":
        letter = subject.output.removeprefix("accel_") if "_" in subject.output else "z"
        axes = scipy.spatial.transform.Rotation.from_quat(
            np.column_stack([uniform(data["t"], data[f"q_{c}"], grid) for c in "xyzw"])
        ).apply(np.eye(3)["xyz".index(letter)])
        force = np.column_stack([derivatives(f"pos_{c}")[1] for c in "enu"])
        force[:, 2] += GRAVITY
        a = np.sum(axes * force, axis=1)
        v = derivatives("position" if letter == "z" else f"position_{letter}")[0]
    else:
        v, a = derivatives("position")
    if subject.reference == "gyroscope":
        for name in ("gyr_y", "gyr_z"):
            rate_of_turn = uniform(data["t"], data[name], grid)
            nuisances.append(np.cumsum(rate_of_turn - np.mean(rate_of_turn)) / rate)
        nuisances.append(grid - np.mean(grid))
    if subject.file.startswith("bpaw"):
        for name in ("bnn" if subject.file.endswith("e") else "bne",):
            nuisances.append(low_pass(uniform(data["t"], data[name], grid), rate, band))
    columns = np.column_stack([v, a, *nuisances, np.gradient(a, grid)])
    edge = int(EDGE * rate / band)
    v, a, *others = columns[edge : len(grid) - edge].T
    return Motion(grid[edge : len(grid) - edge], v, a, np.column_stack(others))


def below(subject: Subject, name: str, at: Array) -> Array:
    """A column of a recording below the band, at given times."""
    data = table(subject.file)
    grid = np.arange(subject.span[0], min(subject.span[1], data["t"][-1]), at[1] - at[0])
    rate = 1.0 / float(at[1] - at[0])
    return np.interp(at, grid, low_pass(uniform(data["t"], data[name], grid), rate, subject.band[1]))


def column(effect: str, m: Motion, across: Array) -> Array:
    """What one unit of an effect adds to the output, (n,)."""
    a = m.sensed - np.mean(m.sensed)
    jerk = m.nuisances[:, -1]
    late = m.t > m.t[0] + 0.4 * (m.t[-1] - m.t[0])
    columns: dict[str, Callable[[], Array]] = {
        "quadratic": lambda: a**2,
        "cubic": lambda: a**3,
        "velocity": lambda: m.v,
        "bias_step": lambda: late.astype(np.float64),
        "time_offset_step": lambda: -jerk * late,
        "sensor_lag": lambda: -jerk,
        "cross_axis": lambda: across,
        "jerk_magnitude": lambda: np.abs(jerk),
    }
    return columns[effect]()


def size_at(d: float, e: Array, m: Motion, output: Array, band: tuple[float, float]) -> float:
    """Coefficient at which an effect stands `d` standard deviations above the noise, everything else being estimated.

    The noise is the spectrum of what a regression on the true model leaves below the band.
    """
    rate, regressors = 1.0 / float(m.t[1] - m.t[0]), np.column_stack([m.sensed, m.nuisances])
    lag = np.allclose(e, -regressors[:, -1])  # a lag is a delay to the model
    if band[0] > 0.0:
        *columns, output, e = (low_pass(y, rate, band[0], "highpass") for y in (*regressors.T, output, e))
        regressors = np.column_stack(columns)
    left = output - regressors @ np.linalg.lstsq(regressors, output, rcond=None)[0]
    free = regressors[:, :-1] if lag else regressors
    rest = e - free @ np.linalg.lstsq(free, e, rcond=None)[0]
    f, density = scipy.signal.welch(left, rate, nperseg=min(len(left), 1 << int(np.log2(len(left) / 4.0))))
    frequency = np.fft.rfftfreq(len(rest), 1.0 / rate)
    inside = (frequency > band[0]) & (frequency <= band[1])
    power = 4.0 * np.abs(np.fft.rfft(rest)[inside]) ** 2 / (len(rest) * rate)
    noise = np.interp(frequency[inside], f[1:], density[1:])
    return d / float(np.sqrt(np.sum(power / noise)))


def sampled_at(t: Array, y: Array) -> Array:
    """Time at which each reading of the output was taken: one that repeats the reading before it was held, (n,) s."""
    first = np.flatnonzero(np.diff(y, prepend=np.nan) != 0.0)
    return t[first[np.searchsorted(first, np.arange(len(y)), side="right") - 1]]


def planted(trial: Trial, folder: Path) -> Path:
    """Write the recording of a trial, its used part only, under the name of its subject."""
    subject = SUBJECTS[trial.subject]
    data = table(subject.file)
    rows = (data["t"] >= subject.span[0]) & (data["t"] <= subject.span[1])
    output = {name: y[rows].copy() for name, y in data.items()}
    if trial.effect != "none":
        m = motion_of(subject)
        e = column(trial.effect, m, below(subject, subject.across, m.t) if subject.across else np.zeros_like(m.t))
        size = size_at(trial.d, e, m, below(subject, subject.output, m.t), subject.band)
        output[subject.output] += size * np.interp(sampled_at(output["t"], output[subject.output]), m.t, e)
    path = folder / f"{trial.subject}.csv"
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(output)
        writer.writerows(
            ["" if np.isnan(cell) else repr(float(cell)) for cell in row] for row in zip(*output.values(), strict=True)
        )
    sidecar = (SIDECARS / f"{subject.sidecar}.toml").read_text(encoding="utf-8")
    path.with_suffix(".toml").write_text(sidecar, encoding="utf-8")
    return path


def run(trial: Trial) -> Outcome:
    """Plant, ask `improve` and the comparison with the held-out part, and keep what they say."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = planted(trial, folder)
        t = table(SUBJECTS[trial.subject].file)["t"]
        low, high = max(SUBJECTS[trial.subject].span[0], t[0]), min(SUBJECTS[trial.subject].span[1], t[-1])
        split = high - HELD_OUT * (high - low)
        for part, begin, end in (("fitted", low, split), ("unseen", split, high)):
            product("cut", path, "--only", f"{begin:.6f}:{end:.6f}", "-o", folder / f"{part}.csv")
        answer = json.loads(product("improve", folder / "fitted.csv", "--holdout", folder / "unseen.csv", "--json"))
    last = answer["steps"][-1]["heldout"]
    return {
        "key": trial.key,
        "subject": trial.subject,
        "effect": trial.effect,
        "d": trial.d,
        "effects": answer["effects"],
        "classes": answer["classes"],
        "inseparable": answer["diagnosis"]["inseparable"],
        "verdict": answer["verdict"],
        "sentence": answer["sentence"],
        "base": errors(answer["steps"][0]["heldout"]),
        "error": errors(last),
        "seconds": time.perf_counter() - started,
    }


def errors(answer: dict[str, Any]) -> dict[str, float | None]:
    """What a comparison with the held-out part leaves."""
    return {
        "accel": answer["accel_rms"],
        "band": answer["band"],
        "one_step": answer["one_step_rms"],
        **{f"{float(horizon):g}": drift for horizon, drift in answer["coast_rms"].items()},
    }


def product(*arguments: str | Path) -> str:
    """What a command of the product prints."""
    command = [sys.executable, "-m", "accelcal", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1200)
    if done.returncode not in (0, 3):
        raise RuntimeError(f"{' '.join(command[2:])}: {done.stderr.strip()[-500:]}")
    return done.stdout


def plan(subjects: Sequence[str], effects: Sequence[str], sizes: Sequence[float]) -> Iterator[Trial]:
    """Every trial that a recording allows; the unplanted ones first."""
    chosen = [name for name in SUBJECTS if not subjects or name in subjects]
    yield from (Trial(name, "none", 0.0) for name in chosen)
    for name in chosen:
        for effect in IN_CLASS:
            if (effects and effect not in effects) or (effect == "cross_axis" and not SUBJECTS[name].across):
                continue
            yield from (Trial(name, effect, d) for d in sizes)


def names_of(outcome: Outcome) -> set[str]:
    """Names that an answer gives, with those that it ties them to."""
    tied = {m for tie in outcome["classes"] for m in (tie["effect"], *tie["members"])}
    verdict = {"unexplained"} if outcome["verdict"] == "unexplained" else set()
    return {name.split(".")[0] for name in {*outcome["effects"], *tied}} | verdict


def share_of(outcome: Outcome, plain: Outcome) -> float:
    """Held-out drift after 1 s, or one-step error of a shorter record, over that of the unplanted recording."""
    kind = "one_step" if plain["error"]["1"] is None else "1"
    return float(outcome["error"][kind] / plain["error"][kind])


def in_class(outcome: Outcome, plain: Outcome) -> bool:
    """Whether a name that the unplanted recording does not give is of the class of what was planted.

    A lag is a delay to every model, which takes it up: then nothing new is named, and the error is back.
    """
    right = IN_CLASS[outcome["effect"]] | {outcome["effect"]}
    new = names_of(outcome) - names_of(plain)
    if outcome["effect"] == "sensor_lag" and not new:
        return share_of(outcome, plain) <= BACK
    return bool(new & right)


def main() -> None:
    """Run what is asked for and print the figures of the bar."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recording", action="append", default=[], choices=list(SUBJECTS))
    parser.add_argument("--effect", action="append", default=[], choices=list(IN_CLASS))
    parser.add_argument("--d", action="append", type=float, default=[])
    parser.add_argument("--out", type=Path, default=Path("target/bench/planted.jsonl"))
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    if not os.environ.get("ACCELCAL_REAL_DATA"):
        raise SystemExit("ACCELCAL_REAL_DATA names no folder: there is nothing to plant in")
    trials = list(plan(given.recording, given.effect, given.d or SIZES))
    outcomes = run_all(run, trials, given.out, given.workers)
    plain = {outcome["subject"]: outcome for outcome in outcomes if outcome["effect"] == "none"}
    for outcome in plain.values():
        print(f"{outcome['key']}: {', '.join(outcome['effects']) or 'nothing'} named; {outcome['sentence']}")
    for d in given.d or SIZES:
        asked = [outcome for outcome in outcomes if outcome["effect"] != "none" and outcome["d"] == d]
        right = [outcome for outcome in asked if in_class(outcome, plain[outcome["subject"]])]
        back = [outcome for outcome in asked if share_of(outcome, plain[outcome["subject"]]) <= BACK]
        for outcome in asked:
            new = names_of(outcome) - names_of(plain[outcome["subject"]]) - {"unexplained"}
            message = "right" if outcome in right else "WRONG" if new else "not named"
            print(
                f"{outcome['key']}: {message}; {', '.join(outcome['effects']) or 'nothing'}; {outcome['verdict']}; "
                f"held out {share_of(outcome, plain[outcome['subject']]):.2f} of the unplanted"
            )
        print(f"d = {d:g}: in its class {len(right)} of {len(asked)}; error back {len(back)} of {len(asked)}")


if __name__ == "__main__":
    main()
