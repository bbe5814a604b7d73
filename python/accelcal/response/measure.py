"""From a recording to its frequency response: points, parameters, linearity, and the time-domain fit beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from accelcal._support.result import Storable
from accelcal._support.values import immutable
from accelcal.data import (
    POSITION_ORDER,
    Array,
    Channel,
    Recording,
    RecordingError,
    high_passes,
    require_reference,
    units,
    usual_step,
)
from accelcal.diagnosis.left_out import gain_of_changes, shown_by_output, without_wrong_readings
from accelcal.diagnosis.policy import DATA_SHEET_NOISE_RATIO
from accelcal.estimation.estimate import Fit, estimate, most_noise
from accelcal.estimation.gauss_newton import NotIdentifiable
from accelcal.io.write import filter_entries
from accelcal.model import Model
from accelcal.response.broadband import HIGHEST, measure_broadband
from accelcal.response.linearity import Harmonics, Term, linearity, measure_step
from accelcal.response.parametric import ResponseModel, fit_response
from accelcal.response.sine import ALONE, Point, Reference, SineStep, explained, find_steps, may_be_stepped
from accelcal.signals.processing import response as gain_of, spline


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
    noise: tuple[float, float]
    """Density that this fit has, and one behind the filters of the fitted structure, (m/s²)/sqrt(Hz)."""
    declaration: str
    """The entry of a sidecar that declares these filters; empty where they leave the noise as it is."""

    @property
    def sentence(self) -> str:
        """For people."""
        return (
            f"time-domain fit: 1 + k = {units.decimal(self.gain, 2.0 * self.gain_std)}, delay "
            f"{units.in_usual_size(self.delay, 2.0 * self.delay_std, 's')} (± U, k = 2) for all frequencies; the table "
            "differs from it by at most "
            f"{100 * self.magnitude:.3g} % in magnitude (at {self.magnitude_at:.4g} Hz) and "
            f"{math.degrees(self.phase):.3g} deg in phase (at {self.phase_at:.4g} Hz){self.advice}"
        )

    @property
    def advice(self) -> str:
        """How to declare the filters that the response shows, to be appended to a sentence; empty where there is
        nothing to gain."""
        if not self.declaration:
            return ""
        before, left = self.noise
        return (
            f"; with the filters of the fitted structure it has {left:.3g} (m/s²)/√Hz of noise instead of "
            f"{before:.3g}: declare them in [channels]: accel = {{ ..., lowpass = {self.declaration} }}"
        )


def cross_check(recording: Recording, points: Sequence[Point], model: ResponseModel | None) -> CrossCheck | str:
    """Compare with a linear fit in the time domain, behind the declared filters, and with one behind those of the
    fitted structure; a sentence where there is none."""
    try:
        fit = estimate(Model.linear(), recording)
    except (RecordingError, NotIdentifiable) as error:
        return f"no time-domain fit to compare with: {error}"
    filters = recording.rig.passed_by_output
    f = np.array([p.frequency for p in points])
    gain, delay = 1.0 + fit["scale_factor"].value, fit["time_offset"].value
    expected = gain * np.exp(-2j * math.pi * f * delay) * gain_of(filters, 1.0 / usual_step(recording.accel.t))(f)
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
        *_declared_fit(recording, fit, model),
    )


def _declared_fit(recording: Recording, fit: Fit, model: ResponseModel | None) -> tuple[tuple[float, float], str]:
    """Noise of a fit, and of one with the filters of a structure declared; and how to declare them, if that is less by
    what makes a model inadequate."""
    noise = most_noise(fit)
    if model is None or model.best.filters == model.best.behind:
        return (noise, noise), ""
    rig = replace(recording.rig, lowpass=None, output_filters=model.best.filters)
    with suppress(RecordingError, NotIdentifiable):
        left = most_noise(estimate(Model.linear(), replace(recording, rig=rig)))
        if DATA_SHEET_NOISE_RATIO * left < noise:
            return (noise, left), filter_entries(rig, "accel")["lowpass"] or ""
    return (noise, noise), ""


Method = Literal["auto", "sine", "broadband"]
"""Steady sines, any other motion, or whichever of the two the record holds."""
NEAR = 0.03
"""Relative distance from a frequency that was asked for at which a sine still is it."""
STEPPED = 0.25
"""Share of the output's power within steps from which on a recording is one of sine steps, where their sines explain
`ALONE` of it."""
FREQUENCIES = 3
"""Fewest different frequencies of steps that are a response by frequency."""
CHANNELS = 16
"""Samples of each channel below which there is nothing to fit a sine to."""


TYPE_A = (
    "Expanded uncertainties are of type A, from the noise beside each line: no contribution of the calibration of the "
    "reference is contained."
)


@immutable
@dataclass(frozen=True, slots=True)
class FrequencyResponse(Storable):
    """Sensitivity by frequency of one recording."""

    recording: str
    """File name."""
    points: tuple[Point, ...]
    """By frequency, then by time."""
    model: ResponseModel | None
    """Parameters; None with too few points."""
    terms: tuple[Term, ...]
    """Amplitude linearity, from sine steps."""
    check: CrossCheck | str | None
    """The time-domain fit, or why there is none; None where it was not asked for."""

    @property
    def basis(self) -> str:
        """What the expanded uncertainties of points and parameters contain, for people."""
        declared = max((p.reference_std for p in self.points), default=0.0)
        if not declared:
            return TYPE_A
        return (
            "Expanded uncertainties combine the noise beside each line (type A) with the declared relative standard "
            f"uncertainty of the reference's acceleration, {100.0 * declared:.2g} %, on magnitudes (type B)."
        )

    def __repr__(self) -> str:
        span = f", {self.points[0].frequency:.4g} to {self.points[-1].frequency:.4g} Hz" if self.points else ""
        return f"FrequencyResponse({self.recording!r}: {len(self.points)} points{span})"


def frequency_response(
    recording: Recording,
    *,
    frequencies: Sequence[float] | None = None,
    method: Method = "auto",
    reference: Reference | None = None,
    check: bool = True,
) -> FrequencyResponse:
    """Magnitude and phase of the output over the acceleration of the reference, with uncertainties (ISO 16063-11, -41).

    Parameters
    ----------
    recording : Recording
        Its output holds declared filters too: they are part of the response.
    frequencies : sequence of float, optional
        Hz. Of sine steps those to keep; of a broadband motion those to estimate. By default all that are found.
    method : {"auto", "sine", "broadband"}
        Sine approximation where most of the motion is steady sines, else spectral estimation.
    reference : Reference, optional
        A channel and its order; by default the position, of order 2.
    check : bool
        Whether to compare with a linear fit in the time domain.

    Raises
    ------
    RecordingError
        If no frequency is found, or one that was asked for is not in the recording.

    Examples
    --------
    >>> import numpy as np
    >>> from accelcal.simulation import ADXL105_RIG, simulate
    >>> rng = np.random.default_rng(1)
    >>> simulated = simulate("sine_steps", seconds=60.0, rig=ADXL105_RIG, parameters={"scale_factor": 0.01}, rng=rng)
    >>> response = frequency_response(simulated.recording, check=False)
    >>> len(response.points), response.model.best.structure.name
    (16, 'one pole')
    """
    if recording.reference is not None:
        recording = without_wrong_readings(recording)
    used = recorded_reference(recording) if reference is None else reference
    _require_samples(recording, used)
    asked = None if frequencies is None else _valid(recording, frequencies)
    harmonics = [] if method == "broadband" else _sine(recording, used, method, asked)
    points: list[Point] = []
    if not harmonics:
        if method == "sine":
            raise RecordingError(
                f"{recording.name}: no steady sine was found in output and reference; expected steps of at least six "
                "periods each. Take --method broadband for a sweep or a random motion"
            )
        try:
            points = measure_broadband(recording.accel, used, asked)
        except ValueError as error:
            raise RecordingError(f"{recording.name}: {error}") from None
    if not points and not harmonics:
        raise RecordingError(
            f"{recording.name}: output and reference have no frequency in common that stands out of their noise; "
            "check that both saw the same motion, or move more"
        )
    return _concluded(recording, used, harmonics, points, check)


def stepped_response(recording: Recording, *, check: bool = True) -> FrequencyResponse | None:
    """The response where the motion is one of sine steps at `FREQUENCIES` or more; None, in a moment, where it is not.

    What `frequency_response` takes for steady sines, but never a spectral estimation.
    """
    used = recorded_reference(recording)
    few = min(map(len, (recording.accel, used.channel))) < CHANNELS
    if few or not may_be_stepped(recording.accel, _highest(recording, used)):
        return None
    harmonics = _sine(recording, used, "auto", None)
    if len(_distinct([h.point.frequency for h in harmonics])) < FREQUENCIES:
        return None
    return _concluded(recording, used, harmonics, [], check)


def _concluded(
    recording: Recording,
    reference: Reference,
    harmonics: Sequence[Harmonics],
    broadband: Sequence[Point],
    check: bool,
) -> FrequencyResponse:
    """Points by frequency with all that follows from them."""
    measured = sorted((*(h.point for h in harmonics), *broadband), key=lambda p: (p.frequency, p.start))
    points = [replace(p, reference_std=declared_std(recording, reference)) for p in measured]
    model = fit_response(points, recording.rig.output_filters, 1.0 / usual_step(recording.accel.t))
    terms: tuple[Term, ...] = ()
    if model is not None and harmonics:
        gain, sized = model.best.response, float(model.best.theta[0])
        terms = linearity(harmonics, gain, sized, coupled=not high_passes(recording.rig.output_filters))
    return FrequencyResponse(
        recording.name, tuple(points), model, terms, cross_check(recording, points, model) if check else None
    )


def declared_std(recording: Recording, reference: Reference) -> float:
    """Relative standard uncertainty of the reference's acceleration by its declared scale and clock; 0 without."""
    uncertainty = recording.rig.uncertainty
    return math.hypot(uncertainty.encoder_scale or 0.0, reference.order * (uncertainty.clock_rate or 0.0))


def _distinct(frequencies: Sequence[float]) -> list[float]:
    """Frequencies that differ by more than `NEAR`, rising."""
    distinct: list[float] = []
    for f in sorted(frequencies):
        if not distinct or f > (1.0 + NEAR) * distinct[-1]:
            distinct.append(f)
    return distinct


def _highest(recording: Recording, reference: Reference) -> float:
    """Highest frequency at which sines are looked for, Hz."""
    return HIGHEST / max(usual_step(recording.accel.t), usual_step(reference.channel.t))


def recorded_reference(recording: Recording) -> Reference:
    """What the recording was referred to, its position or a velocity or acceleration, behind its declared filters."""
    rig, read = recording.rig, recording.reference
    channel = recording.position if read is None else read
    order = POSITION_ORDER if read is None else require_reference(read)[0]
    if read is not None and recording.left_out:
        channel = _with_gaps_filled(read, shown_by_output(recording, order))
    filters = gain_of(rig.position_filters, 1.0 / usual_step(channel.t))
    return Reference(channel, order, rig.polarity, filters)


def _with_gaps_filled(read: Channel, shown: Callable[[Array], Array]) -> Channel:
    """The reference on even times, since a spectral estimate wants them: gaps move as the output shows."""
    steps = np.rint(np.diff(read.t) / usual_step(read.t))
    rows = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1.0))])
    t = np.interp(np.arange(rows[-1] + 1.0), rows, read.t)
    motion = shown(read.t)
    gain = gain_of_changes(read.y, motion)
    return replace(read, t=t, y=spline(read.t, read.y - gain * motion, t) + gain * shown(t))


def _require_samples(recording: Recording, reference: Reference) -> None:
    for channel in (recording.accel, reference.channel):
        if len(channel) < CHANNELS:
            raise RecordingError(
                f"{recording.name}: {channel.name} has {len(channel)} samples, expected at least {CHANNELS}; a "
                "frequency response needs a recording of output and reference"
            )


def _valid(recording: Recording, frequencies: Sequence[float]) -> list[float]:
    valid = [float(f) for f in frequencies]
    if not valid or not all(np.isfinite(f) and f > 0.0 for f in valid):
        raise RecordingError(f"{recording.name}: frequencies {valid}, expected positive numbers in Hz")
    return valid


def _sine(recording: Recording, reference: Reference, method: str, asked: Sequence[float] | None) -> list[Harmonics]:
    """Sines that are asked for, or all; none where the motion is not one of steady sines."""
    steps = _shared(find_steps(recording.accel, _highest(recording, reference)), recording, reference)
    inside, steady = explained(recording.accel, steps)
    if method == "auto" and (inside < STEPPED or steady < ALONE):
        return []
    points = [h for step in steps for h in measure_step(recording.accel, reference, step)]
    if asked is None:
        return points
    missing = [f for f in asked if not any(abs(h.point.frequency - f) < NEAR * f for h in points)]
    if missing:
        there = ", ".join(f"{f:.4g}" for f in sorted({h.point.frequency for h in points}))
        raise RecordingError(
            f"{recording.name}: no steady sine at {', '.join(f'{f:.6g}' for f in missing)} Hz; found are: {there} Hz"
        )
    return [h for h in points if any(abs(h.point.frequency - f) < NEAR * f for f in asked)]


def _shared(steps: Sequence[SineStep], recording: Recording, reference: Reference) -> list[SineStep]:
    """Steps that lie within the stretch that both channels cover."""
    begin = max(float(recording.accel.t[0]), float(reference.channel.t[0]))
    end = min(float(recording.accel.t[-1]), float(reference.channel.t[-1]))
    return [s for s in steps if s.start >= begin and s.end <= end]
