"""Mechanisms: a coefficient that follows a driver, or the memory of one, found by name (derivations 7.13).

`scale_factor_follows_abs_a` is a scale factor in proportion to a first-order memory of |a|, as of a supply that sags.
A short memory is a product, a long one an integral. Members with a name of their own are rows of the tables beside
their kin: products are made by `product`, here are the effects of recorded channels.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data import ANGULAR_ACCELERATION, Array
from accelcal.effects.building_blocks import instants, is_streamed, lagged, since, slow
from accelcal.effects.registry import CATALOGUE, Effect, Mechanism, Search, Shape, Traits, enter
from accelcal.signals.signals import TINY, Signals

PATTERN = re.compile(r"(?P<carrier>[a-z]\w*?)_follows_(?P<driver>\w+)")
CARRIERS = ("bias", "scale_factor", "time_offset", "velocity")
"""Coefficients of which a search asks what they follow; a rig by itself tells no encoder's scale from the sensor's."""
STEPS = 16
"""Instants at which a step is tried before it is refined."""
STARTING, STILL = 0.1, 0.01
"""Time within which a record that begins at rest does not move, s, and the share of the top speed that is rest."""
AFTER_REST = 1e-3
"""Share of a driver's range within which its memory begins where the record begins at rest."""
RATE_SPAN = 1.0
"""Temperature rates are differences over this time to either side, s: sensors of temperature are slow and coarse."""
AMPLITUDES = "amplitudes that differ by a factor of two or more"
"""What separates a coefficient from what follows the motion, and |a| from a²."""


@dataclass(frozen=True, slots=True)
class Driver:
    """A variable that a coefficient may follow, or whose memory."""

    text: str
    """As it is written in an equation."""
    unit: str
    """Whose `power` it has."""
    of: Callable[..., Array]
    """Its values, SI, of signals and of `shapes` by keyword: (n,), or (n, m) where an effect has m columns."""
    size: float = 1.0
    """A usual range, SI."""
    at_rest: Callable[[Signals], float] | None = None
    """Its value before the record, where the sensor is at rest; None where its zero is a choice: what the record begins
    with."""
    needs: tuple[str, ...] = ()
    """Channels that it takes."""
    local: bool = True
    """Whether its value at one time depends on the signals then alone."""
    power: int = 1
    shapes: Mapping[str, Shape] = field(default_factory=dict)
    """Parameters that it has itself."""


def temperature_rate(s: Signals) -> Array:
    """Rate of the recorded temperature, (n,) K/s; on a stream over the time before alone, as its memory gives it."""
    T = s.temperature
    if is_streamed():
        return (T - lagged(T, RATE_SPAN, s.step, T[0])) / RATE_SPAN
    reach = max(1, round(RATE_SPAN / s.step))
    i = np.arange(len(T))
    low, high = np.maximum(i - reach, 0), np.minimum(i + reach, len(T) - 1)
    return (T[high] - T[low]) / np.maximum((high - low) * s.step, s.step)


DRIVERS: Mapping[str, Driver] = {
    "abs_a": Driver("|a|", "m/s²", lambda s: np.abs(s.a), at_rest=lambda s: abs(s.rest)),
    "a2": Driver("a²", "m/s²", lambda s: s.a**2, at_rest=lambda s: s.rest**2, power=2),
    "abs_v": Driver("|v|", "m/s", lambda s: np.abs(s.v), 0.1, at_rest=lambda s: 0.0),
    "v2": Driver("v²", "m/s", lambda s: s.v**2, 0.01, at_rest=lambda s: 0.0, power=2),
    "position": Driver("p", "m", lambda s: s.p, 0.1),
    "temperature": Driver("T", "K", lambda s: s.temperature, 10.0, needs=("temperature",)),
    "temperature_rate": Driver("dT/dt", "K/s", temperature_rate, 0.1, needs=("temperature",), local=False),
}
"""Drivers that every record has, and the recorded temperature, by the name in that of a mechanism."""
VELOCITY = Driver("v", "m/s", lambda s: s.v, at_rest=lambda s: 0.0)
TIME = Driver("t", "s", lambda s: s.t)
INSTANT = Driver("[t >= instant]", "1", since, shapes={"instant": Shape("s", instants, trials=STEPS)})
POWER_ON = Driver(
    "exp(-t/tau)",
    "1",
    lambda s, tau: np.exp(np.maximum(s.t, 0.0) / -tau),
    shapes={"tau": Shape("s", slow(0.04, 1.0), trials=5, spacing="log")},
)
"""Drivers whose memory no coefficient follows: that of the velocity is the position, that of time is time."""


def driver_of(name: str) -> Driver:
    """The driver of a name.

    Raises
    ------
    KeyError
        If it is none, and no effect of a recorded channel of that name is known.
    """
    if name in DRIVERS:
        return DRIVERS[name]
    carrier = "bias" if member("bias", name) else "scale_factor"  # where the output follows it under a physical name
    followed = member(carrier, name)
    if followed is None:
        raise KeyError(name)
    return channel(name, unit_of_channel(followed.unit, carrier))


def member(carrier: str, driver: str, *, memory: bool = False) -> Effect | None:
    """The effect by which a coefficient follows a driver, or the memory of one; None where none has been entered."""
    for effect in CATALOGUE.values():
        of = effect.mechanism if memory else effect.product
        if of is not None and (of.carrier, of.driver) == (carrier, driver):
            return effect
    return None


def channel_of(effect: Effect) -> str:
    """The recorded channel that an effect follows, or whose memory; empty where it follows none."""
    of = effect.mechanism or effect.product
    return of.driver if of is not None and of.driver == of.text else ""


def unit_of_channel(unit: str, carrier: str) -> str:
    """Unit of a recorded channel, from that of the effect by which a carrier follows it."""
    return (unit.removeprefix("m/s²").removeprefix("/") if carrier == "bias" else unit.removesuffix("⁻¹")).strip("()")


def channel(name: str, unit: str) -> Driver:
    """A recorded channel of a unit as a driver."""
    return Driver(name, unit or "1", lambda s: s.side[name], needs=(name,))


def named(name: str) -> Effect | None:
    """The mechanism of a name, entered into the catalogue at the first call; None where the name is none.

    Examples
    --------
    >>> named("scale_factor_follows_abs_a").unit, named("bias_follows_a2").name
    ('(m/s²)⁻¹', 'self_heating')
    """
    asked = PATTERN.fullmatch(name)
    if name in CATALOGUE or asked is None:
        return CATALOGUE.get(name)
    try:
        carrier, _ = CATALOGUE[asked["carrier"]], driver_of(asked["driver"])
    except KeyError:
        return None
    bears = carrier.port in ("output", "position") and carrier.width == 1 and carrier.traits.noise is None
    alias = member(carrier.name, asked["driver"], memory=True)
    if alias is None and bears and carrier.mechanism is None:
        enter({name: mechanism(carrier.name, asked["driver"])})
    return alias or CATALOGUE.get(name)


POWERS = {1: "⁻¹", 2: "⁻²"}
"""How an inverse power of a unit is written."""


def per(unit: str, driver: str, power: int = 1) -> str:
    """Unit of a coefficient of `unit` per unit of a driver, or its power.

    Examples
    --------
    >>> per("m/s²", "V"), per("1", "m/s²"), per("s", "K/s"), per("m/s²", "m/s²", 2), per("s", "m/s", 2)
    ('m/s²/V', '(m/s²)⁻¹', 's/(K/s)', '(m/s²)⁻¹', 's/(m/s)²')
    >>> per("m/s²", "m/s²")
    '1'
    """
    if driver in ("", "1"):
        return unit
    if unit == driver:
        return per("1", driver, power - 1) if power > 1 else "1"
    compound = f"({driver})" if "/" in driver or power > 1 else driver
    return f"{compound}{POWERS[power]}" if unit == "1" else f"{unit}/{compound}{'²' if power > 1 else ''}"


def memories(s: Signals) -> tuple[float, float]:
    """Time constants of a memory: from one sample, a product, to beyond the record, an integral, s."""
    return s.step, 3.0 * s.length


def begins_at_rest(s: Signals, driver: Driver) -> bool:
    """Whether a record begins at rest, where the value of a driver of the motion is known."""
    speed = np.abs(s.v)
    first = float(np.max(speed[: 1 + int(STARTING / max(s.step, TINY))]))
    return driver.at_rest is not None and first <= STILL * float(np.max(speed))


def memory(s: Signals, driver: Driver, tau: float, start: float = 0.0) -> Array:
    """Memory u of a driver, tau u' = h - u, (n,).

    It begins at the driver's value at rest on a stream and where the record begins so, elsewhere at the mean of the
    motion, or where a channel begins; and at `start` above that.
    """
    h, rest = driver.of(s), driver.at_rest
    if rest is None:
        return lagged(h, tau, s.step, h[0] + start)
    before = rest(s) if is_streamed() or begins_at_rest(s, driver) else float(np.mean(h))
    return lagged(h, tau, s.step, before + start)


def state_of(driver: Driver) -> Shape:
    """What a memory holds at the beginning of a record beyond what is taken for it; next to nothing after a rest."""

    def within(s: Signals) -> tuple[float, float]:
        reach = float(np.ptp(driver.of(s))) * (AFTER_REST if begins_at_rest(s, driver) else 1.0)
        return -reach, reach

    unit = driver.unit if driver.power == 1 else f"({driver.unit})²"
    return Shape(unit, within, trials=3, added=True, at_rest=0.0)


def mechanism(carrier: str, name: str) -> dict[str, Any]:
    """The effect "coefficient times memory of a driver", as a row of the catalogue."""
    changed, driver = CATALOGUE[carrier], driver_of(name)
    if "tau" in changed.shapes:
        raise AccelcalError(
            f"{carrier}_follows_{name}: {carrier} has a time constant of its own; a mechanism needs that name"
        )
    simple = member(carrier, name)
    includes = (*((simple.name,) if simple else ()), carrier)
    looks = (changed.line("Looks like") or "a residual").split(",")[0].rstrip(".")
    lasting = f"; {AMPLITUDES}" if driver.at_rest is not None else ""
    return product(carrier, driver) | {
        "function": lambda s, tau, start, **shape: changed.column(s, **shape) * memory(s, driver, tau, start),
        "card": f"""The {carrier.replace("_", " ")} follows {driver.text}, with a memory.

    Equation: e = c u times what one unit of {carrier} adds, tau u' = {driver.text} - u.
    Looks like: {looks}, of a size that follows the last tau seconds of {driver.text}.
    Easily confused with: {", ".join(includes)}; another driver that changes alike.
    Separate by: changing {driver.text} alone, in stretches longer than tau{lasting}.
    """,
        "symbol": f"{changed.symbol}({driver.text})",
        "scale": 0.1 * changed.prior.scale / driver.size,
        "source": f"a tenth of {carrier} over a usual range of the driver",
        "shapes": {**changed.shapes, "tau": Shape("s", memories, trials=7, spacing="log"), "start": state_of(driver)},
        "traits": Traits(memory=True),
        "search": Search(includes=includes),
        "product": None,
        "mechanism": Mechanism(carrier, name, driver.text),
    }


def product(carrier: str, by: str | Driver) -> dict[str, Any]:
    """The effect "coefficient times driver", without memory, as a row of the catalogue that lacks card and size.

    Parameters
    ----------
    carrier : name of the coefficient, which the effect includes where the zero of the driver is a choice.
    by : the driver, or its name in `DRIVERS`.
    """
    changed, driver = CATALOGUE[carrier], DRIVERS[by] if isinstance(by, str) else by
    name = by if isinstance(by, str) else driver.text if driver.text in driver.needs else ""

    shapes = {
        key: replace(shape, bounds=partial(instants, carried=changed.column)) if shape.bounds is instants else shape
        for key, shape in driver.shapes.items()
    }

    def times(s: Signals, **shape: float) -> Array:
        columns = driver.of(s, **{key: shape.pop(key) for key in driver.shapes}).T
        return np.asarray((columns * changed.column(s, **shape)).T)

    return {
        "function": times,
        "unit": per(changed.unit, driver.unit, driver.power),
        "port": changed.port,
        "owner": changed.owner,
        "shapes": {**changed.shapes, **shapes},
        "needs": tuple(dict.fromkeys((*changed.needs, *driver.needs))),
        "traits": Traits(memory=not driver.local),
        "search": Search(includes=() if driver.at_rest else (carrier, *changed.search.includes)),
        "product": Mechanism(carrier, name, driver.text),
    }


KNOWN = ("temperature", "a_y", "a_z")
"""Channels whose named effects include the channel by itself and times the acceleration."""
FOLLOWERS = {
    "bias": ("", "output", "rig", "c", "0.1 mg per unit of the channel", "a residual proportional to the channel"),
    "scale_factor": (
        *("_scale", "scale factor", "sensor", "k", "0.1 % per unit of the channel"),
        "a residual proportional to acceleration, its size following the channel",
    ),
}
"""Effects of a recorded channel by carrier: ending of the name, what follows it, owner, symbol, source, and looks."""


def side_channel(name: str, unit: str = "", carrier: str = "bias") -> Effect:
    """The effect "the output follows the channel `name`", entered into the catalogue at the first call.

    It has the name of the channel, with `_scale` where the scale factor follows; `_channel` is appended where a
    physical effect already has that name.

    Parameters
    ----------
    name : the recorded channel.
    unit : its SI unit, for the unit of the coefficient.
    carrier : "bias", or "scale_factor" for the effect times the acceleration.

    Examples
    --------
    >>> from accelcal.effects import side_channel
    >>> side_channel("supply", "V").unit, side_channel("supply", "V", "scale_factor").unit
    ('m/s²/V', 'V⁻¹')
    """
    ending, what, owner, symbol, source, looks = FOLLOWERS[carrier]
    entry = CATALOGUE.get(f"{name}{ending}")
    effect_name = f"{name}{ending}" if entry is None or entry.needs == (name,) else f"{name}{ending}_channel"
    if effect_name not in CATALOGUE:
        row = product(carrier, channel(name, unit)) | {
            "card": f"""The {what} follows the recorded channel {name!r}.

    Equation: e = c {name}{" a" if ending else ""}.
    Looks like: {looks}.
    Easily confused with: any effect that changes together with the channel on this record.
    Separate by: changing the channel on purpose while everything else stays.
    """,
            "owner": owner,
            "symbol": f"{symbol}({name})",
            "scale": 1e-3,
            "source": source,
        }
        enter({effect_name: row})
    return CATALOGUE[effect_name]


def side_channels(units: Iterable[tuple[str, str]]) -> tuple[Effect, ...]:
    """Effects of all channels (name, unit) that have no named physical effect: added, and times the acceleration."""
    return tuple(
        side_channel(name, unit, carrier)
        for name, unit in units
        for carrier in FOLLOWERS
        if name not in KNOWN and (carrier != "bias" or name != ANGULAR_ACCELERATION)  # that is angular_acceleration
    )


def mechanisms_of(carriers: Iterable[str], channels: Iterable[str]) -> Iterator[Effect]:
    """Mechanisms of several carriers with every driver that a record has.

    Parameters
    ----------
    carriers : names of coefficients.
    channels : names of the recorded channels.
    """
    recorded = tuple(channels)
    drivers = [name for name, driver in DRIVERS.items() if set(driver.needs) <= set(recorded)]
    for carrier in carriers:
        for driver in (*drivers, *(name for name in recorded if name not in DRIVERS)):
            effect = named(f"{carrier}_follows_{driver}")
            if effect is not None:
                yield effect
