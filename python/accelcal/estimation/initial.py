"""Initial estimates of a run: output and a constant regressed on the encoder, noise by grid search."""

from __future__ import annotations

import math

import numpy as np

from accelcal.data.recording import RecordingError
from accelcal.estimation.drive import DriveIntegrals, drive, run_filter
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise, Values
from accelcal.model import Model

LEAST_SETTLED = 0.1
"""Share of the readings that the fastest trial filter uses, below which those of a slower one tell nothing of it."""


def initial_coefficients(model: Model) -> dict[str, float]:
    """Coefficients before a record is read: where they are held, the mean of their prior, or zero."""
    return {
        e.name: model.fixed.get(e.name, model.priors[e.name].mean if e.name in model.priors else 0.0)
        for e in model.terms
    }


def initial_estimate(run: PreparedRun, model: Model) -> tuple[Values, Noise]:
    """Coefficients and noise at which the iteration of one run begins."""
    coefficients = initial_coefficients(model)
    offset = coefficients["time_offset"]
    question = (run.origins.t, len(run.t), float(np.sum(run.z)), run.restarts, offset)
    scale, constant, noise = run.once(question, lambda: regressed(run, offset))
    if "scale_factor" not in model.fixed:
        coefficients["scale_factor"] = scale - 1.0
    if "bias" not in model.fixed:
        coefficients["bias"] = constant
    return Values(coefficients, model.terms), noise


def regressed(run: PreparedRun, time_offset: float) -> tuple[float, float, Noise]:
    """Rough 1 + k, K0 and noise from output and constant alone.

    The filter is linear in what drives it, so three tracks (encoder alone, output alone, constant alone) give the
    innovations of every combination; for each trial of q the best combination is a 2 x 2 solve.
    """
    plain = drive(run, Values({"time_offset": time_offset}), None)
    rows = slice(0, min(len(run.t), 40_000))
    plain = plain.part(rows)
    h = np.diff(plain.t, prepend=plain.t[0])
    zero = np.zeros_like(h)
    polarity = run.rig.polarity
    once, twice = np.where(plain.restart, 0, h), np.where(plain.restart, 0, h**2 / 2)
    gained, moved = (np.where(plain.restart, 0.0, known[rows]) for known in run.gravity_integrals)
    ones = DriveIntegrals(plain.t, zero, once, twice, plain.restart, plain.extra_q)
    encoder = DriveIntegrals(plain.t, plain.z, -gained, -moved, plain.restart, plain.extra_q)
    output = DriveIntegrals(plain.t, zero, plain.first + gained, plain.second + moved, plain.restart, plain.extra_q)
    r = run.reading_variance_guess
    rate = 1.0 / run.reading_step
    best: tuple[float, float, float, Noise] | None = None
    crossovers = np.geomspace(4.0 / (plain.t[-1] - plain.t[0]), 0.15 * rate, 9)
    trials = [Noise((2.0 * np.pi * crossover) ** 4 * r * run.reading_step, r) for crossover in crossovers]
    settled = [encoder.settled(run.wait(noise)) for noise in trials]
    most = max(map(np.count_nonzero, settled))
    for noise, counts in zip(trials, settled, strict=True):
        if np.count_nonzero(counts) <= LEAST_SETTLED * most:  # so slow a filter hardly settles between two holes
            continue
        tracks = [run_filter(run, driven, noise) for driven in (encoder, output, ones)]
        S = tracks[0].series("S")
        y, u, unit = ((t.series("e") / np.sqrt(S))[counts] for t in tracks)
        X = np.column_stack([-u, -unit])
        c, *_ = np.linalg.lstsq(X, y, rcond=None)
        residual = float(np.mean((y - X @ c) ** 2))
        # With q and R scaled together the gains stay; the best common factor is the mean square itself.
        cost = float(np.mean(np.log(S[counts]))) + math.log(residual)
        if best is None or cost < best[0]:
            best = cost, float(c[0]), float(c[1]), Noise(noise.q * residual, r * residual)
    if best is None:
        raise RecordingError(
            f"{run.recording.name or 'recording'}: the record breaks off before any filter has settled, "
            f"{int(np.sum(plain.restart))} times in {len(plain.t)} readings; use `accelcal cut` on a whole part"
        )
    _, slope, constant, likely = best
    if not math.isfinite(slope) or abs(slope) < 1e-9:
        slope = 1e-9
    scale = 1.0 / slope  # p'' + g = pol (u - K0)/s
    bias = -polarity * constant * scale
    return scale, bias, likely
