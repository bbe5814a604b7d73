"""The model file: a fit as JSON, out and in again, with where it came from."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from accelcal import _core
from accelcal.calibration.electrical import electrical
from accelcal.data.channel_filter import ChannelFilter
from accelcal.data.rig import LowPass, Rig, Sensor, Uncertainty
from accelcal.effects import CATALOGUE, find, side_channel
from accelcal.effects.side_channels import follows_output, side_channel_scale
from accelcal.estimation.dwell_fit import DwellFit
from accelcal.estimation.estimate import Fit, tied_sum
from accelcal.estimation.noise import Level, NoiseReport
from accelcal.estimation.run_fit import RunFit
from accelcal.estimation.run_to_run import Spread
from accelcal.estimation.values import Noise, NoiseGrowth
from accelcal.io import atomic_write
from accelcal.model import Estimate, Model, Prior
from accelcal.serialization.noise_effects import noise_effect_from_dict, noise_effect_to_dict
from accelcal.signals.signals import Origins
from accelcal.validation.comparison import Comparison

MODEL_SCHEMA = "accelcal/model/1"
COMPARE_SCHEMA = "accelcal/compare/1"


class ModelFileError(ValueError):
    """A file that is not a model file. The text names it and states what was expected."""


def to_dict(fit: Fit, *, rig: Rig | None = None, seed: int | None = None) -> dict[str, Any]:
    """Return a fit as the content of a model file.

    Parameters
    ----------
    fit : what to write.
    rig : rig of the (first) recording; by default that of the recordings held by `fit`.
    seed : random seed that took part, if any.
    """
    rig = rig if rig is not None else fit.rig
    return {
        "schema": MODEL_SCHEMA,
        "version": _core.__version__,
        "method": fit.method,
        "model": {
            "effects": list(fit.model.effects),
            "fixed": dict(fit.model.fixed),
            "priors": {name: asdict(prior) for name, prior in fit.model.priors.items()},
            "shapes": {name: dict(shape) for name, shape in fit.model.shapes.items()},
            "per_run": list(fit.model.per_run),
            "own": [
                {"name": e.name, "sha256": e.digest, "source": e.text}
                for e in (find(name) for name in fit.model.effects)
                if e.text
            ],
            "side_channels": {
                e.name: {"channel": e.needs[0], "unit": e.unit, "of": "output" if follows_output(e) else "scale_factor"}
                for e in (find(name) for name in fit.model.effects)
                if e.traits.follows
            },
        },
        "parameters": [{**estimate_to_dict(e), "stands_for": tied_sum(fit, e.name)} for e in fit.estimates],
        "shapes": [estimate_to_dict(e) for e in fit.shapes],
        "run_to_run": [asdict(spread) for spread in fit.spreads],
        "noise_effects": [noise_effect_to_dict(one) for one in fit.noise_effects],
        "covariance": {
            "names": [e.name if e.run is None else f"{e.name}[{e.run}]" for e in fit.free],
            "matrix": fit.covariance.tolist(),
        },
        "electrical": electrical(fit, rig),
        "noise": [_noise_to_dict(run.noise) for run in fit.runs],
        "rig": asdict(rig),
        "data": [
            {
                "file": run.name,
                "sha256": run.digest,
                "session_sha256": run.session,
                "used_s": [run.start, run.end],
                "readings": run.readings,
                "samples": run.samples,
                "log_likelihood": run.log_likelihood,
                "nis": run.nis,
            }
            for run in fit.runs
        ],
        "dwells": None if fit.dwells is None else asdict(fit.dwells),
        "origins": asdict(fit.origins),
        "validity": {key: list(span) for key, span in fit.validity.items()},
        "remarks": list(fit.remarks),
        "tilt_deg": fit.tilt,
        "seed": seed,
    }


def estimate_to_dict(e: Estimate) -> dict[str, Any]:
    """One parameter with its standard uncertainty."""
    return {
        "name": e.name,
        "symbol": e.symbol,
        "unit": e.unit,
        "value": e.value,
        "std": e.std,
        "owner": e.owner,
        "run": e.run,
    }


def estimate_from_dict(p: Mapping[str, Any]) -> Estimate:
    """What :func:`estimate_to_dict` wrote."""
    return Estimate(p["name"], p["symbol"], p["unit"], float(p["value"]), float(p["std"]), p["owner"], p["run"])


def dumps(content: Mapping[str, Any]) -> str:
    """Return JSON text; what is not finite becomes null, since JSON has no other word for it."""
    return json.dumps(_finite(content), indent=2, ensure_ascii=False) + "\n"


def save(fit: Fit, path: str | Path, *, seed: int | None = None) -> None:
    """Write a model file, whole or not at all."""
    atomic_write(path, dumps(to_dict(fit, seed=seed)))


def load(path: str | Path) -> Fit:
    """Read a model file.

    Raises
    ------
    ModelFileError
        If the file is missing, is not JSON, or is not a model file of a version that is understood.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ModelFileError(f"{path}: no such file; make one with: accelcal fit RUN.csv -o {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ModelFileError(f"{path}: cannot be read as text ({error}); expected a model file") from None
    except json.JSONDecodeError as error:
        raise ModelFileError(
            f"{path}: line {error.lineno}, column {error.colno}: not JSON ({error.msg}); expected a model file as "
            "written by: accelcal fit RUN.csv -o MODEL.json. The model comes first, the recording second"
        ) from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != MODEL_SCHEMA:
        found = "none" if schema is None else f'"{schema}"'
        raise ModelFileError(
            f'{path}: expected a model file with the schema "{MODEL_SCHEMA}", found {found}; make one with: '
            "accelcal fit RUN.csv -o MODEL.json"
        )
    try:
        return from_dict(content)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from None
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        what = f"there is no {error}" if isinstance(error, KeyError) else str(error)
        raise ModelFileError(
            f"{path}: the model file is damaged or incomplete ({what}); take a copy that is whole, or fit again"
        ) from None


KINDS: Mapping[str, tuple[type, str]] = {
    "method": (str, "a text"),
    **dict.fromkeys(("parameters", "data", "noise", "remarks"), (list, "a list")),
    **dict.fromkeys(("model", "covariance", "rig", "origins", "validity"), (dict, "an object")),
}
"""Keys that a model file must have, with their types."""


def from_dict(content: Mapping[str, Any]) -> Fit:
    """Return the fit that a model file holds; the recordings themselves are not in it.

    Raises
    ------
    KeyError, TypeError, ValueError
        If something is missing or of the wrong kind.
    """
    for key, (kind, expected) in KINDS.items():
        if not isinstance(content[key], kind):
            raise ValueError(f"{key}: expected {expected}, found {json.dumps(content[key])[:40]}")
    model = content["model"]
    require_known(model)
    rig = dict(content["rig"])
    rig["sensor"] = Sensor(**rig["sensor"])
    rig["lowpass"] = LowPass(**rig["lowpass"]) if rig["lowpass"] else None
    for key in ("output_filters", "position_filters"):  # files of older versions have neither
        rig[key] = tuple(channel_filter_from_dict(f) for f in rig.get(key, ()))
    rig["uncertainty"] = Uncertainty(**rig["uncertainty"])
    rig["assumptions"] = tuple(rig["assumptions"])
    fit = Fit(
        model=Model(
            tuple(model["effects"]),
            dict(model["fixed"]),
            {name: Prior(**prior) for name, prior in model["priors"].items()},
            model["shapes"],
            tuple(model.get("per_run", ())),
        ),
        estimates=tuple(estimate_from_dict(p) for p in content["parameters"]),
        shapes=tuple(estimate_from_dict(p) for p in content.get("shapes", ())),
        covariance=np.array(content["covariance"]["matrix"], dtype=np.float64),
        runs=tuple(
            RunFit(
                name=data["file"],
                digest=data["sha256"],
                start=data["used_s"][0],
                end=data["used_s"][1],
                readings=data["readings"],
                samples=data["samples"],
                noise=_noise_from_dict(noise),
                log_likelihood=data["log_likelihood"],
                nis=data["nis"],
                session=data.get("session_sha256", data["sha256"]),
            )
            for data, noise in zip(content["data"], content["noise"], strict=True)
        ),
        origins=Origins(**content["origins"]),
        rig=Rig(**rig),
        method=content["method"],
        validity={key: (float(low), float(high)) for key, (low, high) in content["validity"].items()},
        remarks=tuple(content["remarks"]),
        spreads=tuple(spread_from_dict(spread) for spread in content.get("run_to_run", ())),
        noise_effects=tuple(noise_effect_from_dict(one) for one in content.get("noise_effects", ())),
        tilt=float(content.get("tilt_deg", 0.0)),
        dwells=dwells_from_dict(content["dwells"]) if content.get("dwells") else None,
    )
    stored, known = {e.name for e in fit.estimates}, {term.name for term in fit.model.terms}
    if stored < known and all(name.endswith(".mean") for name in known - stored):
        raise ModelFileError(
            "an earlier version fitted this model: its Gauss-Markov process had no mean; fit it again to its recording"
        )
    if stored != known:
        raise ValueError(
            f"its coefficients are not those of its effects: {', '.join(sorted(stored ^ known))} on one side only"
        )
    if fit.covariance.shape != (len(fit.free),) * 2:
        raise ValueError(
            f"covariance.matrix has the shape {fit.covariance.shape}, expected a row and a column for each of "
            f"{', '.join(e.name for e in fit.free)}"
        )
    return fit


def spread_from_dict(content: Mapping[str, Any]) -> Spread:
    """What a model file holds of a coefficient that differs from run to run; null stands for infinity."""
    known: dict[str, Any] = {key: math.inf if y is None else y for key, y in content.items()}
    return Spread(**{**known, "runs": tuple(known["runs"])})


def dwells_from_dict(content: Mapping[str, Any]) -> DwellFit:
    """What a model file holds of the dwells of its fit; null stands for what no dwell is left over to show."""
    each = {key: tuple(content[key]) for key in ("angle", "residual", "std", "remarks")}
    zeros = tuple((str(group), float(zero)) for group, zero in content["zeros"])
    ratio = math.nan if content["ratio"] is None else content["ratio"]
    return DwellFit(**{**content, **each, "zeros": zeros, "ratio": ratio})


def channel_filter_from_dict(content: Mapping[str, Any]) -> ChannelFilter:
    """Return a declared filter as the rig of a model file holds it."""
    return ChannelFilter(**{**content, "b": tuple(content["b"]), "a": tuple(content["a"])})


def require_known(model: Mapping[str, Any]) -> None:
    """Enter side channels that a model uses, and require the user's file where it uses effects from one.

    Raises
    ------
    ModelFileError
        If a user's effect is not loaded; the text names the missing file.
    """
    for stored in model["side_channels"].values():
        if stored.get("of", "output") == "output":
            side_channel(stored["channel"], stored["unit"].removeprefix("m/s²/").strip("()"))
        else:
            side_channel_scale(stored["channel"], stored["unit"].removesuffix("⁻¹").strip("()"))
    for own in model["own"]:
        if own["name"] not in CATALOGUE:
            raise ModelFileError(
                f"the model uses {own['name']!r} from a file of your own (SHA-256 {own['sha256'][:12]}…); name that "
                "file with --effects-file. Its source is stored in the model file under model.own"
            )
        if CATALOGUE[own["name"]].digest != own["sha256"]:
            raise ModelFileError(
                f"{own['name']!r} in the effects file is not the one that the model was fitted with: its source has "
                f"changed (SHA-256 {CATALOGUE[own['name']].digest[:12]}… instead of {own['sha256'][:12]}…). Fit again, "
                "or name the old file"
            )


def comparison_to_dict(comparison: Comparison) -> dict[str, Any]:
    """Return the numbers of a comparison; `coast_rms_m` is rezeroed, horizons the record does not allow are null."""

    def by_horizon(found: Mapping[float, float | None]) -> dict[str, float | None]:
        return {f"{horizon:g}": value for horizon, value in found.items()}

    return {
        "schema": COMPARE_SCHEMA,
        "recording": comparison.recording,
        "one_step_rms_m": comparison.one_step_rms,
        "nis": comparison.nis,
        "k_step_rms_m": {str(k): value for k, value in comparison.k_step_rms.items()},
        "simulated_rms_m": comparison.simulated_rms,
        "coast_rms_m": by_horizon(comparison.coast_rms),
        "coast_frozen_rms_m": by_horizon(comparison.coast_frozen_rms),
        "coast_floor_m": by_horizon(comparison.coast_floor),
        "coast_starts": {f"{horizon:g}": count for horizon, count in comparison.coast_starts.items()},
        "setup_bias_m_per_s2": {"value": comparison.setup_bias[0], "std": comparison.setup_bias[1]},
        "accel_rms_m_per_s2": comparison.accel_rms,
        "band_hz": comparison.band,
        "worst": comparison.worst,
        "bins": [
            {
                "variable": b.variable,
                "unit": b.unit,
                "edges": b.edges.tolist(),
                "mean": b.mean.tolist(),
                "std": b.std.tolist(),
            }
            for b in comparison.bins
        ],
        "outside": [
            {
                "variable": o.variable,
                "unit": o.unit,
                "range": None if o.range is None else list(o.range),
                "readings_outside": o.count,
                "readings": o.of,
                "one_step_rms_m": {"inside": o.one_step[0], "outside": o.one_step[1]},
                "coast_rms_m": {f"{h:g}": {"inside": c[0], "outside": c[1]} for h, c in o.coast.items()},
                "coast_starts": {f"{h:g}": {"inside": n[0], "outside": n[1]} for h, n in o.starts.items()},
            }
            for o in comparison.outside
        ],
        "remarks": list(comparison.remarks),
        "not_carried": list(comparison.not_carried),
        "noise_scores": [{**asdict(score), "sentence": score.sentence} for score in comparison.noise_scores],
        "breaks": list(comparison.breaks),
    }


def _noise_to_dict(report: NoiseReport) -> dict[str, Any]:
    def level_to_dict(level: Level | None) -> dict[str, Any] | None:
        if level is None:
            return None
        return {
            "density_m_per_s2_rthz": level.density,
            "density_std": level.density_std,
            "reading_m": level.reading,
            "reading_std": level.reading_std,
            "count": level.count,
        }

    return {
        "q": report.noise.q,
        "r": report.noise.r,
        "growth": [
            {"effect": one.effect.name, "q": one.q, "r": one.r, "mean": one.mean} for one in report.noise.growth
        ],
        "all": level_to_dict(report.all),
        "rest": level_to_dict(report.rest),
        "motion": level_to_dict(report.motion),
        "declared_m_per_s2_rthz": report.declared,
        "ratio": report.ratio,
        "crossover_hz": report.crossover,
        "band_hz": report.band,
    }


def _noise_from_dict(content: Mapping[str, Any]) -> NoiseReport:
    def level_from_dict(level: Mapping[str, Any] | None) -> Level | None:
        if level is None:
            return None
        spread = [math.nan if level[key] is None else level[key] for key in ("density_std", "reading_std")]
        return Level(level["density_m_per_s2_rthz"], spread[0], level["reading_m"], spread[1], level["count"])

    whole = level_from_dict(content["all"])
    if whole is None:
        raise ValueError("noise.all is missing")
    return NoiseReport(
        noise=Noise(
            content["q"],
            content["r"],
            tuple(
                NoiseGrowth(find(one["effect"]), one["q"], one["r"], one["mean"]) for one in content.get("growth", ())
            ),
        ),
        all=whole,
        rest=level_from_dict(content["rest"]),
        motion=level_from_dict(content["motion"]),
        declared=content["declared_m_per_s2_rthz"],
        crossover=content["crossover_hz"],
        band=content["band_hz"],
    )


def _finite(content: Any) -> Any:
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return content
