"""Clocks and the dynamics of the sensor: what changes when a value appears in the output."""

from __future__ import annotations

import numpy as np

from accelcal.data import Array
from accelcal.effects.building_blocks import jitter_at_top_jerk, lagged, slow, snap
from accelcal.effects.mechanisms import INSTANT, TIME, product
from accelcal.effects.registry import NoiseSource, Search, Shape, SizePrior, Traits, effect, enter
from accelcal.signals.signals import Signals

enter(
    {
        "time_offset_step": product("time_offset", INSTANT)
        | {
            "card": """Step of the delay of the output: a sample was dropped or stored twice.

    Equation: e = -(1 + k) dt0 jerk [t >= instant].
    Looks like: a residual proportional to jerk before or after an instant only.
    Easily confused with: clock_skew.
    Separate by: sample counters; a common trigger at the beginning and at the end.
    """,
            "symbol": "dt0",
            "scale": 6e-4,
            "source": "one dropped sample at 1666 Hz",
        },
        "clock_skew": product("time_offset", TIME)
        | {
            "card": """Rate difference of the two clocks: the delay of the output grows linearly.

    Equation: e = -(1 + k) alpha t jerk.
    Looks like: a residual proportional to jerk whose size is a straight line over time.
    Easily confused with: time_offset_step, scale_drift when the motion has one frequency.
    Separate by: a longer record; a common trigger at the beginning and at the end.
    """,
            "symbol": "alpha",
            "scale": 5e-5,
            "source": "crystal: 50 ppm",
        },
    }
)


@effect(
    "timing_jitter",
    unit="s²",
    port="noise",
    owner="timing",
    symbol="sigma_t²",
    scale=1e-10,
    source="10 µs",
    traits=Traits(positive=True, noise=NoiseSource("noise over jerk", jitter_at_top_jerk)),
)
def timing_jitter(s: Signals) -> Array:
    """Jitter of the time stamps, of variance sigma_t².

    Equation: variance of the output = sigma_t² ((1 + k) jerk)².
    Looks like: noise that grows with |jerk|, without a mean.
    Easily confused with: vibration, whose noise follows v⁴.
    Separate by: the histogram of the time stamps; motion at high jerk and low speed.
    """
    return (s.scale * s.jerk) ** 2


@effect(
    "rounded_stamps",
    unit="s²",
    port="noise",
    owner="timing",
    symbol="Dt²",
    scale=1e-6,
    source="loggers and phones that write milliseconds",
    traits=Traits(positive=True, noise=NoiseSource("stamps on a grid", jitter_at_top_jerk)),
)
def rounded_stamps(s: Signals) -> Array:
    """Time stamps are rounded to steps Dt that are no divisor of the spacing of the samples.

    Equation: variance of the output = Dt²/12 ((1 + k) jerk)².
    Looks like: spacings of few values, whole multiples of one step; noise that grows with |jerk|.
    Easily confused with: timing_jitter, whose stamps lie on no grid.
    Separate by: the histogram of the spacings; stamps recorded with more digits.
    """
    return (s.scale * s.jerk) ** 2 / 12.0


@effect(
    "held_samples",
    unit="s²",
    port="noise",
    owner="timing",
    symbol="Th²",
    scale=1e-6,
    source="a bus that is read faster than the sensor renews its value",
    traits=Traits(positive=True, noise=NoiseSource("held output", jitter_at_top_jerk, raises=("tone", "whiteness"))),
)
def held_samples(s: Signals) -> Array:
    """Samples are repeated because the sensor was slower than the logger; each is late by up to Th.

    Equation: variance of the output = Th²/12 ((1 + k) jerk)², beside a delay of Th/2. Where repeats are left out, Th is
    the period of the logger; where they are not, that of the sensor.
    Looks like: runs of equal samples while the output changes by far more than its resolution.
    Easily confused with: quantisation, time_offset, timing_jitter.
    Separate by: a logger at the rate of the sensor, or triggered by its data-ready signal.
    """
    return (s.scale * s.jerk) ** 2 / 12.0


@effect(
    "sensor_lag",
    unit="1",
    symbol="l",
    scale=SizePrior(0.001, "a low-pass takes the whole signal; RC of 159 Hz: tau = 1.0 ms (paper)", (1.0,), 1.0),
    shapes={"tau": Shape("s", (1e-4, 1e-2), trials=4, spacing="log")},
    traits=Traits(positive=True, memory=True, summand="sensor lag", delay_class=True),
    search=Search(includes=("time_offset",)),
)
def sensor_lag(s: Signals, tau: float) -> Array:
    """First-order low-pass that was not declared; time_offset, in every base, already holds its delay tau.

    Equation: e = (1 + k) l (x - a), tau x' = a - x; with l = 1, beyond the delay, tau²/2 times the snap a''.
    Looks like: beyond a delay, an output that falls short the more the higher the frequency.
    Easily confused with: time_offset and sensor_resonance; while tau is small only l (2 - l) tau² can be
    estimated.
    Separate by: a sweep of frequency up to a tenth of 1/tau; declaring and removing the low-pass.
    """
    return s.scale * (lagged(s.a, tau, s.step, s.a[0]) - s.a)


@effect(
    "lowpass_error",
    unit="s",
    owner="rig",
    symbol="dtau",
    scale=5e-5,
    source="RC of 159 Hz with a capacitor of 5 %",
    traits=Traits(memory=True, visible=False, summand="error of the low-pass"),
)
def lowpass_error(s: Signals) -> Array:
    """The declared low-pass has a time constant longer by dtau; a fit carries it where a tolerance is declared.

    Equation: e = -(1 + k) dtau x, (tau + dtau) x' = jerk - x, with tau as declared.
    Looks like: a delay, and above 1/(10 tau) an output that falls short.
    Easily confused with: time_offset and sensor_lag.
    Separate by: measuring the filter; a sweep of frequency up to a tenth of 1/tau.
    """
    lowpass = s.rig.lowpass
    return -s.scale * (s.jerk if lowpass is None else lagged(s.jerk, lowpass.tau, s.step, 0.0))


@effect(
    "sensor_resonance",
    unit="s²",
    owner="mounting",
    symbol="1/w0²",
    scale=3e-8,
    source="900 Hz: IIS2ICLX; brackets 100 Hz to 500 Hz",
    traits=Traits(positive=True, memory=True, delay_class=True),
    search=Search(includes=("time_offset",)),
)
def sensor_resonance(s: Signals) -> Array:
    """Resonance of sensor or bracket, well above the motion; time_offset already holds its delay 1/(Q w0). One near the
    motion is declared, as a low-pass of the kind "resonance".

    Equation: e = -(1 + k) c a'', c = (1 - 1/(2 Q²))/w0².
    Looks like: beyond a delay, an output that is too large the more the higher the frequency.
    Easily confused with: time_offset, and sensor_lag, which is the same shape with the other sign.
    Separate by: a sweep of frequency to a tenth of the resonance; a tap test; a second bracket.
    """
    return -s.scale * snap(s)


def carried_over(s: Signals, start: float) -> float:
    """What an effect with memory holds at the first sample, m/s²: the rest, and a share of the largest acceleration."""
    largest: float = np.max(np.abs((s.whole or s).a - s.rest))  # a symbol, where a filter is exported
    return s.rest + start * largest


@effect(
    "creep",
    unit="1",
    symbol="cc",
    scale=3e-4,
    source="1e-4 to 1e-3, no published figure",
    shapes={
        "tau": Shape("s", slow(0.004, 0.25), trials=5, spacing="log"),
        "start": Shape("1", (-1.0, 1.0), trials=3, at_rest=0.0),
    },
    traits=Traits(memory=True),
)
def creep(s: Signals, tau: float, start: float) -> Array:
    """Viscoelastic creep of the sensing element: part of its response is delayed.

    Equation: e = cc x, tau x' = a - x. What x carries over from before the record is a share of the largest
    acceleration: 0 where the stage had long been at rest.
    Looks like: a slow tail after a hold.
    Easily confused with: warm_up, bias_gauss_markov, velocity when tau is long.
    Separate by: a long constant tilt step.
    """
    return lagged(s.a, tau, s.step, carried_over(s, start))


@effect(
    "ac_coupling",
    unit="1",
    symbol="h",
    scale=SizePrior(0.02, "piezoelectric sensors and AC-coupled channels: tau = 0.1 s to 10 s", (1.0,), mean=1.0),
    shapes={
        "tau": Shape("s", slow(0.002, 30.0), trials=4, spacing="log"),
        "start": Shape("1", (-1.0, 1.0), added=True, at_rest=0.0),
    },
    traits=Traits(positive=True, memory=True),
    search=Search(includes=("bias",)),
)
def ac_coupling(s: Signals, tau: float, start: float = 0.0) -> Array:
    """First-order high-pass that was not declared (derivations 7.3b): a coupling capacitor, a charge amplifier.

    A coefficient of 1 takes away all that is constant, gravity included. While tau exceeds the record only h/tau can
    be estimated, and the prior decides.

    Equation: e = -(1 + k) h x, tau x' = a - x. What x carries over from before the record, or from switching on, is a
    share of the largest acceleration: 0 where the stage had long been at rest.
    Looks like: after a change of acceleration the output decays to its zero; an output early at low frequencies.
    Easily confused with: velocity where tau exceeds a period of the motion; creep, of which it is one with cc = -1.
    Separate by: a lasting step of tilt, of which a high-pass leaves nothing after 5 tau; motion as slow as 1/tau.
    """
    return -s.scale * lagged(s.a, tau, s.step, carried_over(s, start))
