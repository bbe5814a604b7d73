"""The encoder of II-A follows 100 mm/s: which motions stay below, and what a faster one does to k and a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from accelcal.data import Array, Channel, Recording
from accelcal.estimation.estimate import Fit, estimate
from accelcal.filters.choice import FilterChoice
from accelcal.model import Model
from accelcal.simulation.motion import Motion, motion
from accelcal.simulation.sensor import simulate
from accelcal.verbs import diagnose
from papers.stakkeland2007.rows import (
    ACI,
    CWPA,
    PAPER_SENSOR,
    PLAIN_ADXL105,
    PLAIN_CXL02,
    SIGMAS,
    Item,
    Paired,
    Plan,
    Row,
    filtered,
    paired,
    prior_sigmas,
    sampled,
    start,
    tuned,
)

LIMIT = 0.1
"""Speed that the encoder follows, m/s."""
SLOW = ("bursts", "moves", "interleaved")
"""Motions that are planned for the rig of the paper."""
TOO_FAST = 0.13
"""Top speed of the bursts that exceed it, m/s."""
SECONDS = 10.0
LARGEST = 4.0
"""Standard deviations."""
STEPS = 20
"""Steps of the encoder between two of its readings."""


@dataclass(frozen=True, slots=True)
class Followed:
    """One record as the encoder reads it."""

    recording: Recording
    fit: Fit
    behind: float
    """Largest distance between reading and position, m."""

    @property
    def sigma(self) -> float:
        """Largest error of k, K2, K3 in standard deviations."""
        names = [name for name in PAPER_SENSOR if name != "bias"]
        return max(abs(self.fit[name].value - PAPER_SENSOR[name]) / self.fit[name].std for name in names)


def encoder_speed_item(plan: Plan) -> Item:
    """Below, at and above the limit."""
    below, above = (
        plan.repeat("encoder speed", 1, lambda rng, top=top: followed(rng, top))[0]  # type: ignore[misc]
        for top in (LIMIT, TOO_FAST)
    )
    k, late = above.fit["scale_factor"], above.fit["time_offset"]
    error, usual = k.value - PAPER_SENSOR["scale_factor"], below.fit["scale_factor"].std
    return Item(
        name="encoder_speed",
        title=f"Encoder that follows {1e3 * LIMIT:g} mm/s, CXL02, bursts of {SECONDS:g} s",
        source="II-A",
        rows=(
            _planned_row(),
            _tones_row(),
            Row(
                by="us",
                claim="up to the limit k, K2, K3 are right",
                expected=f"errors below {LARGEST:g} sigma",
                measured=f"{below.sigma:.1f} sigma; the reading is behind by {1e6 * below.behind:.3f} um at most",
                value=below.sigma,
                n=1,
                threshold=f"{LARGEST:g} sigma",
                holds=below.sigma < LARGEST,
            ),
            Row(
                by="us",
                claim=f"bursts of {1e3 * TOO_FAST:g} mm/s: the reading comes late and short, and k is too large",
                expected=f"beyond {LARGEST:g} of the standard deviations up to the limit, k above, time offset below",
                measured=(
                    f"k off by {error:+.2g} ± {k.std:.1g}, time offset {1e3 * late.value:+.2f} ± {1e3 * late.std:.1g} "
                    f"ms; behind by {1e3 * above.behind:.2g} mm"
                ),
                value=error,
                n=1,
                threshold=f"{LARGEST:g} times {usual:.1g}; time offset likewise",
                holds=error > LARGEST * usual and late.value < -LARGEST * below.fit["time_offset"].std,
                remark="the sensor feels a longer way than the encoder reads; the fit takes the rest as noise",
            ),
            _diagnosis_row(above),
        ),
    )


def followed(rng: np.random.Generator, top: float) -> Followed:
    """Bursts up to a speed, read by the encoder."""
    made = simulate("bursts", seconds=SECONDS, rig=PLAIN_CXL02, parameters=PAPER_SENSOR, rng=rng, v_max=top)
    position = made.recording.position
    behind = read(made.truth.motion, position.t) - made.truth.motion.position(position.t)
    resolution = PLAIN_CXL02.resolution or 1e-6
    y = resolution * np.round((position.y + behind) / resolution)
    recording = replace(made.recording, position=replace(position, y=y))
    return Followed(recording, estimate(Model.cubic(), recording), float(np.max(np.abs(behind))))


def read(stage: Motion, t: Array) -> Array:
    """Position that follows the stage at no more than `LIMIT`, at equally spaced t (n,) s; m."""
    fine = np.linspace(t[0], t[-1], (len(t) - 1) * STEPS + 1)
    p = stage.position(fine)
    most = LIMIT * (fine[1] - fine[0]) * (1.0 + 1e-6)  # a motion at the limit is followed
    x, found = float(p[0]), np.empty(len(p))
    for i, to in enumerate(p.tolist()):
        x += min(max(to - x, -most), most)
        found[i] = x
    return found[::STEPS]


def top_speed(name: str) -> tuple[float, float]:
    """Top speed (m/s) of a planned motion as it is without a choice of size, and its share of time above `LIMIT`."""
    planned = motion(name, 60.0, np.random.default_rng(1))
    speed = np.abs(planned.velocity(np.arange(0.0, 60.0, 1e-3)))
    return float(np.max(speed)), float(np.mean(speed > LIMIT * (1.0 + 1e-3)))


def _planned_row() -> Row:
    tops = {name: top_speed(name)[0] for name in SLOW}
    fastest = max(tops.values())
    return Row(
        by="us",
        claim="the motions planned for the rig stay below the limit",
        expected=f"at most {1e3 * LIMIT:g} mm/s",
        measured=", ".join(f"{name} {1e3 * top:.1f}" for name, top in tops.items()) + " mm/s",
        value=fastest,
        n=len(tops),
        threshold="0.1 %",
        holds=fastest < LIMIT * (1.0 + 1e-3),
    )


def _tones_row() -> Row:
    top, share = top_speed("tones")
    return Row(
        by="us",
        claim="the four tones that most items use take a faster encoder",
        expected=f"above {1e3 * LIMIT:g} mm/s",
        measured=f"up to {1e3 * top:.0f} mm/s, above the limit for {share:.0%} of the time",
        value=top,
        n=1,
        threshold=f"{1e3 * LIMIT:g} mm/s",
        holds=top > LIMIT,
        remark="their readings are simulated without a limit of speed",
    )


def _diagnosis_row(above: Followed) -> Row:
    verdict = diagnose(above.fit, above.recording)
    return Row(
        by="us",
        claim="the diagnosis then calls the model incomplete, though it has no name for a limit of speed",
        expected="any verdict but adequate",
        measured=f"{verdict.verdict}: {verdict.sentence.split(' (')[0]}",
        value=float(verdict.verdict != "adequate"),
        n=1,
        threshold="not adequate",
        holds=verdict.verdict != "adequate",
        remark="no effect of the catalogue is a limit of speed; encoder_lag is a low-pass",
    )


GAP_SECONDS, CALIBRATION, GAP = 60.0, 20.0, 1.0
"""Length, time with position before the first gap, length of the gaps and of the pauses between them, s."""
CURVED_SENSOR = {**PAPER_SENSOR, "quadratic": -1e-3, "cubic": 1e-4}
"""Ten times as nonlinear."""

FILTERS: Mapping[str, FilterChoice] = {
    "ACI linear": ACI,
    "CWPA linear": CWPA,
    "ACI cubic": replace(ACI, model="cubic"),
    "CWPA cubic": replace(CWPA, model="cubic"),
}


@dataclass(frozen=True, slots=True)
class GapErrors:
    """rms position error at the end of the gaps, one figure per record, m."""

    errors: Mapping[str, Array]
    """(n,) by name of the filter in `FILTERS`."""

    def rms(self, name: str) -> float:
        """Over all records, m."""
        return float(np.sqrt(np.mean(self.errors[name] ** 2)))

    def compare(self, first: str, second: str) -> Paired:
        """First over second, on the same records."""
        return paired(self.errors[first], self.errors[second])


def gaps_item(plan: Plan) -> Item:
    """ACI against CWPA, linear against cubic."""
    runs = plan.runs(10, 40)
    paper, curved = (gap_errors(plan, sensor, runs) for sensor in (PAPER_SENSOR, CURVED_SENSOR))
    comparisons: tuple[tuple[GapErrors, Literal["paper", "us"], str, str, str], ...] = (
        (paper, "paper", "CWPA linear", "ACI linear", "CWPA tracks better through gaps, linear model (Table II)"),
        (paper, "paper", "CWPA cubic", "ACI cubic", "CWPA tracks better through gaps, cubic model (Table II)"),
        (paper, "paper", "ACI linear", "ACI cubic", "the linear model tracks better, ACI (Table III)"),
        (paper, "paper", "CWPA linear", "CWPA cubic", "the linear model tracks better, CWPA (Table III)"),
        (
            curved,
            "us",
            "ACI cubic",
            "ACI linear",
            "the cubic model tracks better if K2, K3 are ten times as large, ACI",
        ),
        (
            curved,
            "us",
            "CWPA cubic",
            "CWPA linear",
            "the cubic model tracks better if K2, K3 are ten times as large, CWPA",
        ),
    )
    rows = [_floor_row(paper, runs), *(_pair_row(*comparison, runs) for comparison in comparisons)]
    return Item(
        name="gaps",
        title="Position error after 1 s without position, ADXL105",
        source="III-B, IV, Tables II and III (their bodies are lost)",
        rows=tuple(rows),
    )


def gap_errors(plan: Plan, sensor: Mapping[str, float], runs: int) -> GapErrors:
    """All four filters on the same records; CWPA keeps its accelerometer readings during the gaps, as in the paper."""

    def once(rng: np.random.Generator) -> list[float]:
        simulated = simulate(
            "tones", seconds=GAP_SECONDS, rig=PLAIN_ADXL105, parameters=sensor, rng=rng, position_noise=0.0
        )
        truth = simulated.truth
        noise = tuned(truth, PLAIN_ADXL105)
        holed = withheld(simulated.recording, CALIBRATION, GAP)
        ends = gap_ends(CALIBRATION, GAP, GAP_SECONDS)
        at = ends - 1e-9  # just before position is back
        position = truth.motion.position(_event_before(simulated.recording.accel.t, at))

        def error(choice: FilterChoice) -> float:
            track = filtered(choice, holed, noise, start(choice, truth), prior_sigmas(choice))
            return float(np.sqrt(np.mean((sampled(track, at)[:, 0] - position) ** 2)))

        return [error(choice) for choice in FILTERS.values()]

    columns = np.array(plan.repeat("gaps", runs, once)).T
    return GapErrors(dict(zip(FILTERS, columns, strict=True)))


def withheld(recording: Recording, first: float, length: float) -> Recording:
    """From `first` s on, every second stretch of `length` s is without positions: its samples are simply absent."""
    t = recording.position.t
    seen = (t < first) | ((t - first) % (2.0 * length) < length)
    position = recording.position
    return replace(recording, position=Channel(position.name, t[seen], position.y[seen], position.unit))


def gap_ends(first: float, length: float, seconds: float) -> Array:
    """Instants at which position comes back, s."""
    return np.arange(first + 2.0 * length, seconds, 2.0 * length)


def random_walk_floor(density: float, gap: float) -> float:
    """sqrt(q t³/3), q = N²/2: what the sensor's noise alone does in a gap; m."""
    return float(np.sqrt(density**2 / 2.0 * gap**3 / 3.0))


def _event_before(t: Array, at: Array) -> Array:
    """The last accelerometer sample not later than `at`: what a filter without position has seen."""
    return np.asarray(t[np.searchsorted(t, at, side="right") - 1])


def _floor_row(result: GapErrors, runs: int) -> Row:
    density = PLAIN_ADXL105.sensor.noise
    assert density is not None  # the ready-made rigs declare it
    floor = random_walk_floor(density, GAP)
    seen = result.rms("ACI cubic")
    count = runs * len(gap_ends(CALIBRATION, GAP, GAP_SECONDS))
    margin = SIGMAS / np.sqrt(2.0 * count)
    return Row(
        by="us",
        claim="the sensor's noise sets the error of a calibrated sensor",
        expected=f"{floor * 1e3:.3f} mm = sqrt(q t³/3)",
        measured=f"{seen * 1e3:.3f} mm (ACI cubic)",
        value=seen,
        n=count,
        threshold=f"within -{margin:.0%} and +{margin + 0.1:.0%}: velocity and bias add up to 10 %",
        holds=bool(1.0 - margin < seen / floor < 1.1 + margin),
        remark="no filter can do better",
    )


def _pair_row(result: GapErrors, by: Literal["paper", "us"], first: str, second: str, claim: str, runs: int) -> Row:
    pair = result.compare(first, second)
    return Row(
        by=by,
        claim=claim,
        expected=f"{first} below {second}",
        measured=f"{result.rms(first) * 1e3:.3f} mm against {result.rms(second) * 1e3:.3f} mm ({pair.verdict})",
        value=pair.ratio,
        n=runs,
        threshold=f"2 % and {SIGMAS:.2f} sigma (mean log ratio is {pair.deviate:+.1f} sigma)",
        holds=pair.verdict == "smaller",
        remark=f"ratio {pair.ratio:.3f}",
    )
