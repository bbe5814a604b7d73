"""Every recorded side channel is a candidate by itself."""

from __future__ import annotations

from collections.abc import Iterable

from accelcal.data.arrays import Array
from accelcal.effects.registry import CATALOGUE, Effect, Search, Traits, effect
from accelcal.signals.signals import Signals

KNOWN = ("temperature", "a_y")
"""Channels whose effects have names of their own."""


def side_channel(name: str, unit: str = "") -> Effect:
    """The effect "the output follows the channel `name`", entered into the catalogue when it is first asked for.

    It bears the name of the channel; `_channel` is appended where a physical effect already has that name.

    Parameters
    ----------
    name : the recorded channel.
    unit : its SI unit, for the unit of the coefficient.

    Examples
    --------
    >>> from accelcal.effects import side_channel
    >>> side_channel("supply", "V").unit
    'm/s²/V'
    """
    taken = CATALOGUE.get(name)
    if taken is not None and taken.needs != (name,):
        name, channel = f"{name}_channel", name
    else:
        channel = name
    if name not in CATALOGUE:
        _enter(name, channel, unit)
    return CATALOGUE[name]


def side_channels(units: Iterable[tuple[str, str]]) -> tuple[Effect, ...]:
    """Candidates of all channels (name, unit) that no effect of the catalogue is about."""
    return tuple(side_channel(name, unit) for name, unit in units if name not in KNOWN)


def _enter(name: str, channel: str, unit: str) -> None:
    def follow(s: Signals) -> Array:
        return s.side[channel]

    follow.__doc__ = f"""The output follows the recorded channel {channel!r}.

    Equation: e = c {channel}.
    Looks like: a residual proportional to the channel.
    Easily confused with: any effect that changes together with the channel on this record.
    Separate by: changing the channel on purpose while everything else stays.
    """
    effect(
        name,
        unit="m/s²" if unit in ("", "1") else f"m/s²/({unit})" if "/" in unit else f"m/s²/{unit}",
        owner="rig",
        symbol=f"c({channel})",
        scale=1e-3,
        source="0.1 mg per unit of the channel",
        needs=(channel,),
        traits=Traits(follows=channel),
        search=Search(includes=("bias",)),
    )(follow)
