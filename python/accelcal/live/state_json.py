"""A moment of a live view as JSON, schema `accelcal/live/1`."""

from __future__ import annotations

import math
from typing import Any, Literal

from accelcal.live.monitor import Alarm
from accelcal.live.session import LiveState
from accelcal.serialization.model_file import estimate_to_dict

SCHEMA = "accelcal/live/1"


def state_to_dict(
    state: LiveState,
    source: str,
    event: Literal["state", "alarm", "end"] = "state",
    *,
    alarm: Alarm | None = None,
    ended: str | None = None,
) -> dict[str, Any]:
    """What one line says.

    Parameters
    ----------
    source : name of the source.
    alarm : what an alarm is about.
    ended : why the source ended.
    """
    innovation, nis, bias = state.innovation, state.nis, state.regressor_bias
    return {
        "schema": SCHEMA,
        "event": event,
        "source": source,
        "t_s": state.t,
        "parameters": [estimate_to_dict(e) for e in state.estimates],
        "regressor_bias": None
        if bias is None
        else {"value": bias.value, "sigma": bias.sigma, "sentence": bias.sentence or None},
        "innovation": None
        if innovation is None
        else {"t_s": innovation.t, "e_m": innovation.e, "std_m": math.sqrt(innovation.variance)},
        "nis": None
        if nis is None
        else {"value": nis.value, "low": nis.low, "high": nis.high, "readings": nis.readings},
        "holds": state.holds,
        "blocks": state.blocks,
        "alarms": state.alarms,
        "alarm": None if alarm is None else _alarm(alarm),
        "lines": {
            "used": state.used,
            "broken": state.broken,
            "out_of_order": state.out_of_order,
            "missing": state.missing,
        },
        "dropped_bytes": state.dropped_bytes,
        "outputs": state.outputs,
        "readings": state.readings,
        "untested": state.untested,
        "refused": state.refused,
        "recorded_rows": state.recorded,
        "ended": ended,
    }


def _alarm(alarm: Alarm) -> dict[str, Any]:
    return {
        "t_s": alarm.t,
        "kind": alarm.kind,
        "value": alarm.value,
        "low": alarm.low,
        "high": alarm.high,
        "readings": alarm.readings,
        "since_s": alarm.since,
        "sentence": alarm.sentence,
    }
