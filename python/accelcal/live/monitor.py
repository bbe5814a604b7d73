"""Whether the innovations of a live filter are those that its model expects."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import ClassVar, Literal

from accelcal._support.result import Storable

FALSE_ALARM = 1e-6
"""Probability of an alarm in one block while the model holds."""
TOLERANCE = 0.2
"""Relative error of the expected variance that counts as holding: what data sheets say of noise is not exact."""
LEAST_READINGS = 200
"""Of a block."""
LEAST_TIME = 1.0
"""Length of a block, s: at most 86 400 blocks, and on average 0.09 false alarms, a day."""
SETTLING = 50
"""First readings, which are not judged: the filter still learns where it is."""
RUNNING = 1000
"""Readings of the running NIS."""
CONFIDENCE = 0.99
"""Of the interval of the running NIS."""


@dataclass(frozen=True, slots=True)
class Alarm(Storable):
    """A block of innovations that the model does not explain."""

    derived: ClassVar[tuple[str, ...]] = ("sentence",)

    t: float
    """End of the block, s."""
    kind: Literal["nis", "mean"]
    """Mean of e²/S, or of e/sqrt(S)."""
    value: float
    low: float
    high: float
    readings: int
    since: float
    """End of the first block of those in a row that raised an alarm, s."""

    @property
    def sentence(self) -> str:
        """What was found, what was expected, and what it may be."""
        expected = f"expected {self.low:.3g} to {self.high:.3g} over {self.readings} readings"
        if self.kind == "mean":
            return (
                f"t = {self.t:.6g} s: the innovations have a mean of {self.value:.3g} standard deviations, {expected}; "
                "the bias or the scale factor has changed, or the model lacks an effect"
            )
        cause = (
            "the sensor has changed, the model lacks an effect, or less noise is declared than there is"
            if self.value > self.high
            else "more noise is declared than there is"
        )
        return f"t = {self.t:.6g} s: NIS {self.value:.3g}, {expected}; {cause}"


@dataclass(frozen=True, slots=True)
class Interval:
    """A running mean and where it lies with a probability while the model holds."""

    value: float
    low: float
    high: float
    readings: int


class InnovationMonitor:
    """Tests normalised innovations, block by block, against the standard normal distribution.

    In a block of n readings the sum of e²/S is chi-square with n degrees of freedom and the mean of e/sqrt(S) has the
    variance 1/n. Either test has half of `false_alarm`; both let the true variance be off by `tolerance`.

    Parameters
    ----------
    false_alarm : probability of an alarm in one block while the model holds.
    tolerance : relative error of the expected variance that still counts as holding.
    least_readings, least_time : a block ends when both are reached; readings, s.
    settling : first readings, which are not judged.

    Examples
    --------
    >>> monitor = InnovationMonitor(least_readings=100, least_time=0.0, settling=0)
    >>> alarms = [monitor.add(0.01 * i, (-1.0) ** i) for i in range(100)]
    >>> alarms[-1] is None
    True
    >>> [monitor.add(1.0 + 0.01 * i, 2.0) for i in range(100)][-1].kind
    'mean'
    """

    def __init__(
        self,
        *,
        false_alarm: float = FALSE_ALARM,
        tolerance: float = TOLERANCE,
        least_readings: int = LEAST_READINGS,
        least_time: float = LEAST_TIME,
        settling: int = SETTLING,
    ) -> None:
        self.false_alarm, self.tolerance = false_alarm, tolerance
        self.least_readings, self.least_time = least_readings, least_time
        self.blocks, self.alarms = 0, 0
        """Blocks that were judged, and those that raised an alarm."""
        self.holds: bool | None = None
        """Whether the newest block is what the model expects; None before the first."""
        self._settling = settling
        self._recent: deque[float] = deque(maxlen=RUNNING)
        self._count, self._sum, self._square = 0, 0.0, 0.0
        self._began = 0.0
        self._since: float | None = None

    def add(self, t: float, normalised: float) -> Alarm | None:
        """Take in an innovation at `t` (s) in standard deviations; the alarm of the block that it ends, if any."""
        square = normalised * normalised
        self._recent.append(square)
        if self._settling > 0:
            self._settling -= 1
            return None
        if self._count == 0:
            self._began = t
        self._count += 1
        self._sum += normalised
        self._square += square
        if self._count < self.least_readings or t - self._began < self.least_time:
            return None
        alarm = self._judged(t)
        self.blocks += 1
        self.alarms += alarm is not None
        self.holds = alarm is None
        self._since = None if alarm is None else alarm.since
        self._count, self._sum, self._square = 0, 0.0, 0.0
        return alarm

    @property
    def nis(self) -> Interval | None:
        """Mean e²/S of the last `RUNNING` readings with its interval of 99 %; None before the first reading."""
        n = len(self._recent)
        if n == 0:
            return None
        low, high = chi_square_bounds(n, 1.0 - CONFIDENCE)
        return Interval(math.fsum(self._recent) / n, low, high, n)

    def _judged(self, t: float) -> Alarm | None:
        """The alarm of the block that ends here: of the mean first, which names a cause."""
        n, off = self._count, 1.0 + self.tolerance
        since = t if self._since is None else self._since
        bound = normal_bound(self.false_alarm / 2.0) * math.sqrt(off / n)
        mean = self._sum / n
        if not abs(mean) <= bound:
            return Alarm(t, "mean", mean, -bound, bound, n, since)
        low, high = chi_square_bounds(n, self.false_alarm / 2.0)
        nis = self._square / n
        if not low / off <= nis <= high * off:
            return Alarm(t, "nis", nis, low / off, high * off, n, since)
        return None


def chi_square_bounds(n: int, alpha: float) -> tuple[float, float]:
    """Where the mean of n squared standard normal numbers lies but for the probability `alpha`, half on each side."""
    from scipy.special import chdtri

    return float(chdtri(n, 1.0 - alpha / 2.0)) / n, float(chdtri(n, alpha / 2.0)) / n


def normal_bound(alpha: float) -> float:
    """What the size of a standard normal number exceeds with probability `alpha`."""
    from scipy.special import ndtri

    return -float(ndtri(alpha / 2.0))
