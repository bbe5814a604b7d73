"""NEES of K2 and K3 under the vibration of Table I, with vibration in the noise of the model and without it.

python -m benches.vibration_nees --runs 60 --amplitudes 0 0.5 1 2
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy import stats

from papers.stakkeland2007.rig import CURVED, NEES_REGION, replayed
from papers.stakkeland2007.rows import Plan


def main() -> None:
    """Print relative rms errors and the mean NEES beside its region."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--runs", type=int, default=60)
    asked.add_argument("--seed", type=int, default=100)
    asked.add_argument("--amplitudes", type=float, nargs="*", default=[0.0, 0.5, 1.0, 2.0])
    given = asked.parse_args()
    dof = len(CURVED) * given.runs
    low, high = (float(stats.chi2.ppf(p, dof)) / dof for p in (0.5 - NEES_REGION / 2.0, 0.5 + NEES_REGION / 2.0))
    plan = Plan(quick=False, seed=given.seed)
    for amplitude in given.amplitudes:
        for how, with_noise in (("without", False), ("with", True)):
            result = replayed(plan, amplitude, given.runs, with_noise=with_noise)
            K2, K3 = np.sqrt(np.mean(np.square(result.relative), axis=0))
            print(
                f"A = {amplitude:g} m/s², {how} the noise model: K2 {K2:.4f}, K3 {K3:.4f} rms (at most 0.01), NEES/dof "
                f"{result.nees / dof:.3f} ({low:.3f} to {high:.3f}), {given.runs} runs",
                flush=True,
            )


if __name__ == "__main__":
    main()
