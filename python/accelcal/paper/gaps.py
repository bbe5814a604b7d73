"""Tables II and III: tracking through periods without position (paper III-B, IV)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import Channel, Recording
from accelcal.filters.choice import FilterChoice
from accelcal.paper.rows import SIGMAS, Item, Paired, Plan, Row, paired
from accelcal.paper.tuning import ACI, CWPA, PAPER_SENSOR, PLAIN_ADXL105, filtered, prior_sigmas, sampled, start, tuned
from accelcal.simulation.sensor import simulate

SECONDS, CALIBRATION, GAP = 60.0, 20.0, 1.0
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
            "tones", seconds=SECONDS, rig=PLAIN_ADXL105, parameters=sensor, rng=rng, position_noise=0.0
        )
        truth = simulated.truth
        noise = tuned(truth, PLAIN_ADXL105)
        holed = withheld(simulated.recording, CALIBRATION, GAP)
        ends = gap_ends(CALIBRATION, GAP, SECONDS)
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
    count = runs * len(gap_ends(CALIBRATION, GAP, SECONDS))
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
