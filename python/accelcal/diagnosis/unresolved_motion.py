"""The remark on a motion that changes faster than the sampling resolves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from accelcal.diagnosis.policy import UNRESOLVED_MOST_SHARE
from accelcal.diagnosis.remarks import Remark, remark
from accelcal.estimation.run import PreparedRun


def unresolved_motion(runs: Sequence[PreparedRun]) -> Remark | None:
    """How often the motion jumps between two samples; None where it never does.

    Where the jumps fill more than `UNRESOLVED_MOST_SHARE` of a record, what is left of it is too little to judge.
    """
    if not any(np.any(run.jumps.certain) for run in runs):
        return None
    instants = sum(len(run.jumps.t) for run in runs)
    spans = [run.jumps.before + run.jumps.after for run in runs]
    share = sum(float(np.sum(span)) for span in spans) / sum(float(run.t[-1] - run.t[0]) for run in runs)
    code = "unresolved_motion" if share < UNRESOLVED_MOST_SHARE else "motion_beyond_sampling"
    return remark(code, instants=instants, share=100.0 * share)
