"""The model file: a fit as JSON, out and in again, with where it came from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from accelcal import _core
from accelcal._support.arguments import checked
from accelcal._support.listing import listing
from accelcal.calibration.electrical import electrical
from accelcal.data.arrays import Array
from accelcal.data.channel_filter import ChannelFilter
from accelcal.data.rig import LowPass, Rig, Sensor, Uncertainty
from accelcal.data.run_labels import RunLabels
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
from accelcal.serialization.consistency import require_consistent
from accelcal.serialization.errors import ModelFileError
from accelcal.serialization.json_text import AGAIN, dumps, plain, read_json
from accelcal.serialization.migrations import MODEL_SCHEMA, migrated
from accelcal.serialization.noise_effects import noise_effect_from_dict, noise_effect_to_dict
from accelcal.signals.signals import Origins
from accelcal.validation.comparison import Evaluation, NoiseFloor, Region
from accelcal.validation.stretches import headline_horizon

COMPARE_SCHEMA = "accelcal/compare/1"

__all__ = [
    "MODEL_SCHEMA",
    "ModelFileError",
    "comparison_to_dict",
    "dumps",
    "estimate_to_dict",
    "from_dict",
    "load",
    "save",
    "to_dict",
]


def to_dict(fit: Fit, *, rig: Rig | None = None, seed: int | None = None) -> dict[str, Any]:
    """Return a fit as the content of a model file.

    Parameters
    ----------
    fit : what to write.
    rig : rig of the (first) recording; by default that of the recordings held by `fit`.
    seed : random seed that took part, if any.
    """
    rig = rig if rig is not None else fit.rig
    content = {
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
                "labels": asdict(run.labels),
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
    return dict(plain(content))


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


@checked
def save(fit: Fit, path: str | Path, *, seed: int | None = None) -> None:
    """Write a model file, whole or not at all.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> made = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(made.recording)
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "m.json")
    >>> fit.save(path)
    >>> ac.load_model(path)["bias"] == fit["bias"]
    True
    """
    atomic_write(path, dumps(to_dict(fit, seed=seed)))


@checked
def load(path: str | Path) -> Fit:
    """Read a model file.

    Raises
    ------
    ModelFileError
        If the file is missing, is no strict JSON, was written by a newer version, or holds a leaf or a combination of
        leaves that no fit has. The text names file and leaf.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> made = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(made.recording)
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "m.json")
    >>> fit.save(path)
    >>> ac.load_model(path).model.added
    ()
    """
    path = Path(path)
    content = read_json(path)
    try:
        return from_dict(content)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from None


def from_dict(content: Any) -> Fit:
    """Return the fit that the content of a model file holds; the recordings themselves are not in it.

    Raises
    ------
    ModelFileError
        If it does not follow the schema, or contradicts itself. The text names the path to the leaf.
    """
    from accelcal.serialization.schema.check import require  # pydantic is imported by what reads a model alone
    from accelcal.serialization.schema.model import ModelFile

    content, known = migrated(content), dict(CATALOGUE)
    try:
        require(ModelFile, content)
        require_known(content["model"])
        fit = fit_of(content)
        require_consistent(fit, content)
    except ModelFileError as error:
        for name in set(CATALOGUE) - set(known):  # side channels of a file that is refused
            del CATALOGUE[name]
        raise ModelFileError(f"{error}. The model file is damaged or incomplete: {AGAIN}") from None
    return fit


def fit_of(content: Mapping[str, Any]) -> Fit:
    """The fit of a content that follows the schema.

    Raises
    ------
    ModelFileError
        If the parts of the model do not fit together.
    """
    where = "model"
    try:
        model = model_from_dict(content["model"])
        where = "rig"
        rig = rig_from_dict(content["rig"])
        where = "noise"
        noises = [_noise_from_dict(noise) for noise in content["noise"]]
    except ValueError as error:
        raise ModelFileError(f"{where}: {error}") from None
    require_coefficients(model, content["parameters"])
    return Fit(
        model=model,
        estimates=tuple(estimate_from_dict(p) for p in content["parameters"]),
        shapes=tuple(estimate_from_dict(p) for p in content["shapes"]),
        covariance=matrix_from_list(content["covariance"]["matrix"]),
        runs=tuple(
            RunFit(
                name=data["file"],
                digest=data["sha256"],
                start=data["used_s"][0],
                end=data["used_s"][1],
                readings=data["readings"],
                samples=data["samples"],
                noise=noise,
                log_likelihood=data["log_likelihood"],
                nis=data["nis"],
                session=data["session_sha256"],
                labels=RunLabels(**data.get("labels", {})),
            )
            for data, noise in zip(content["data"], noises, strict=False)
        ),
        origins=Origins(**content["origins"]),
        rig=rig,
        method=content["method"],
        validity={key: (float(low), float(high)) for key, (low, high) in content["validity"].items()},
        remarks=tuple(content["remarks"]),
        spreads=tuple(spread_from_dict(spread) for spread in content["run_to_run"]),
        noise_effects=tuple(noise_effect_from_dict(one) for one in content["noise_effects"]),
        tilt=float(content["tilt_deg"]),
        dwells=dwells_from_dict(content["dwells"]) if content["dwells"] else None,
    )


def model_from_dict(content: Mapping[str, Any]) -> Model:
    """Effects and free coefficients of a model file.

    Raises
    ------
    ValueError
        If an effect is not known, or one that is held or has a prior is not in the model.
    """
    return Model(
        tuple(content["effects"]),
        dict(content["fixed"]),
        {name: Prior(**prior) for name, prior in content["priors"].items()},
        {name: dict(shape) for name, shape in content["shapes"].items()},
        tuple(content["per_run"]),
    )


def rig_from_dict(content: Mapping[str, Any]) -> Rig:
    """The rig of a model file.

    Raises
    ------
    ValueError
        If a declared filter is none.
    """
    return Rig(
        **{
            **content,
            "sensor": Sensor(**content["sensor"]),
            "lowpass": LowPass(**content["lowpass"]) if content["lowpass"] else None,
            "output_filters": tuple(channel_filter_from_dict(f) for f in content["output_filters"]),
            "position_filters": tuple(channel_filter_from_dict(f) for f in content["position_filters"]),
            "uncertainty": Uncertainty(**content["uncertainty"]),
            "assumptions": tuple(content["assumptions"]),
        }
    )


def matrix_from_list(rows: Sequence[Sequence[float]]) -> Array:
    """A square matrix.

    Raises
    ------
    ModelFileError
        If a row has another length than there are rows.
    """
    for i, row in enumerate(rows):
        if len(row) != len(rows):
            raise ModelFileError(f"covariance.matrix[{i}]: found {len(row)} numbers, expected {len(rows)}: one a row")
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(rows))


def require_coefficients(model: Model, parameters: Sequence[Mapping[str, Any]]) -> None:
    """Compare the names of the parameters with the coefficients of the model.

    Raises
    ------
    ModelFileError
        If one is missing or foreign.
    """
    stored, known = {p["name"] for p in parameters}, {term.name for term in model.terms}
    if stored < known and all(name.endswith(".mean") for name in known - stored):
        raise ModelFileError(
            "an earlier version fitted this model: its Gauss-Markov process had no mean; fit it again to its recording"
        )
    if stored != known:
        raise ModelFileError(
            f"parameters: its coefficients are not those of its effects: {', '.join(sorted(stored ^ known))} on one "
            "side only"
        )


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


def comparison_to_dict(comparison: Evaluation) -> dict[str, Any]:
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
        "noise_floor": noise_floor_to_dict(comparison.noise_floor),
        "headline_horizon_s": headline_horizon(comparison),
        "coast_starts": {f"{horizon:g}": count for horizon, count in comparison.coast_starts.items()},
        "setup_bias_m_per_s2": {"value": comparison.setup_bias[0], "std": comparison.setup_bias[1]},
        "accel_rms_m_per_s2": comparison.accel_rms,
        "band_hz": comparison.band,
        "fit_percent": comparison.fit_percent,
        "worst": comparison.worst,
        "where_it_fails": [region_to_dict(each) for each in comparison.worst_regions],
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
        "left_out": list(comparison.left_out),
    }


def region_to_dict(region: Region) -> dict[str, Any]:
    """One row of where a model fails; `p` is adjusted for the number of regions."""
    content = asdict(region)
    stretch = content.pop("stretch")
    return {**content, "stretch_s": None if stretch is None else list(stretch)}


def region_from_dict(content: Mapping[str, Any]) -> Region:
    """The row that `region_to_dict` has written."""
    fields = dict(content)
    stretch = fields.pop("stretch_s")
    return Region(**fields, stretch=None if stretch is None else (stretch[0], stretch[1]))


def noise_floor_to_dict(floor: NoiseFloor | None) -> dict[str, Any] | None:
    """The floor under errors with its source; null where a comparison is one of several whose floor is told once."""
    if floor is None:
        return None
    return {
        "source": floor.sensor.source,
        "density_m_per_s2_rthz": floor.sensor.density,
        "density_std": floor.sensor.std,
        "declared_m_per_s2_rthz": floor.sensor.declared,
        "drift_rms_m": {f"{h:g}": None if spread is None else asdict(spread) for h, spread in floor.drift.items()},
        "simulated_rms_m": asdict(floor.simulated),
    }


def _noise_to_dict(progress: NoiseReport) -> dict[str, Any]:
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
        "q": progress.noise.q,
        "r": progress.noise.r,
        "growth": [
            {"effect": one.effect.name, "q": one.q, "r": one.r, "mean": one.mean} for one in progress.noise.growth
        ],
        "all": level_to_dict(progress.all),
        "rest": level_to_dict(progress.rest),
        "motion": level_to_dict(progress.motion),
        "declared_m_per_s2_rthz": progress.declared,
        "ratio": progress.ratio,
        "crossover_hz": progress.crossover,
        "band_hz": progress.band,
        "reference": progress.reference,
    }


def _noise_from_dict(content: Mapping[str, Any]) -> NoiseReport:
    def level_from_dict(level: Mapping[str, Any] | None) -> Level | None:
        if level is None:
            return None
        spread = [math.nan if level[key] is None else level[key] for key in ("density_std", "reading_std")]
        return Level(level["density_m_per_s2_rthz"], spread[0], level["reading_m"], spread[1], level["count"])

    whole = level_from_dict(content["all"])
    assert whole is not None  # the schema demands it
    return NoiseReport(
        noise=Noise(
            content["q"],
            content["r"],
            tuple(NoiseGrowth(find(one["effect"]), one["q"], one["r"], one["mean"]) for one in content["growth"]),
        ),
        all=whole,
        rest=level_from_dict(content["rest"]),
        motion=level_from_dict(content["motion"]),
        declared=content["declared_m_per_s2_rthz"],
        crossover=content["crossover_hz"],
        band=content["band_hz"],
        reference=content["reference"],
    )


__dir__ = listing(globals())
