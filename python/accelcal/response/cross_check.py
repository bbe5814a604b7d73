"""The same recording in the time domain: a linear fit's scale factor and delay against the frequency response."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from accelcal._support.result import Storable
from accelcal.data.channel_filter import ChannelFilter
from accelcal.data.recording import Recording, RecordingError
from accelcal.data.stamps import usual_step
from accelcal.estimation.estimate import estimate
from accelcal.estimation.gauss_newton import NotIdentifiable
from accelcal.model import Model
from accelcal.response.points import Point
from accelcal.signals.transfer import response


@dataclass(frozen=True, slots=True)
class CrossCheck(Storable):
    """What a fit of scale factor and delay to all motion says, and how far the response is from it."""

    derived: ClassVar[tuple[str, ...]] = ("sentence",)

    gain: float
    """1 + k"""
    gain_std: float
    delay: float
    """s"""
    delay_std: float
    magnitude: float
    """Largest relative difference in magnitude."""
    magnitude_at: float
    """Its frequency, Hz."""
    phase: float
    """Largest difference in phase, rad."""
    phase_at: float
    """Its frequency, Hz."""

    @property
    def sentence(self) -> str:
        """For people."""
        return (
            f"time-domain fit: gain {self.gain:.6g} +- {2 * self.gain_std:.2g}, delay {self.delay * 1e6:.6g} +- "
            f"{2e6 * self.delay_std:.2g} us for all frequencies; the table differs from it by at most "
            f"{100 * self.magnitude:.3g} % in magnitude (at {self.magnitude_at:.4g} Hz) and "
            f"{math.degrees(self.phase):.3g} deg in phase (at {self.phase_at:.4g} Hz)"
        )


def cross_check(recording: Recording, points: Sequence[Point]) -> CrossCheck | str:
    """Compare with a linear fit in the time domain, behind the declared filters; a sentence where there is none."""
    try:
        fit = estimate(Model.linear(), recording)
    except (RecordingError, NotIdentifiable) as error:
        return f"no time-domain fit to compare with: {error}"
    rig = recording.rig
    filters = list(rig.output_filters)
    if rig.lowpass is not None:
        filters.append(ChannelFilter("RC", cutoff=rig.lowpass.cutoff))
    f = np.array([p.frequency for p in points])
    gain, delay = 1.0 + fit["scale_factor"].value, fit["time_offset"].value
    expected = gain * np.exp(-2j * math.pi * f * delay) * response(filters, 1.0 / usual_step(recording.accel.t))(f)
    ratio = np.array([p.value for p in points]) / expected
    magnitude, phase = np.abs(np.abs(ratio) - 1.0), np.abs(np.angle(ratio))
    i, j = int(np.argmax(magnitude)), int(np.argmax(phase))
    return CrossCheck(
        gain,
        fit["scale_factor"].std,
        delay,
        fit["time_offset"].std,
        float(magnitude[i]),
        float(f[i]),
        float(phase[j]),
        float(f[j]),
    )
