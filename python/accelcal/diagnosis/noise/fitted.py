"""Effects that act on noise in a fit, and what they gain on another recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from accelcal._support.errors import AccelcalError
from accelcal.data import Recording
from accelcal.diagnosis.clean_fit import outliers_found, run_noise_tests, without_outliers
from accelcal.diagnosis.noise.counts import rounded_noise, score_of_rounding
from accelcal.diagnosis.noise.growing import BlockPowers, growing_noise, score_of_growth
from accelcal.diagnosis.noise.outliers import (
    SampleErrors,
    outlying_noise,
    output_errors,
    reading_errors,
    score_of_tails,
)
from accelcal.diagnosis.noise.residuals import Residuals
from accelcal.diagnosis.policy import NOISE_EFFECT_ALPHA
from accelcal.effects import Effect, find
from accelcal.estimation.estimate import Fit, require_channels, settled_state, state_at
from accelcal.estimation.noise import NoiseEffect, NoiseScore
from accelcal.estimation.run import PreparedRun, prepared
from accelcal.estimation.run_state import RunState
from accelcal.model import Model
from accelcal.validation.prediction import values_on


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
    grown = {effect.name: effect for effect in growing_noise([r.clean for r in records], growing)} if growing else {}
    for effect in effects:
        channel = rejected_channel(effect)
        if channel:
            grown[effect.name] = outlying_noise(channel, effect, [record.errors(channel) for record in records])
        elif is_rounding(effect):
            grown[effect.name] = rounded_noise([record.clean for record in records], effect)
    return tuple(grown[effect.name] for effect in effects if effect.name in grown)


def noise_scores_of(effects_in_model: Sequence[NoiseEffect], record: RecordNoise) -> tuple[NoiseScore, ...]:
    """What each effect gains on a record that it was not estimated from; none where frequencies do not match."""
    effects = {effect.name: find(effect.name) for effect in effects_in_model}
    growing = [effect for effect in effects.values() if grows(effect)]
    blocks = BlockPowers.of(record.clean, growing) if growing else None
    scores: list[NoiseScore | None] = []
    for noise_effect in effects_in_model:
        if noise_effect.value <= 0.0:  # the fit saw none
            continue
        channel = rejected_channel(effects[noise_effect.name])
        if channel:
            scores.append(score_of_tails(record.errors(channel), noise_effect))
        elif is_rounding(effects[noise_effect.name]):
            scores.append(score_of_rounding(record.clean, noise_effect))
        elif blocks is not None:
            scores.append(score_of_growth(blocks, noise_effect))
    return tuple(score for score in scores if score is not None)


def with_noise_effects(fit: Fit, original: Sequence[PreparedRun], states: Sequence[RunState]) -> Fit:
    """The fit with estimates of the effects of its model that act on noise.

    Parameters
    ----------
    fit : from `states`.
    original : runs with their outliers.
    states : of the runs without them, at the values of the fit.
    """
    if not fit.model.noise_effects:
        return fit
    outlying = any(rejected_channel(effect) == "accel" for effect in fit.model.noise_effects)
    records = []
    for index, (run, state) in enumerate(zip(original, states, strict=True)):
        recording, whole, clean, span = run.recording, state, state.run.recording, fit.runs[index]
        if outlying and (len(clean.accel), len(clean.position)) != (len(recording.accel), len(recording.position)):
            whole = state_at(fit, index, prepared(run, fit.origins, start=span.start, end=span.end))
        records.append(RecordNoise.of(state, whole, recording))
    return replace(fit, noise_effects=noise_estimates(fit.model, records))


def noise_shown(fit: Fit, name: str) -> bool:
    """Whether a fit shows an effect of its model that acts on noise."""
    size = next((effect for effect in fit.noise_effects if effect.name == name), None)
    return size is not None and size.p_value < NOISE_EFFECT_ALPHA and size.value > 0.0


def require_noise_shown(fit: Fit, names: Sequence[str]) -> None:
    """Refuse effects that act on noise and that the recordings of a fit do not show.

    Raises
    ------
    ValueError
        Naming the effect, and from which size on it would show.
    """
    sizes = {effect.name: effect for effect in fit.noise_effects}
    for effect in fit.model.noise_effects:
        if effect.name not in names:
            continue
        size = sizes.get(effect.name)
        if size is None:
            raise AccelcalError(
                f"{effect.name!r} cannot be added: the record is too short, or its filters leave no noise above the "
                "motion"
            )
        if not noise_shown(fit, effect.name):
            least = size.particulars.get("least", 0.0)
            limit = f"; it would show from {size.symbol} = {least:.2g} {size.unit} on" if least > 0.0 else ""
            raise AccelcalError(
                f"{effect.name!r} cannot be added: this record does not show it (p = {size.p_value:.2g}){limit}"
            )


def noise_scores(
    fit: Fit, run: PreparedRun, *, start: float | None = None, end: float | None = None
) -> tuple[NoiseScore, ...]:
    """What each effect of a fit that acts on noise gains on a recording, as its log predictive density.

    Parameters
    ----------
    fit : a model with such effects; without them the answer is empty.
    run : one that the fit was not made from.
    start, end : s, optional; only this part is used.

    Raises
    ------
    RecordingError
        If a channel is missing that the model needs.
    """
    if not fit.noise_effects:
        return ()
    recording = run.recording
    require_channels(fit.model, recording)

    def state_of(run: PreparedRun) -> RunState:
        return settled_state(prepared(run, fit.origins, start=start, end=end), values_on(fit, recording), fit.noise())

    whole, clean = state_of(run), run
    for test in outliers_found(run_noise_tests(whole)):
        clean = without_outliers(clean, test)
    state = whole if clean is run else state_of(clean)
    return noise_scores_of(fit.noise_effects, RecordNoise.of(state, whole, recording))
