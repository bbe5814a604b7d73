"""Checks: what must be read with a verdict, each a function of the evidence that gives its remarks or none.

A new check is one function here or in a file of its own, one row of `CHECKS`, and one test with its null.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from accelcal.diagnosis.evidence import Evidence
from accelcal.diagnosis.policy import ENGINES_APART, UNRESOLVED_MOST_SHARE
from accelcal.diagnosis.position_noise import coloured_position
from accelcal.diagnosis.run_agreement import runs_disagree
from accelcal.diagnosis.transverse import transverse_coherence
from accelcal.diagnosis.turning import turning_sensor
from accelcal.estimation.estimate import implausible_scale
from accelcal.estimation.remarks import Remark, remark


def scale_factor(e: Evidence) -> Iterator[Remark]:
    """Scale factor that no working sensor has: beside it every curve is significant.

    No null: the range is that of units mistaken for one another (tests/workflow/test_judgement.py).
    """
    scale = e.fit.values().scale
    if "scale_factor" not in e.model.fixed:
        yield from implausible_scale(scale)


def engines(e: Evidence) -> Iterator[Remark]:
    """Replay and weak form that disagree: normal differences of two estimates, beyond `ENGINES_APART` standard
    deviations (tests/diagnosis/test_independent_estimate.py)."""
    apart = sorted((one for one in e.differences if abs(one.sigma) > ENGINES_APART), key=lambda one: -abs(one.sigma))
    for worst in apart[:1]:
        yield remark(
            "engines_disagree",
            parameters=", ".join(dict.fromkeys(one.name for one in apart)),
            parameter=worst.name,
            replay=float(f"{worst.replay:.6g}"),
            weak=float(f"{worst.weak:.6g}"),
            sigma=abs(worst.sigma),
        )


def unresolved_motion(e: Evidence) -> Iterator[Remark]:
    """Motion that jumps between two samples; beyond `UNRESOLVED_MOST_SHARE` of a record what is left is too little to
    judge (tests/diagnosis/noise_tests/test_unresolved.py)."""
    jumps = [run.jumps for run in e.runs]
    if any(np.any(one.certain) for one in jumps):
        share = sum(float(np.sum(one.before + one.after)) for one in jumps)
        share /= sum(float(run.t[-1] - run.t[0]) for run in e.runs)
        code = "unresolved_motion" if share < UNRESOLVED_MOST_SHARE else "motion_beyond_sampling"
        yield remark(code, instants=sum(len(one.t) for one in jumps), share=100.0 * share)


def agreement(e: Evidence) -> Iterator[Remark]:
    """Recordings with another value of a shared parameter: chi-square over the runs, below `HOMOGENEITY_ALPHA`
    (tests/diagnosis/test_run_agreement.py)."""
    yield from runs_disagree(e.by_run)


def run_to_run(e: Evidence) -> Iterator[Remark]:
    """Coefficients that differ from run to run, and what they go with; tested in the fit (REML,
    tests/estimation/test_run_to_run.py)."""
    yield from (one for one in e.fit.remarks if one.code in ("goes_with", "run_to_run"))


def faults(e: Evidence) -> Iterable[Remark]:
    """Faults of the data, which were sought before the fit, each with its own null (tests/diagnosis)."""
    return e.stretch.remarks


def unsteady(e: Evidence) -> Iterator[Remark]:
    """Effects that would have entered, had they one size in all parts of the runs and happened once: chi-square over
    the parts, below `HOMOGENEITY_ALPHA` (tests/diagnosis/search/test_homogeneity.py)."""
    sigma = {candidate.effect: candidate.snr for candidate in e.scan.candidates}
    for one in () if e.forbidden else e.scan.changing:
        if one.effect in sigma:  # of those that explain part of what is left at the end
            sizes = {"sizes": one.unequal.text} if one.unequal else {}
            code = "no_single_size" if one.unequal else "recurs"
            yield remark(code, effect=one.effect, sigma=sigma[one.effect], **sizes)


def slow_noise(e: Evidence) -> Iterator[Remark]:
    """Slow noise that effects were judged against, the run with the highest knee: by log-evidence of its spectrum
    (tests/diagnosis/search/test_slow_noise.py)."""
    worst = max(e.scan.slow_noise, key=lambda noise: noise.knee, default=None)
    if worst is not None and worst.knee:
        yield remark("slow_noise", knee=worst.knee, log_evidence=worst.log_evidence)


CHECKS: tuple[Callable[[Evidence], Iterable[Remark]], ...] = (
    scale_factor,
    engines,
    turning_sensor,
    coloured_position,
    unresolved_motion,
    agreement,
    run_to_run,
    faults,
    unsteady,
    slow_noise,
    transverse_coherence,
)
"""Every check, in the order of their remarks; one reads what those before it found."""
