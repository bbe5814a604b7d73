"""NEES of K2 and K3 under the vibration of Table I, with vibration in the noise of the model and without it.

python -m benches.vibration_nees --runs 60 --amplitudes 0 0.5 1 2
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy import stats

from accelcal.effects import found_by
from accelcal.estimation.estimate import estimate
from accelcal.model import Model
from accelcal.paper.tuning import PAPER_SENSOR
from accelcal.paper.vibration import CURVED, shaken

REGION = 0.999
"""Probability of the region of the normalised error."""


def main() -> None:
    """Print relative rms errors and the mean NEES beside its region."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--runs", type=int, default=60)
    asked.add_argument("--seed", type=int, default=100)
    asked.add_argument("--amplitudes", type=float, nargs="*", default=[0.0, 0.5, 1.0, 2.0])
    given = asked.parse_args()
    dof = len(CURVED) * given.runs
    low, high = (float(stats.chi2.ppf(p, dof)) / dof for p in (0.5 - REGION / 2.0, 0.5 + REGION / 2.0))
    truth = np.array([PAPER_SENSOR[name] for name in CURVED])
    models = {"without": Model.cubic(), "with": Model.cubic().add(found_by("noise over speed").name)}
    for amplitude in given.amplitudes:
        for how, model in models.items():
            nees, relative = 0.0, []
            for k in range(given.runs):
                fit = estimate(model, shaken(amplitude, np.random.default_rng(given.seed + k)).recording)
                rows = [[e.name for e in fit.free].index(name) for name in CURVED]
                error = np.array([fit[name].value for name in CURVED]) - truth
                nees += float(error @ np.linalg.solve(fit.covariance[np.ix_(rows, rows)], error))
                relative.append(error / truth)
            K2, K3 = np.sqrt(np.mean(np.square(relative), axis=0))
            print(
                f"A = {amplitude:g} m/s², {how} the noise model: K2 {K2:.4f}, K3 {K3:.4f} rms (at most 0.01), NEES/dof "
                f"{nees / dof:.3f} ({low:.3f} to {high:.3f}), {given.runs} runs",
                flush=True,
            )


if __name__ == "__main__":
    main()
