"""Evaluate a model on a recording: coast, predict one step, compare accelerations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import scipy

from accelcal._support.errors import AccelcalError
from accelcal.data import GRAVITY, POSITION_ORDER, Array, Flags, median_step, root_mean_square, within_spans
from accelcal.estimation.columns import evaluated
from accelcal.estimation.drive import DriveIntegrals, drive
from accelcal.estimation.engines import ENGINES, sums_of
from accelcal.estimation.estimate import Fit, require_band, settled_state
from accelcal.estimation.rows import inverse, normal_equations
from accelcal.estimation.run import PreparedRun, Source, recording_of
from accelcal.estimation.run_state import RunState
from accelcal.estimation.shape_parameters import linearised
from accelcal.estimation.smoothing import of_lever, output_at, side_channels_at
from accelcal.estimation.values import Noise
from accelcal.signals.processing import ORDER, derivative, even_times, low_pass, spectral_density, spline
from accelcal.signals.series import runs_of_true
from accelcal.signals.signals import Signals
from accelcal.validation.comparison import (
    BINS,
    HORIZONS,
    TWO_SIDED,
    Bins,
    Coast,
    Evaluation,
    ReferenceNoise,
    RmsInterval,
    Spectrum,
)
from accelcal.validation.noise_floor import Ruler
from accelcal.validation.prediction import MOST_STEPS, Coasting, DrivenRun, Prediction, accumulated, left_out, rms
from accelcal.validation.regions import outside


def spectrum(evaluation: Evaluation, scale: float, expected: Callable[[Array], Array]) -> Bins:
    """Density of the residual over the expected one, of an output of scale 1, in bins of frequency up to the band."""
    (t, residual), band = evaluation.accel_residual, evaluation.band
    rate = 1.0 / median_step(t)
    segment = int(min(len(residual), max(64, 2 ** round(math.log2(8.0 * BINS * rate / band)))))
    if segment < 16:
        return Bins("frequency", "Hz", np.linspace(0.0, band, BINS + 1), np.ones(BINS), np.zeros(BINS))
    f, density = spectral_density(residual / scale, rate, segment)
    edges = np.linspace(0.0, 0.8 * band, BINS + 1)
    ratio, std = np.ones(BINS), np.zeros(BINS)
    averages = max(1.0, 2.0 * len(residual) / segment - 1.0)
    for i in range(BINS):
        rows = (f > edges[i]) & (f <= edges[i + 1])
        if rows.any():
            ratio[i] = float(np.mean(density[rows] / expected(f[rows])))
            std[i] = 1.3 / math.sqrt(averages * float(rows.sum()))  # neighbours of a Hann window overlap
    return Bins("frequency", "Hz", edges, ratio, std)


def predicted_density(f: Array, noise: Noise, scale: float, reference: ReferenceNoise, band: float) -> Array:
    """One-sided density of the accelerometer-side residual under noise alone, (n,) (m/s²)²/Hz.

    Parameters
    ----------
    f : (n,) Hz.
    noise, scale : of the model; scale is 1 + k.
    reference : noise of what tells the motion.
    band : of the low-pass, Hz.
    """
    passed = 1.0 / (1.0 + (f / band) ** (2 * ORDER)) ** 2  # the low-pass ran forwards and backwards
    return np.asarray(scale**2 * (2.0 * noise.usual.q + reference.as_acceleration(f)) * passed)


def accel_spectrum(fit: Fit, comparison: Evaluation) -> Spectrum | None:
    """Spectra of the accelerometer-side residual and of the predicted noise; None where the record is too short."""
    if comparison.reference_noise is None:
        return None
    _t, residual = comparison.accel_residual
    step = median_step(comparison.residual[0])
    spectrum = welch(residual, 1.0 / step)
    if spectrum is None:
        return None
    f, density, low, high = spectrum
    inside = (f > 0.0) & (f <= comparison.band)
    if int(inside.sum()) < FEWEST_LINES:
        return None
    scale, reference = fit.values().scale, comparison.reference_noise
    predicted = predicted_density(f[inside], fit.noise(), scale, reference, comparison.band)
    return Spectrum(f[inside], density[inside], predicted, low, high)


def one_step_spectrum(comparison: Evaluation) -> Spectrum | None:
    """Spectrum of one-step residuals over their predicted deviation, which is flat when nothing is missing, 1/Hz."""
    t, y = comparison.normalised
    rate = 1.0 / median_step(t)
    spectrum = welch(y, rate)
    if spectrum is None:
        return None
    f, density, low, high = spectrum
    return Spectrum(f[1:], density[1:], np.full(len(f) - 1, 2.0 / rate), low, high)


FEWEST_LINES = 4
"""Frequencies without which a spectrum shows nothing."""
AVERAGED_SEGMENTS = 24
"""Half-overlapping segments of an averaged spectrum."""
OVERLAP_LOSS = 1.0 + 2.0 / 36.0
"""Half-overlapping Hann segments are worth this many times fewer independent ones (Welch 1967)."""


def welch(y: Array, rate: float) -> tuple[Array, Array, float, float] | None:
    """Frequencies, one-sided density, and the 95 % region of its ratio to the true one; None below 64 samples."""
    if len(y) < 64:
        return None
    segment = int(min(len(y), max(64, 2 * len(y) // (AVERAGED_SEGMENTS + 1))))
    f, density = spectral_density(y, rate, segment)
    worth = max(1.0, (2.0 * len(y) / segment - 1.0) / OVERLAP_LOSS)
    low, high = (float(scipy.special.gammaincinv(worth, p)) / worth for p in (0.025, 0.975))
    return f, density, low, high


STEPS = (1, 10, 100, 1000)
"""Readings ahead at which prediction errors are taken."""
EDGE = 4.0
"""Periods of the band at either end of a record that a zero-phase low-pass spoils."""
LEAST_PERIODS = 12.0
"""Fewer periods of the band than this are too short a residual to say where it is large."""


def compare(
    fit: Fit,
    source: Source,
    *,
    band: float | None = None,
    horizons: Sequence[float] = HORIZONS,
    start: float | None = None,
    end: float | None = None,
    ruler: Ruler | None = None,
    ahead: Prediction | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Evaluation:
    """Compare a fitted model with a recording, simulation first.

    Parameters
    ----------
    fit : parameters, noise and origins.
    source : any run, the fitted one or another.
    band : Hz, optional; bandwidth of the accelerometer-side residual. By default the crossover of the two noises, below
        which predicted encoder noise stays under sensor noise.
    horizons : s; when to take the coasting error after position is withheld.
    start, end : s, optional; only readings in [start, end] are used.
    ruler : filter under which several models are compared; by default that of the fit itself.
    ahead : the prediction under that filter, where it is made already.
    progress : called with the share of the work that is done, 0 to 1.

    Returns
    -------
    Evaluation

    Raises
    ------
    RecordingError
        If the channels do not overlap.

    Notes
    -----
    While position is withheld nothing uses it: what effects need comes from the corrected output and the simulated
    motion, the start state from the causal filter, the constant from readings before the start.
    """
    ahead = ahead or predicted(fit, source, ruler, start=start, end=end)
    run, e, S = ahead.run, ahead.e, ahead.S
    counts, inside = ahead.counts, run.t >= ahead.since
    progress(0.3)
    coasting = {horizon: ahead.at_horizon(horizon) for horizon in horizons}
    progress(0.5)
    accelerations, t_res, motion = accel_side(ahead, fit, band)
    delta, delta_std = (float(y[0]) for y in ahead.constants(np.array([len(run.t) - 1])))
    gain = abs(fit.values().scale)
    progress(0.8)
    simulated = ahead.simulate()
    innovations = None if run.order == POSITION_ORDER else of_weak_form(ahead)
    squares = e[counts] ** 2 / S[counts] if innovations is None else innovations[1] ** 2
    progress(1.0)
    return Evaluation(
        recording=recording_of(source).name,
        one_step_rms=ahead.one_step_rms,
        nis=None if fit.runs[0].noise.band is not None else float(np.mean(squares)),
        k_step_rms={k: ahead.k_step(k) for k in STEPS},
        **coasted(coasting),
        **accelerations,
        simulated=simulated[:3],
        simulated_std=simulated[3],
        simulated_rms=root_mean_square(simulated[1] - simulated[2]),
        residual=(run.t[inside], e[inside]),
        residual_std=np.sqrt(S[inside]),
        setup_bias=(-delta * gain * run.rig.polarity, delta_std * gain),
        outside=outside(fit, ahead, t_res, motion, coasting),
        not_carried=left_out(fit, recording_of(source)),
        drifts={h: (run.t[c.starts], c.rezeroed) for h, c in coasting.items()},
        reference_noise=ahead.reference_noise,
        innovations=innovations,
    )


def predicted(
    fit: Fit, source: Source, ruler: Ruler | None, *, start: float | None = None, end: float | None = None
) -> Prediction:
    """The prediction of a recording in a part, s, by a model under the filter of a comparison, or under its own."""
    remembers = (ruler or Ruler.of([fit])).remembers
    ruled = fit if ruler is None else ruler.held_by(fit)
    ahead = Prediction.of(ruled, source, start=start, end=end, remembers=remembers)
    if ruler is not None and ruler.remembers:
        ahead.nodes_apart = nodes_apart(ruler, source, start, end)
    return ahead


def coasted(coasting: Mapping[float, Coasting]) -> dict[str, Any]:
    """Fields of an evaluation from the errors of coasting, by horizon, s."""
    return {
        "coast_rms": {h: rms(c.rezeroed) for h, c in coasting.items()},
        "coast_frozen_rms": {h: rms(c.frozen) for h, c in coasting.items()},
        "coast_floor": {h: rms(c.floor) for h, c in coasting.items()},
        "held_back": {
            h: float(np.linalg.norm(c.floor) / np.linalg.norm(c.open_floor))
            for h, c in coasting.items()
            if len(c.floor)
        },
        "coast_starts": {h: len(c.starts) for h, c in coasting.items()},
    }


def accel_side(ahead: Prediction, fit: Fit, band: float | None) -> tuple[dict[str, Any], Array, Signals]:
    """Fields of an evaluation from the accelerations, in a band, Hz, with their times, s, and the motion at them."""
    run = ahead.run
    require_band(run, band)
    band = band if band is not None else min(ahead.crossover, 0.2 / run.reading_step)
    t, residual, motion = accel_residual(ahead, band)
    enough = len(residual) * run.reading_step * band >= LEAST_PERIODS
    state = ahead.settled if enough else None
    fields = {
        "accel_rms": root_mean_square(residual) if len(residual) else math.nan,
        "band": band,
        "accel_residual": (t, residual),
        "measured": output_at(run, ahead.values.stamps(t, run.origins.t), band, run.tau(ahead.values)),
        "motion": None if state is None else motion_of(run, state, band),
        "reference": None if state is None else reference_error(fit, state),
    }
    return fields, t, motion


PER_PERIOD = 6.0
"""Samples in a period of the fastest motion on which effects are evaluated."""


def motion_of(run: PreparedRun, state: RunState, band: float) -> Signals:
    """Smoothed motion of a run on a uniform grid from its first reading on, which resolves it and a band, Hz."""
    signals = state.signals
    every = max(1, int(1.0 / (PER_PERIOD * max(band, signals.cutoff) * run.reading_step)))
    return signals.resampled(even_times(run.t[0], run.t[-1], every * run.reading_step) - run.origins.t)


def reference_error(fit: Fit, state: RunState) -> tuple[RmsInterval, RmsInterval] | None:
    """Error of the readings of a run without and with what a model corrects of them, rms, m; None where it is nothing.

    Coefficients and shapes of what is corrected are estimated anew from the innovations of the run, beside all others;
    the mean square of their columns is a quadratic form of them, less what noise alone gives. A wave whose period is
    off by more than half a turn over the stroke is seen in part.
    """
    by_name = state.values.by_name
    terms = [term for term in fit.model.free if term.effect.port == "position" and by_name[term.name]]
    if not terms:
        return None
    held = np.array([by_name[term.name] for term in terms])
    terms += [shape.term for shape in linearised(fit.model, state) if shape.term.effect.port == "position"]
    held = np.concatenate([held, np.zeros(len(terms) - len(held))])
    others = [term for term in fit.model.free if term not in terms]
    normal, n = normal_equations(state, [*terms, *others]), len(terms)
    unscaled = inverse(normal.gram)
    change = unscaled @ normal.score
    level = max(1.0, (normal.power - float(change @ normal.score)) / sums_of(state).rows)
    change, covariance = change[:n], level * unscaled[:n, :n]
    columns = np.array(evaluated(state, terms))
    columns = columns - np.mean(columns, axis=1, keepdims=True)
    power = columns @ columns.T / columns.shape[1]

    def size_of(c: Array) -> RmsInterval:
        square, spread = float(c @ power @ c - np.trace(power @ covariance)), power @ covariance @ power
        std = math.sqrt(float(4.0 * c @ spread @ c + 2.0 * np.trace(spread @ covariance)))
        roots = (math.sqrt(max(0.0, square + sign * TWO_SIDED * std)) for sign in (0.0, -1.0, 1.0))
        return RmsInterval(*roots)

    return size_of(held + change), size_of(change)


def nodes_apart(ruler: Ruler, source: Source, start: float | None, end: float | None) -> float:
    """Spacing of nodes, s, on which a model of a table remembers simulated motion of a recording; 0 where none does."""
    place = recording_of(source).sums, start, end
    if place not in ruler.nodes:
        several = [ruler.held_by(fit) for fit in ruler.remembering]
        ahead = (Prediction.of(fit, source, start=start, end=end, remembers=True) for fit in several)
        ruler.nodes[place] = max(model.nodes_apart for model in ahead)
    return ruler.nodes[place]


def coast(fit: Fit, source: Source, start: float, horizon: float) -> Coast:
    """Predict position over `horizon` seconds after the last reading at or before `start`, without using any later one.

    Parameters
    ----------
    fit, source : model and run.
    start, horizon : s.

    Raises
    ------
    ValueError
        If no reading precedes `start` or the accelerometer record ends before the horizon.
    """
    ahead = Prediction.of(fit, source, withheld=start)
    k = int(np.searchsorted(ahead.run.t, start, side="right")) - 1
    if k < 1:
        raise AccelcalError(f"no encoder reading precedes {start} s; the record begins at {ahead.run.t[0]:.6g} s")
    stop = int(np.searchsorted(ahead.run.t, ahead.run.t[k] + horizon, side="right"))
    rows = np.arange(k + 1, stop)
    if len(rows) == 0 or bool(np.any(ahead.drive.restart[rows])):
        raise AccelcalError(f"the accelerometer record does not reach {horizon} s beyond {start} s without a hole")
    return Coast(float(ahead.run.t[k]), ahead.run.t[rows], *ahead.along(k, rows))


def accel_residual(ahead: DrivenRun, band: float) -> tuple[Array, Array, Signals]:
    """Residual of `residual_of` where it counts, (n,) m/s², behind its times (n,) s, and the motion of the reference on
    the same grid."""
    t, residual, inside = residual_of(ahead, band)
    return t[inside], residual[inside], motion_at(ahead, t, band).at(inside)


def residual_of(ahead: DrivenRun, band: float) -> tuple[Array, Array, Flags]:
    """Output minus what the model says for the encoder's own acceleration, both low-passed at `band`.

    Nothing is withheld here: effects are taken at the smoothed motion, for the causal filter knows a reversal too late.
    The difference of measured and simulated position is low-passed and differentiated, not the positions themselves:
    it is small and nearly straight, so a short record keeps its ends.

    Returns
    -------
    Times (n,) s on an even grid, residual (n,) m/s², and where neither an end nor a hole spoils it, (n,).
    """
    run, step = ahead.run, ahead.run.reading_step
    t = even_times(run.t[0], run.t[-1], step)
    driven = smoothed_drive(ahead)
    missed = accumulated(driven, np.diff(run.t, prepend=run.t[0]))[1]
    missed = without_steps(np.subtract(driven.z, missed, out=missed), run)
    restart = driven.restart
    del driven  # each series is as long as the record
    missed = low_pass(spline(run.t, bridged(run.t, missed, restart, 1.0 / band), t), 1.0 / step, band)
    residual = second_derivative(missed, step)
    residual *= -ahead.values.scale * run.rig.polarity
    edge = int(min(EDGE / band, 0.25 * (t[-1] - t[0])) * (1.0 / step))
    holes = np.flatnonzero((np.diff(run.t) > MOST_STEPS * step) | ahead.drive.restart[1:])
    beside = np.column_stack([run.t[holes] - 1.0 / band, run.t[holes + 1] + 1.0 / band])
    spoiled = within_spans([(0, edge), (len(t) - edge, len(t)), *np.searchsorted(t, beside)], len(t))
    return t, residual, ~spoiled & (t >= ahead.since)


def motion_at(ahead: DrivenRun, t: Array, band: float) -> Signals:
    """Motion of the reference, low-passed at `band`, Hz, at the times of a residual (n,), s."""
    run, values, step, rig = ahead.run, ahead.values, ahead.run.reading_step, ahead.run.rig
    p = low_pass(spline(run.t, without_steps(run.z, run), t), 1.0 / step, band)
    a = second_derivative(p, step)
    side, pull = side_channels_at(run, t), run.gravity.within(t, step, band)
    if GRAVITY in side:
        side[GRAVITY] = pull = np.asarray(pull + rig.polarity * of_lever(side, values))
    sensed = rig.polarity * (a + pull)
    return Signals(
        t=t - run.origins.t,
        p=p - run.origins.p + np.interp(t, run.t, run.z - without_steps(run.z, run)),
        v=derivative(p, step),
        a=sensed,
        jerk=derivative(sensed, step),
        scale=values.scale,
        bias=values.bias,
        rig=rig,
        cutoff=band,
        side=side,
        side_origins=run.origins.side,
    )


def of_weak_form(ahead: Prediction) -> tuple[Array, Array]:
    """Times, s, and innovations of the weak form over their standard deviations, at the model as it is."""
    state = settled_state(ENGINES["weak"].prepare(ahead.run), ahead.values, ahead.noise)
    sums = sums_of(state)
    inside = sums.times >= ahead.since
    return sums.times[inside], sums.whitened[inside]


def smoothed_drive(ahead: DrivenRun) -> DriveIntegrals:
    """What drives the filter where effects are taken at the smoothed motion."""
    if ahead.causal is None:
        return ahead.drive
    return drive(ahead.run, ahead.values, ahead.settled.signals)


def without_steps(y: Array, run: PreparedRun) -> Array:
    """Readings without their jumps where the position counts from another zero; a low-pass would ring."""
    if not run.restarts:
        return y
    jumps = np.zeros_like(y)
    behind = np.searchsorted(run.t, run.restarts)
    jumps[behind] = y[behind] - y[behind - 1]
    return np.asarray(y - np.cumsum(jumps))


def bridged(t: Array, y: Array, missing: Flags, beside: float) -> Array:
    """A series (n,) whose pieces, parted where the output is missing or the filter began anew, go on along the line
    through `beside` seconds of the one before: a low-pass would spread the motion that nobody integrated."""
    y = y.copy()
    for a, b in runs_of_true(missing, 1):  # one flag is a reading behind a hole
        first, last = np.searchsorted(t, [t[a] - beside, t[b] + beside])
        if min(a - first, last - b) < 2:
            continue
        before, behind = (np.polyfit(t[rows] - t[b], y[rows], 1) for rows in (slice(first, a), slice(b, last)))
        y[b:] -= np.polyval(behind - before, t[b:] - t[b])
        y[a:b] = np.polyval(before, t[a:b] - t[b])
    return y


def second_derivative(y: Array, step: float) -> Array:
    """Second derivative of uniform samples, sixth order inside, second order at the two ends."""
    d = np.zeros_like(y)
    if len(y) < 7:
        return np.asarray(np.gradient(np.gradient(y, step), step))
    d[1:-1] = y[2:] - 2.0 * y[1:-1] + y[:-2]
    c = (2.0 / 180.0, -27.0 / 180.0, 270.0 / 180.0, -490.0 / 180.0)
    inside = np.multiply(y[3:-3], c[3], out=d[3:-3])
    for k, weight in ((2, c[2]), (1, c[1]), (0, c[0])):
        inside += weight * (y[k : k - 6] + y[6 - k : len(y) - k])
    d[0], d[-1] = d[1], d[-2]
    d /= step**2
    return d
