"""One run at given coefficients: drive, noise, filter, smoothed signals and whitened innovations."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from accelcal import _core
from accelcal.data import Array, Flags, RecordingError
from accelcal.estimation.drive import DriveIntegrals, drive, require_output, run_filter, without_transients
from accelcal.estimation.dwell_rows import Nuisances
from accelcal.estimation.noise import (
    GROWN,
    LEAST_COUNT,
    LEAST_LINES,
    MeasuredSpectrum,
    NoiseSearch,
    variance_functions,
    with_growth,
)
from accelcal.estimation.run import LONG, PreparedRun
from accelcal.estimation.smoothing import smoothed_signals
from accelcal.estimation.values import Noise, Values
from accelcal.model import Model
from accelcal.signals.processing import NEARLY_NYQUIST, spectral_density
from accelcal.signals.signals import Signals

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
    gained, moved = (np.where(plain.restart, 0.0, integrals[rows]) for integrals in run.gravity_integrals)
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
            f"{run.recording.title}: the record breaks off before any filter has settled, "
            f"{int(np.sum(plain.restart))} times in {len(plain.t)} readings; use `accelcal cut` on a whole part"
        )
    _, slope, constant, likely = best
    if not math.isfinite(slope) or abs(slope) < 1e-9:
        slope = 1e-9
    scale = 1.0 / slope  # p'' + g = pol (u - K0)/s
    bias = -polarity * constant * scale
    return scale, bias, likely


COLOURED = 0.15
"""Autocorrelation of innovations beyond which the noise is not the white noise of the model."""
BEYOND_OUTPUT = 10.0
"""Power of the fitted noise over all that the output shows near the crossover, beyond which it is not the output's: an
error of the readings that is white as an acceleration passes every test of innovations."""
STILL_THERE = 0.5
"""Density of the innovations there, over that of white ones, below which the fitted noise stands for something slower:
an effect that the model lacks."""
MOTION_BELOW = 0.5
"""Share of the output's power below the crossover from which on the readings determine the motion."""
OCTAVE_BELOW = 0.5
"""That power is taken from this share of the crossover on."""


PART = 1 << 18
"""Readings of a part, where the filter runs part by part."""
FORGOTTEN = 16.0
"""Waits of a filter after which its start has left less than rounding does."""


@dataclass(frozen=True, slots=True)
class FilteredPart:
    """The filter over some readings, all of a short run; of a long one it has forgotten where it began and ended."""

    rows: slice
    """Readings at which it holds."""
    over: slice
    """Readings over which it ran."""
    drive: DriveIntegrals
    """Over those."""
    track: _core.ReplayTrack

    @classmethod
    def of(cls, run: PreparedRun, integrals: DriveIntegrals, noise: Noise, rows: slice) -> FilteredPart:
        """Of `rows`, at the least."""
        t, over = run.t, slice(0, len(run.t))
        if len(t) > LONG:
            margin = FORGOTTEN * run.wait(noise)
            length = max(PART, int(4.0 * margin / run.reading_step))
            rows = slice(rows.start, min(max(rows.stop, rows.start + length), len(t)))
            begin, end = np.searchsorted(t, [t[rows.start] - margin, t[rows.stop - 1] + margin]).tolist()
            over = slice(begin, end)
        else:
            rows = over
        part = integrals if over == slice(0, len(t)) else integrals.part(over)
        return cls(rows, over, part, run_filter(run, part, noise))

    @property
    def inside(self) -> slice:
        """The readings at which it holds among those over which it ran."""
        return slice(self.rows.start - self.over.start, self.rows.stop - self.over.start)

    def series(self, name: str) -> Array:
        """A series of its track at those readings."""
        return self.track.series(name)[self.inside]

    @property
    def smoothed(self) -> tuple[Array, Array, Array]:
        """Position (m), velocity (m/s) and noise of the output (m/s²) there, given all readings."""
        p, v, noise = self.track.smooth(*self.drive.arrays)
        return p[self.inside], v[self.inside], noise[self.inside]


@dataclass(slots=True, eq=False, weakref_slot=True)
class RunState:
    """One run at given coefficients; `at` makes one, `refresh` moves it to others."""

    run: PreparedRun
    values: Values
    noise: Noise
    """Noise that the filter is run with."""
    drive: DriveIntegrals
    filtered: FilteredPart | None
    """The filter over the readings that were last asked for; None before any were."""
    signals: Signals
    band: float | None
    """Band that is imposed on the noise, Hz."""
    search: NoiseSearch
    """Noise by likelihood, before a band is imposed."""
    spectrum: MeasuredSpectrum | None = None
    """Measured spectrum of what the model leaves; None where it is white, or before a fit has measured it."""
    weak: object | None = None
    """Rows of the weak form, where the run is fitted by it; `estimation.engines.sums_of` makes them."""
    of_dwells: Nuisances | None = None
    """What was estimated of the dwells of the recording beside the coefficients; None before a fit has."""
    counts: Flags = field(init=False)
    """Readings whose innovations are used, (n,)."""
    whitened: Array = field(init=False)
    """Innovations over their standard deviations, (n,)."""

    def __post_init__(self) -> None:
        self._read_track()

    @classmethod
    def at(
        cls, run: PreparedRun, values: Values, noise: Noise, band: float | None = None, *, search_noise: bool
    ) -> RunState:
        """The state at coefficients and noise; with `search_noise` at the noise that is most likely near them."""
        integrals, search = without_transients(run, drive(run, values, None), noise), NoiseSearch(noise)
        if search_noise:
            search = search.again(run, integrals)
            noise = search.within(band, run)
        state = cls(run, values, noise, integrals, None, cast(Signals, None), band, search)
        state.signals = smoothed_signals(run, integrals, state.smoothed(), noise, values, None, band)
        return state

    def refresh(self, values: Values, *, search_noise: bool, only_growing: bool = False) -> None:
        """Move to other coefficients: drive and signals are made from the signals of the state before. Nuisances stay.

        With `only_growing` noise is searched for where an effect of the model makes it grow, and nowhere else.
        """
        require_output(self.run, values)
        values = replace(values, nuisances=self.values.nuisances)
        run, ratio = self.run, self.values.scale / values.scale
        self.filtered = None  # free the old track before the next is made; each holds nine arrays
        del self.whitened
        self.values = values
        self.search = self.search.scaled(ratio**2)  # the sensor's noise stays; q is that noise over 1 + k
        self.drive = without_transients(run, drive(run, values, self.signals), self.noise)
        functions = variance_functions(run, self.noise, self.signals)
        self.weak = None
        if search_noise and (functions or not only_growing):
            self.search = self.search.again(run, self.drive, functions)
        self.noise = self.search.within(self.band, run)
        self.drive = with_growth(self.drive, self.noise, functions)
        before = None if values.constant else self.signals
        del self.signals  # five arrays, which a model without effects does not need
        self._read_track()
        self.signals = smoothed_signals(run, self.drive, self.smoothed(), self.noise, values, before, self.band)

    def filter_over(self, rows: slice) -> FilteredPart:
        """The filter over some readings, and beyond them."""
        held = self.filtered
        if held is None or rows.start < held.rows.start or held.rows.stop < rows.stop:
            self.filtered = held = FilteredPart.of(self.run, self.drive, self.noise, rows)
        return held

    def parts(self) -> Iterator[FilteredPart]:
        """The filter over all readings, part by part."""
        begin = 0
        while begin < len(self.run.t):
            part = self.filter_over(slice(begin, begin + 1))
            yield part
            begin = part.rows.stop

    def series(self, name: str) -> Array:
        """A series of the filter at all readings, (n,)."""
        series = np.empty(len(self.run.t))
        for part in self.parts():
            series[part.rows] = part.series(name)
        return series

    def smoothed(self) -> tuple[Array, Array, Array]:
        """Position (m), velocity (m/s) and noise of the output (m/s²) at all readings, given all of them, (n,) each."""
        p, v, noise = (np.empty(len(self.run.t)) for _ in range(3))
        for part in self.parts():
            p[part.rows], v[part.rows], noise[part.rows] = part.smoothed
        return p, v, noise

    def _read_track(self) -> None:
        self.counts = self.drive.settled(self.run.wait(self.noise))
        self.whitened = np.empty(len(self.run.t))
        for part in self.parts():
            np.divide(part.series("e"), np.sqrt(part.series("S")), out=self.whitened[part.rows])

    def grown(self, model: Model) -> RunState:
        """A state for a model with further effects, at the coefficients, filter and signals of this one."""
        grown = copy.copy(self)
        grown.values = Values(
            initial_coefficients(model) | dict(self.values.by_name), model.terms, self.values.nuisances
        )
        grown.search = NoiseSearch(self.search.noise, GROWN)
        grown.weak = None
        return grown

    @property
    def log_likelihood(self) -> float:
        """Of the innovations that count."""
        y, S = self.whitened[self.counts], self.series("S")[self.counts]
        return float(-0.5 * np.sum(y**2 + np.log(2.0 * np.pi * S)))

    @property
    def beyond_output(self) -> bool:
        """Whether the noise that is laid on the output is larger than all that the output shows near the crossover.

        It biases the scale factor where the readings determine the motion, so most of the output must lie below.
        """
        run, crossover = self.run, self.run.crossover(self.noise)
        rate = 1.0 / run.accel_step
        f, density = resolved(run.undone.y, rate, crossover)
        near = (f > OCTAVE_BELOW * crossover) & (f <= min(crossover, NEARLY_NYQUIST * rate))
        if np.count_nonzero(near) < LEAST_LINES // 2:
            return False
        moving = f > f[1]  # without the mean
        if np.sum(density[moving & (f <= crossover)]) < MOTION_BELOW * np.sum(density[moving]):
            return False
        shown = float(np.median(density[near] * (1.0 + (2.0 * np.pi * f[near] * run.tau(self.values)) ** 2)))
        laid = 2.0 * self.noise.usual.q * self.values.scale**2
        return laid > BEYOND_OUTPUT * shown > 0.0 and self._left_near(crossover) > STILL_THERE

    def _left_near(self, crossover: float) -> float:
        """Density of the whitened innovations near the crossover over that of white noise of variance 1."""
        y, rate = self.whitened[self.counts], 1.0 / self.run.reading_step
        f, density = resolved(y, rate, crossover)
        near = density[(f > OCTAVE_BELOW * crossover) & (f <= crossover)]
        return float(np.median(near)) * 0.5 * rate if len(near) else 0.0

    @property
    def coloured(self) -> bool:
        """Whether innovations at the likelihood's own noise are far from white."""
        y = self.whitened[self.counts]
        if len(y) < LEAST_COUNT:
            return False
        power = float(np.mean(y**2))
        return self.beyond_output or any(
            abs(float(np.mean(y[lag:] * y[:-lag]))) > COLOURED * power for lag in (1, 2, 3)
        )


def resolved(y: Array, rate: float, crossover: float) -> tuple[Array, Array]:
    """Frequencies, Hz, and one-sided density of samples, from segments as long as lines near the crossover need."""
    segment = min(len(y), 2 ** max(6, math.ceil(math.log2(2.0 * LEAST_LINES * rate / crossover))))
    return spectral_density(y, rate, segment)
