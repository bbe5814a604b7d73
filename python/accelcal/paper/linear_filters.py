"""What the paper says of the linear model: one estimate in both forms (II-B), one in both orders (III-B1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from accelcal.data.arrays import Array
from accelcal.filters.choice import FilterChoice
from accelcal.filters.record import forward_parameters
from accelcal.paper.rows import Item, Plan, Row
from accelcal.paper.tuning import ACI, CWPA, PAPER_SENSOR, PLAIN_ADXL105, filtered, prior_sigmas, start, tuned
from accelcal.simulation.sensor import simulate

SECONDS = 60.0
RUNS = 4
SAME = 0.02
"""Standard deviations within which two filters on one record give the same estimate; ACI and CWPA differ by 0.08."""
PAIRS: tuple[tuple[str, str, Mapping[str, tuple[object, object]], FilterChoice], ...] = (
    ("the linear model gives the same estimate in both forms", "II-B", {"form": ("forward", "inverse")}, ACI),
    ("first and second order are the same for the linear model", "III-B1", {"order": (1, 2)}, ACI),
    ("first and second order are the same for the linear model", "III-B1", {"order": (1, 2)}, CWPA),
)


def linear_filters_item(plan: Plan) -> Item:
    """Two filters on the same records, in standard deviations of either."""
    return Item(
        name="linear_filters",
        title=f"Linear model, ADXL105 without low-pass, {SECONDS:g} s: k and K0 at the end",
        source="II-B, III-B1",
        rows=tuple(_row(plan, claim, source, choices, system) for claim, source, choices, system in PAIRS),
    )


def apart(plan: Plan, first: FilterChoice, second: FilterChoice, runs: int) -> Array:
    """Largest difference of k and K0 in each run, in standard deviations of the first, (runs,)."""
    sensor = {name: value for name, value in PAPER_SENSOR.items() if name in ("bias", "scale_factor")}

    def once(rng: np.random.Generator) -> float:
        simulated = simulate(
            "tones", seconds=SECONDS, rig=PLAIN_ADXL105, parameters=sensor, rng=rng, position_noise=0.0
        )
        noise = tuned(simulated.truth, PLAIN_ADXL105)
        a, b = (
            forward_parameters(filtered(f, simulated.recording, noise, start(f, simulated.truth), prior_sigmas(f)))
            for f in (first, second)
        )
        return float(np.max(np.abs(a.values - b.values) / np.sqrt(np.diag(a.covariance))))

    return np.array(plan.repeat(f"linear filters {first} {second}", runs, once))


def _row(
    plan: Plan, claim: str, source: str, choices: Mapping[str, tuple[object, object]], system: FilterChoice
) -> Row:
    ((name, pair),) = choices.items()
    first, second = (replace(system, **{name: value}) for value in pair)  # type: ignore[arg-type]
    runs = plan.runs(RUNS, 4 * RUNS)
    difference = float(np.max(apart(plan, first, second, runs)))
    return Row(
        by="paper",
        claim=f"{claim}, {system.system.upper()}",
        expected="no difference",
        measured=f"{difference:.2g} sigma at most",
        value=difference,
        n=runs,
        threshold=f"{SAME:g} sigma",
        holds=difference < SAME,
        remark=source,
    )
