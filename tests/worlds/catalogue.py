"""The effects of the catalogue as physics: each says what it adds, where in the chain, and where its equation is from.

The chain: true acceleration -> `force` (what the element feels) -> `dynamics` (how the element follows) -> `response`
(what it makes of it) -> `clip` -> `clock` (when it is read) -> low-pass -> `sample`. On the other side true position ->
`scale` (errors engraved in it: functions of position alone, taken at the very instant of a reading, because they may
change within one step of the fine grid) and `encoder` (all that has memory or depends on time) -> `reading`.
A magnitude multiplies the bracketed contribution of the catalogue; a function returns what is to be added at its place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from .numerics import STEP, Array, interpolate, lag, play, resonate
from .scene import G0, REFERENCE_TEMPERATURE, Scene

Place = Literal["force", "dynamics", "response", "clip", "clock", "sample", "scale", "encoder", "reading"]
Kind = Literal["mean", "random", "variance", "invisible"]
Shape = Mapping[str, float]
Contribution = Callable[[Scene, Array, float, Shape, np.random.Generator], Array]
"""(scene, signal at that place, magnitude, shape, generator of this effect) -> what is added, on the same instants."""
Draw = Callable[[Scene, np.random.Generator], dict[str, float]]


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect."""

    name: str
    unit: str
    """Of the magnitude."""
    place: Place
    kind: Kind
    """`mean` adds a signal, `random` a random one, `variance` noise; `invisible` hides in the base on a level rig."""
    explains: tuple[str, ...]
    """What its contribution is a function of."""
    typical: float
    add: Contribution
    draw: Draw
    """Draws shape parameters that the world does not fix."""
    source: str


def _no_shape(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
    return {}


def declare(
    registry: dict[str, Effect],
    unit: str,
    place: Place,
    explains: str,
    typical: float,
    kind: Kind = "mean",
    draw: Draw = _no_shape,
) -> Callable[[Contribution], Contribution]:
    """Enter a function into a registry under its own name; the docstring is its source."""

    def enter(add: Contribution) -> Contribution:
        name, source = add.__name__, add.__doc__ or ""
        registry[name] = Effect(name, unit, place, kind, tuple(explains.split()), typical, add, draw, source)
        return add

    return enter


CATALOGUE: dict[str, Effect] = {}


def between(**ranges: tuple[float, float]) -> Draw:
    def draw(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
        return {name: float(rng.uniform(*limits)) for name, limits in ranges.items()}

    return draw


def instant(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
    """Draw an instant in the middle half of the time in which the stage moves."""
    return {"instant": float(np.quantile(scene.t[np.abs(scene.v) > 1e-4], rng.uniform(0.25, 0.75)))}


# --- the element: what it makes of the force it feels ---------------------------------------------------------------


@declare(CATALOGUE, "(m/s²)⁻¹", "response", "acceleration", 1e-3)
def quadratic(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """K2 of the model equation of IEEE Std 1293-1998; equation (4) of Stakkeland et al. 2007."""
    return m * f * f


@declare(CATALOGUE, "(m/s²)⁻²", "response", "acceleration", 1e-3)
def cubic(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """K3 of the model equation of IEEE Std 1293-1998; equation (4) of Stakkeland et al. 2007."""
    return m * f * f * f


@declare(CATALOGUE, "(m/s²)⁻¹", "response", "acceleration", 3e-3)
def odd_quadratic(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Koq of IEEE Std 1293-1998: a pendulum or beam whose stiffness grows with the size of its deflection."""
    return m * np.copysign(f * f, f)


@declare(CATALOGUE, "1", "response", "acceleration", 1e-3)
def scale_asymmetry(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """K1'/2 of IEEE Std 1293-1998: the scale factor is 1 + k + m for positive and 1 + k − m for negative force."""
    return np.where(f > 0, m * f, -m * f)


@declare(CATALOGUE, "m/s²", "response", "acceleration", -3e-3)
def dead_zone(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A threshold of half width |m|: no answer inside, |m| less outside (IEEE Std 528, "dead band").

    With m > 0 the answer inside is doubled and |m| more outside: crossover, the (K0'/2) sgn a of IEEE Std 1293.
    """
    return m * np.clip(f / abs(m), -1, 1)


def _loop_width(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
    return {"half_width": float(rng.uniform(0.05, 0.2) * np.std(scene.a[np.abs(scene.a) > 0.02]))}


@declare(CATALOGUE, "1", "response", "acceleration", 0.03, draw=_loop_width)
def hysteresis(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A share m of the force reaches the output through a link with play (Brokate, Sprekels 1996, ch. 2)."""
    return m * play(f, shape["half_width"])


@declare(CATALOGUE, "m/s²", "clip", "acceleration", 0.3)
def saturation(scene: Scene, y: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The output stops at ±level (data sheets, "full-scale range").

    The magnitude is how far the level lies below the largest output; a given shape parameter `level` replaces it.
    """
    level = shape["level"] if "level" in shape else np.max(np.abs(y)) - m
    return np.clip(y, -level, level) - y


# --- temperature ----------------------------------------------------------------------------------------------------


@declare(CATALOGUE, "m/s²/K", "response", "temperature", 3e-3)
def temperature_bias(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Zero-g level against temperature (data sheet ADXL355, table 1, "0 g offset temperature coefficient")."""
    return m * (scene.temperature - REFERENCE_TEMPERATURE)


@declare(CATALOGUE, "1/K", "response", "temperature acceleration", 3e-3)
def temperature_scale(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Sensitivity change due to temperature (data sheet ADXL355, table 1); the element's own temperature counts."""
    return m * (scene.temperature - REFERENCE_TEMPERATURE) * f


@declare(CATALOGUE, "s m/s²/K", "response", "temperature", 0.1)
def temperature_rate(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Bias from heat flow through the case, proportional to dT/dt (Lawrence 1998, Modern Inertial Technology)."""
    return m * np.gradient(scene.temperature, STEP)


@declare(CATALOGUE, "m/s²", "response", "time", 1e-2, draw=between(tau=(5.0, 12.0)))
def warm_up(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Turn-on transient: power is applied at time zero and a lumped thermal mass settles (IEEE Std 528, "warm-up")."""
    return m * np.exp(-np.maximum(scene.t, 0) / shape["tau"])


@declare(CATALOGUE, "(m/s²)⁻¹", "response", "acceleration time", 3e-3, draw=between(tau=(3.0, 12.0)))
def self_heating(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Power that grows with a² heats one thermal mass, tau x' = a² − x (Fourier's law, lumped capacitance)."""
    heat = f * f
    heat[scene.t < 0] = 0.0
    return m * lag(heat, shape["tau"])


# --- slow changes of the sensor -------------------------------------------------------------------------------------


@declare(CATALOGUE, "m/s³", "response", "time", 1e-4)
def bias_drift(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Rate ramp of the bias (IEEE Std 952-1997, annex C, drift rate ramp)."""
    return m * scene.t


@declare(CATALOGUE, "m/s²", "response", "time", 3e-3, draw=instant)
def bias_step(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A shift of the bias at one instant, as after a shock (data sheet ADXL355, "turn-on to turn-on, shock")."""
    return np.where(scene.t >= shape["instant"], m, 0.0)


@declare(CATALOGUE, "m/s²/√s", "response", "time", 1e-3, kind="random")
def bias_random_walk(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Wiener process of intensity m² (IEEE Std 952-1997, annex C, rate random walk)."""
    walk = np.cumsum(rng.standard_normal(len(scene.t))) * m * np.sqrt(STEP)
    return np.asarray(walk - walk[np.searchsorted(scene.t, 0.0)])


@declare(CATALOGUE, "m/s²", "response", "time", 3e-3, kind="random", draw=between(tau=(2.0, 6.0)))
def bias_gauss_markov(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Stationary b' = −b/tau + w of standard deviation m (Gelb 1974, section 2.2 and table 2.2-1)."""
    keep = np.exp(-STEP / shape["tau"])
    shocks = rng.standard_normal(len(scene.t)) * np.sqrt(1 - keep**2)
    shocks[0] /= np.sqrt(1 - keep**2)
    return m * np.asarray(lfilter([1.0], [1.0, -keep], shocks))


@declare(CATALOGUE, "1/s", "response", "time acceleration", 3e-4)
def scale_drift(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The scale factor changes at a steady rate (IEEE Std 528, "scale factor stability")."""
    return m * scene.t * f


@declare(CATALOGUE, "1", "response", "time acceleration", 3e-3, draw=instant)
def scale_step(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The scale factor shifts at one instant, as when the supply of a ratiometric sensor does (data sheet ADXL358)."""
    return np.where(scene.t >= shape["instant"], m * f, 0.0)


@declare(CATALOGUE, "1/√s", "response", "time acceleration", 3e-4, kind="random")
def scale_random_walk(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Wiener process of intensity m² times the force (IEEE Std 952-1997, annex C, of the scale factor)."""
    return bias_random_walk(scene, f, m, shape, rng) * f


@declare(CATALOGUE, "1", "response", "time acceleration", 2e-3, kind="random", draw=between(tau=(0.5, 2.0)))
def scale_gauss_markov(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Stationary Markov process of standard deviation m times the force (Stakkeland et al. 2007, section II-D)."""
    return bias_gauss_markov(scene, f, m, shape, rng) * f


# --- what motion does to the rig ------------------------------------------------------------------------------------


@declare(CATALOGUE, "s⁻¹", "force", "velocity", 1e-2)
def velocity(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Viscous drag of the cable tilts the sensor in proportion to speed (Stokes drag on a compliant mount)."""
    return G0 * np.sin(m * scene.v / G0)


@declare(CATALOGUE, "m⁻¹", "force", "velocity", 0.3)
def velocity_squared(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Centripetal acceleration v²/r along the input axis on a bent rail (kinematics of a curve of curvature m)."""
    return m * scene.v**2


@declare(CATALOGUE, "m⁻¹", "force", "velocity", 0.3)
def velocity_odd(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Quadratic drag of the air on the sensor's case, against the motion (Rayleigh's drag equation)."""
    return m * scene.v * np.sqrt(scene.v**2)


@declare(CATALOGUE, "m/s²", "force", "velocity", 1e-3)
def coulomb(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Dry friction bends the mount by a constant amount against the motion, released at rest (Coulomb 1785).

    The change of sign takes 0.1 mm/s (Armstrong-Helouvry 1991, smooth Coulomb model).
    """
    return m * scene.v / np.hypot(scene.v, 1e-4)


@declare(CATALOGUE, "m/s²", "force", "position velocity", 1e-3, draw=between(length=(1e-3, 1e-2)))
def presliding(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A cable chain bends before it slides: friction comes to its full size over a way after each turn (Dahl 1968)."""
    way = np.sign(scene.v)
    decay = np.exp(-np.abs(np.diff(scene.p, prepend=scene.p[0])) / shape["length"])
    z = np.zeros(len(way))
    for i in range(1, len(z)):
        z[i] = way[i] + (z[i - 1] - way[i]) * decay[i] if way[i] else z[i - 1]
    return m * z


@declare(CATALOGUE, "s/m", "response", "acceleration velocity", 1e-2)
def acceleration_velocity(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Induction: the scale factor changes with speed in the field of the linear motor (Faraday's law)."""
    return f * (m * scene.v)


@declare(CATALOGUE, "m/s² per m", "force", "position", 3e-2)
def rail_slope(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Gravity along a rail whose inclination is m p/g0 (weight on an inclined plane)."""
    return G0 * np.sin(m * scene.p / G0)


@declare(CATALOGUE, "m/s² per m²", "force", "position", 0.3)
def rail_curve(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Gravity along a rail whose height is the cubic m p³/(3 g0): inclination m p²/g0 (inclined plane)."""
    return G0 * np.sin(np.arctan(m * scene.p**2 / G0))


@declare(CATALOGUE, "m/s²", "force", "position", 3e-3, draw=between(period=(0.03, 0.06), phase=(0.0, 2 * np.pi)))
def rail_wave(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Gravity along a rail that waves with the distance of its screws; m is the largest value (inclined plane)."""
    return G0 * np.sin(m / G0 * np.sin(2 * np.pi * scene.p / shape["period"] + shape["phase"]))


# --- timing and dynamics --------------------------------------------------------------------------------------------


def read_late(scene: Scene, y: Array, late: Array | float) -> Array:
    return interpolate(scene.t[0], y, scene.t - late) - y


@declare(CATALOGUE, "s", "clock", "jerk", 3e-5)
def time_offset(scene: Scene, y: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Transport delay: the output at stamp t belongs to the instant t − m (Franklin, Powell, Workman 1998, ch. 3)."""
    return read_late(scene, y, m)


@declare(CATALOGUE, "s", "clock", "jerk time", 1e-4, draw=instant)
def time_offset_step(scene: Scene, y: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """From one instant on the stamps are late, as after a buffer overrun (NTP, RFC 5905, "step")."""
    return read_late(scene, y, np.where(scene.t >= shape["instant"], m, 0.0))


@declare(CATALOGUE, "1", "clock", "jerk time", 3e-6)
def clock_skew(scene: Scene, y: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The accelerometer's clock runs fast by m: true instant t gets stamp (1 + m) t (RFC 5905, "frequency error")."""
    return read_late(scene, y, scene.t * m / (1 + m))


@declare(CATALOGUE, "s", "sample", "jerk", 1e-4, kind="variance")
def timing_jitter(scene: Scene, y: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Aperture jitter: each sample is taken at a random instant of standard deviation m around its stamp.

    W. Kester, Analog Devices MT-007. Here the instants move, so the function returns times, s.
    """
    return m * rng.standard_normal(len(y))


@declare(CATALOGUE, "s", "dynamics", "jerk", 1e-4)
def sensor_lag(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The element follows as one first-order lag of time constant m (Doebelin 2003, section 3.3)."""
    return lag(f, m) - f


@declare(CATALOGUE, "s", "dynamics", "jerk", 3e-5, draw=between(quality=(3.0, 8.0)))
def sensor_resonance(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Seismic mass on a spring, y'' = w0² (f − y) − (w0/Q) y' (Doebelin 2003, section 3.3).

    The magnitude is its delay at low frequency, 1/(Q w0), so that f0 = 1/(2 pi Q m).
    """
    return resonate(f, 1 / (2 * np.pi * shape["quality"] * m), shape["quality"]) - f


@declare(CATALOGUE, "1", "dynamics", "acceleration time", 1e-2, draw=between(tau=(0.8, 4.0)))
def creep(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Standard linear solid: a share m of the deflection follows with tau (Zener 1948, Elasticity and Anelasticity)."""
    return m * lag(f, shape["tau"])


# --- lateral acceleration -------------------------------------------------------------------------------------------


@declare(CATALOGUE, "1", "response", "a_y", 3e-3)
def cross_axis(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The input axis leans by m towards the lateral axis (IEEE Std 1293-1998, misalignment δo)."""
    return scene.a_y * float(np.sin(m))


@declare(CATALOGUE, "(m/s²)⁻¹", "response", "a_y", 3e-3)
def cross_axis_quadratic(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Koo of IEEE Std 1293-1998."""
    return m * scene.a_y**2


@declare(CATALOGUE, "(m/s²)⁻¹", "response", "acceleration a_y", 3e-3)
def cross_coupling(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Kio of IEEE Std 1293-1998: a pendulous mass that the force has deflected turns its input axis."""
    return f * scene.a_y * m


# --- lines, vibration, samples --------------------------------------------------------------------------------------


@declare(CATALOGUE, "m/s²", "response", "frequency", 1e-2, draw=between(frequency=(18, 60), phase=(0, 2 * np.pi)))
def tone(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A line picked up at one frequency, amplitude m (Ott 2009, Electromagnetic Compatibility Engineering, ch. 2)."""
    return m * np.cos(2 * np.pi * shape["frequency"] * scene.t + shape["phase"])


@declare(CATALOGUE, "m/s²", "force", "velocity", 0.3, kind="variance", draw=lambda scene, rng: {"exponent": 2.0})
def vibration(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Ball bearings shake the sensor at 200 to 300 Hz; m at the highest speed (Stakkeland et al. 2007, II-F)."""
    return scene.bearing(m, shape["exponent"])


@declare(
    CATALOGUE, "(m/s²)⁻¹", "response", "velocity", 1e-2, draw=lambda scene, rng: {"amplitude": 1.5, "exponent": 2.0}
)
def vibration_rectification(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Even nonlinearity m in the vibration band turns vibration into bias m <vibration²>.

    Analog Devices, "Vibration rectification in MEMS accelerometers" (2017). The vibration that it lives on, of
    `amplitude` at the highest speed, is felt by the element as well (`companions`).
    """
    return m * scene.bearing(shape["amplitude"], shape["exponent"]) ** 2


@declare(CATALOGUE, "m/s²", "sample", "samples", 3.0, kind="variance", draw=between(share=(5e-4, 2e-3)))
def accelerometer_outliers(scene: Scene, y: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Each reading is hit with probability `share` by an error of standard deviation m (Tukey 1960, contamination).

    The magnitude is the size and not the share: rare large errors have any expected gain of likelihood on records
    that hold none of them.
    """
    return np.where(rng.random(len(y)) < shape["share"], m, 0.0) * rng.standard_normal(len(y))


@declare(CATALOGUE, "m", "reading", "samples", 30e-6, kind="variance", draw=between(share=(5e-4, 2e-3)))
def encoder_outliers(scene: Scene, y: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Each reading is hit with probability `share` by an error of standard deviation m (Tukey 1960)."""
    return np.where(rng.random(len(y)) < shape["share"], m, 0.0) * rng.standard_normal(len(y))


@declare(CATALOGUE, "m/s²", "sample", "samples", 0.1, kind="variance")
def quantisation(scene: Scene, y: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A converter of step m: each reading goes to the nearest code (Bennett 1948, Bell Syst. Tech. J. 27)."""
    return m * np.rint(y / m) - y


# --- the encoder ----------------------------------------------------------------------------------------------------


@declare(
    CATALOGUE,
    "m",
    "scale",
    "encoder_position",
    2e-7,
    draw=lambda s, rng: {"period": 20e-6, "phase": rng.uniform(0, 6)},
)
def encoder_cyclic(scene: Scene, p: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Interpolation error of amplitude m that repeats with the signal period (Heydemann 1981, Appl. Opt. 20)."""
    w = 2 * np.pi / shape["period"]
    return m * np.sin(w * p + shape["phase"])


@declare(CATALOGUE, "m", "encoder", "velocity", 1e-6)
def encoder_backlash(scene: Scene, p: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The reading head hangs in a gap of width |m| and is dragged along; m > 0 leads by m/2, m < 0 lags by |m|/2.

    Nordin, Gutman 2002, Automatica 38, dead-band model of backlash: it remembers its side through rests.
    """
    return float(np.sign(m)) * (p - play(p, abs(m) / 2))


@declare(CATALOGUE, "m⁻¹", "scale", "encoder_position", 1e-3, draw=lambda scene, rng: {"cubic_per_m": 0.0})
def encoder_nonlinearity(scene: Scene, p: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Long-wave error of a scale stretched by its fastening: m (p² + cubic_per_m p³) (ISO 230-2, systematic error)."""
    return m * p**2 * (1 + shape["cubic_per_m"] * p)


@declare(CATALOGUE, "m", "encoder", "time", 1e-5, draw=instant)
def encoder_step(scene: Scene, p: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Counts missed at one instant shift every later reading by m (data sheet LS7366R, quadrature count error)."""
    return np.where(scene.t >= shape["instant"], m, 0.0)


# --- what a level, untouched rig never shows ------------------------------------------------------------------------


@declare(CATALOGUE, "rad", "force", "constant", 1e-3, kind="invisible")
def tilt(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Gravity along a rail that is not level, g0 sin m (inclined plane)."""
    return np.full_like(f, G0 * np.sin(m))


def _upright(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
    return {"gravity": G0}


@declare(CATALOGUE, "rad", "dynamics", "constant acceleration", 2e-3, kind="invisible", draw=_upright)
def misalignment(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The input axis leans by m towards the vertical: f cos m + g0 sin m (IEEE Std 1293-1998, misalignment δp)."""
    return f * float(np.cos(m) - 1) + shape["gravity"] * float(np.sin(m))


@declare(CATALOGUE, "1", "scale", "encoder_position", 1e-4, kind="invisible")
def encoder_scale(scene: Scene, p: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The scale is longer than it says: p grows by m p (thermal expansion of a steel scale, ISO 230-2)."""
    return m * p


@declare(CATALOGUE, "(m/s²)⁻¹", "response", "acceleration", 1e-3, kind="invisible", draw=_upright)
def cross_axis_gravity(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Kip of IEEE Std 1293-1998: force times gravity on the pendulous axis; equation (7) of Stakkeland et al. 2007."""
    return m * f * shape["gravity"]
