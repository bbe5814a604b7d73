"""The paper's suboptimal design (IV, [4]): parameters estimated, considered (Schmidt-Kalman), or ignored.

Two worlds on records that end after a second without position. In one the scale factor varies, the paper's first guess
at its open question; in the other K2 and K3 are constants drawn from their prior. What a filter states about position
and velocity is judged by NEES, what it reaches by the position error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import Recording
from accelcal.data.rig import Rig
from accelcal.filters.choice import FilterChoice, GaussMarkov
from accelcal.paper.rows import ALPHA, SIGMAS, Item, Plan, Row, paired
from accelcal.paper.tuning import ACI, PLAIN_ADXL105, PLAIN_CXL02, filtered, prior_sigmas, start, tuned
from accelcal.paper.varying import SIGMA, TAU, varied
from accelcal.simulation.sensor import Simulated, simulate
from accelcal.validation.consistency import Consistency, consistency, nees

SEEN, GAP = 20.0, 1.0
"""Time with position and then without, s."""
CURVATURE_SIGMAS = (1e-3, 1e-4)
"""Prior of K2 and K3 in the second world, (m/s²)⁻¹ and (m/s²)⁻²."""
PROCESS = {"k": GaussMarkov(q=2.0 * SIGMA**2 / TAU, tau=TAU)}
"""The scale factor of the first world, as its filters know it."""
KNOWN = 1e-9
"""Standard deviation of a parameter that a filter takes as known."""


@dataclass(frozen=True, slots=True)
class Design:
    """One way to treat the uncertain parameters."""

    choice: FilterChoice
    sigmas: Mapping[str, float]
    """Prior of the uncertain parameters that the filter carries."""
    processes: Mapping[str, GaussMarkov] | None = None


@dataclass(frozen=True, slots=True)
class Reached:
    """One design over n records."""

    errors: Array
    """(n,) m: absolute position error after the gap."""
    consistency: Consistency
    """Of position and velocity there."""

    @property
    def rms(self) -> float:
        """Position error, m."""
        return float(np.sqrt(np.mean(self.errors**2)))


LINEAR = replace(ACI, interpolation="cubic")
CUBIC = replace(LINEAR, model="cubic")
SCALE_DESIGNS: Mapping[str, Design] = {
    "estimated as constant": Design(LINEAR, {"k": SIGMA}),
    "considered": Design(replace(LINEAR, consider=("k",)), {"k": SIGMA}, PROCESS),
    "ignored": Design(LINEAR, {"k": KNOWN}),
    "estimated": Design(LINEAR, {"k": SIGMA}, PROCESS),
}
"""The varying scale factor."""
CURVATURE_DESIGNS: Mapping[str, Design] = {
    "estimated": Design(CUBIC, dict(zip(("K2", "K3"), CURVATURE_SIGMAS, strict=True))),
    "considered": Design(replace(CUBIC, consider=("K2", "K3")), dict(zip(("K2", "K3"), CURVATURE_SIGMAS, strict=True))),
    "ignored": Design(LINEAR, {}),
}
"""Constant K2 and K3."""


def consider_item(plan: Plan) -> Item:
    """Consistency and error of every design in both worlds."""
    runs = plan.runs(12, 60)
    scale = reached(plan, "consider scale", PLAIN_ADXL105, SCALE_DESIGNS, runs)
    curvature = reached(plan, "consider curvature", PLAIN_CXL02, CURVATURE_DESIGNS, runs)
    varies, constant = f"k varies by {SIGMA:g} within {TAU:g} s", "K2, K3 constant and unknown"
    return Item(
        name="consider",
        title=f"Uncertain parameters considered (Schmidt-Kalman), estimated or ignored: {GAP:g} s without position",
        source="IV, [4]",
        rows=(
            _nees_row(f"{varies}, considered: consistent", scale["considered"], "consistent"),
            _nees_row(f"{varies}, estimated as a process: consistent", scale["estimated"], "consistent"),
            _nees_row(
                f"{varies}, estimated as constant: overconfident", scale["estimated as constant"], "overconfident"
            ),
            _nees_row(f"{varies}, ignored: overconfident", scale["ignored"], "overconfident"),
            _error_row("the suboptimal design tracks better, k varies", scale, "estimated as constant"),
            _nees_row(f"{constant}, considered: consistent", curvature["considered"], "consistent"),
            _nees_row(f"{constant}, estimated: consistent", curvature["estimated"], "consistent"),
            _nees_row(f"{constant}, ignored: overconfident", curvature["ignored"], "overconfident"),
            _error_row("the suboptimal design tracks better, K2 and K3 constant", curvature, "ignored"),
        ),
    )


def reached(plan: Plan, world: str, rig: Rig, designs: Mapping[str, Design], runs: int) -> dict[str, Reached]:
    """Every design on the same records; the world is that of the scale factor if no design is cubic."""
    curved = any(design.choice.model == "cubic" for design in designs.values())

    def once(rng: np.random.Generator) -> list[tuple[float, float]]:
        made = record(rng, rig, curved=curved)
        seen = cut(made.recording)
        return [judged(design, made, seen, rig) for design in designs.values()]

    values = np.array(plan.repeat(world, runs, once))
    return {
        name: Reached(values[:, i, 0], consistency(values[:, i, 1], 2, 1.0 - ALPHA)) for i, name in enumerate(designs)
    }


def record(rng: np.random.Generator, rig: Rig, *, curved: bool) -> Simulated:
    """A record of one world."""
    K2, K3 = CURVATURE_SIGMAS * rng.standard_normal(2) if curved else (0.0, 0.0)
    sensor = {"bias": 0.05, "quadratic": K2, "cubic": K3}
    made = simulate("tones", seconds=SEEN + GAP, rig=rig, parameters=sensor, rng=rng, position_noise=0.0)
    return made if curved else varied(made, rng)


def cut(recording: Recording) -> Recording:
    """Without the positions of the last second."""
    position = recording.position
    seen = position.t < SEEN
    return replace(recording, position=replace(position, t=position.t[seen], y=position.y[seen]))


def judged(design: Design, made: Simulated, seen: Recording, rig: Rig) -> tuple[float, float]:
    """Position error (m) and NEES of position and velocity at the end."""
    choice, truth = design.choice, made.truth
    sigmas = dict(zip(choice.states(), prior_sigmas(choice), strict=True)) | dict(design.sigmas)
    prior = np.array(list(sigmas.values()))
    track = filtered(choice, seen, tuned(truth, rig), start(choice, truth), prior, parameters=design.processes)
    error = track.states[-1, :2] - truth.motion.derivatives(track.times[-1:])[:2, 0]
    return abs(float(error[0])), float(nees(error, track.covariance[:2, :2]))


def _nees_row(claim: str, found: Reached, verdict: str) -> Row:
    low, high = found.consistency.low, found.consistency.high
    return Row(
        by="us",
        claim=claim,
        expected="2" if verdict == "consistent" else f"above {high:.2f}",
        measured=f"NEES of p, v {found.consistency.mean:.3g}; position error {1e3 * found.rms:.3g} mm rms",
        value=found.consistency.mean,
        n=found.consistency.runs,
        threshold=f"{1.0 - ALPHA:.1%} region {low:.2f} to {high:.2f}",
        holds=found.consistency.verdict == verdict,
    )


def _error_row(claim: str, found: Mapping[str, Reached], rival: str) -> Row:
    pair = paired(found["considered"].errors, found[rival].errors)
    best = found["estimated"].rms
    return Row(
        by="paper",
        claim=claim,
        expected=f"considered below {rival}",
        measured=(
            f"{1e3 * found['considered'].rms:.3g} mm against {1e3 * found[rival].rms:.3g} mm ({pair.verdict}); "
            f"estimated {1e3 * best:.3g} mm"
        ),
        value=pair.ratio,
        n=len(found[rival].errors),
        threshold=f"2 % and {SIGMAS:.2f} sigma (mean log ratio is {pair.deviate:+.1f} sigma)",
        holds=pair.verdict == "smaller",
        remark="it makes the stated uncertainty true, not the error small (derivations 5.2)",
    )
