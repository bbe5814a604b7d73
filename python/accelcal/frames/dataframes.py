"""Results as pandas DataFrames: SI numbers, units in `attrs["units"]`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal.data.dwells import Dwells
from accelcal.data.recording import Recording
from accelcal.diagnosis.dwells import DwellDiagnosis
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import find
from accelcal.estimation.estimate import Fit
from accelcal.estimation.parameter_tracks import Track
from accelcal.experiment.detectability import Power
from accelcal.filters.choice import STATE_UNITS
from accelcal.filters.record import FilterRun
from accelcal.frames.packages import pandas
from accelcal.io.write import common_rows, common_stamps
from accelcal.model import Estimate
from accelcal.selection.improvement import History, Improvement
from accelcal.validation.comparison import Coast, Comparison
from accelcal.validation.differences import PairedComparison, verdict_of
from accelcal.validation.paired import HeldOutChange

if TYPE_CHECKING:
    from pandas import DataFrame

HALF_95 = 1.96
"""Half of a 95 % interval in standard deviations."""


def framed(rows: Mapping[str, Any], index: str, units: Mapping[str, str], **about: str) -> DataFrame:
    """A frame of columns, one of which is the index, with units and other attributes."""
    frame = pandas().DataFrame(dict(rows)).set_index(index)
    frame.attrs = {"units": {key: unit for key, unit in units.items() if key in rows}, **about}
    return frame


def label_of(fit: Fit, e: Estimate) -> str:
    """Name of an estimate, with the number of its run where every run has one."""
    return e.name if e.run is None else f"{e.name}[{e.run}]"


def of_recording(recording: Recording) -> DataFrame:
    """Channels on common stamps, NaN where one was not sampled."""
    rows, units = {"t": common_stamps(recording)}, {"t": "s"}
    for channel, values, missing in common_rows(recording):
        rows[channel.name] = np.where(missing, np.nan, values)
        units[channel.name] = channel.unit
    return framed(rows, "t", units, name=recording.name)


def of_dwells(dwells: Dwells) -> DataFrame:
    """One row for each dwell."""
    columns = {key: getattr(dwells, key) for key in ("angle", "mean", "std", "duration", "samples", "group")}
    if dwells.temperature is not None:
        columns["temperature"] = dwells.temperature
    units = {"angle": "rad", "mean": "m/s²", "std": "m/s²", "duration": "s", "temperature": "degC"}
    return framed({"dwell": np.arange(len(dwells)), **columns}, "dwell", units, name=dwells.name)


def of_fit(fit: Fit) -> DataFrame:
    """One row for each parameter: value, standard uncertainty, 95 % interval, unit, and whether it was held."""
    every = (*fit.estimates, *fit.shapes)
    half = [fit.expanded(e, HALF_95) if e.std > 0.0 else math.nan for e in every]
    return framed(
        {
            "parameter": [label_of(fit, e) for e in every],
            "value": [e.value for e in every],
            "std": [e.std for e in every],
            "low": [e.value - h for e, h in zip(every, half, strict=True)],
            "high": [e.value + h for e, h in zip(every, half, strict=True)],
            "unit": [e.unit for e in every],
            "symbol": [e.symbol for e in every],
            "owner": [e.owner for e in every],
            "held": [e.std <= 0.0 for e in every],
        },
        "parameter",
        {},
        name=", ".join(name for name, _ in fit.sources),
    )


def of_correlations(fit: Fit) -> DataFrame:
    """Correlations of the free parameters, names on both sides."""
    std = np.sqrt(np.diag(fit.covariance))
    names = [label_of(fit, e) for e in fit.free]
    return pandas().DataFrame(fit.covariance / np.outer(std, std), index=names, columns=names)


def of_comparison(seen: Comparison) -> DataFrame:
    """One row for each horizon: unaided drift with the bias re-estimated, with all from the fit, and noise floor, m."""
    columns = {
        "drift": seen.coast_rms,
        "drift_frozen": seen.coast_frozen_rms,
        "noise_floor": seen.drift_floors,
    }
    rows: dict[str, Any] = {"horizon": list(seen.coast_rms)}
    rows |= {key: numbers_of([of[h] for h in seen.coast_rms]) for key, of in columns.items()}
    rows["start_points"] = [seen.coast_starts[h] for h in seen.coast_rms]
    return framed(rows, "horizon", {"horizon": "s", **dict.fromkeys(columns, "m")}, name=seen.recording)


def of_regions(seen: Comparison) -> DataFrame:
    """One row for the worst region of each variable, worst first."""
    rows = [
        {**asdict(region), **dict(zip(("start", "end"), region.stretch or (math.nan, math.nan), strict=True))}
        for region in seen.worst_regions
    ]
    return listed(rows, ("variable", *REGION), "variable", name=seen.recording, worst=seen.worst)


REGION = ("unit", "low", "high", "excess", "excess_unit", "sigma", "share", "p", "start", "end")


def of_coast(coast: Coast) -> DataFrame:
    """One row for each reading after the start: predicted positions and their floor, m."""
    rows = {"t": coast.t, "frozen": coast.frozen, "rezeroed": coast.rezeroed, "floor": coast.floor}
    return framed(rows, "t", {"t": "s", "frozen": "m", "rezeroed": "m", "floor": "m"})


def of_diagnosis(found: Diagnosis) -> DataFrame:
    """One row for each coefficient of each candidate, the most significant candidate first."""
    rows = [
        {
            "effect": c.effect,
            "part": part,
            "estimate": estimate,
            "std": std,
            "unit": c.unit,
            "sigma": c.snr,
            "p_value": c.p_value,
            "largest": c.largest,
            "largest_unit": "m" if find(c.effect).port == "position" else "m/s²",
            "confounded_with": ", ".join(name for name in c.members if name != c.effect),
            "named": c.effect in found.effects,
        }
        for c in found.scan.candidates
        for part, (estimate, std) in enumerate(zip(c.estimate, c.std, strict=True))
    ]
    return listed(rows, DIAGNOSIS, "effect", verdict=found.verdict, sentence=found.sentence)


DIAGNOSIS = (
    "effect",
    "part",
    "estimate",
    "std",
    "unit",
    "sigma",
    "p_value",
    "largest",
    "largest_unit",
    "confounded_with",
    "named",
)


def of_dwell_diagnosis(found: DwellDiagnosis) -> DataFrame:
    """One row for each candidate on dwells."""
    keys = ("effect", "estimate", "std", "unit", "sigma", "p_value")
    rows = [{key: getattr(c, key) for key in keys} for c in found.candidates]
    return listed(rows, keys, "effect", verdict=found.verdict, sentence=found.sentence)


def of_power(found: Power) -> DataFrame:
    """One row for each part of each effect: smallest size that is detected with 95 % probability."""
    rows = [
        {
            "effect": each.effect,
            "part": part,
            "smallest": size,
            "unit": each.unit,
            "largest": each.largest,
            "largest_unit": each.largest_unit,
            "confounded_with": ", ".join(each.members[1:]),
        }
        for each in found.detectabilities
        for part, size in enumerate(each.smallest)
    ]
    keys = ("effect", "part", "smallest", "unit", "largest", "largest_unit", "confounded_with")
    return listed(rows, keys, "effect", name=found.name)


def of_history(found: History) -> DataFrame:
    """One row for each model: its errors on held-out data, m."""
    return of_steps(found.names, found.steps)


def of_improvement(found: Improvement) -> DataFrame:
    """One row for each step: its errors on held-out data, m."""
    names = [" + ".join(("base", *step.effects)) for step in found.steps]
    return of_steps(names, [step.heldout for step in found.steps])


def of_steps(names: Sequence[str], steps: Sequence[Comparison]) -> DataFrame:
    """Several models on one recording."""
    rows: dict[str, Any] = {"model": list(names)}
    for h in steps[0].coast_rms:
        rows[f"drift_{h:g}s"] = numbers_of([seen.coast_rms[h] for seen in steps])
        rows[f"noise_floor_{h:g}s"] = numbers_of([seen.drift_floors[h] for seen in steps])
    rows["simulation"] = [seen.simulated_rms for seen in steps]
    rows["one_step"] = [seen.one_step_rms for seen in steps]
    return framed(rows, "model", {key: "m" for key in rows if key != "model"}, name=steps[0].recording)


def of_paired(found: PairedComparison) -> DataFrame:
    """One row for each model but the first and each recording, and one for all recordings (recording is empty)."""
    rows = [
        {"model": one.name, "recording": name, "verdict": verdict_of(change), **_change(change)}
        for one in found.differences
        for name, change in (*zip(found.recordings, one.recordings, strict=True), ("", one.pooled))
    ]
    return listed(rows, ("model", *PAIRED), "model", reference=found.names[0])


PAIRED = ("recording", "verdict", "measure", "before", "after", "percent", "low", "high", "stretches")


def _change(change: HeldOutChange | None) -> dict[str, Any]:
    """Errors of two models, m, and the change in percent with its 95 % interval."""
    if change is None:
        return {}
    low, high = change.percent_interval
    keys = ("measure", "before", "after", "percent", "stretches")
    return {**{key: getattr(change, key) for key in keys}, "low": low, "high": high}


def of_track(track: Track) -> DataFrame:
    """One row for each instant: every parameter, and its standard uncertainty in a column NAME_std."""
    rows: dict[str, Any] = {"t": track.t}
    units = {"t": "s"}
    for k, (name, unit) in enumerate(zip(track.names, track.units, strict=True)):
        rows |= {name: track.values[:, k], f"{name}_std": track.std[:, k]}
        units |= {name: unit, f"{name}_std": unit}
    return framed(rows, "t", units)


def of_filter_run(run: FilterRun) -> DataFrame:
    """One row for each event: every state and its standard uncertainty, innovation and its standard deviation."""
    rows: dict[str, Any] = {"t": run.times, "from_position": run.from_position}
    for k, name in enumerate(run.names):
        rows |= {name: run.states[:, k], f"{name}_std": np.sqrt(run.variances[:, k])}
    rows |= {"innovation": run.innovations, "innovation_std": np.sqrt(run.innovation_variances)}
    units = {"t": "s", **STATE_UNITS, **{f"{name}_std": unit for name, unit in STATE_UNITS.items()}}
    return framed(rows, "t", units)


def listed(rows: Sequence[Mapping[str, Any]], keys: Sequence[str], index: str, **about: str) -> DataFrame:
    """A frame of rows, with all its columns even where there is no row."""
    frame = pandas().DataFrame(list(rows), columns=list(keys)).set_index(index)
    frame.attrs = about
    return frame


def numbers_of(values: Sequence[float | None]) -> list[float]:
    """Numbers with NaN where there is none."""
    return [math.nan if value is None else value for value in values]
