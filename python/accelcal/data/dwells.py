"""Static dwells: means of the output at rest, at known elevations of the input axis above the horizontal; positions of
three outputs at unknown attitudes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Result
from accelcal._support.values import immutable
from accelcal.data.arrays import Array
from accelcal.data.rig import STANDARD_GRAVITY, Rig, Sensor

ATTITUDES = {"up": 0.5 * math.pi, "down": -0.5 * math.pi, "level": 0.0}
"""Elevation of the input axis by the word of a sidecar, rad."""


@dataclass(frozen=True, slots=True)
class DwellSetup:
    """Entries of a sidecar on dwells; None = not declared."""

    angle: float | None = None
    """Elevation of the input axis above the horizontal, rad; +90 degrees reads +g."""
    unknown: bool = False
    """Whether attitudes are not known: hand-held positions of a triad."""
    angle_std: float | None = None
    """Standard uncertainty of each angle, rad."""
    gravity: float | None = None
    """Local gravity, m/s²."""
    table: str = ""
    """File of dwells of the same sensor that are fitted together with this recording."""


def white_variance(std: Array, samples: Array, duration: Array, sensor: Sensor) -> Array:
    """Variance of means from noise within them, (m/s²)²: of the samples, no less than the declared density allows."""
    return np.maximum(std**2 / samples, 0.5 * (sensor.noise or 0.0) ** 2 / duration)


def slow_variance(duration: Array, sensor: Sensor) -> Array:
    """Variance of means from declared instability and random walk of the bias, (m/s²)²."""
    return np.asarray((sensor.bias_instability or 0.0) ** 2 + (sensor.random_walk or 0.0) ** 2 * duration / 3.0)


@immutable
@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Dwells(Result):
    """Means of the output of one sensor at rest. All arrays are (n,), one value for each dwell.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> angle = np.arange(8) * np.pi / 4.0
    >>> mean = 9.80665 * np.sin(angle) + 0.05
    >>> many = np.ones(8)
    >>> dwells = ac.Dwells(angle, mean, 1e-3 * many, 60.0 * many, 6000.0 * many, ("0",) * 8, ac.Rig())
    >>> dwells
    Dwells('': 8 between +0 and +315 degrees)
    """

    angle: Array
    """Elevation of the input axis above the horizontal, rad; beyond ±90 degrees as on a dividing head."""
    mean: Array
    """Of the samples, m/s²."""
    std: Array
    """Of the samples, not of their mean, m/s²."""
    duration: Array
    """s"""
    samples: Array
    """Number of samples."""
    group: tuple[str, ...]
    """Dwells of one group share one angle zero."""
    rig: Rig
    temperature: Array | None = None
    """degC; None where it was not recorded."""
    angle_std: float = 0.0
    """Standard uncertainty of each angle, independent of the others, rad."""
    gravity: float = STANDARD_GRAVITY
    """Local gravity, m/s²."""
    name: str = ""
    """File name, for messages."""
    digest: str = ""
    """SHA-256 of the source file, hex."""
    assumptions: tuple[str, ...] = ()
    """Sentences on what was not declared and therefore assumed."""

    def __post_init__(self) -> None:
        count = len(self.mean)
        for key in ("angle", "std", "duration", "samples", "group"):
            if len(getattr(self, key)) != count:
                raise AccelcalError(f"{key} has {len(getattr(self, key))} values for {count} dwells; give one for each")
        if not count:
            raise AccelcalError(f"{self.name or 'dwells'}: there is no dwell; give at least one")
        exact = np.flatnonzero(self.white <= 0.0)
        if len(exact):
            raise AccelcalError(
                f"{self.name or 'dwells'}: the samples of dwell {exact[0] + 1} do not scatter and no noise is "
                'declared, so that it would be exact; declare noise = "..." in [sensor]'
            )

    def __len__(self) -> int:
        return len(self.mean)

    def __repr__(self) -> str:
        degrees = np.degrees(self.angle)
        return f"Dwells({self.name!r}: {len(self)} between {np.min(degrees):+.4g} and {np.max(degrees):+.4g} degrees)"

    @property
    def white(self) -> Array:
        """Variance of each mean from noise within its dwell, (m/s²)²: of the samples, and no less than the declared
        density allows."""
        return white_variance(self.std, self.samples, self.duration, self.rig.sensor)

    @property
    def variance(self) -> Array:
        """Variance of each mean at its declared angle, (m/s²)²."""
        return self.variance_at(self.angle)

    def variance_at(self, angle: Array, scale: float = 1.0) -> Array:
        """Variance of each mean from all that is declared, (m/s²)² (derivations 6.11): noise, instability and random
        walk of the bias, error of the angle at elevations of a sensor with a scale 1 + k."""
        var = self.angle_std**2
        square = 0.5 * (1.0 - math.exp(-2.0 * var) * np.cos(2.0 * angle))
        turned = (scale * self.gravity) ** 2 * np.maximum(square - np.sin(angle) ** 2 * math.exp(-var), 0.0)
        return np.asarray(self.white + slow_variance(self.duration, self.rig.sensor) + turned)

    def specific_force(self, angle: Array) -> Array:
        """Mean specific force along the input axis at elevations of which each is uncertain, m/s²."""
        return np.asarray(self.gravity * math.exp(-0.5 * self.angle_std**2) * np.sin(angle))

    def rows(self, rows: Array) -> Dwells:
        """Some of the dwells."""
        some = np.flatnonzero(rows) if np.asarray(rows).dtype == np.bool_ else np.asarray(rows, dtype=np.intp)
        return replace(
            self,
            angle=self.angle[some],
            mean=self.mean[some],
            std=self.std[some],
            duration=self.duration[some],
            samples=self.samples[some],
            group=tuple(self.group[k] for k in some),
            temperature=None if self.temperature is None else self.temperature[some],
        )


@immutable
@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Positions:
    """Means of three outputs of one sensor at rest, at attitudes of which nothing is known but the norm of gravity.

    Examples
    --------
    >>> import numpy as np
    >>> faces = 9.80665 * np.vstack([np.eye(3), -np.eye(3)])
    >>> len(Positions(faces + 0.05, np.full((6, 3), 0.01), np.full(6, 400.0), 9.80665))
    6
    """

    mean: Array
    """(n, 3), in any unit where they are calibrated by themselves, m/s² beside a motion."""
    std: Array
    """Of the samples, (n, 3)."""
    samples: Array
    """(n,)"""
    gravity: float
    """m/s²"""
    name: str = ""
    """File name, for messages."""
    unit: str = "count"
    duration: Array = field(default_factory=lambda: np.ones(1))
    """(n,), or one for all, s."""
    temperature: Array | None = None
    """(n,) degC; None where it was not recorded."""
    rig: Rig = field(default_factory=Rig)
    digest: str = ""
    """SHA-256 of the source file, hex."""

    def __len__(self) -> int:
        return len(self.mean)

    @property
    def white(self) -> Array:
        """Variance of each mean from noise within its rest, (n, 3) (m/s²)²."""
        return white_variance(self.std, self.samples[:, None], self.duration[:, None], self.rig.sensor)

    @property
    def variance(self) -> Array:
        """The same from all that is declared, instability and random walk of the bias among it."""
        return np.asarray(self.white + slow_variance(self.duration[:, None], self.rig.sensor))
