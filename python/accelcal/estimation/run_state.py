"""One run while a fit iterates: nominal, noise, filter, smoothed signals, normal equations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array, Flags
from accelcal.data.recording import RecordingError
from accelcal.estimation.drive import DriveIntegrals
from accelcal.estimation.noise import LEAST_COUNT, Level, NoiseReport, estimate_noise, level, level_of
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise, Values
from accelcal.model import Model, Term
from accelcal.signals.signals import Signals

COLOURED = 0.15
"""Autocorrelation of innovations beyond which the noise is not the white noise of the model."""
LEAST_BLOCKS = 8
"""Fewer blocks than this do not measure a scatter."""
MOST_BLOCKS = 40
"""More blocks are not needed to measure one."""
NEAR, GROWN = 0.05, 0.3
"""Logarithms of q and R within which they are sought at least, and once the model has grown."""


@dataclass(frozen=True, slots=True)
class RunFit:
    """What the fit learned about one of its recordings."""

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


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal equations of one run."""

    gram: Array
    """X'X, (m, m)."""
    score: Array
    """X'y, (m,)."""
    spread: Array | None
    """Sum of outer products of block scores, (m, m); None when there are fewer than 8 blocks."""


class RunState:
    """The state of one run while a fit iterates."""

    def __init__(
        self, run: PreparedRun, values: Values, noise: Noise, terms: Sequence[Term], band: float | None
    ) -> None:
        self.run = run
        self.values = values
        self.noise = noise
        self.terms = terms
        self.band = band
        self.signals: Signals | None = None
        self.loud = noise
        """Noise by likelihood, before a band was imposed."""
        self.reach = 1.0
        """How far off it may be, in logarithms."""

    @classmethod
    def begin(cls, run: PreparedRun, model: Model, band: float | None) -> RunState:
        """First guess: output and a constant regressed on the encoder, noise by grid search."""
        start = at_first(model)
        scale, constant, noise = first_guess(run, start["time_offset"])
        if "scale_factor" not in model.fixed:
            start["scale_factor"] = scale - 1.0
        if "bias" not in model.fixed:
            start["bias"] = constant
        return cls(run, Values(start, model.terms), noise, model.free, band)

    def grown(self, model: Model) -> RunState:
        """A pass for a model with further effects, begun where this one came to rest: its first normal equations are
        those of the new coefficients at filter and signals of this one."""
        values = Values(at_first(model) | dict(self.values.by_name), model.terms)
        begun = RunState(self.run, values, self.noise, model.free, self.band)
        begun.loud, begun.reach = self.loud, GROWN
        begun.drive, begun.track, begun.signals = self.drive, self.track, self.signals
        begun.counts, begun.whitened = self.counts, self.whitened
        begun.normal = begun.normal_equations(begun.terms)
        return begun

    def refresh(self, *, noise_too: bool) -> None:
        """Nominal, noise, filter, smoothed signals and normal equations at the current values."""
        self.drive = self.run.drive(self.values, self.signals)
        if noise_too:
            before, self.loud = self.loud, estimate_noise(self.run, self.drive, self.loud, reach=self.reach)
            moved = max(abs(math.log(self.loud.q / before.q)), abs(math.log(self.loud.r / before.r)))
            self.reach = min(max(2.0 * moved, NEAR), 1.0)
            self.noise = self.loud if self.band is None else within(self.band, self.run, self.loud)
        vars(self).pop("track", None)  # gone before the next is made: each holds nine series
        self.track = self.run.track(self.drive, self.noise)
        self.signals = self.run.signals(self.drive, self.track, self.noise, self.values, self.signals, self.band)
        self.counts: Flags = self.drive.settled(self.run.wait(self.noise))
        self.whitened: Array = self.track.series("e")
        self.whitened /= np.sqrt(self.track.series("S"))
        self.normal = self.normal_equations(self.terms)

    def release(self) -> None:
        """Give up filter and signals, which hold most of the memory of a long run; run, noise and values stay."""
        for name in ("track", "drive", "whitened", "counts"):
            vars(self).pop(name, None)
        self.signals = None

    def information(self, term: Term) -> float:
        """What this run tells of the coefficient of one more term, all others known."""
        return float(self.normal_equations([term]).gram[0, 0])

    @property
    def log_likelihood(self) -> float:
        """Of the innovations that count."""
        y, S = self.whitened[self.counts], self.track.series("S")[self.counts]
        return float(-0.5 * np.sum(y**2 + np.log(2.0 * np.pi * S)))

    def normal_equations(self, terms: Sequence[Term]) -> Normal:
        """X'X and X'y of this run, stretch by stretch; X itself is never held whole."""
        assert self.signals is not None
        m = len(terms)
        gram, score = np.zeros((m, m)), np.zeros(m)
        block = self.blocks if self.band is not None else None
        sums = np.zeros((0 if block is None else int(block[-1]) + 1, m))
        for rows, columns in self.run.columns(self.track, self.drive, terms, self.signals):
            kept = self.counts[rows]
            columns = columns[kept]
            gram += columns.T @ columns
            parts = columns * self.whitened[rows][kept][:, None]
            score += parts.sum(axis=0)
            if block is not None:
                np.add.at(sums, block[rows][kept], parts)
        return Normal(gram, score, sums.T @ sums if len(sums) >= LEAST_BLOCKS else None)

    @property
    def blocks(self) -> NDArray[np.intp]:
        """Block of each reading; blocks outlast the memory of the filter."""
        span = float(self.run.t[-1] - self.run.t[0])
        length = max(span / MOST_BLOCKS, 1.0 / self.run.crossover(self.noise))
        return np.asarray((self.run.t - self.run.t[0]) / length, dtype=np.intp)

    @property
    def coloured(self) -> bool:
        """Whether innovations at the likelihood's own noise are far from white."""
        y = self.whitened[self.counts]
        if len(y) < LEAST_COUNT:
            return False
        power = float(np.mean(y**2))
        return any(abs(float(np.mean(y[lag:] * y[:-lag]))) > COLOURED * power for lag in (1, 2, 3))

    def finish(self) -> RunFit:
        """Noise report and fit statistics at the final values."""
        run, drive, noise = self.run, self.drive, self.noise
        assert self.signals is not None
        scale = self.values.scale
        rest = motion = None
        if self.band is None:
            whole = level(run, drive, noise, scale)
            moving = moving_readings(run, self.signals)
            rest = level_of(run, drive, noise, ~moving, scale)
            motion = level_of(run, drive, noise, moving, scale)
        else:
            noise = self.in_band()
            density, reading = abs(scale) * math.sqrt(2.0 * noise.q), math.sqrt(self.loud.r)
            share = 1.0 / math.sqrt(2.0 * max(1, int(self.blocks[-1])))
            whole = Level(density, share * density, reading, math.nan, int(self.counts.sum()))
        y = self.whitened[self.counts]
        report = NoiseReport(
            noise=noise,
            all=whole,
            rest=rest,
            motion=motion,
            declared=run.rig.sensor.noise,
            crossover=run.crossover(noise),
            band=self.band,
        )
        return RunFit(
            name=run.recording.name,
            digest=run.recording.digest,
            start=float(run.t[0]),
            end=float(run.t[-1]),
            readings=len(run.t),
            samples=len(run.accel.t),
            noise=report,
            log_likelihood=self.log_likelihood,
            nis=float(np.mean(y**2)) if self.band is None else None,
        )

    def in_band(self) -> Noise:
        """Noise scaled so that the model's covariance equals the one that the blocks show."""
        if self.normal.spread is None:
            return self.noise
        ratio = np.diag(self.normal.spread) / np.diag(self.normal.gram)
        factor = float(np.exp(np.mean(np.log(ratio))))
        return Noise(self.noise.q * factor, self.noise.r * factor)


def at_first(model: Model) -> dict[str, float]:
    """Coefficients before anything is known of them: where they are held, the mean of their prior, or zero."""
    return {
        e.name: model.fixed.get(e.name, model.priors[e.name].mean if e.name in model.priors else 0.0)
        for e in model.terms
    }


def first_guess(run: PreparedRun, time_offset: float) -> tuple[float, float, Noise]:
    """Rough 1 + k, K0 and noise from output and constant alone.

    The filter is linear in what drives it, so three passes (encoder alone, output alone, constant alone) give the
    innovations of every combination; for each trial of q the best combination is a 2 x 2 solve.
    """
    plain = run.drive(Values({"time_offset": time_offset}), None)
    rows = slice(0, min(len(run.t), 40_000))
    plain = plain.part(rows)
    h = np.diff(plain.t, prepend=plain.t[0])
    zero = np.zeros_like(h)
    polarity = run.rig.polarity
    ones = DriveIntegrals(
        plain.t, zero, np.where(plain.restart, 0, h), np.where(plain.restart, 0, h**2 / 2), plain.restart
    )
    encoder = DriveIntegrals(plain.t, plain.z, zero, zero, plain.restart)
    output = DriveIntegrals(plain.t, zero, plain.first, plain.second, plain.restart)
    r = run.reading_variance_guess
    rate = 1.0 / run.reading_step
    best: tuple[float, float, float, float] | None = None
    for crossover in np.geomspace(4.0 / (plain.t[-1] - plain.t[0]), 0.15 * rate, 9):
        noise = Noise((2.0 * np.pi * crossover) ** 4 * r * run.reading_step, r)
        tracks = [run.track(d, noise) for d in (encoder, output, ones)]
        S = tracks[0].series("S")
        counts = encoder.settled(run.wait(noise))
        if not counts.any():  # a filter this slow settles in no stretch between two holes
            continue
        y, u, one = ((t.series("e") / np.sqrt(S))[counts] for t in tracks)
        X = np.column_stack([-u, -one])
        c, *_ = np.linalg.lstsq(X, y, rcond=None)
        residual = float(np.mean((y - X @ c) ** 2))
        # With q and R scaled together the gains stay; the best common factor is the mean square itself.
        cost = float(np.mean(np.log(S[counts]))) + math.log(residual)
        if best is None or cost < best[0]:
            best = (cost, float(c[0]), float(c[1]), noise.q * residual)
            kept = Noise(noise.q * residual, r * residual)
    if best is None:
        raise RecordingError(
            f"{run.recording.name or 'recording'}: the record breaks off before any filter has settled, "
            f"{int(np.sum(plain.restart))} times in {len(plain.t)} readings; use `accelcal cut` on a whole part"
        )
    slope, constant = best[1], best[2]
    if not math.isfinite(slope) or abs(slope) < 1e-9:
        slope = 1e-9
    # p'' = pol (u - K0)/s - g was driven as pol u - g: slope multiplies (pol u - g).
    scale = 1.0 / slope
    bias = -polarity * (constant + run.rig.gravity * (1.0 - slope)) * scale
    return scale, bias, kept


def within(band: float, run: PreparedRun, noise: Noise) -> Noise:
    """Noise whose crossover lies at `band`, with the process density kept."""
    return Noise(noise.q, noise.q / ((2.0 * np.pi * band) ** 4 * run.reading_step))


def moving_readings(run: PreparedRun, signals: Signals) -> Flags:
    """Readings at which the stage moves: speed or acceleration above 2 % of their largest, and a little around."""
    v, a = np.abs(signals.v), np.abs(signals.a - np.median(signals.a))
    busy = (v > 0.02 * np.quantile(v, 0.999)) | (a > 0.05 * np.quantile(a, 0.999))
    step = float(signals.t[1] - signals.t[0])
    reach = max(1, int(0.05 / step))
    near = np.convolve(busy, np.ones(2 * reach + 1), mode="same") > 0 if len(busy) > 2 * reach else busy
    index = np.clip(np.rint((run.t - run.origins.t - signals.t[0]) / step).astype(int), 0, len(near) - 1)
    return np.asarray(near[index])
