"""The effects of a model that act on noise: estimates on the records of a fit, scores on any other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from accelcal.data.recording import Recording
from accelcal.diagnosis.noise_model.growing import BlockPowers, growing_noise, score_of_growth
from accelcal.diagnosis.noise_model.heavy_tails import outlying_noise, reading_errors, score_of_tails
from accelcal.diagnosis.noise_model.rounding import rounded_noise, score_of_rounding
from accelcal.diagnosis.noise_tests.outliers import SampleErrors, output_errors
from accelcal.diagnosis.noise_tests.residuals import Residuals
from accelcal.effects import Effect, find
from accelcal.estimation.noise_effects import NoiseEffect, NoiseScore
from accelcal.estimation.run_state import RunState
from accelcal.model import Model


@dataclass(frozen=True, slots=True)
class RecordNoise:
    """A record at the values of a fit, with its outliers and without."""

    clean: Residuals
    whole: Residuals
    recording: Recording
    """With its outliers."""

    @classmethod
    def of(cls, clean: RunState, whole: RunState, recording: Recording) -> RecordNoise:
        """From states without and with the outliers of a recording."""
        without = Residuals(clean)
        return cls(without, without if whole is clean else Residuals(whole), recording)

    def errors(self, channel: str) -> SampleErrors:
        """Errors of single samples of a channel, accel or position."""
        return output_errors(self.whole) if channel == "accel" else reading_errors(self.clean, self.recording)


def rejected_channel(effect: Effect) -> str:
    """Channel that outliers are rejected from: accel or position; empty where the effect has none."""
    return effect.traits.noise.rejects if effect.traits.noise else ""


def is_rounding(effect: Effect) -> bool:
    """Whether the effect is the converter's step."""
    return effect.traits.noise is not None and effect.traits.noise.found_by == "output steps"


def grows(effect: Effect) -> bool:
    """Whether the effect makes the noise of the output change along the record."""
    return effect.port == "noise" and not rejected_channel(effect) and not is_rounding(effect)


def noise_estimates(model: Model, records: Sequence[RecordNoise]) -> tuple[NoiseEffect, ...]:
    """Estimates of all effects of a model that act on noise, in its order; those that a record cannot show are missing.

    Parameters
    ----------
    model : with at least one such effect.
    records : those of the fit.
    """
    effects = model.noise_effects
    growing = [effect for effect in effects if grows(effect)]
    found = {one.name: one for one in growing_noise([r.clean for r in records], growing)} if growing else {}
    for effect in effects:
        channel = rejected_channel(effect)
        if channel:
            found[effect.name] = outlying_noise(channel, effect, [record.errors(channel) for record in records])
        elif is_rounding(effect):
            found[effect.name] = rounded_noise([record.clean for record in records], effect)
    return tuple(found[effect.name] for effect in effects if effect.name in found)


def noise_scores_of(known: Sequence[NoiseEffect], record: RecordNoise) -> tuple[NoiseScore, ...]:
    """What each effect gains on a record that it was not estimated from; none where frequencies do not match."""
    effects = {one.name: find(one.name) for one in known}
    growing = [effect for effect in effects.values() if grows(effect)]
    blocks = BlockPowers.of(record.clean, growing) if growing else None
    found: list[NoiseScore | None] = []
    for one in known:
        if one.value <= 0.0:  # the fit saw none
            continue
        channel = rejected_channel(effects[one.name])
        if channel:
            found.append(score_of_tails(record.errors(channel), one))
        elif is_rounding(effects[one.name]):
            found.append(score_of_rounding(record.clean, one))
        elif blocks is not None:
            found.append(score_of_growth(blocks, one))
    return tuple(score for score in found if score is not None)
