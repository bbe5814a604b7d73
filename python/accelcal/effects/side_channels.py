"""Every recorded side channel is a candidate by itself, and times the acceleration."""

from __future__ import annotations

from collections.abc import Iterable

from accelcal.data.orientation import ANGULAR_ACCELERATION
from accelcal.effects.registry import CATALOGUE, Effect, Search, Traits, enter

KNOWN = ("temperature", "a_y", "a_z")
"""Channels whose named effects include the channel by itself and times the acceleration."""


def side_channel(name: str, unit: str = "") -> Effect:
    """The effect "the output follows the channel `name`", entered into the catalogue at the first call.

    It has the name of the channel; `_channel` is appended where a physical effect already has that name.

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
    own = free_name(name, name)
    if own not in CATALOGUE:
        enter(
            {
                own: {
                    "function": lambda s: s.side[name],
                    "card": f"""The output follows the recorded channel {name!r}.

    Equation: e = c {name}.
    Looks like: a residual proportional to the channel.
    Easily confused with: any effect that changes together with the channel on this record.
    Separate by: changing the channel on purpose while everything else stays.
    """,
                    "unit": "m/s²" if unit in ("", "1") else f"m/s²/({unit})" if "/" in unit else f"m/s²/{unit}",
                    "owner": "rig",
                    "symbol": f"c({name})",
                    "scale": 1e-3,
                    "source": "0.1 mg per unit of the channel",
                    "needs": (name,),
                    "traits": Traits(follows=name),
                    "search": Search(includes=("bias",)),
                }
            }
        )
    return CATALOGUE[own]


def side_channel_scale(name: str, unit: str = "") -> Effect:
    """The effect "the scale factor follows the channel `name`", as `side_channel`; `_scale` follows the name.

    Examples
    --------
    >>> from accelcal.effects.side_channels import side_channel_scale
    >>> side_channel_scale("supply", "V").unit
    'V⁻¹'
    """
    own = free_name(f"{name}_scale", name)
    if own not in CATALOGUE:
        enter(
            {
                own: {
                    "function": lambda s: s.a * s.side[name],
                    "card": f"""The scale factor follows the recorded channel {name!r}.

    Equation: e = c {name} a.
    Looks like: a residual proportional to acceleration, its size following the channel.
    Easily confused with: scale_drift, temperature_scale where the channel changes with time or temperature.
    Separate by: changing the channel on purpose while the motion stays.
    """,
                    "unit": "1" if unit in ("", "1") else f"({unit})⁻¹" if "/" in unit else f"{unit}⁻¹",
                    "owner": "sensor",
                    "symbol": f"k({name})",
                    "scale": 1e-3,
                    "source": "0.1 % per unit of the channel",
                    "needs": (name,),
                    "traits": Traits(follows=name),
                    "search": Search(includes=("scale_factor",)),
                }
            }
        )
    return CATALOGUE[own]


def side_channels(units: Iterable[tuple[str, str]]) -> tuple[Effect, ...]:
    """Effects of all channels (name, unit) that have no named physical effect: added, and times the acceleration."""
    free = [(name, unit) for name, unit in units if name not in KNOWN]
    return tuple(
        make(name, unit)
        for name, unit in free
        for make in (side_channel, side_channel_scale)
        if make is side_channel_scale or name != ANGULAR_ACCELERATION  # by itself it is angular_acceleration
    )


def follows_output(effect: Effect) -> bool:
    """Whether an effect of a channel is added to the output, and not times the acceleration."""
    return effect.search.includes == ("bias",)


def free_name(wanted: str, channel: str) -> str:
    """A name in the catalogue for an effect of a channel: the wanted one, unless a physical effect has it."""
    known = CATALOGUE.get(wanted)
    return wanted if known is None or known.needs == (channel,) else f"{wanted}_channel"
