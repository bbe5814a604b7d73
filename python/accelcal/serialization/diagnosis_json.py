"""What the loop found, as plain values ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import Any

from accelcal._support.listing import listing
from accelcal.data.rig import STANDARD_GRAVITY
from accelcal.diagnosis.contribution import Importance, Size
from accelcal.diagnosis.dwells import DwellDiagnosis
from accelcal.diagnosis.findings import Confounded, Finding
from accelcal.diagnosis.noise_tests.noise_test import NoiseTest
from accelcal.diagnosis.outlier_rejection import RejectedReadings
from accelcal.diagnosis.remarks import Remark
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import find
from accelcal.estimation.estimate import Fit
from accelcal.selection.improvement import Improvement
from accelcal.serialization.model_file import comparison_to_dict, estimate_to_dict, region_to_dict, to_dict
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison, ModelDifference, verdict_of
from accelcal.validation.paired import HeldOutChange, heldout_change
from accelcal.validation.ruler import Ruler

DIAGNOSIS_SCHEMA = "accelcal/diagnosis/1"
DWELLS_SCHEMA = "accelcal/diagnosis-of-dwells/1"
IMPROVE_SCHEMA = "accelcal/improve/2"
PAIRED_SCHEMA = "accelcal/compare-models/1"


def diagnosis_to_dict(found: Diagnosis) -> dict[str, Any]:
    """Content of `diagnose --json`; candidates by rank."""
    range_ = found.fit.rig.sensor.range
    return {
        "schema": DIAGNOSIS_SCHEMA,
        "suspect_data": list(found.suspect),
        "verdict": found.verdict,
        "sentence": found.sentence,
        "effects": list(found.effects),
        "largest_contributions": by_effect(found.effects, found),
        "tolerance": importance(found.importance),
        "classes": ties(found.classes),
        "remarks": remarks(found.remarks),
        "inseparable": ties(found.inseparable),
        "dropped": dropped(found.dropped),
        "breaks": list(found.breaks),
        "used": [list(span) for span in found.used],
        "candidates": [candidate(c, range_) for c in found.scan.candidates],
        "channels": [channel(test) for test in found.channels],
        "candidates_examined": found.scan.examined,
        "alpha": found.alpha,
        "detection_limits": detection_limits(found),
        "parameters": parameters(found),
        "where": where(found.where),
    }


def dwells_to_dict(found: DwellDiagnosis) -> dict[str, Any]:
    """Return a diagnosis of dwells."""
    return {
        "schema": DWELLS_SCHEMA,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "members": list(found.members),
        "candidates": [asdict(one) for one in found.candidates],
        "dwells": asdict(found.seen),
        "remarks": list(found.remarks),
    }


def detection_limits(found: Diagnosis) -> dict[str, float | None]:
    """Smallest coefficient of each effect that would have been detected, in its unit; None where it is not visible."""
    return {name: size if math.isfinite(size) else None for name, size in found.scan.detection_limits.items()}


def where(seen: Evaluation) -> dict[str, Any]:
    """Where the model fails: in words, the worst region of every variable, and tiles of excess in sigmas."""
    return {
        "worst": seen.worst,
        "regions": [region_to_dict(each) for each in seen.worst_regions],
        "tiles": [
            {"variable": b.variable, "unit": b.unit, "edges": b.edges.tolist(), "sigma": b.score.tolist()}
            for b in seen.bins
        ],
    }


def candidate(c: Candidate, range_: float | None) -> dict[str, Any]:
    """One candidate; an effect of several columns has lists."""
    single = len(c.estimate) == 1
    return {
        "effect": c.effect,
        "shape": dict(c.shape),
        "estimate": c.estimate[0] if single else list(c.estimate),
        "unit": c.unit,
        "std": c.std[0] if single else list(c.std),
        "snr": c.snr,
        "p_value": c.p_value,
        "p_raw": c.p_raw,
        "log_evidence": c.log_evidence,
        "class": list(c.members),
        "largest_contribution": sizes(Size(c.largest, find(c.effect).port == "position"), range_),
    }


def channel(test: NoiseTest) -> dict[str, Any]:
    """A significant effect that has no mean."""
    return {
        "effect": test.effect,
        "estimate": test.estimate,
        "unit": test.unit,
        "std": test.std,
        "p_raw": test.p_value,
        "sentence": test.sentence,
        "parts": dict(test.parts),
    }


def sizes(size: Size, range_: float | None) -> dict[str, float | None]:
    """A contribution to the output in m/s², mg and percent of full scale, or to the reading in m."""
    if size.at_encoder:
        return {"m_per_s2": None, "mg": None, "percent_of_full_scale": None, "m": size.value}
    return {
        "m_per_s2": size.value,
        "mg": 1e3 * size.value / STANDARD_GRAVITY,
        "percent_of_full_scale": 100.0 * size.value / range_ if range_ else None,
        "m": None,
    }


def by_effect(names: Sequence[str], found: Diagnosis) -> dict[str, dict[str, float | None]]:
    """Largest contribution over the used range of each effect that has one."""
    range_ = found.fit.rig.sensor.range
    return {name: sizes(found.sizes[name], range_) for name in names if name in found.sizes}


def importance(found: Importance | None) -> dict[str, Any] | None:
    """Effects that matter and those below the declared tolerance; None where none is declared."""
    if found is None:
        return None
    return {
        "m_per_s2": found.tolerance,
        "matters": list(found.matters),
        "below": list(found.below),
        "not_comparable": list(found.not_comparable),
    }


def dropped(several: Sequence[RejectedReadings]) -> list[dict[str, Any]]:
    """Samples that were rejected as outliers."""
    return [
        {"recording": d.recording, "channel": d.channel, "count": d.count, "of": d.of, "sentence": d.sentence}
        for d in several
    ]


def remarks(several: Sequence[Remark]) -> list[dict[str, Any]]:
    """What must be read with the verdict."""
    return [{"code": r.code, "sentence": r.sentence, "values": dict(r.values)} for r in several]


def finding(one: Finding, range_: float | None) -> dict[str, Any]:
    """An effect that was found; one of several columns has lists."""
    single = len(one.estimate) == 1
    return {
        "effect": one.effect,
        "class": list(one.group.members),
        "experiment": one.group.experiment,
        "estimate": one.estimate[0] if single else list(one.estimate),
        "std": one.std[0] if single else list(one.std),
        "unit": one.unit,
        "sigma": one.sigma,
        "largest_contribution": None if one.largest is None else sizes(one.largest, range_),
        "sizes_in_parts": part_sizes(one.group),
        "remarks": [one.remark] if one.remark else [],
    }


def part_sizes(group: Confounded) -> dict[str, Any] | None:
    """Sizes of an effect in the parts of the runs, over its size in all; None where they were not compared."""
    parts = group.parts
    return {"size": list(parts.size), "std": list(parts.std), "p": parts.p_value} if parts.size else None


def ties(several: Sequence[Confounded]) -> list[dict[str, Any]]:
    """Equivalence classes."""
    return [
        {"effect": t.effect, "members": list(t.members), "experiment": t.experiment, "sizes_in_parts": part_sizes(t)}
        for t in several
    ]


def parameters(found: Diagnosis) -> list[dict[str, Any]]:
    """Parameters of the fitted model with their largest contribution."""
    range_ = found.fit.rig.sensor.range
    at_encoder = {term.name for term in found.fit.model.terms if term.port == "position"}
    return [
        {
            **estimate_to_dict(e),
            "largest_contribution": sizes(Size(found.largest[e.name], e.name in at_encoder), range_),
        }
        for e in found.fit.estimates
    ]


def improvement_to_dict(found: Improvement) -> dict[str, Any]:
    """Content of `improve --json`.

    `found` is what the record shows, `left` what the last model still lacks; `verdict` and `sentence` sum up both.
    """
    last, range_ = found.diagnosis, found.diagnosis.fit.rig.sensor.range
    left_verdict, left_sentence = found.left
    return {
        "schema": IMPROVE_SCHEMA,
        "suspect_data": list(last.suspect),
        "verdict": found.verdict,
        "sentence": found.sentence,
        "effects": list(found.effects),
        "found": [finding(one, range_) for one in found.found],
        "left": {
            "verdict": left_verdict,
            "sentence": left_sentence,
            "effects": [one.effect for one in last.scan.found],
        },
        "remarks": remarks(last.remarks),
        "largest_contributions": by_effect(found.effects, last),
        "tolerance": importance(found.importance),
        "classes": ties(found.classes),
        "inseparable": ties(last.inseparable),
        "dropped": dropped(last.dropped),
        "breaks": list(last.breaks),
        "used": [list(span) for span in last.used],
        "heldout_is_same_run": found.same_run,
        "ruler": ruler([step.fit for step in found.steps], [step.heldout for step in found.steps]),
        "steps": [
            {
                "effects": list(step.effects),
                "train": comparison_to_dict(step.train),
                "heldout": comparison_to_dict(step.heldout),
                "change": changed,
            }
            for step, changed in zip(found.steps, changes([step.heldout for step in found.steps]), strict=True)
        ],
        "parameters": parameters(last),
        "shapes": [estimate_to_dict(e) for e in last.fit.shapes],
        "channels": [channel(test) for test in last.channels],
        "detection_limits": detection_limits(last),
        "candidates_examined": found.examined,
        "alpha": last.alpha,
        "model": to_dict(last.fit),
    }


def ruler(fits: Sequence[Fit], seen: Sequence[Evaluation]) -> dict[str, float]:
    """The one filter and the one band in which several models are compared."""
    noise = Ruler.of(fits).noise
    return {
        "noise_m_per_s2_rthz": math.sqrt(2.0 * noise.usual.q),
        "reading_std_m": math.sqrt(noise.usual.r),
        "band_hz": seen[0].band,
    }


def compared_to_dict(found: Comparison) -> dict[str, Any]:
    """Content of `compare --json`: comparisons of each model, and the difference of each from the first."""
    return {
        "schema": PAIRED_SCHEMA,
        "models": list(found.names),
        "horizon_s": found.paired_horizon,
        "differences": [difference_to_dict(one, found.recordings) for one in found.differences],
        "recordings": [
            {
                "recording": name,
                "ruler": ruler(found.fits, seen),
                "comparisons": [comparison_to_dict(each) for each in seen],
            }
            for name, seen in zip(found.recordings, found.seen, strict=True)
        ],
    }


def difference_to_dict(found: ModelDifference, recordings: Sequence[str]) -> dict[str, Any]:
    """One model against the first: over all recordings, then one by one."""
    return {
        "model": found.name,
        "reference": found.first,
        "verdict": found.verdict,
        "recordings_disagree": found.disagree,
        "sentence": found.sentence,
        "change": change_to_dict(found.pooled),
        "recordings": [
            {"recording": name, "verdict": verdict_of(change), "change": change_to_dict(change)}
            for name, change in zip(recordings, found.recordings, strict=True)
        ],
        "horizons": [change_to_dict(change) for change in found.horizons],
    }


def changes(seen: Sequence[Evaluation]) -> list[dict[str, Any] | None]:
    """Change of the held-out error from each step to the next, with its paired standard error; None for the first."""
    return [None, *(change_to_dict(heldout_change(before, after)) for before, after in pairwise(seen))]


def change_to_dict(change: HeldOutChange | None) -> dict[str, Any] | None:
    """A paired change with its standard error and its 95 % interval; null where the data are too short for one."""
    if change is None:
        return None
    low, high = change.percent_interval
    return {
        "measure": change.measure,
        "unit": change.unit,
        "before": change.before,
        "after": change.after,
        "percent": change.percent,
        "percent_std": change.percent_std,
        "percent_low": low,
        "percent_high": high,
        "sigma": change.sigma,
        "stretches": change.stretches,
    }


__dir__ = listing(globals())
