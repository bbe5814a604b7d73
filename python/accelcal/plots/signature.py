"""The figure of an effect in the catalogue: its contribution on a known motion, over time and against its variable."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from accelcal.data import ACROSS, ANGULAR_ACCELERATION, LEVELS, LEVERS, OF_ARM, RATES, TURNED, Array
from accelcal.effects import Effect, spelled
from accelcal.plots.figure import Axis, Figure, Line, Panel, Role
from accelcal.results import words as formatting
from accelcal.signals.signals import Signals
from accelcal.simulation.motion import motion
from accelcal.simulation.sensor import ADXL105_RIG

HEIGHT = 150.0
"""px"""
SECONDS, RATE = 30.0, 400.0
"""Length (s) and samples per second of the motion on every card."""
WARMING = 4.0, 12.0
"""Rise (K) and time constant (s) of the temperature on every card."""
DRAUGHT = 1.0, 0.11
"""Amplitude (K) and frequency (Hz) of what is added to it, so that temperature is not merely a function of time."""
SEED = 11
"""Of the motion, and of random effects."""
FOLLOWS = 0.95
"""Share of an effect that must be a function of a variable for it to be drawn against it, 0 to 1."""
LOOPS = 0.998
"""Below this share the points are joined in order of time, which shows a loop."""
PERIODS = 3.0
"""Of what is periodic."""
VARIABLES: Mapping[str, tuple[str, Callable[[Signals], Array]]] = {
    "velocity": ("m/s", lambda s: s.v),
    "acceleration": ("m/s²", lambda s: s.a),
    "position": ("m", lambda s: s.p),
    "jerk": ("m/s³", lambda s: s.jerk),
    "temperature": ("K", lambda s: s.temperature),
    "a_y": ("m/s²", lambda s: s.side["a_y"]),
    "a_z": ("m/s²", lambda s: s.side["a_z"]),
}
"""Variables to draw an effect against, with units and values (n,); the first that fits is used."""
AXIS_WORDS = {"a_y": "transverse acceleration", "a_z": "acceleration along the pendulous axis"}


def signature(effect: Effect) -> Figure:
    """Draw an effect of typical size on the motion of the cards.

    Parameters
    ----------
    effect : of the catalogue, or a user's own that needs no channel but temperature and a_y.

    Raises
    ------
    KeyError
        If the effect needs another side channel.
    """
    s = card_motion()
    shape = typical_shape(effect, s)
    curves = contributions(effect, s, shape)
    right = dependence(effect, s, shape, curves)
    factor, unit = formatting.prefixed("m" if at_encoder(effect) else "m/s²", *curves.values())
    size = Axis("standard deviation" if effect.port == "noise" else "contribution", unit)
    largest = max(float(np.max(np.abs(y))) for y in curves.values()) * factor
    scaled = s.a * (largest / float(np.max(np.abs(s.a))))
    roles: tuple[Role, ...] = ("residual", "other", "floor")
    drawn = [(role, name or spelled(effect.name)) for role, name in zip(roles, curves, strict=False)]
    over_time = [Line(s.t, y * factor, name, role) for (role, name), y in zip(drawn, curves.values(), strict=True)]
    time = Axis("time", "s", range=(0.0, PERIODS / shape["frequency"]) if "frequency" in shape else None)
    motion_line = Line(s.t, scaled, "acceleration, scaled", "grid")
    panels = [Panel((motion_line, *over_time), time, size, height=HEIGHT)]
    if right is not None:
        variable, x, functions = right
        scale, x_unit = formatting.prefixed(VARIABLES[variable][0], x)
        lines = [
            Line(x * scale, y * factor, name, role) for (role, name), y in zip(drawn, functions.values(), strict=True)
        ]
        panels.append(Panel(tuple(lines), Axis(AXIS_WORDS.get(variable, variable), x_unit), size, height=HEIGHT))
    return Figure(tuple(panels), columns=2)


def caption(effect: Effect) -> str:
    """Caption of the figure, in a sentence."""
    size = f"{effect.prior.typical:g} {effect.unit}".removesuffix(" 1")
    drawn = "one realisation" if effect.family or effect.port == "process" else "contribution"
    return f"{effect.name.replace('_', ' ')}: {drawn} to a motion of {SECONDS:g} s at its typical size, {size}"


@cache
def card_motion() -> Signals:
    """The motion of the cards: moves and bursts with rests, while the sensor warms up and shakes a little sideways."""
    t = np.arange(int(SECONDS * RATE)) / RATE
    p, v, a, jerk = motion("interleaved", SECONDS, np.random.default_rng(SEED), a_rms=3.0).derivatives(t)
    (rise, tau), (swing, slow) = WARMING, DRAUGHT
    temperature = rise * (1.0 - np.exp(-t / tau)) + swing * np.sin(2.0 * np.pi * slow * t)
    side = {"temperature": temperature, "a_y": 0.2 * np.sin(2.0 * np.pi * 0.4 * t)}
    side["a_z"] = 0.2 * np.sin(2.0 * np.pi * 0.55 * t)
    turning = (*TURNED, *LEVERS, *RATES, ANGULAR_ACCELERATION, *OF_ARM, *ACROSS, *LEVELS)
    swinging = {name: 0.05 * np.sin(2.0 * np.pi * (0.3 + 0.1 * n) * t) for n, name in enumerate(turning)}
    return Signals(t=t, p=p, v=v, a=a, jerk=jerk, scale=1.0, rig=ADXL105_RIG, cutoff=0.2 * RATE, side=side | swinging)


def at_encoder(effect: Effect) -> bool:
    """Whether an effect adds to the reading and not to the output."""
    return effect.port == "position" or (effect.port == "noise" and effect.owner == "encoder")


def typical_shape(effect: Effect, s: Signals) -> dict[str, float]:
    """Shape parameters in the middle of their trials."""
    return {name: float(declared.grid(s)[declared.trials // 2]) for name, declared in effect.shapes.items()}


def contributions(effect: Effect, s: Signals, shape: Mapping[str, float]) -> dict[str, Array]:
    """Curves of one effect at its typical size, by name of the column; (n,) each, m/s² or m.

    Variances are drawn as standard deviations; of a random state or a nonparametric curve, one realisation.
    """
    y = effect.column(s, **shape)
    if effect.port == "noise":
        return {"": np.sqrt(effect.prior.typical * y)}
    if effect.width == 1:
        return {"": effect.prior.typical * y}
    if effect.family or effect.port == "process":
        return {"": effect.prior.typical * (y @ np.random.default_rng(SEED).standard_normal(effect.width))}
    sizes = np.max(np.abs(y), axis=0)
    return {
        name: effect.prior.typical * column * (sizes[0] / size)
        for name, column, size in zip(effect.parts, y.T, sizes, strict=True)
    }


Dependence = tuple[str, Array, Mapping[str, Array]]
"""A variable, its values (m,) SI, and the curves of an effect as a function of it."""


def dependence(
    effect: Effect, s: Signals, shape: Mapping[str, float], curves: Mapping[str, Array]
) -> Dependence | None:
    """An effect against the variable that it is a function of; None where there is none, or where it is constant.

    An effect that is periodic in position is drawn over a few periods of a slow traverse.
    """
    if "period" in shape:
        slow = traverse(PERIODS * shape["period"])
        return "position", slow.p, contributions(effect, slow, shape)
    by_name = {name: of(s) for name, (_, of) in VARIABLES.items()}
    variable = next(
        (n for n, x in by_name.items() if all(explained_share(x, y) > FOLLOWS for y in curves.values())), None
    )
    if variable is None:
        return None
    x = by_name[variable]
    loops = any(explained_share(x, y) < LOOPS for y in curves.values())
    order = np.arange(len(x)) if loops else np.argsort(x, kind="stable")
    return variable, x[order], {name: y[order] for name, y in curves.items()}


def traverse(length: float) -> Signals:
    """A slow motion at constant speed over `length`, m."""
    t = np.arange(600) / 100.0
    still = np.zeros_like(t)
    return replace(card_motion(), t=t, p=length * t / t[-1], v=still + length / t[-1], a=still, jerk=still)


def explained_share(x: Array, y: Array) -> float:
    """Share of `y` that is a function of `x`: 1 when neighbours in `x` agree, 0 when they differ as any two do.

    Half the mean square of successive differences over the variance (von Neumann 1941), taken from 1.
    """
    scatter = float(np.var(y))
    if scatter <= 1e-12 * float(np.mean(y**2)):
        return 0.0
    return 1.0 - 0.5 * float(np.mean(np.diff(y[np.argsort(x, kind="stable")]) ** 2)) / scatter
