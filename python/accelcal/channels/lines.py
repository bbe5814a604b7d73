"""Lines at fixed frequencies, in the output and among the innovations."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.channels.finding import ALARM, LEAST_BLOCKS, ChannelFinding
from accelcal.channels.motion_noise import rank_correlation
from accelcal.channels.residuals import Residuals, coarse
from accelcal.recording import Array
from accelcal.replay import filter_columns
from accelcal.signals import Signals

MOST_LINES = 5
"""Lines that are reported."""
FEWEST_BINS = 64
"""Fewer bins than this have no level."""
LEVEL_SPAN = 0.04
"""Share of the sampling rate over which the level of the noise may be taken as one."""
STEP_LINE = 0.05
"""Share of a coarse converter step below which a line may be the converter's own."""
COMB = 25.0
"""Hz on either side of a line in which others may not ..."""
COMPANY = 3.0
"""... hold so many times its power together: a band of noise or a comb of lines is the vibration of some machine."""
NEIGHBOURS = 1001
"""Bins of the periodogram over which its local level is taken."""
SHARE = 1e-3
"""A line with less of the power of what makes it would stand among far stronger ones."""
OWN_LINE = 3.0
"""A motion with this many times the line itself has it from its drive."""
DRIVEN = 20.0
"""Power of a line of the motion's own nonlinear functions over that at its neighbours, where the motion makes lines."""


def tones(seen: Residuals) -> tuple[ChannelFinding, ...]:
    """Lines at fixed frequency: in the output above the motion, in the whitened innovations below.

    Periodogram (Hann) over its local median; the median of m correlated bins is worth m/4 exponential ones, so one bin
    exceeds x times the level with chance (1 + x/(m/4))^-(m/4), times the number of bins. `follows_motion` marks a line
    whose power goes with speed: that is vibration.
    """
    t, y, rate = reading_grid(seen)
    split = max(2.0 * seen.signals.cutoff, 1.0 / max(seen.t[-1] - seen.t[0], 1e-9))
    below, bins_below = lines_of(y, rate, 0.0, min(split, 0.45 * rate))
    beyond, bins_beyond = lines_of(seen.residual, seen.rate, split, 0.5 * seen.rate, seen.tau)
    bins = bins_below + bins_beyond
    peaks = [(min(1.0, p * bins), -ratio, f, False) for f, ratio, p in below]
    peaks += [(min(1.0, p * bins), -ratio, f, True) for f, ratio, p in beyond]
    peaks.sort()
    loud = [peak for peak in peaks if peak[0] < ALARM] or peaks[:1]
    of_output, of_readings = (seen.t, seen.residual, seen.rate), (t, y, rate)
    return tuple(line(seen, of_output if up else of_readings, f, -minus, p, up) for p, minus, f, up in loud)


def reading_grid(seen: Residuals) -> tuple[Array, Array, float]:
    """Whitened innovations at uniform times, zero where none was taken."""
    step = seen.run.reading_step
    t = seen.run.t[seen.state.counts]
    place = np.rint((t - t[0]) / step).astype(np.intp)
    y = np.zeros(int(place[-1]) + 1)
    y[place] = seen.readings
    return t[0] + step * np.arange(len(y)), y, 1.0 / step


def lines_of(
    y: Array, rate: float, low: float, high: float, tau: float = 0.0
) -> tuple[list[tuple[float, float, float]], int]:
    """Peaks of the periodogram between two frequencies, loudest first: Hz, ratio to the level, chance of one bin.

    The slope that a low-pass of time constant `tau` gives to white noise is taken off first.
    """
    n = len(y)
    if n < 256:
        return [], 0
    window = np.hanning(n)
    spectrum = np.abs(scipy.fft.rfft((y - y.mean()) * window, scipy.fft.next_fast_len(n, real=True))) ** 2
    f = np.fft.rfftfreq(scipy.fft.next_fast_len(n, real=True), 1.0 / rate)
    spectrum *= 1.0 + (2.0 * np.pi * f * tau) ** 2
    rows = slice(*np.searchsorted(f, [max(low, 8.0 * rate / n), high]))
    part = spectrum[rows]
    if len(part) < FEWEST_BINS:
        return [], 0
    level, m = local_level(part, max(FEWEST_BINS, min(NEIGHBOURS, int(LEVEL_SPAN * n))))
    ratio = part / level
    worth = m / 4.0
    chance = np.exp(-worth * np.log1p(ratio / worth))
    peaks: list[tuple[float, float, float]] = []
    around = max(16, int(COMB * n / rate))
    for k in np.argsort(-ratio)[: 8 * MOST_LINES]:
        at = float(f[rows][k])
        if all(abs(at - other) > 4.0 * rate / n for other, _, _ in peaks) and stands_alone(part, level, int(k), around):
            i = int(k) + rows.start
            if 0 < i < len(spectrum) - 1:
                a, b, c = np.log(spectrum[i - 1 : i + 2] + 1e-300)
                bend = a - 2.0 * b + c
                at += 0.5 * (a - c) / bend * float(f[1]) if bend < 0.0 else 0.0
            peaks.append((at, float(ratio[k]), float(chance[k])))
        if len(peaks) == MOST_LINES:
            break
    return peaks, len(part)


def stands_alone(part: Array, level: Array, k: int, around: int) -> bool:
    """Whether a peak is more than one tooth of a comb: what its neighbours hold beyond the noise, each no more than it.

    Noise alone adds up to that with the chance of six standard deviations.
    """
    rows = slice(max(0, k - around), k + around + 1)
    excess = np.minimum(part[rows], part[k]) - level[rows]
    own = slice(max(0, k - 4 - rows.start), k + 5 - rows.start)
    mine = float(np.sum(excess[own]))
    others = float(np.sum(excess)) - mine
    noise = 1.5 * level[k] * math.sqrt(len(excess))
    return bool(others < COMPANY * mine + 6.0 * noise)


def local_level(part: Array, m: int = NEIGHBOURS) -> tuple[Array, int]:
    """Mean of exponential bins from their local median over m bins, and the number of bins behind each."""
    m = min(m, len(part))
    K = max(1, len(part) // m)
    edges = np.linspace(0, len(part), K + 1).astype(int)
    medians = np.maximum(medians_between(part, edges) / math.log(2.0), 1e-300)
    centres = 0.5 * (edges[:-1] + edges[1:])
    # The spectrum may fall steeply between blocks (RC, whitening): follow it by straight lines of its logarithm.
    return np.exp(np.interp(np.arange(len(part)), centres, np.log(medians))), m


def medians_between(y: Array, edges: NDArray[np.intp]) -> Array:
    """Median of each stretch of a series between neighbouring edges, (len(edges) - 1,)."""
    length = np.diff(edges)
    medians = np.empty(len(length))
    for several in np.unique(length):
        alike = length == several
        medians[alike] = np.median(y[edges[:-1][alike][:, None] + np.arange(several)], axis=1)
    return medians


def line(
    seen: Residuals, data: tuple[Array, Array, float], frequency: float, ratio: float, p_value: float, of_output: bool
) -> ChannelFinding:
    """Amplitude of one line at the sensor, and whether it comes and goes with speed."""
    t, y, rate = data
    turned = -2j * np.pi * frequency * (t - t[0])
    np.exp(turned, out=turned)
    turned *= y
    if of_output:
        amplitude = 2.0 * abs(complex(np.mean(turned))) / seen.rc_gain(frequency)
        std = amplitude / math.sqrt(2.0 * max(ratio, 1e-9) / 1.5)  # Hann: a line stands 1.5 times lower over the noise
    else:
        amplitude, std = line_fit(seen, frequency)
    length = max(1, int(0.1 * rate))
    K = len(y) // length
    heard = turned[: K * length].reshape(K, length).mean(axis=1)
    del turned
    speed = np.mean(np.interp(t[: K * length], seen.t, seen.motion[0]).reshape(K, length) ** 2, axis=1)
    follows = False
    if K >= LEAST_BLOCKS and p_value < ALARM and np.ptp(speed) > 0.0:
        at_rest = abs(complex(np.mean(heard[speed <= np.quantile(speed, 0.4)])))
        fades = at_rest < 0.5 * abs(complex(np.mean(heard)))
        follows = fades and rank_correlation(np.abs(heard) ** 2, speed)[1] < ALARM
    if coarse(seen) and amplitude * seen.rc_gain(frequency) < STEP_LINE * seen.lsb:
        p_value = 1.0  # steps crossed by a periodic motion make lines of their own
    span = float(t[-1] - t[0])
    within = frequency < seen.signals.cutoff
    parts = {
        "frequency": float(frequency),
        "frequency_std": math.sqrt(12.0) / (2.0 * math.pi * span) * std / max(amplitude, 1e-300),
        "follows_motion": float(follows),
        "within_motion": float(within),
        "made_by_motion": float(within and p_value < ALARM and driven(seen.signals, frequency, amplitude)),
    }
    text = f"a line of {amplitude:.2g} m/s² at {frequency:.4g} Hz" if p_value < ALARM else "no line stands out"
    return ChannelFinding("tone", ratio, p_value, amplitude, "m/s²", std, text, parts)


def driven(s: Signals, frequency: float, amplitude: float) -> bool:
    """Whether a motion makes lines at a frequency: a nonlinearity that is missing would show as a tone there.

    The smoothed motion holds a part of any line of the output. Where it has little more of it than that, the line is
    taken out of it first, or it would pass for its own cause.
    """
    window, turning = np.hanning(len(s.t)), 2j * np.pi * frequency
    near, beside = np.arange(-2, 3) / 2.0, np.concatenate([np.arange(-24, -3), np.arange(4, 25)])
    turns = np.exp(-(turning + 2j * np.pi * np.concatenate([near, beside])[:, None] / s.length) * s.t) * window

    def stands(made: Array) -> bool:
        power = np.abs(turns @ (made - np.mean(made))) ** 2
        top = float(np.max(power[: len(near)]))
        share = 2.0 * top / np.sum(window) ** 2 / max(float(np.var(made)), 1e-300)
        return bool(top > DRIVEN * np.median(power[len(near) :]) and share > SHARE)

    wave = np.exp(turning * s.t)
    own = 2.0 * np.sum(s.a * window * np.conj(wave)) / np.sum(window)
    if abs(own) > OWN_LINE * amplitude:
        if stands(s.a):
            return True
        own = 0.0
    a, v, p = (y - np.real(own * wave / turning**k) for k, y in enumerate((s.a, s.v, s.p)))
    signs = (np.where(np.abs(y) > 2.0 * w, np.sign(y), 0.0) for y, w in ((a, s.a_width), (v, s.v_width)))
    return any(stands(made) for made in (a**2, a**3, np.abs(a), v**2, p**2, *signs))


def line_fit(seen: Residuals, frequency: float) -> tuple[float, float]:
    """Amplitude of a line at the output and its standard deviation, by exact columns of the replay, m/s²."""
    phase = 2.0 * np.pi * frequency * np.arange(int((seen.run.t[-1] - seen.run.t[0]) / seen.step) + 4) * seen.step
    scale = seen.state.values.scale
    X = carried(seen, [np.cos(phase) / scale, np.sin(phase) / scale], [], seen.step)
    _, amplitude, std = pair_fit(X, seen.readings)
    return amplitude, std


def carried(seen: Residuals, on_grid: Sequence[Array], direct: Sequence[Array], step: float) -> Array:
    """Whitened columns of settled readings, either driven by accelerations on a grid or added to the readings."""
    run, state = seen.run, seen.state
    grid = float(run.t[0]), step
    parts = filter_columns(state.track, run.t, state.drive.restart, grid, on_grid, 1.0, direct)
    return np.concatenate([np.ascontiguousarray(rows[:, state.counts[part]].T) for part, rows in parts])


def pair_fit(X: Array, y: Array) -> tuple[float, float, float]:
    """Twice the log-likelihood that two columns gain, length of their coefficients, and its standard deviation."""
    A = np.einsum("ni,nj->ij", X, X)  # tall and thin: starting threads would cost more than they save
    A += 1e-12 * np.trace(A) * np.eye(2)
    c = np.linalg.solve(A, np.einsum("ni,n->i", X, y))
    level = float(np.mean(y**2))
    std = math.sqrt(level * float(np.trace(np.linalg.inv(A))) / 2.0)
    return float(c @ A @ c) / level, float(np.hypot(*c)), std
