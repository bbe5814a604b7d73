"""Fit a model to one or several recordings: the replay, iterated to its fixed point."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.effects import find
from accelcal.model import Model, Prior, Term
from accelcal.noise import LEAST_COUNT, Level, NoiseReport, estimate_noise, level, level_of
from accelcal.recording import Array, Recording, RecordingError
from accelcal.replay import Drive, Flags, Noise, Run, Values
from accelcal.rig import STANDARD_GRAVITY, Rig
from accelcal.shaping import Bend, linearised
from accelcal.signals import Origins, Signals

MAX_ROUNDS = 12
"""Rounds of linearisation; a start within a fifth of a period of the true delay needs four."""
USUAL_ROUNDS = 6
"""Rounds that a well-behaved record takes; the measure of progress."""
NOISE_ROUNDS = 5
"""Rounds in which the noise is estimated anew."""
CONVERGED = 0.01
"""A round that moves every parameter by less than this share of its standard deviation is the last."""
SHAPE_ROUNDS = 6
"""Rounds in which shape parameters move."""
SHAPE_CONVERGED = 0.1
"""The same for shape parameters, each round of which is a whole fit."""
COLOURED = 0.15
"""Autocorrelation of innovations beyond which the noise is not the white noise of the model."""
TRIAL_BANDS = 9
"""Bands that are tried when it is not."""
LEAST_BLOCKS = 8
"""Fewer blocks than this do not measure a scatter."""
MOST_BLOCKS = 40
"""More blocks are not needed to measure one."""
PER_RUN_OWNERS = ("timing",)
"""Owners whose coefficients belong to each run of a joint fit."""
SEPARATED_BY_TURNING = ("tilt",)
SEPARATED_BY_ROLLING = ("misalignment", "cross_axis_gravity")


class NotIdentifiable(ValueError):
    """The record cannot determine the model. The text says what was not excited and what to do."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter with its standard uncertainty."""

    name: str
    symbol: str
    unit: str
    value: float
    std: float
    """0 when the parameter was held fixed."""
    owner: str
    run: int | None = None
    """Which run it belongs to in a joint fit; None when all runs share it."""


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
class Fit:
    """Estimates of a model with their covariance, and where they come from."""

    model: Model
    estimates: tuple[Estimate, ...]
    covariance: Array
    """(m, m) of the free estimates, in their order, SI units."""
    runs: tuple[RunFit, ...]
    origins: Origins
    rig: Rig
    """Rig of the first recording."""
    method: str = "replay"
    validity: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of a (m/s²), v (m/s), p (m), temperature (degC), frequency (Hz) that the fit has seen."""
    remarks: tuple[str, ...] = ()
    """Sentences a user must read beside the numbers."""
    shapes: tuple[Estimate, ...] = ()
    """Shape parameters that were estimated (creep.tau); their doubt stands in the covariance, they do not."""

    def __getitem__(self, name: str) -> Estimate:
        """Return the (first) estimate called `name`."""
        for estimate in (*self.estimates, *self.shapes):
            if estimate.name == name:
                return estimate
        raise KeyError(f"{name!r} is not a parameter of this fit; it has {', '.join(e.name for e in self.estimates)}")

    @property
    def free(self) -> tuple[Estimate, ...]:
        """Estimates in the order of the covariance."""
        return tuple(e for e in self.estimates if e.name not in self.model.fixed)

    @property
    def log_likelihood(self) -> float:
        """Innovation log-likelihood of all runs."""
        return sum(run.log_likelihood for run in self.runs)

    def values(self, run: int = 0) -> Values:
        """Coefficients as they apply to one run."""
        return Values({e.name: e.value for e in self.estimates if e.run in (None, run)}, self.model.terms)

    def noise(self, run: int = 0) -> Noise:
        """Noise of one run."""
        return self.runs[run].noise.noise


def fit(
    model: Model,
    recordings: Recording | Sequence[Recording],
    *,
    start: float | None = None,
    end: float | None = None,
    band: float | None = None,
    origins: Origins | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Estimate the free parameters of a model by the replay with smoothed regressors.

    Parameters
    ----------
    model : base and effects.
    recordings : one or several runs. Each is whitened on its own; their information adds up. Parameters of the
        sensor are shared, those of timing belong to each run. Runs with a reversed mount beside normal ones bring in
        `tilt`, rolled beside normal ones `misalignment` and `cross_axis_gravity`; a low-pass with a declared tolerance
        brings in `lowpass_error` with that tolerance as its prior.
    start, end : s, optional; only readings in [start, end] are used.
    band : Hz, optional; trust the encoder up to this frequency and the accelerometer's share below it, instead of up
        to the crossover of the two noises.
    origins : zero points of t, p and temperature; by default those of the first recording.
    report : called with the share of the work that is done, 0 to 1.

    Returns
    -------
    Fit

    Raises
    ------
    NotIdentifiable
        If the motion does not excite what the model asks for.
    RecordingError
        If polarity or axis of the sidecar contradict the data.

    Notes
    -----
    Gauss-Newton about the exact nominal: output re-stamped by `time_offset`, integrals of the output, RTS-smoothed
    motion as regressors, q and R by innovation likelihood in each of the first rounds.
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    if not several:
        raise ValueError("a fit needs at least one recording")
    return result(solve_runs(model, several, start=start, end=end, band=band, origins=origins, report=report))


def solve_runs(
    model: Model,
    recordings: Sequence[Recording],
    *,
    start: float | None = None,
    end: float | None = None,
    band: float | None = None,
    origins: Origins | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> Solution:
    """Complete the model, prepare the runs and iterate; where the noise is not white, in the band that determines the
    scale best.

    Parameters and errors are those of :func:`fit`.
    """
    model = complete(model, recordings)
    first = Run(recordings[0], origins, start=start, end=end)
    runs = [first, *(Run(r, first.origins, start=start, end=end) for r in recordings[1:])]
    for run in runs:
        require_motion(run)
    solution = iterate(model, runs, [band] * len(runs), report)
    if band is None:
        bands = [choose_band(model, one) if one.coloured else None for one in solution.passes]
        if any(bands):
            solution = replace(iterate(model, runs, bands, report), chosen=tuple(bands))
    return shaped(solution)


def shaped(solution: Solution) -> Solution:
    """The solution at the shape parameters that the record is most likely at, with their doubt in the covariance."""
    bent = Bent.of(solution)
    for _ in range(SHAPE_ROUNDS):
        if bent is None:
            return solution
        if bent.settled:
            break
        moved = bent.moved(solution.model)
        try:
            trial = iterate(moved, [p.run for p in solution.passes], [p.band for p in solution.passes])
        except NotIdentifiable:
            break
        if trial.log_likelihood <= solution.log_likelihood:
            break
        solution = replace(trial, chosen=solution.chosen)
        bent = Bent.of(solution)
    return solution if bent is None else replace(solution, covariance=bent.covariance, shapes=bent.estimates)


@dataclass(frozen=True, slots=True)
class Bent:
    """Shape parameters beside the coefficients at a solution, linearised."""

    bends: Sequence[Bend]
    step: Array
    """Towards the most likely values, (b,)."""
    std: Array
    """(b,)"""
    covariance: Array
    """Of the coefficients, the doubt of the shapes included, (m, m)."""

    @classmethod
    def of(cls, solution: Solution) -> Bent | None:
        """Normal equations of coefficients and shapes together; None where no shape parameter is free."""
        layout, passes = solution.layout, solution.passes
        first = passes[0]
        assert first.signals is not None
        bends = linearised(solution.model, first.values, first.signals, first.information)
        if not bends:
            return None
        m, b = len(layout.slots), len(bends)
        belief = np.array([*layout.prior_information(solution.model), *(one.belief**-2.0 for one in bends)])
        information, score = np.diag(belief), np.zeros(m + b)
        score[:m] = belief[:m] * (layout.prior_mean(solution.model) - solution.x)
        for index, one in enumerate(passes):
            assert one.signals is not None
            own = bends if index == 0 else linearised(solution.model, one.values, one.signals, one.information)
            rows = [*layout.rows(index), *range(m, m + b)]
            normal = one.normal_equations([*one.terms, *(bend.term for bend in own)])
            information[np.ix_(rows, rows)] += normal.gram
            score[rows] += normal.score
        size = np.sqrt(np.diag(information))
        inverse = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
        plain = np.linalg.inv(information[:m, :m] / np.outer(size[:m], size[:m])) / np.outer(size[:m], size[:m])
        # What was added to the covariance for noise that is not white stays.
        covariance = solution.covariance + inverse[:m, :m] - plain
        return cls(bends, (inverse @ score)[m:], np.sqrt(np.diag(inverse)[m:]), covariance)

    @property
    def settled(self) -> bool:
        """Whether no shape parameter would move by a noticeable share of its standard deviation."""
        return bool(np.all(np.abs(self.step) < SHAPE_CONVERGED * self.std))

    def moved(self, model: Model) -> Model:
        """The model one step on."""
        return model.reshaped(**{b.name: b.moved(float(d)) for b, d in zip(self.bends, self.step, strict=True)})

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Values and standard deviations."""
        return tuple(
            Estimate(b.name, b.shape, b.unit, b.value, float(std), find(b.effect).owner)
            for b, std in zip(self.bends, self.std, strict=True)
        )


def result(solution: Solution) -> Fit:
    """The fit that a solution amounts to.

    Raises
    ------
    NotIdentifiable, RecordingError
        If the solution cannot be a sensor on the declared rig.
    """
    model, layout, passes = solution.model, solution.layout, solution.passes
    x, covariance = solution.x, solution.covariance
    runs = [one.run for one in passes]
    left_out = [(name_of(run), run.left_out) for run in runs if run.left_out]
    remarks = [f"{name}: {count} readings jump away and come back; left out" for name, count in left_out]
    remarks += [
        f"{name_of(run)}: the noise is not white up to the crossover; the encoder is trusted up to {b:.3g} Hz only, "
        "where the estimate is surest"
        for run, b in zip(runs, solution.chosen, strict=False)
        if b is not None
    ]
    remarks += judge(layout, x, covariance, runs)
    if not solution.converged:
        remarks.append(
            f"the iteration had not settled after {MAX_ROUNDS} rounds: the model does not describe this record"
        )
    fits = tuple(one.finish() for one in passes)
    remarks += [f"{f.name or 'recording'}: {f.noise.remark}" for f in fits if f.noise.remark]
    return Fit(
        model=model,
        estimates=layout.estimates(x, covariance, model),
        covariance=covariance,
        runs=fits,
        origins=runs[0].origins,
        rig=runs[0].rig,
        validity=validity(passes),
        remarks=tuple(remarks),
        shapes=(*solution.shapes, *held_shapes(model)),
    )


def held_shapes(model: Model) -> Iterator[Estimate]:
    """Shape parameters that the model holds."""
    for name, value in model.fixed.items():
        effect, _, shape = name.partition(".")
        if effect in model.effects and shape in find(effect).shapes:
            yield Estimate(name, shape, find(effect).shapes[shape].unit, value, 0.0, find(effect).owner)


@dataclass(frozen=True, slots=True)
class Solution:
    """Where the iteration came to rest."""

    model: Model
    """What was fitted: what was asked for, and what the rigs of the runs add to it."""
    layout: Layout
    x: Array
    covariance: Array
    passes: list[Pass]
    converged: bool
    chosen: tuple[float | None, ...] = ()
    """Band of each run that was chosen because its noise is not white, Hz."""
    shapes: tuple[Estimate, ...] = ()
    """Shape parameters that were estimated."""

    @property
    def log_likelihood(self) -> float:
        """Innovation log-likelihood of all runs."""
        return sum(one.log_likelihood for one in self.passes)


def iterate(
    model: Model,
    runs: Sequence[Run],
    bands: Sequence[float | None],
    report: Callable[[float], None] = lambda share: None,
) -> Solution:
    """Gauss-Newton to the fixed point of nominal, noise and smoothed regressors.

    Raises
    ------
    NotIdentifiable
        If the information matrix is singular.
    """
    layout = Layout.of(model, len(runs))
    passes = [Pass.begin(run, model, band) for run, band in zip(runs, bands, strict=True)]
    x = layout.gather([p.values for p in passes])
    belief, mean = layout.prior_information(model), layout.prior_mean(model)
    converged = False
    for round_number in range(MAX_ROUNDS):
        information, score = np.diag(belief), belief * (mean - x)
        for index, one in enumerate(passes):
            one.values = layout.scatter(x, model, index)
            one.refresh(noise_too=round_number < NOISE_ROUNDS)
            rows = layout.rows(index)
            information[np.ix_(rows, rows)] += one.normal.gram
            score[rows] += one.normal.score
        step, covariance = solve(information, score, layout)
        x = x + step
        report(min(0.9, (round_number + 1) / USUAL_ROUNDS))
        converged = bool(np.all(np.abs(step) <= CONVERGED * np.sqrt(np.diag(covariance))))
        if round_number >= 2 and converged:
            break
    if any(one.band is not None for one in passes):
        covariance = robust(covariance, layout, passes, belief)
    for index, one in enumerate(passes):
        one.values = layout.scatter(x, model, index)
        one.refresh(noise_too=False)
    return Solution(model, layout, x, covariance, passes, converged)


def robust(covariance: Array, layout: Layout, passes: Sequence[Pass], belief: Array) -> Array:
    """Covariance from the scatter of block scores where the noise model does not hold (sandwich form)."""
    middle = np.diag(belief)
    for index, one in enumerate(passes):
        rows = layout.rows(index)
        spread = one.normal.spread
        middle[np.ix_(rows, rows)] += one.normal.gram if spread is None else spread
    return np.asarray(covariance @ middle @ covariance)


def choose_band(model: Model, one: Pass) -> float | None:
    """Band in which this run determines the scale factor best by the scatter of its own blocks.

    Where the noise is not white, a crossover from the likelihood follows the loudest part of the spectrum. Each
    trial band is fitted on its own; the relative standard deviation of 1 + k decides, measured, not modelled.
    """
    crossover = one.run.crossover(one.noise)
    least = LEAST_BLOCKS / float(one.run.t[-1] - one.run.t[0])
    top = min(crossover, 0.2 / one.run.reading_step)
    if least >= top:
        return None
    best: tuple[float, float] | None = None
    for band in np.geomspace(least, top, TRIAL_BANDS):
        try:
            trial = iterate(model, [one.run], [float(band)])
        except (NotIdentifiable, ValueError):
            continue
        slot = next((i for i, (e, _) in enumerate(trial.layout.slots) if e.name == "scale_factor"), None)
        if slot is None or not trial.converged:
            continue
        doubt = math.sqrt(trial.covariance[slot, slot]) / abs(1.0 + float(trial.x[slot]))
        if best is None or doubt < best[0]:
            best = (doubt, float(band))
    return None if best is None else best[1]


def name_of(run: Run) -> str:
    """What messages call a run."""
    return run.recording.name or "recording"


def complete(model: Model, recordings: Sequence[Recording]) -> Model:
    """Add what turning or rolling the sensor between recordings makes visible, and the error of the low-pass.

    Where the tolerance of a low-pass is declared, its time constant is a nuisance with that standard deviation: one
    for all runs, since the filter travels with the sensor. With a declared tolerance of 0, or none, it is exact.
    """
    mounts = {r.rig.mount for r in recordings}
    extra: list[str] = []
    if {"normal", "reversed"} <= mounts or {"rolled", "reversed"} <= mounts:
        extra += [n for n in SEPARATED_BY_TURNING if n not in model.effects]
    if {"normal", "rolled"} <= mounts:
        extra += [n for n in SEPARATED_BY_ROLLING if n not in model.effects]
    unsure = max((r.rig.lowpass_prior for r in recordings), default=0.0)
    if unsure > 0.0 and "lowpass_error" not in model.effects:
        model = model.add("lowpass_error", priors={"lowpass_error": Prior(0.0, unsure)})
    return model.add(*extra) if extra else model


def require_motion(run: Run) -> None:
    """Refuse a record in which the position never changes."""
    travel = float(np.ptp(run.z))
    if travel == 0.0:
        raise NotIdentifiable(
            f"{run.recording.name or 'recording'}: position is {run.z[0] + 0.0:.6g} m throughout; acceleration was not "
            "excited, so scale_factor and time_offset cannot be estimated. Record a run in which the stage moves"
        )


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal equations of one run."""

    gram: Array
    """X'X, (m, m)."""
    score: Array
    """X'y, (m,)."""
    spread: Array | None
    """Sum of outer products of block scores, (m, m); None when there are fewer than 8 blocks."""


class Pass:
    """The state of one run while a fit iterates."""

    def __init__(self, run: Run, values: Values, noise: Noise, terms: Sequence[Term], band: float | None) -> None:
        self.run = run
        self.values = values
        self.noise = noise
        self.terms = terms
        self.band = band
        self.signals: Signals | None = None
        self.loud = noise
        """Noise by likelihood, before a band was imposed."""

    @classmethod
    def begin(cls, run: Run, model: Model, band: float | None) -> Pass:
        """First guess: output and a constant regressed on the encoder, noise by grid search."""
        start = {
            e.name: model.fixed.get(e.name, model.priors[e.name].mean if e.name in model.priors else 0.0)
            for e in model.terms
        }
        scale, constant, noise = first_guess(run, start["time_offset"])
        if "scale_factor" not in model.fixed:
            start["scale_factor"] = scale - 1.0
        if "bias" not in model.fixed:
            start["bias"] = constant
        return cls(run, Values(start, model.terms), noise, model.free, band)

    def refresh(self, *, noise_too: bool) -> None:
        """Nominal, noise, filter, smoothed signals and normal equations at the current values."""
        self.drive = self.run.drive(self.values, self.signals)
        if noise_too:
            self.loud = estimate_noise(self.run, self.drive, self.loud)
            self.noise = self.loud if self.band is None else within(self.band, self.run, self.loud)
        vars(self).pop("track", None)  # gone before the next is made: each holds nine series
        self.track = self.run.track(self.drive, self.noise)
        self.signals = self.run.signals(self.drive, self.track, self.noise, self.values, self.signals, self.band)
        self.counts: Flags = self.drive.settled(self.run.wait(self.noise))
        self.whitened: Array = self.track.series("e") / np.sqrt(self.track.series("S"))
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


def first_guess(run: Run, time_offset: float) -> tuple[float, float, Noise]:
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
    ones = Drive(plain.t, zero, np.where(plain.restart, 0, h), np.where(plain.restart, 0, h**2 / 2), plain.restart)
    encoder = Drive(plain.t, plain.z, zero, zero, plain.restart)
    output = Drive(plain.t, zero, plain.first, plain.second, plain.restart)
    r = run.reading_variance_guess
    rate = 1.0 / run.reading_step
    best: tuple[float, float, float, float] | None = None
    for crossover in np.geomspace(4.0 / (plain.t[-1] - plain.t[0]), 0.15 * rate, 12):
        noise = Noise((2.0 * np.pi * crossover) ** 4 * r * run.reading_step, r)
        tracks = [run.track(d, noise) for d in (encoder, output, ones)]
        S = tracks[0].series("S")
        counts = encoder.settled(run.wait(noise))
        y, u, one = ((t.series("e") / np.sqrt(S))[counts] for t in tracks)
        X = np.column_stack([-u, -one])
        c, *_ = np.linalg.lstsq(X, y, rcond=None)
        residual = float(np.mean((y - X @ c) ** 2))
        # With q and R scaled together the gains stay; the best common factor is the mean square itself.
        cost = float(np.mean(np.log(S[counts]))) + math.log(residual)
        if best is None or cost < best[0]:
            best = (cost, float(c[0]), float(c[1]), noise.q * residual)
            kept = Noise(noise.q * residual, r * residual)
    assert best is not None
    slope, constant = best[1], best[2]
    if not math.isfinite(slope) or abs(slope) < 1e-9:
        slope = 1e-9
    # p'' = pol (u - K0)/s - g was driven as pol u - g: slope multiplies (pol u - g).
    scale = 1.0 / slope
    bias = -polarity * (constant + run.rig.gravity * (1.0 - slope)) * scale
    return scale, bias, kept


def within(band: float, run: Run, noise: Noise) -> Noise:
    """Noise whose crossover lies at `band`, with the process density kept."""
    return Noise(noise.q, noise.q / ((2.0 * np.pi * band) ** 4 * run.reading_step))


def moving_readings(run: Run, signals: Signals) -> Flags:
    """Readings at which the stage moves: speed or acceleration above 2 % of their largest, and a little around."""
    v, a = np.abs(signals.v), np.abs(signals.a - np.median(signals.a))
    busy = (v > 0.02 * np.quantile(v, 0.999)) | (a > 0.05 * np.quantile(a, 0.999))
    step = float(signals.t[1] - signals.t[0])
    reach = max(1, int(0.05 / step))
    near = np.convolve(busy, np.ones(2 * reach + 1), mode="same") > 0 if len(busy) > 2 * reach else busy
    index = np.clip(np.rint((run.t - run.origins.t - signals.t[0]) / step).astype(int), 0, len(near) - 1)
    return np.asarray(near[index])


@dataclass(frozen=True, slots=True)
class Layout:
    """Which row of the joint solve belongs to which coefficient and run."""

    terms: tuple[Term, ...]
    runs: int
    slots: tuple[tuple[Term, int | None], ...]

    @classmethod
    def of(cls, model: Model, runs: int) -> Layout:
        """Shared parameters have one row, parameters of timing one for each run."""
        slots: list[tuple[Term, int | None]] = []
        for term in model.free:
            own = runs > 1 and term.owner in PER_RUN_OWNERS
            slots += [(term, index) for index in range(runs)] if own else [(term, None)]
        return cls(model.free, runs, tuple(slots))

    def rows(self, run: int) -> list[int]:
        """Row of each free coefficient as run `run` sees it."""
        return [
            next(i for i, (slot, r) in enumerate(self.slots) if slot.name == term.name and r in (None, run))
            for term in self.terms
        ]

    def gather(self, values: Sequence[Values]) -> Array:
        """First guesses of all runs as one vector; shared ones are averaged over runs by median."""
        x = np.empty(len(self.slots))
        for i, (term, run) in enumerate(self.slots):
            each = [v.by_name[term.name] for v in values]
            x[i] = float(np.median(each)) if run is None else each[run]
        return x

    def scatter(self, x: Array, model: Model, run: int) -> Values:
        """Coefficients as run `run` sees them."""
        own = {term.name: float(x[i]) for i, (term, r) in enumerate(self.slots) if r in (None, run)}
        terms = model.terms
        return Values({t.name: own.get(t.name, model.fixed.get(t.name, 0.0)) for t in terms}, terms)

    def prior_information(self, model: Model) -> Array:
        """Inverse variances of the priors, 0 where there is none."""
        return np.array([model.priors[t.name].std ** -2 if t.name in model.priors else 0.0 for t, _ in self.slots])

    def prior_mean(self, model: Model) -> Array:
        """Means of the priors, 0 where there is none."""
        return np.array([model.priors[t.name].mean if t.name in model.priors else 0.0 for t, _ in self.slots])

    def estimates(self, x: Array, covariance: Array, model: Model) -> tuple[Estimate, ...]:
        """Free and fixed parameters in the order of the model."""
        found: list[Estimate] = []
        for term in model.terms:
            if term.name in model.fixed:
                found.append(Estimate(term.name, term.symbol, term.unit, model.fixed[term.name], 0.0, term.owner))
            for i, (slot, run) in enumerate(self.slots):
                if slot.name == term.name:
                    std = math.sqrt(covariance[i, i])
                    found.append(Estimate(term.name, term.symbol, term.unit, float(x[i]), std, term.owner, run))
        return tuple(found)


def solve(information: Array, score: Array, layout: Layout) -> tuple[Array, Array]:
    """Solve the normal equations scaled to unit diagonal.

    Raises
    ------
    NotIdentifiable
        If a column is empty or columns cannot be told apart.
    """
    names = [term.name for term, _ in layout.slots]
    size = np.sqrt(np.diag(information))
    if not np.all(np.isfinite(information)):
        raise NotIdentifiable("the record is too violent for the model: the information matrix is not finite")
    silent = [n for n, s in zip(names, size, strict=True) if s == 0.0]
    if silent:
        raise NotIdentifiable(f"{' and '.join(silent)} was not excited: the motion does not contain it")
    correlation = information / np.outer(size, size)
    eigenvalues, vectors = scipy.linalg.eigh(correlation)
    if eigenvalues[0] < 1e-10:
        tied = [n for n, w in zip(names, vectors[:, 0], strict=True) if abs(w) > 0.2]
        raise NotIdentifiable(
            f"{', '.join(tied)} cannot be told apart on this record; drop all but one, or hold them with a value"
        )
    inverse = (vectors / eigenvalues) @ vectors.T
    covariance = inverse / np.outer(size, size)
    return covariance @ score, covariance


SCALE_STD_LIMIT = 0.5
"""A scale factor less certain than this was not excited at all."""
PLAUSIBLE_SCALE = (0.5, 2.0)


def judge(layout: Layout, x: Array, covariance: Array, runs: Sequence[Run]) -> list[str]:
    """Refuse what cannot be a sensor, and say what is strange.

    Raises
    ------
    NotIdentifiable
        If the scale factor is not determined.
    RecordingError
        If the output runs against the encoder, or gravity shows on an axis declared level.
    """
    by_name = {term.name: i for i, (term, _) in enumerate(layout.slots)}
    rig, name = runs[0].rig, runs[0].recording.name or "recording"
    remarks: list[str] = []
    if "scale_factor" in by_name:
        i = by_name["scale_factor"]
        scale, std = 1.0 + x[i], math.sqrt(covariance[i, i])
        if std > SCALE_STD_LIMIT * max(1.0, abs(scale)):
            raise NotIdentifiable(
                f"{name}: 1 + k = {scale:.3g} with a standard deviation of {std:.2g}: acceleration was not excited "
                "enough to estimate scale_factor. Record a run with stronger or longer motion"
            )
        if scale < -3.0 * std:
            other = "normal" if rig.mount == "reversed" else "reversed"
            raise RecordingError(
                f"{name}: the output runs against the encoder (1 + k = {scale:.3f}). The sensor is mounted the other "
                f'way round or a sign is swapped; write in the sidecar\n[rig]\nmount = "{other}"'
            )
        if not PLAUSIBLE_SCALE[0] <= scale <= PLAUSIBLE_SCALE[1]:
            remarks.append(
                f"1 + k = {scale:.4g} is implausible for a working sensor: check the units of position and output "
                f"(a factor of {1.0 / scale:.4g}), for instance mm read as m"
            )
    if "bias" in by_name:
        constant = x[by_name["bias"]]
        axis = "up" if constant * rig.polarity > 0.0 else "down"
        if rig.gravity == 0.0 and abs(abs(constant) - STANDARD_GRAVITY) < 0.2 * STANDARD_GRAVITY:
            raise RecordingError(
                f"{name}: the output has a constant of {constant:.3f} m/s², close to gravity, on an axis declared "
                f'level. If the axis is vertical, write in the sidecar\n[rig]\naxis = "{axis}"'
            )
    return remarks


def validity(passes: Sequence[Pass]) -> dict[str, tuple[float, float]]:
    """Ranges that the fit has seen, over all runs."""
    ranges: dict[str, list[float]] = {}

    def widen(key: str, low: float, high: float) -> None:
        ranges.setdefault(key, [low, high])
        ranges[key] = [min(ranges[key][0], low), max(ranges[key][1], high)]

    for one in passes:
        s = one.signals
        assert s is not None
        for key, y in (("a", s.a), ("v", s.v), ("p", s.p + one.run.origins.p)):
            widen(key, float(np.min(y)), float(np.max(y)))
        widen("frequency", 0.0, s.cutoff)
        for key, y in s.side.items():
            offset = one.run.origins.temperature if key == "temperature" else 0.0
            widen(key, float(np.min(y)) + offset, float(np.max(y)) + offset)
    return {key: (low, high) for key, (low, high) in ranges.items()}


def tied_sum(fit: Fit, name: str) -> str:
    """What a parameter really is on this rig, as long as no joint fit has separated it."""
    separated = set(fit.model.effects)
    parts = {
        "bias": [
            "K0",
            *([] if "tilt" in separated else ["g0 tilt"]),
            *([] if "misalignment" in separated else ["g0 misalignment"]),
        ],
        "scale_factor": ["k", "encoder scale", *([] if "cross_axis_gravity" in separated else ["g0 Kin"])],
        "time_offset": ["clock offset", "sensor lag", "error of the low-pass"],
    }
    return " + ".join(parts.get(name, [fit[name].symbol]))
