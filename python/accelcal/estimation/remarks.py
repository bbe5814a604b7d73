"""Remarks: what must be read with a fit or a verdict, each with a code, a sentence and its numbers.

A new remark is one entry of `KINDS`, and one call of `remark` where its numbers are known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from string import Formatter
from typing import Any, Literal

Place = Literal["verdict", "data", "beside"]
"""Where it is printed: in the sentence of the verdict, as suspect data before it, or beside it."""
Value = float | int | str


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of remark."""

    place: Place
    text: str
    """Its sentence, with the names of its values in braces."""
    forbids_names: bool = False
    """Whether no effect is certain beside it, so that none is named."""
    vetoes_adequate: bool = False
    """Whether no model is adequate beside it; it then opens the sentence of the verdict."""


KINDS: dict[str, Kind] = {
    "implausible_scale": Kind(
        "verdict",
        "1 + k = {scale:.4g} is implausible for a working sensor, which shows 0.7 to 1.4: {cause}",
        forbids_names=True,
    ),
    "motion_beyond_sampling": Kind(
        "verdict",
        "The motion changes faster than the sampling resolves during {share:.2g} % of the record, at {instants} "
        "instants; sample faster, or smooth the set-points",
        forbids_names=True,
    ),
    "undeclared_lowpass": Kind(
        "verdict",
        "The output lags and falls short as behind a first-order low-pass with tau = {tau:.4g} ± {std:.2g} ms, corner "
        "{corner:.3g} Hz, which is not declared: with it, {left:.2g} of {before:.2g} (m/s²)/√Hz of noise are left. If "
        "the output passes such a filter, declare it in [channels]: accel = {{ ..., lowpass = "
        '{{ kind = "RC", tau = "{tau:.4g} ms", tolerance = 0.1 }} }}',
        forbids_names=True,
    ),
    "undeclared_resonance": Kind(
        "verdict",
        "The output follows as behind a resonance at f0 = {f0:.4g} ± {f0_std:.2g} Hz with Q = {q:.3g} ± {q_std:.2g}, "
        "which is not declared: with it, {left:.2g} of {before:.2g} (m/s²)/√Hz of noise are left. If mount or element "
        "has one, declare it in [channels]: accel = {{ ..., lowpass = {entry} }}",
        forbids_names=True,
    ),
    "turning_sensor": Kind(
        "verdict",
        "A tilt of {tilt_deg:.2g} degrees rms or a slow drift of either channel would explain all of it; orientation "
        "is not recorded. The residual below {band:.2g} Hz is {rms:.2g} m/s² rms where a bias instability of "
        "{bias_instability:.2g} m/s² is ordinary",
        forbids_names=True,
    ),
    "coloured_position": Kind(
        "verdict",
        "The noise of the position is not white: {rms:.2g} m with a correlation time of {tau:.2g} s, or in that "
        "proportion; the sensor is not to blame",
    ),
    "engines_disagree": Kind(
        "verdict",
        "Two independent estimates of this record disagree in {parameters}: {parameter} is {replay} by the replay and "
        "{weak} by the weak form, {sigma:.3g} standard deviations of their difference apart",
        vetoes_adequate=True,
    ),
    "dropout": Kind(
        "data",
        "{recording}: {channel}: {count} gaps without readings, {share:.2g} % of the record together, the "
        "longest {longest:.3g} s from t = {time:.6g} s on",
    ),
    "glitch": Kind(
        "data",
        "{recording}: {channel}: the reading jumps and returns {count} times, by at most {longest:.3g} m at t = "
        "{time:.6g} s; such readings are left out",
    ),
    "rail_hit": Kind(
        "data",
        "{recording}: {channel}: the output saturates {count} times, {share:.2g} % of the record together, for "
        "{longest:.2g} s at most from t = {time:.6g} s on",
    ),
    "denied": Kind(
        "data",
        "{recording}: {count} of {of} readings of {channel} ({share:.2g} %, stretches: {stretches}, from t = "
        "{time:.6g} s to {end:.6g} s) are left out: they lie far beyond all others, or jump far more, and the "
        "reference shows no such motion; check supply, cable and damaged packets{cut}",
    ),
    "saturated": Kind(
        "data",
        "{recording}: {count} of {of} readings of {channel} ({share:.2g} %, stretches: {stretches}, from t = "
        "{time:.6g} s to {end:.6g} s) are left out: the output is at the limit of its range there, where a smaller "
        "motion or a wider range would keep them{cut}",
    ),
    "stuck": Kind(
        "data",
        "{recording}: {count} of {of} readings of {channel} ({share:.2g} %, stretches: {stretches}, from t = "
        "{time:.6g} s to {end:.6g} s) are left out: they repeat one value while the other channel moves; check range, "
        "cable, supply and logger{cut}",
    ),
    "other_scale": Kind(
        "data",
        "{recording}: {count} of {of} readings of {channel} ({share:.2g} %, from t = {time:.6g} s to {end:.6g} s) are "
        "left out: the output is {scale:.3g} times there what the same motion makes in the rest; look for a range, a "
        "gain or a wiring that was changed{cut}",
    ),
    "unrelated": Kind(
        "data",
        "{recording}: {count} of {of} readings of {channel} ({share:.2g} %, from t = {time:.6g} s to {end:.6g} s) are "
        "left out: until then output and reference do not move together, after that they do; start the record when the "
        "stage is homed and the sensor is mounted{cut}",
    ),
    "lost_signal": Kind(
        "data",
        "{recording}: {count} of {of} readings of {channel} ({share:.2g} %, stretches: {stretches}, from t = "
        "{time:.6g} s to {end:.6g} s) are left out: they jump away from the motion that the output shows and come "
        "back, as a vibrometer does that loses its signal; check its focus and the reflecting surface{cut}",
    ),
    "position_step": Kind(
        "data",
        "{recording}: {channel}: the reading jumps {count} times and stays: missed counts; the largest jump is "
        "{longest:.3g} m at t = {time:.6g} s",
    ),
    "break": Kind(
        "data",
        "{recording}: from t = {time:.6g} s on no relation of output and position holds; only the part before it is "
        "used{cut}",
    ),
    "dropped_samples": Kind("data", "{recording}: {channel}: samples were lost without a trace in the time stamps"),
    "disturbed": Kind(
        "data",
        "{recording}: something disturbed the record {between}: the residual below {band:.2g} Hz, {rms:.2g} m/s² rms "
        "where a bias instability of {bias_instability:.2g} m/s² is ordinary, lives there alone. That is left out, and "
        "the rest is judged{cut}",
    ),
    "tilt_or_drift": Kind(
        "beside",
        "A tilt of {tilt_deg:.2g} degrees rms would explain the drift of the bias as well: below {band:.2g} Hz it is "
        "{rms:.2g} m/s² rms where a bias instability of {bias_instability:.2g} m/s² is ordinary; orientation is not "
        "recorded",
    ),
    "slow_residual": Kind(
        "beside",
        "A tilt of {tilt_deg:.2g} degrees rms, a slow drift of either channel, or an effect that the model lacks, "
        "would explain the residual below {band:.2g} Hz, {rms:.2g} m/s² rms where a bias instability of "
        "{bias_instability:.2g} m/s² is ordinary; orientation is not recorded. Do not take bias and scale factor for "
        "the sensor's: run accelcal diagnose",
    ),
    "unresolved_motion": Kind(
        "beside",
        "The motion changes faster than the sampling resolves at {instants} instants; declare or smooth the set-points",
    ),
    "search_stopped": Kind(
        "beside",
        "The search was stopped at its limit of {models} models; this is the best answer so far. Add what is missing "
        "with accelcal add, and go on from there with accelcal diagnose",
    ),
    "validation_rises": Kind(
        "beside",
        "{effect} was not added: with it the {measure} on left-out blocks of the fitted data rises by {percent:.2g} % "
        "({sigma:.1f} paired standard errors over {blocks} blocks)",
    ),
    "validation_not_better": Kind(
        "beside",
        "{effect} was not added: it fits the data but predicts no left-out block: the {measure} there changes by "
        "{percent:+.2g} % ({sigma:+.1f} paired standard errors over {blocks} blocks)",
    ),
    "implausible": Kind(
        "beside",
        "{effect} was not added: it would contribute {size:.3g} {unit}, more than the {limit} of {most:.3g} {unit}",
    ),
    "implausible_beside": Kind(
        "beside",
        "{effect} was not added: beside it 1 + k = {scale:.4g}, which no working sensor has",
    ),
    "undetermined": Kind(
        "beside",
        "{effect} was not added: beside the other parameters it explains no more than chance (gain {gain:.2g} for "
        "{coefficients} coefficients)",
    ),
    "unconfirmed": Kind(
        "beside",
        "{effect} was not added: the fit with it does not confirm it (gain {gain:.2g} for {coefficients} coefficients, "
        "no more than chance among {examined} candidates)",
    ),
    "too_short_with": Kind(
        "beside", "{effect} was not added: {blocks} blocks are left with it, {least} are needed for a verdict"
    ),
    "noise_not_shown": Kind(
        "beside", "{effect} was not added: its test is significant, but the fit with it does not show it"
    ),
    "contradicted": Kind(
        "beside",
        "{effect} is contradicted by the held-out record: it would show there at {d:.0f} sigma, and with it the "
        "systematic error rises by {percent:.2g} % ({sigma:.1f} paired standard errors); it is not named",
    ),
    "heldout_rises": Kind(
        "beside",
        "On the held-out data the {measure} of the last model is {percent:.2g} % larger than that of {best} "
        "({sigma:.1f} paired standard errors): the best step is {best}",
    ),
    "slow_noise": Kind(
        "beside",
        "The noise is not white: it rises below {knee:.2g} Hz, and effects were judged against it; what varies more "
        "slowly than that is found only if it is larger",
    ),
    "depends_on_frequency": Kind(
        "beside",
        "{effect} would explain part of what is left ({sigma:.0f} sigma), but what is left depends on frequency: "
        "{sizes}; it is not named",
    ),
    "no_single_size": Kind(
        "beside",
        "{effect} would explain part of what is left ({sigma:.0f} sigma), but it does not have one size: {sizes}; it "
        "is not named",
    ),
    "recurs": Kind(
        "beside",
        "{effect} would explain part of what is left ({sigma:.0f} sigma), but it would have to happen again and again; "
        "it is not named",
    ),
    "runs_disagree": Kind(
        "beside",
        "The recordings disagree (p = {p:.2g}): {parameter} is {value} on {recording} and {others} on the others; "
        "sensor and reference cannot be distinguished there",
    ),
    "run_to_run": Kind("beside", "{text}"),
    "goes_with": Kind("beside", "{text}"),
    "transverse_coherence": Kind(
        "beside",
        "The residual is coherent with {channel} between {low:.2g} Hz and {high:.2g} Hz: {share:.0f} % of its power "
        "there, a sensitivity of {sensitivity:.2g}; a transverse sensitivity that depends on frequency, or a rig that "
        "rocks",
    ),
    "outliers_rejected": Kind("beside", "{recording}: {count} of {of} readings of {channel} were rejected as outliers"),
    "imposed_band": Kind(
        "beside",
        "{recording}: the noise is not white up to the crossover; the encoder is trusted up to {band:.3g} Hz, "
        "where it has the most information",
    ),
    "measured_spectrum": Kind(
        "beside", "{recording}: what the model leaves is not white; readings are weighted by its measured spectrum"
    ),
    "changes_with_band": Kind("beside", "{recording}: {text}"),
    "not_observable": Kind(
        "beside",
        "{recording}: bias is not observable behind the declared {filters}; this run does not determine it, and a "
        "constant of its output is not laid on the sensor",
    ),
    "mostly_prior": Kind("beside", "{parameter} is dominated by its prior, {mean:g} ± {std:g}: the record says little"),
    "not_of_type": Kind(
        "verdict",
        "This sensor is not of the type of its prior (p = {p_value:.1g} over {parameters}): {parameter} lies "
        "{sigma:.1f} standard deviations from it; fit again without the prior",
    ),
    "angle_zero": Kind(
        "beside",
        "{recording}: the arm is level {degrees:.3g} degrees{counts} from the declared zero of the angle; reduce zero "
        "in [channels] angle by that and fit again, for the scale factor errs by half the square of that angle",
    ),
    "on_bound": Kind("beside", "{text}"),
    "seen_by_runs": Kind("beside", "{text}"),
    "assumed": Kind("beside", "{text}"),
    "dwells_scatter": Kind("beside", "{text}"),
    "positions_agree": Kind(
        "beside",
        "{positions} and the motion agree: chi-square {squares:.3g} of {freedom} degrees of freedom, p = {p:.2g}, not "
        "below alpha = {alpha:g}",
    ),
    "positions_disagree": Kind(
        "beside",
        "{positions} and the motion disagree: chi-square {squares:.3g} of {freedom} degrees of freedom, p = {p:.2g}, "
        "below alpha = {alpha:g}. Most of it is {parameter}, positions less motion: {differences}. One value cannot be "
        "right for both: check sensor, units and gravity of both; if the bias alone differs, `--vary bias` lets it",
    ),
    "not_settled": Kind(
        "beside",
        "the iteration had not settled after {rounds} rounds: the model does not describe this record, or holds an "
        "effect as large as the output itself",
    ),
    "noise_beyond_declared": Kind("beside", "{recording}: {text}"),
    "barely_shown": Kind(
        "beside",
        "{effect} is {sigma:.1f} standard deviations from zero, where {expected:g} are expected of an effect that is "
        "there: drop it, or fit a record that separates it, by {experiment}",
    ),
    "chosen": Kind(
        "beside",
        "{effect}: these recordings named it at {sigma:.1f} standard deviations, where {threshold:.1f} are needed, and "
        "estimates that are named are too large on average. Allowing for that choice its size is {text}, 95 %: "
        "{interval}; the estimate alone is {raw}",
    ),
    "replaced": Kind("beside", "{process} was taken out: {effect} explains what it did"),
    "beside_others": Kind("beside", "the record shows nothing of {effect} beside the other processes: drop it"),
    "not_fitted": Kind("beside", "{text}"),
    "live_filter": Kind("beside", "{text}"),
    "noted": Kind("beside", "{text}"),
    "not_added": Kind(
        "beside", "{effect} would explain more of the record ({sigma:.0f} sigma), but it was not added: {reason}"
    ),
}
"""Every code that a remark can have; of several causes of a residual the first counts. A single fault has a sentence of
its own, with its instant."""


@dataclass(frozen=True, slots=True)
class Remark:
    """One remark on a record or a verdict."""

    code: str
    sentence: str
    values: Mapping[str, Value]
    """Its numbers in SI, by name."""

    @property
    def place(self) -> Place:
        """Where it is printed."""
        return KINDS[self.code].place

    @property
    def forbids_names(self) -> bool:
        """Whether no effect is certain beside it."""
        return KINDS[self.code].forbids_names

    @property
    def vetoes_adequate(self) -> bool:
        """Whether no model is adequate beside it."""
        return KINDS[self.code].vetoes_adequate


class _Plain(Formatter):
    """Fills a sentence: what `g` writes with an exponent between one and a million has digits."""

    def format_field(self, value: Any, format_spec: str) -> Any:
        text = format(value, format_spec)
        if format_spec.endswith("g") and "e+0" in text and abs(value) < 1e6:
            return f"{float(text):{format_spec[:1] if format_spec[0] == '+' else ''}.0f}"
        return text


_PLAIN = _Plain()


def remark(code: str, **values: Value) -> Remark:
    """The remark of a code with its values.

    Raises
    ------
    KeyError
        If there is no such code, or a value that its sentence contains is missing.

    Examples
    --------
    >>> remark("not_added", effect="cubic", sigma=7.2, reason="no fit with it is possible").sentence
    'cubic would explain more of the record (7 sigma), but it was not added: no fit with it is possible'
    >>> values = {"measure": "one-step error", "percent": 152.3, "sigma": 46.1, "blocks": 16}
    >>> remark("validation_rises", effect="cubic", **values).sentence.partition(" on left-out ")[2]
    'blocks of the fitted data rises by 150 % (46.1 paired standard errors over 16 blocks)'
    """
    return Remark(code, _PLAIN.format(KINDS[code].text, **values), values)
