"""Effects that act on noise in a fit, and what they gain on another recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from accelcal._support.errors import AccelcalError
from accelcal.diagnosis.noise_model.estimates import RecordNoise, noise_estimates, noise_scores_of, rejected_channel
from accelcal.diagnosis.noise_tests.run_all import run_noise_tests
from accelcal.diagnosis.outlier_rejection import outliers_found, without_outliers
from accelcal.diagnosis.policy import NOISE_EFFECT_ALPHA
from accelcal.estimation.estimate import Fit, require_channels, settled_state, state_at
from accelcal.estimation.noise_effects import NoiseScore
from accelcal.estimation.run import PreparedRun, prepared
from accelcal.estimation.run_state import RunState
from accelcal.validation.other_record import values_on


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


def require_noise_shown(fit: Fit, names: Sequence[str]) -> None:
    """Refuse effects that act on noise and that the recordings of a fit do not show.

    Raises
    ------
    ValueError
        Naming the effect, and from which size on it would show.
    """
    known = {one.name: one for one in fit.noise_effects}
    for effect in fit.model.noise_effects:
        if effect.name not in names:
            continue
        one = known.get(effect.name)
        if one is None:
            raise AccelcalError(
                f"{effect.name!r} cannot be added: the record is too short, or its filters leave no noise above the "
                "motion"
            )
        if one.p_value >= NOISE_EFFECT_ALPHA or one.value <= 0.0:
            least = one.particulars.get("least", 0.0)
            limit = f"; it would show from {one.symbol} = {least:.2g} {one.unit} on" if least > 0.0 else ""
            raise AccelcalError(
                f"{effect.name!r} cannot be added: this record does not show it (p = {one.p_value:.2g}){limit}"
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
    require_channels(fit, recording)

    def state_of(one: PreparedRun) -> RunState:
        return settled_state(prepared(one, fit.origins, start=start, end=end), values_on(fit, recording), fit.noise())

    whole, clean = state_of(run), run
    for test in outliers_found(run_noise_tests(whole)):
        clean = without_outliers(clean, test)
    state = whole if clean is run else state_of(clean)
    return noise_scores_of(fit.noise_effects, RecordNoise.of(state, whole, recording))
