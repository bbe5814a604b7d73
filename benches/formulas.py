"""From a curve to formulas: functions outside the catalogue, and curves that no short formula describes.

python -m benches.formulas --seed 1801 --seeds 10 --d 20
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

import accelcal as ac
from accelcal.data.recording import Recording
from accelcal.diagnosis.select.curve_formulas import FormulaSet, HatGram, nodes_over, value_of
from accelcal.effects import CATALOGUE, find
from accelcal.estimation.estimate import solve_runs
from accelcal.simulation import CXL02_RIG
from accelcal.validation.prediction import Prediction, rms

Function = Callable[[np.ndarray], np.ndarray]
HORIZON = 5.0
"""Time without position, s."""
V, P, A = "shape_of_velocity", "shape_of_position", "shape_of_acceleration"


@dataclass(frozen=True)
class World:
    """A function that is hidden, and the elements of the grammar that it is made of."""

    curve: str
    function: Function
    elements: frozenset[str]
    inner: float | None = None


def world(curve: str, elements: str, function: Function, inner: float | None = None) -> World:
    """One world; `elements` separated by a plus sign."""
    return World(curve, function, frozenset(elements.split(" + ")), inner)


def scaled(curve: str, elements: str, shape: Function, d: float) -> World:
    """A function of x/d."""
    return world(curve, elements, lambda x: shape(x / d), d)


def decaying(u: np.ndarray) -> np.ndarray:
    """exp(-|u|)."""
    return np.exp(-np.abs(u))


WORLDS = {
    "v tanh": scaled(V, "change of sign within a width", np.tanh, 0.02),
    "v signed peak": scaled(V, "signed peak", lambda u: np.sign(u) * decaying(u), 0.03),
    "v peak": scaled(V, "peak", decaying, 0.03),
    "v signed root": world(V, "signed root", lambda v: np.sign(v) * np.sqrt(np.abs(v))),
    "v root": world(V, "root of the size", lambda v: np.sqrt(np.abs(v))),
    "v cube": world(V, "cube", lambda v: v**3),
    "v growth": scaled(V, "growth", np.exp, 0.05),
    "v resonance": scaled(V, "resonance", lambda u: 1.0 / (1.0 + u**2), 0.02),
    "v signed resonance": scaled(V, "signed resonance", lambda u: u / (1.0 + u**2), 0.02),
    "v tanh and drag": world(V, "change of sign within a width + linear", lambda v: np.tanh(v / 0.01) + 8.0 * v, 0.01),
    "v stribeck": world(V, "sign + signed peak", lambda v: np.sign(v) * (1.0 + 1.5 * decaying(v / 0.02)), 0.02),
    "p growth": scaled(P, "growth", np.exp, 0.006),
    "p decay": scaled(P, "decay", lambda u: np.exp(-u), 0.006),
    "p peak": scaled(P, "peak", decaying, 0.004),
    "p signed peak": scaled(P, "signed peak", lambda u: np.sign(u) * decaying(u), 0.004),
    "p resonance": scaled(P, "resonance", lambda u: 1.0 / (1.0 + u**2), 0.003),
    "p signed resonance": scaled(P, "signed resonance", lambda u: u / (1.0 + u**2), 0.003),
    "p tanh": scaled(P, "change of sign within a width", np.tanh, 0.003),
    "p cube": world(P, "cube", lambda p: p**3),
    "a tanh": scaled(A, "change of sign within a width", np.tanh, 0.5),
    "a signed root": world(A, "signed root", lambda a: np.sign(a) * np.sqrt(np.abs(a))),
    "a root": world(A, "root of the size", lambda a: np.sqrt(np.abs(a))),
    "a peak": scaled(A, "peak", decaying, 0.5),
    "a fourth power": world(A, "fourth power", lambda a: a**4),
}
"""24 functions outside the catalogue of effects."""


def bumps(curve: str, places: tuple[float, ...], width: float) -> World:
    """Several bumps of alternating sign at shares of the range: no short formula."""

    def function(x: np.ndarray) -> np.ndarray:
        u = (x - np.min(x)) / np.ptp(x)
        signs = [1.0, -0.7, 0.9, -1.1]
        return np.sum([s * np.exp(-(((u - c) / width) ** 2)) for s, c in zip(signs, places, strict=False)], axis=0)

    return World(curve, function, frozenset())


NONE = {
    "v bumps": bumps(V, (0.3, 0.42, 0.7), 0.05),
    "v four bumps": bumps(V, (0.25, 0.45, 0.55, 0.8), 0.05),
    "p bumps": bumps(P, (0.2, 0.35, 0.75), 0.07),
    "p four bumps": bumps(P, (0.15, 0.4, 0.6, 0.85), 0.06),
}


def record(rng: np.random.Generator, law: World, size: float) -> Recording:
    """A record with the function in its output."""
    simulation = ac.simulate("interleaved", seconds=60.0, rig=CXL02_RIG, parameters={"bias": 0.05}, rng=rng)
    accel = simulation.recording.accel
    p, v, a, _ = simulation.truth.motion.derivatives(accel.t)
    y = accel.y + size * law.function({V: v, P: p, A: a}[law.curve])
    return replace(simulation.recording, accel=replace(accel, y=y), digest=f"{rng.integers(1 << 60)}")


def size_at(d: float, seed: int, law: World) -> float:
    """Size of the function at which it is d standard deviations, from a record without it."""
    run = record(np.random.default_rng(seed), law, 0.0)
    state = solve_runs(ac.Model.linear(), [run]).states[0]
    x = value_of(state.signals, find(law.curve))
    nodes = nodes_over(x)
    y = law.function(nodes)
    return d / float(np.sqrt(y @ HatGram(state, ac.Model.linear(), find(law.curve), nodes).G @ y))


def records(seed: tuple[int, ...], law: World, size: float) -> tuple[Recording, Recording]:
    """A record to learn from, and one that is held out."""
    run, other = (record(np.random.default_rng([*seed, k]), law, size) for k in range(2))
    return run, other


def answer(law: World, runs: tuple[Recording, Recording]) -> FormulaSet:
    """What the product says of one record."""
    run, other = runs
    return ac.formulas(ac.fit(run), run, law.curve, holdout=other)


def normalised(value: float, interval: tuple[float, float], truth: float) -> float:
    """Error over the half of a 68 % interval that points to the truth."""
    low, high = interval
    return (value - truth) / (value - low if truth < value else high - value)


def held_out_errors(law: World, runs: tuple[Recording, Recording], formula_set: FormulaSet) -> tuple[float, float]:
    """Drift after `HORIZON` on the record that is held out: with the first formula, and with the true function, m."""
    run, other = runs
    curve = find(law.curve)
    true = replace(
        curve,
        name="true_function",
        function=lambda s: law.function(value_of(s, curve)),
        shapes={},
        parts=("",),
        traits=replace(curve.traits, memory=True),
        family=None,
    )
    drifts = []
    for effect in (formula_set.formulas[0].effect("first_formula").effect, true):
        CATALOGUE[effect.name] = effect
        fit = ac.fit(run, ac.Model.linear().add(effect.name))
        drifts.append(rms(Prediction.of(fit, other).at_horizon(HORIZON).rezeroed) or 0.0)
        del CATALOGUE[effect.name]
    return drifts[0], drifts[1]


def main() -> None:
    """Print counts beside their bars."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seed", type=int, default=1801)
    asked.add_argument("--seeds", type=int, default=10)
    asked.add_argument("--d", type=float, default=20.0)
    given = asked.parse_args()
    inside = alone = wrong = total = 0
    sizes: list[int] = []
    z: list[float] = []
    errors: list[tuple[float, float]] = []
    for number, (name, law) in enumerate(WORLDS.items()):
        size, hits, singles, bad, first = size_at(given.d, number, law), 0, 0, 0, len(z)
        for k in range(given.seeds):
            runs = records((given.seed, number, k), law, size)
            results = answer(law, runs)
            forms = [frozenset(item.elements) for item in results.formulas]
            true = law.elements in forms
            hits, total = hits + true, total + 1
            singles += true and len(forms) == 1
            bad += len(forms) == 1 and not true
            sizes.append(len(forms))
            if true and law.inner is not None:
                item = results.formulas[forms.index(law.elements)]
                if item.inner is not None and item.inner_interval is not None:
                    z.append(normalised(item.inner, item.inner_interval, law.inner))
            if results.formulas:
                errors.append(held_out_errors(law, runs, results))
        inner = f", inner parameter off by {np.round(z[first:], 1).tolist()} sigma" if z[first:] else ""
        counts = f"true form in the set {hits}, alone {singles}, wrong alone {bad} of {given.seeds}"
        print(f"{name}: {counts}{inner}", flush=True)
        inside, alone, wrong = inside + hits, alone + singles, wrong + bad
    least = int(stats.binom.ppf(0.025, total, 0.8))
    print(f"d = {given.d:g}: true form in the set {inside} of {total} (80 %: least {least}), alone {alone}")
    print(f"a wrong formula alone: {wrong} of {total} (1 %: at most {int(stats.binom.ppf(0.975, total, 0.01))})")
    print(f"formulas in a set: median {np.median(sizes):g} (3), 90 % quantile {np.quantile(sizes, 0.9):g} (8)")
    print(f"inner parameter: z rms {np.sqrt(np.mean(np.square(z))):.2f} of {len(z)} (0.8 to 1.2)")
    formula, true = np.array(errors).T
    ratio = float(np.sqrt(np.mean(formula**2) / np.mean(true**2)))
    print(
        f"held-out drift after {HORIZON:g} s, the first formula over the true function, rms over {len(errors)}: "
        f"{ratio:.3f} (at most 1.05); each alone: median {np.median(formula / true):.3f}, within 5 % "
        f"{int(np.sum(formula < 1.05 * true))} of {len(errors)}"
    )
    for number, (name, law) in enumerate(NONE.items()):
        size = size_at(3.0 * given.d, number, law)
        results = [answer(law, records((given.seed, 100 + number, k), law, size)) for k in range(given.seeds)]
        empty = sum(not item.formulas for item in results)
        print(f"{name} at {3 * given.d:g}: no short formula in {empty} of {given.seeds}", flush=True)


if __name__ == "__main__":
    main()
