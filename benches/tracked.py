"""Three outputs of a tracked board (BROAD 10 and 15): error on the last third of each trial, scales, delay, and names.

From the top of the repository: python -m benches.tracked [--data DIR]
DIR holds broad_slow_translation/broad_trial10.csv and broad_fast_translation/broad_trial15.csv (Laidig, Caruso,
Cereatti, Seel, "BROAD", Data 6(7), 2021, CC BY 4.0). Beside each error stands the least that any linear filter of the
reference leaves, by their coherence.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.signal import csd, welch

from accelcal import io, verbs
from accelcal.data import GRAVITY, Recording
from accelcal.data.orientation import KNOT_READINGS, smooth_spline, unbroken

SIDECAR = """\
[channels]
time = { column = "t", unit = "s" }
accel_x = { column = "accel_x", unit = "m/s^2" }
accel_y = { column = "accel_y", unit = "m/s^2" }
accel_z = { column = "accel", unit = "m/s^2" }
position_e = { column = "pos_e", unit = "m" }
position_n = { column = "pos_n", unit = "m" }
position_u = { column = "pos_u", unit = "m" }
attitude = { columns = ["q_w", "q_x", "q_y", "q_z"], maps = "sensor to ENU" }
"""
TRIALS = {"broad_slow_translation/broad_trial10.csv": 0.065, "broad_fast_translation/broad_trial15.csv": 0.30}
"""Largest error below 10 Hz that is allowed on each, m/s²."""
SCALES, WITHIN = (1.004, 1.007, 0.998), 0.003
BAND, LEARNT = 10.0, 0.66
"""Of the error, Hz; share of a trial that is learnt from."""


def bound(recording: Recording) -> float:
    """Error below the band that no linear filter of the acceleration of the reference removes, m/s²."""
    rows = max(unbroken(recording.position.t), key=lambda rows: rows.stop - rows.start)
    t = recording.position.t[rows]
    a = smooth_spline(t, recording.position.y[rows], KNOT_READINGS)(t, 2) + recording.side[GRAVITY].y[rows]
    even = np.arange(t[0], t[-1], float(np.median(np.diff(t))))
    x, y = np.interp(even, t, a), np.interp(even, recording.accel.t, recording.accel.y)
    settings = {"fs": 1.0 / (even[1] - even[0]), "nperseg": 2048}
    f, of_output = welch(y, **settings)
    left = of_output - np.abs(csd(x, y, **settings)[1]) ** 2 / welch(x, **settings)[1]
    return float(np.sqrt(np.sum(left[(f > 0.0) & (f < BAND)]) * (f[1] - f[0])))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print every figure with its threshold; 1 where one does not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("ACCELCAL_REAL_DATA", "data")))
    parser.add_argument("--cost", action="store_true", help="time fits of single axes too")
    wanted, held, named = parser.parse_args(arguments), True, list[set[str]]()
    for name, most in TRIALS.items():
        with tempfile.TemporaryDirectory() as folder:
            sidecar = Path(folder) / "board.toml"
            sidecar.write_text(SIDECAR)
            axes = io.load_axes(wanted.data / name, sidecar)
        end = float(axes[0].accel.t[-1])
        begin = time.process_time()
        fit = verbs.fit([run.part(0.0, LEARNT * end) for run in axes])
        seconds = time.process_time() - begin
        if wanted.cost:
            begin = time.process_time()
            for run in axes:
                verbs.fit(replace(run.part(0.0, LEARNT * end), name=f"{run.name} alone"))  # examined anew
            print(f"  cost over that of three single fits: {seconds / (time.process_time() - begin):.2f} (1.2)")
        unseen = [run.part(LEARNT * end, end) for run in axes]
        print(f"{name}: fitted in {seconds:.0f} s; delay {1e3 * fit['time_offset'].value:.3f} ms for all axes")
        for run, (evaluation,) in zip(unseen, verbs.compare(fit, unseen, band=BAND).evaluations, strict=True):
            ok = evaluation.accel_rms <= most
            least = bound(run)
            beside = f"at most {most:g}; bound of any linear filter of one axis {least:.4f}"
            print(f"  {run.axis}: {evaluation.accel_rms:.4f} m/s² ({beside})")
            held &= ok
        for e, wanted_scale in zip((e for e in fit.estimates if e.name == "scale_factor"), SCALES, strict=True):
            ok = abs(1.0 + e.value - wanted_scale) <= WITHIN
            judged_scale = f"within {WITHIN:g} of {wanted_scale:g}{'' if ok else ': not'}"
            print(f"  scale of {e.axis} {1.0 + e.value:.4f}({1e4 * e.std:.0f}) ({judged_scale})")
            held &= ok
        judged = verbs.diagnose(fit, axes)
        print(f"  {judged.sentence}")
        named.append({effect for effect in judged.effects if effect != "time_offset"})
    print(f"named on both: {sorted(named[0] & named[1])}; on one alone: {sorted(named[0] ^ named[1])}")
    held &= not named[0] ^ named[1]
    return 0 if held else 1


if __name__ == "__main__":
    raise SystemExit(main())
