"""The encoder: what it adds to the position, m."""

from __future__ import annotations

import numpy as np

from accelcal.data import Array
from accelcal.effects.building_blocks import (
    HIGHEST_HARMONIC,
    amplitude,
    direction,
    harmonics_of,
    instants,
    lagged_at,
    largest,
    one_turn,
    periods,
    since,
    slacks,
)
from accelcal.effects.registry import NoiseSource, Search, Shape, SizePrior, Traits, effect
from accelcal.signals.signals import Signals


@effect(
    "encoder_outliers",
    unit="m²",
    port="noise",
    owner="encoder",
    symbol="rp",
    scale=1e-12,
    source="no published figure",
    traits=Traits(
        positive=True, noise=NoiseSource("reading outliers", largest, rejects="position", raises=("whiteness",))
    ),
)
def encoder_outliers(s: Signals) -> Array:
    """Outliers of the position readings: dirt on the scale, a bit lost.

    Equation: variance of the reading = rp, their rate times their mean square height.
    Looks like: single innovations far outside the distribution of the rest, followed by one of opposite sign.
    Easily confused with: encoder_step, real impacts.
    Separate by: counting them; a repeat, in which dirt recurs at the same place.
    """
    return np.ones_like(s.t)


@effect(
    "encoder_cyclic",
    unit="m",
    port="position",
    owner="encoder",
    symbol="ec",
    scale=2e-7,
    source="1 % of a signal period of 20 µm",
    shapes={"period": Shape("m", periods, trials=8, spacing="log", width=one_turn)} | HIGHEST_HARMONIC,
    parts=("sin", "cos"),
    traits=Traits(noise=NoiseSource("wave over position", amplitude)),
)
def encoder_cyclic(s: Signals, period: float, harmonics: float = 1.0) -> Array:
    """Interpolation error: periodic in position with the period of the scale.

    Equation: b = c sin(2 pi p/period) + d cos(2 pi p/period), and of harmonics n up to 4 that the record shows c_n
    sin(2 pi n p/period) + d_n cos(2 pi n p/period), of one period. The noise test finds the period and the harmonics;
    another period enters beside it as encoder_cyclic_2.
    Looks like: noise of the readings that is a wave when folded on position.
    Easily confused with: rail_wave, encoder noise.
    Separate by: a slow scan folded on the period; two speeds: the encoder's wave grows with the square of speed.
    """
    return harmonics_of((2.0 * np.pi / period) * s.p, harmonics)


@effect(
    "encoder_backlash",
    unit="m",
    port="position",
    owner="encoder",
    symbol="d",
    scale=1e-6,
    source="µm, no published figure",
    shapes={"width": Shape("m", slacks, trials=4, spacing="log", beyond_size=True)},
    traits=Traits(memory=True),
)
def encoder_backlash(s: Signals, width: float) -> Array:
    """Backlash between carriage and reading head: the reading depends on the direction of the last move.

    Equation: b = (d/2) sgn v, kept through rests and straight across a reversal: d (p - play(p, w))/w; a head that
    hangs in a plain gap has w = |d|.
    Looks like: two levels of the reading, one for either direction; impulses at reversals.
    Easily confused with: coulomb, hysteresis, velocity.
    Separate by: approaching the same place from both sides, then resting.
    """
    return 0.5 * direction(s, width)


@effect(
    "encoder_nonlinearity",
    unit="m⁻¹, m⁻²",
    port="position",
    owner="encoder",
    symbol="e2, e3",
    scale=1e-3,
    source="10 µm over 0.1 m (paper)",
    parts=("p²", "p³"),
)
def encoder_nonlinearity(s: Signals) -> Array:
    """Long-wave error of the scale; its straight part is encoder_scale, which no level rig shows.

    Equation: b = e2 p² + e3 p³, felt as the acceleration b'' = (2 e2 + 6 e3 p) v² + (2 e2 p + 3 e3 p²) a.
    Looks like: a scale error that depends on position.
    Easily confused with: acceleration_velocity, rail_slope, velocity_squared.
    Separate by: a shifted start position; the encoder reversed; runs at different speed.
    """
    return np.column_stack([s.p**2, s.p**2 * s.p])


@effect(
    "encoder_step",
    unit="m",
    port="position",
    owner="encoder",
    symbol="ds",
    scale=2e-5,
    source="one signal period missed",
    shapes={"instant": Shape("s", instants, trials=16, picked="jumps")},
    traits=Traits(noise=NoiseSource("position jumps", amplitude)),
)
def encoder_step(s: Signals, instant: float) -> Array:
    """Missed counts: a step of the position that stays.

    Equation: b = ds [t >= instant].
    Looks like: one innovation far outside the rest, with a decay behind it.
    Easily confused with: encoder_outliers, an impact.
    Separate by: a reference mark passed before and after.
    """
    return since(s, instant)


@effect(
    "encoder_scale",
    unit="1",
    port="position",
    owner="encoder",
    symbol="eps",
    scale=1e-4,
    source="10 µm over 0.1 m (paper)",
    traits=Traits(visible=False, summand="encoder scale", uncertainty="encoder_scale", of_any_reference=True),
)
def encoder_scale(s: Signals) -> Array:
    """Scale error of the encoder.

    Equation: b = eps p.
    Looks like: a scale error of the accelerometer, k = -eps.
    Easily confused with: scale_factor; on a level rig they are one number.
    Separate by: an interferometer on the encoder; a tumble in gravity.
    """
    return s.p


@effect(
    "encoder_lag",
    unit="1",
    port="position",
    owner="encoder",
    symbol="le",
    scale=SizePrior(
        0.02, "LVDT behind a demodulator of 500 Hz: tau = 0.3 ms; filtered motion capture: 10 ms", (1.0,), mean=1.0
    ),
    shapes={"tau": Shape("s", (3e-5, 3e-2), trials=5, spacing="log")},
    traits=Traits(positive=True, memory=True, summand="(-encoder lag)", delay_class=True, of_any_reference=True),
    search=Search(includes=("time_offset",)),
)
def encoder_lag(s: Signals, tau: float) -> Array:
    """First-order low-pass of the position sensor (derivations 7.3b): LVDT, vibrometer, filtered motion capture.

    A coefficient of 1 is a plain low-pass. While tau is small only le (2 - le) tau² can be estimated beside
    time_offset, and the prior decides.

    Equation: b = le (x - p), tau x' = p - x; beyond the delay, a position that is short by tau²/2 times p''.
    Looks like: an output early by tau and, beyond that, too large the more the higher the frequency.
    Easily confused with: time_offset and sensor_resonance; sensor_lag delays the output and makes it too small.
    Separate by: a common trigger on both channels and a sweep up to a third of 1/tau, where a lag levels off and a
    resonance rises; a second position sensor of known bandwidth.
    """
    stage = s.rig.polarity * s.a - s.gravity
    return tau * (tau * lagged_at(s.t, stage, tau, float(stage[0])) - s.v)
