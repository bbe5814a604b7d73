"""Where and how much a fitted model fails on a recording: simulation, k-step errors, coasting, residuals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from accelcal.effects.memory import since_reversal
from accelcal.fit import Fit, require_band
from accelcal.predict import Coasting, Prediction, accumulated, rms
from accelcal.recording import Array, Recording
from accelcal.replay import Flags, Noise
from accelcal.shown import shown
from accelcal.signals import ORDER, Signals, derivative, low_pass

HORIZONS = (1.0, 5.0, 10.0)
"""Seconds after position is withheld at which the coasting error is taken."""
STEPS = (1, 10, 100, 1000)
"""Readings ahead at which prediction errors are taken."""
BINS = 12
"""Bins of the residual against each variable."""
EDGE = 4.0
"""Periods of the band at either end of a record that a zero-phase low-pass spoils."""
LEAST_PERIODS = 12.0
"""Fewer periods of the band than this are too short a residual to say where it is large."""
NOTABLE = 4.0
"""A bin that differs from zero by more standard deviations than this is named as the worst."""


@dataclass(frozen=True, slots=True)
class Coast:
    """Unaided drift: what position would have been, had it been withheld."""

    start: float
    """Last reading used, s."""
    t: Array
    """Reading times after it, (n,) s."""
    frozen: Array
    """Predicted position with every parameter from the fit, (n,) m."""
    rezeroed: Array
    """Predicted position with this run's constant estimated before the start, (n,) m."""
    floor: Array
    """Standard deviation that noise and start state alone would give, (n,) m."""


@dataclass(frozen=True, slots=True)
class Bins:
    """Mean residual against one variable, with the band that noise alone would give."""

    variable: str
    unit: str
    edges: Array
    """(n + 1,)"""
    mean: Array
    """(n,) m/s²; against frequency: density ratio of residual to prediction."""
    std: Array
    """(n,) standard deviation of the mean under noise alone."""

    @property
    def score(self) -> Array:
        """Mean over its standard deviation, (n,); against frequency the excess over 1."""
        offset = 1.0 if self.variable == "frequency" else 0.0
        return np.divide(self.mean - offset, self.std, out=np.zeros_like(self.mean), where=self.std > 0.0)

    def explained(self, rms: float) -> float:
        """Share of the mean square `rms`² that a function of this variable explains, beyond chance; at least 0.

        Bins weigh as much as they hold data, which is the inverse of their variance; 0 against frequency.
        """
        known = self.std > 0.0
        if self.variable == "frequency" or not known.any() or not rms > 0.0:
            return 0.0
        weight = self.std[known] ** -2.0
        return max(0.0, float(np.sum(weight * self.mean[known] ** 2 - 1.0) / np.sum(weight)) / rms**2)


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Density of a residual, the one that noise alone would have, and the region of their ratio."""

    frequency: Array
    """(n,) Hz"""
    density: Array
    """(n,) one-sided, unit of the residual squared per Hz."""
    predicted: Array
    """(n,) the same under noise alone."""
    low: float
    high: float
    """95 % of the ratios of density to prediction lie between, each frequency on its own."""


@dataclass(frozen=True, slots=True)
class Outside:
    """Readings outside the range of one variable that the fit has seen, and the errors inside and outside of it."""

    variable: str
    """a, v, p, temperature or another side channel; "any" for readings outside of any of these."""
    unit: str
    range: tuple[float, float] | None
    """That the fit has seen; None for "any"."""
    count: int
    of: int
    """Settled readings at which the motion is known; ends of the record and holes do not count."""
    one_step: tuple[float | None, float | None]
    """Rms innovation inside and outside, m; None where there is no reading."""
    coast: Mapping[float, tuple[float | None, float | None]]
    """Rezeroed rms drift by horizon: windows wholly inside, windows that leave the range, m."""
    starts: Mapping[float, tuple[int, int]]
    """Windows by horizon, inside and outside."""


@shown
@dataclass(frozen=True, slots=True)
class Comparison:
    """A fitted model against a recording."""

    recording: str
    one_step_rms: float
    """m"""
    nis: float | None
    """Mean normalised innovation squared; None where a band was imposed on the fit."""
    k_step_rms: Mapping[int, float | None]
    """Readings ahead -> m."""
    coast_rms: Mapping[float, float | None]
    """Rezeroed: horizon in s -> m; None where the record is too short."""
    coast_frozen_rms: Mapping[float, float | None]
    coast_floor: Mapping[float, float | None]
    coast_starts: Mapping[float, int]
    accel_rms: float
    """Accelerometer-side residual inside the band, m/s²."""
    band: float
    """Hz"""
    simulated: tuple[Array, Array, Array]
    """Free-running simulation: time (s), measured and simulated position (m)."""
    simulated_std: Array
    """Standard deviation of the simulation from noise and start state, m."""
    simulated_rms: float
    """m"""
    residual: tuple[Array, Array]
    """One-step residuals: time (s), innovation (m)."""
    residual_std: Array
    """Predicted standard deviation of each, m."""
    accel_residual: tuple[Array, Array]
    """Accelerometer-side residual: time (s), m/s²."""
    bins: tuple[Bins, ...]
    worst: str
    setup_bias: tuple[float, float]
    """This run's constant minus the fit's, with standard deviation, m/s²: set-up or turn-on bias."""
    remarks: tuple[str, ...] = field(default=())
    outside: tuple[Outside, ...] = ()
    """Readings beyond the range that the fit has seen, variable by variable; the last entry is any of them."""

    def __repr__(self) -> str:
        drifts = (f"{h:g} s: {drift:.3g} m" for h, drift in self.coast_rms.items() if drift is not None)
        return f"Comparison({self.recording!r}: rms drift after {', '.join(drifts) or 'no time: too short'})"


def compare(
    fit: Fit,
    recording: Recording,
    *,
    band: float | None = None,
    horizons: Sequence[float] = HORIZONS,
    start: float | None = None,
    end: float | None = None,
) -> Comparison:
    """Compare a fitted model with a recording, simulation first.

    Parameters
    ----------
    fit : parameters, noise and origins.
    recording : any run, the fitted one or another.
    band : Hz, optional; bandwidth of the accelerometer-side residual. By default the crossover of the two noises, below
        which predicted encoder noise stays under sensor noise.
    horizons : s; when to take the coasting error after position is withheld.
    start, end : s, optional; only readings in [start, end] are used.

    Returns
    -------
    Comparison

    Raises
    ------
    RecordingError
        If the channels do not overlap.

    Notes
    -----
    While position is withheld nothing uses it: what effects need comes from the corrected output and the simulated
    motion, the start state from the causal filter, the constant from readings before the start.
    """
    ahead = Prediction.of(fit, recording, start=start, end=end)
    run, e, S = ahead.run, ahead.e, ahead.S
    counts = ahead.counts
    coasting = {horizon: ahead.at_horizon(horizon) for horizon in horizons}
    require_band(run, band)
    seen_band = band if band is not None else min(ahead.crossover, 0.2 / run.reading_step)
    t_res, residual, motion = accel_residual(ahead, seen_band)
    bins: tuple[Bins, ...] = ()
    if len(residual) * run.reading_step * seen_band >= LEAST_PERIODS:
        found = bin_residual(ahead, t_res, residual, motion, seen_band)
        bins = (*found, spectrum(ahead, residual, seen_band))
    delta, delta_std = ahead.constant_at(len(run.t) - 1)
    gain = abs(fit.values().scale)
    simulated = ahead.simulate()
    return Comparison(
        recording=recording.name,
        one_step_rms=float(np.sqrt(np.mean(e[counts] ** 2))),
        nis=None if fit.runs[0].noise.band is not None else float(np.mean(e[counts] ** 2 / S[counts])),
        k_step_rms={k: ahead.k_step(k) for k in STEPS},
        coast_rms={h: rms(c.rezeroed) for h, c in coasting.items()},
        coast_frozen_rms={h: rms(c.frozen) for h, c in coasting.items()},
        coast_floor={h: rms(c.floor) for h, c in coasting.items()},
        coast_starts={h: len(c.starts) for h, c in coasting.items()},
        accel_rms=float(np.sqrt(np.mean(residual**2))) if len(residual) else math.nan,
        band=seen_band,
        simulated=simulated[:3],
        simulated_std=simulated[3],
        simulated_rms=float(np.sqrt(np.mean((simulated[1] - simulated[2]) ** 2))),
        residual=(run.t, e),
        residual_std=np.sqrt(S),
        accel_residual=(t_res, residual),
        bins=bins,
        worst=worst_of(bins),
        setup_bias=(-delta * gain * run.rig.polarity, delta_std * gain),
        remarks=beyond(fit, motion),
        outside=outside(fit, ahead, t_res, motion, coasting),
    )


def coast(fit: Fit, recording: Recording, start: float, horizon: float) -> Coast:
    """Predict position over `horizon` seconds after the last reading at or before `start`, without using any later one.

    Parameters
    ----------
    fit, recording : model and run.
    start, horizon : s.

    Raises
    ------
    ValueError
        If no reading precedes `start` or the accelerometer record ends before the horizon.
    """
    ahead = Prediction.of(fit, recording, withheld=start)
    k = int(np.searchsorted(ahead.run.t, start, side="right")) - 1
    if k < 1:
        raise ValueError(f"no encoder reading precedes {start} s; the record begins at {ahead.run.t[0]:.6g} s")
    stop = int(np.searchsorted(ahead.run.t, ahead.run.t[k] + horizon, side="right"))
    rows = np.arange(k + 1, stop)
    if len(rows) == 0 or bool(np.any(ahead.drive.restart[rows])):
        raise ValueError(f"the accelerometer record does not reach {horizon} s beyond {start} s without a hole")
    frozen, rezeroed = ahead.predict(k, rows)
    return Coast(float(ahead.run.t[k]), ahead.run.t[rows], frozen, rezeroed, ahead.floor(k, ahead.run.t[rows]))


def accel_residual(ahead: Prediction, band: float) -> tuple[Array, Array, Signals]:
    """Output minus what the model says for the encoder's own acceleration, both low-passed at `band`.

    The difference of measured and simulated position is low-passed and differentiated, not the positions themselves:
    it is small and nearly straight, so a short record keeps its ends.

    Returns
    -------
    Times (n,) s, residual (n,) m/s², and the encoder's motion on the same grid.
    """
    run, values = ahead.run, ahead.values
    step = run.reading_step
    t = np.arange(run.t[0], run.t[-1], step)
    rate = 1.0 / step
    rig = run.rig

    def smoothed(y: Array) -> Array:
        return low_pass(np.asarray(scipy.interpolate.CubicSpline(run.t, y)(t)), rate, band)

    # one spline at a time: each holds six series of its own
    missed = smoothed(ahead.drive.z - accumulated(ahead.drive, np.diff(run.t, prepend=run.t[0]))[1])
    residual = -values.scale * rig.polarity * second_derivative(missed, step)
    del missed
    p = smoothed(run.z)
    a = second_derivative(p, step)
    sensed = rig.polarity * (a + rig.gravity)
    motion = Signals(
        t=t - run.origins.t,
        p=p - run.origins.p,
        v=derivative(p, step),
        a=sensed,
        jerk=derivative(sensed, step),
        scale=values.scale,
        bias=values.bias,
        rig=rig,
        cutoff=band,
        side=run.side_at(t),
    )
    edge = int(min(EDGE / band, 0.25 * (t[-1] - t[0])) * rate)
    inside = np.zeros(len(t), dtype=np.bool_)
    inside[edge : len(t) - edge] = True
    for hole in np.flatnonzero((np.diff(run.t) > 8.0 * step) | ahead.drive.restart[1:]):
        near = slice(*np.searchsorted(t, [run.t[hole] - 1.0 / band, run.t[hole + 1] + 1.0 / band]))
        inside[near] = False
    return t[inside], residual[inside], motion.at(inside)


def second_derivative(y: Array, step: float) -> Array:
    """Second derivative of uniform samples, sixth order inside, second order at the two ends."""
    d = np.zeros_like(y)
    if len(y) < 7:
        return np.asarray(np.gradient(np.gradient(y, step), step))
    d[1:-1] = y[2:] - 2.0 * y[1:-1] + y[:-2]
    c = (2.0 / 180.0, -27.0 / 180.0, 270.0 / 180.0, -490.0 / 180.0)
    d[3:-3] = c[3] * y[3:-3] + c[2] * (y[2:-4] + y[4:-2]) + c[1] * (y[1:-5] + y[5:-1]) + c[0] * (y[:-6] + y[6:])
    d[0], d[-1] = d[1], d[-2]
    return d / step**2


def bin_residual(ahead: Prediction, t: Array, residual: Array, motion: Signals, band: float) -> list[Bins]:
    """Mean residual against time and every variable of the motion."""
    run, noise = ahead.run, ahead.noise
    density = 2.0 * noise.q * ahead.values.scale**2  # one-sided, of the output
    # The mean of T seconds of noise with that density has variance density/(2 T).
    step = run.reading_step
    variables = {
        "time": (t, "s"),
        "position": (motion.p + run.origins.p, "m"),
        "velocity": (motion.v, "m/s"),
        "acceleration": (motion.a, "m/s²"),
        "jerk": (motion.jerk, "m/s³"),
        "time since reversal": (since_reversal(motion), "s"),
        **{
            name: (y + (run.origins.temperature if name == "temperature" else 0.0), run.recording.side[name].unit)
            for name, y in motion.side.items()
        },
    }
    found = []
    for name, (x, unit) in variables.items():
        known = np.isfinite(x)
        if not known.any():
            continue
        low, high = (float(v) for v in np.quantile(x[known], [0.001, 0.999]))
        if not high > low:
            continue
        edges = np.linspace(low, high, BINS + 1)
        index = np.clip(np.searchsorted(edges, x[known], side="right") - 1, 0, BINS - 1)
        count = np.bincount(index, minlength=BINS)
        total = np.bincount(index, weights=residual[known], minlength=BINS)
        mean = np.divide(total, count, out=np.zeros(BINS), where=count > 0)
        std = np.sqrt(np.divide(density, 2.0 * step * count, out=np.zeros(BINS), where=count >= 1.0 / (band * step)))
        found.append(Bins(name, unit, edges, mean, std))
    return found


def spectrum(ahead: Prediction, residual: Array, band: float) -> Bins:
    """Density of the residual over the predicted one, in bins of frequency up to the band."""
    rate = 1.0 / ahead.run.reading_step
    segment = int(min(len(residual), max(64, 2 ** round(math.log2(8.0 * BINS * rate / band)))))
    if segment < 16:
        return Bins("frequency", "Hz", np.linspace(0.0, band, BINS + 1), np.ones(BINS), np.zeros(BINS))
    f, density = scipy.signal.welch(residual, fs=rate, nperseg=segment)
    expected = predicted_density(f, ahead.noise, ahead.values.scale, ahead.run.reading_step, band)
    edges = np.linspace(0.0, 0.8 * band, BINS + 1)
    ratio, std = np.ones(BINS), np.zeros(BINS)
    averages = max(1.0, 2.0 * len(residual) / segment - 1.0)
    for i in range(BINS):
        rows = (f > edges[i]) & (f <= edges[i + 1])
        if rows.any():
            ratio[i] = float(np.mean(density[rows] / expected[rows]))
            std[i] = 1.3 / math.sqrt(averages * float(rows.sum()))  # neighbours of a Hann window overlap
    return Bins("frequency", "Hz", edges, ratio, std)


def predicted_density(f: Array, noise: Noise, scale: float, step: float, band: float) -> Array:
    """One-sided density of the accelerometer-side residual under noise alone, (n,) (m/s²)²/Hz.

    Parameters
    ----------
    f : (n,) Hz.
    noise, scale : of the model; scale is 1 + k.
    step : of the encoder readings, s.
    band : of the low-pass, Hz.
    """
    encoder = 2.0 * noise.r * step * (2.0 * np.pi * f) ** 4
    passed = 1.0 / (1.0 + (f / band) ** (2 * ORDER)) ** 2  # the low-pass ran forwards and backwards
    return np.asarray(scale**2 * (2.0 * noise.q + encoder) * passed)


def accel_spectrum(fit: Fit, comparison: Comparison) -> Spectrum | None:
    """Spectrum of the accelerometer-side residual beside the predicted noise; None where the record is too short."""
    _t, residual = comparison.accel_residual
    step = float(np.median(np.diff(comparison.residual[0])))
    found = welch(residual, 1.0 / step)
    if found is None:
        return None
    f, density, low, high = found
    inside = (f > 0.0) & (f <= comparison.band)
    if int(inside.sum()) < FEWEST_LINES:
        return None
    predicted = predicted_density(f[inside], fit.noise(), fit.values().scale, step, comparison.band)
    return Spectrum(f[inside], density[inside], predicted, low, high)


def one_step_spectrum(comparison: Comparison) -> Spectrum | None:
    """Spectrum of one-step residuals over their predicted deviation, which is flat when nothing is missing, 1/Hz."""
    t, e = comparison.residual
    rate = 1.0 / float(np.median(np.diff(t)))
    found = welch(e / comparison.residual_std, rate)
    if found is None:
        return None
    f, density, low, high = found
    return Spectrum(f[1:], density[1:], np.full(len(f) - 1, 2.0 / rate), low, high)


FEWEST_LINES = 4
"""Frequencies without which a spectrum shows nothing."""
SEGMENTS = 24
"""Half-overlapping segments of a spectrum that is looked at."""
OVERLAP_LOSS = 1.0 + 2.0 / 36.0
"""Half-overlapping Hann segments are worth this many times fewer independent ones (Welch 1967)."""


def welch(y: Array, rate: float) -> tuple[Array, Array, float, float] | None:
    """Frequencies, one-sided density, and the 95 % region of its ratio to the true one; None below 64 samples."""
    if len(y) < 64:
        return None
    segment = int(min(len(y), max(64, 2 * len(y) // (SEGMENTS + 1))))
    f, density = scipy.signal.welch(y, fs=rate, nperseg=segment)
    worth = max(1.0, (2.0 * len(y) / segment - 1.0) / OVERLAP_LOSS)
    low, high = (float(scipy.special.gammaincinv(worth, p)) / worth for p in (0.025, 0.975))
    return f, density, low, high


def worst_of(bins: Sequence[Bins]) -> str:
    """The region that stands out most, in words.

    Any error has a spectrum, so frequency is named only where no variable of the motion stands out.
    """
    found = [(float(np.max(np.abs(b.score))), b, int(np.argmax(np.abs(b.score)))) for b in bins]
    explaining = [one for one in found if one[1].variable != "frequency" and one[0] >= NOTABLE]
    best = max(explaining or found, key=lambda one: one[0], default=None)
    if best is None:
        return "the record is too short to say where the model fails"
    score, one, i = best
    if score < NOTABLE:
        return f"no region stands out: the largest of {sum(len(b.mean) for b in bins)} deviations is {score:.1f} sigma"
    where = f"{one.variable} between {one.edges[i]:.4g} and {one.edges[i + 1]:.4g} {one.unit}".rstrip()
    if one.variable == "frequency":
        return f"{where}: the residual is {math.sqrt(one.mean[i]):.2g} times the predicted noise ({score:.1f} sigma)"
    return f"{where}: mean residual {one.mean[i]:+.3g} m/s² ({score:.1f} sigma)"


def beyond(fit: Fit, motion: Signals) -> tuple[str, ...]:
    """Sentences on what this run does beyond the range that the fit has seen."""
    said = []
    for key, (y, unit) in seen_by(fit, motion).items():
        low, high = fit.validity[key]
        share = float(np.mean((y < low) | (y > high)))
        if share > 0.001:
            span = f"[{low:.4g}, {high:.4g}] {unit}".rstrip()
            said.append(f"{100 * share:.1f} % of this run lies outside the fitted range of {key} {span}")
    return tuple(said)


def seen_by(fit: Fit, motion: Signals) -> dict[str, tuple[Array, str]]:
    """Variables of the motion whose range the fit has kept, with their units."""
    offsets = {"temperature": fit.origins.temperature}
    variables = {"a": (motion.a, "m/s²"), "v": (motion.v, "m/s"), "p": (motion.p + fit.origins.p, "m")}
    variables |= {
        name: (y + offsets.get(name, 0.0), "degC" if name == "temperature" else "") for name, y in motion.side.items()
    }
    return {key: value for key, value in variables.items() if key in fit.validity}


def outside(
    fit: Fit, ahead: Prediction, t: Array, motion: Signals, coasting: Mapping[float, Coasting]
) -> tuple[Outside, ...]:
    """Count and score the readings beyond the range that the fit has seen; empty where no range is known.

    Parameters
    ----------
    t : (n,) s, times of `motion`.
    coasting : drift by horizon. A window that leaves the range at any reading counts as outside.
    """
    run, variables = ahead.run, seen_by(fit, motion)
    if len(t) == 0 or not variables:
        return ()
    at = np.clip(np.searchsorted(t, run.t - 0.5 * run.reading_step), 0, len(t) - 1)
    known = ahead.counts & (np.abs(t[at] - run.t) <= run.reading_step)
    flags = {}
    for key, (y, _) in variables.items():
        low, high = fit.validity[key]
        flags[key] = known & ((y < low) | (y > high))[at]
    found = [
        scored(ahead, known, flags[key], coasting, key, unit, fit.validity[key]) for key, (_, unit) in variables.items()
    ]
    return (*found, scored(ahead, known, np.any(list(flags.values()), axis=0), coasting, "any", "", None))


def scored(
    ahead: Prediction,
    known: Flags,
    out: Flags,
    coasting: Mapping[float, Coasting],
    variable: str,
    unit: str,
    span: tuple[float, float] | None,
) -> Outside:
    """Errors of one side of a range and of the other."""
    left = np.cumsum(out)
    apart = {h: left[c.ends] > left[c.starts] for h, c in coasting.items()}
    return Outside(
        variable=variable,
        unit=unit,
        range=span,
        count=int(out.sum()),
        of=int(known.sum()),
        one_step=(rms(ahead.e[known & ~out]), rms(ahead.e[out])),
        coast={h: (rms(c.rezeroed[~apart[h]]), rms(c.rezeroed[apart[h]])) for h, c in coasting.items()},
        starts={h: (int(np.sum(~apart[h])), int(np.sum(apart[h]))) for h in coasting},
    )
