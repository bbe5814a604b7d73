"""What a fit keeps of each recording: its span, its noise at rest and in motion, its likelihood."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from accelcal.data import NO_LABELS, POSITION_ORDER, VELOCITY, Flags, RunLabels
from accelcal.estimation.noise import Level, NoiseReport, level, level_of
from accelcal.estimation.rows import NormalEquations, block_length, normal_equations, sums_of
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.run_state import RunState
from accelcal.estimation.values import Noise
from accelcal.estimation.weak_form.rows import WeakRows
from accelcal.model import Model
from accelcal.signals.signals import Signals


@dataclass(frozen=True, slots=True)
class RunFit:
    """Span, noise and likelihood of one recording of a fit."""

    name: str
    digest: str
    start: float
    """s"""
    end: float
    """s"""
    readings: int
    samples: int
    noise: NoiseReport
    log_likelihood: float
    nis: float | None
    """Mean normalised innovation squared, 1 when noise and innovations agree; None when a band was imposed."""
    session: str = ""
    """Digest of the whole recording that the run is a part of."""
    labels: RunLabels = NO_LABELS
    """When, how mounted, by whom."""


def run_fit(state: RunState, model: Model) -> RunFit:
    """Noise report and fit statistics of a run at the final values."""
    run = state.run
    y = state.whitened[state.counts] if run.order == POSITION_ORDER else sums_of(state).whitened
    return RunFit(
        name=run.recording.name,
        digest=run.recording.digest,
        start=float(run.t[0]),
        end=float(run.t[-1]),
        readings=run.used,
        samples=len(run.accel.t),
        noise=noise_of_run(state, model),
        log_likelihood=state.log_likelihood,
        nis=float(np.mean(y**2)) if state.band is None else None,
        session=run.recording.session,
        labels=run.recording.labels,
    )


def noise_of_run(state: RunState, model: Model) -> NoiseReport:
    """Noise report by what the run was fitted with."""
    if state.run.order != POSITION_ORDER:
        return noise_report_of_reference(state)
    return noise_report(state) if state.band is None else noise_report_in_band(state, model)


def noise_report_of_reference(state: RunState) -> NoiseReport:
    """Noise by the likelihood of the weak form, whose reference is no position; not split into rest and motion.

    Of an acceleration only the sum of both noises is known; either has half of it.
    """
    sums, reference = sums_of(state), state.run.recording.reference
    assert isinstance(sums, WeakRows)
    assert reference is not None
    density, reading = abs(state.values.scale) * math.sqrt(2.0 * sums.noise.q), math.sqrt(sums.noise.r)
    share = 1.0 / math.sqrt(2.0 * sums.rows)
    return NoiseReport(
        noise=state.noise,
        all=Level(density, share * density, reading, share * reading, sums.rows),
        rest=None,
        motion=None,
        declared=state.run.rig.sensor.noise,
        crossover=state.run.crossover(state.noise),
        band=state.band,
        reference="velocity" if reference.name == VELOCITY else "reference_acceleration",
    )


def noise_report(state: RunState) -> NoiseReport:
    """Noise by likelihood: of all readings, of those at rest and of those in motion."""
    run, integrals, noise, scale = state.run, state.drive, state.noise, state.values.scale
    whole = level(run, integrals, noise, scale)
    moving = in_motion(run, state.signals)
    return NoiseReport(
        noise=noise,
        all=whole,
        rest=level_of(run, integrals, noise, ~moving, scale),
        motion=level_of(run, integrals, noise, moving, scale),
        declared=run.rig.sensor.noise,
        crossover=run.crossover(noise),
    )


def noise_report_in_band(state: RunState, model: Model) -> NoiseReport:
    """Noise where a band was imposed, by the scatter of block scores, not split into rest and motion."""
    run, scale = state.run, state.values.scale
    noise = noise_of_blocks(state.noise, normal_equations(state, model.free))
    density, reading = abs(scale) * math.sqrt(2.0 * noise.q), math.sqrt(state.search.noise.r)
    blocks = int(float(run.t[-1] - run.t[0]) / block_length(state))
    share = 1.0 / math.sqrt(2.0 * max(1, blocks))
    return NoiseReport(
        noise=noise,
        all=Level(density, share * density, reading, math.nan, int(state.counts.sum())),
        rest=None,
        motion=None,
        declared=run.rig.sensor.noise,
        crossover=run.crossover(noise),
        band=state.band,
    )


def noise_of_blocks(noise: Noise, normal: NormalEquations) -> Noise:
    """Noise scaled so that the model's covariance equals the one that the blocks show."""
    if normal.spread is None:
        return noise
    ratio = np.diag(normal.spread) / np.diag(normal.gram)
    factor = float(np.exp(np.mean(np.log(ratio))))
    return noise.scaled(factor, factor)


def in_motion(run: PreparedRun, signals: Signals) -> Flags:
    """Readings at which the stage moves: speed or acceleration above 2 % of their largest, and a little around."""
    v, a = np.abs(signals.v), np.abs(signals.a - np.median(signals.a))
    busy = (v > 0.02 * np.quantile(v, 0.999)) | (a > 0.05 * np.quantile(a, 0.999))
    step = float(signals.t[1] - signals.t[0])
    margin = max(1, int(0.05 / step))
    near = np.convolve(busy, np.ones(2 * margin + 1), mode="same") > 0 if len(busy) > 2 * margin else busy
    index = np.clip(np.rint((run.t - run.origins.t - signals.t[0]) / step).astype(int), 0, len(near) - 1)
    return np.asarray(near[index])
