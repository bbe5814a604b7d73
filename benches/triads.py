"""Three outputs on a body that turns: what is named with nothing missing, whether an effect that is hidden on one axis
is found on that axis, and how right the estimates are.

From the top of the repository: python -m benches.triads [--records 100] [--seed 1] [--out build/triads]
The records come from `tests/estimation/triads.py`, which turns and differentiates frames. Of so many records each, 3 in
5 have an effect hidden at d = 20, and twice as many are fitted for the consistency of the estimates. Outcomes are kept
in OUT, a line each, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.signal import lfilter
from scipy.stats import chi2

from accelcal import io, verbs
from accelcal.data import Array
from accelcal.model import Model
from benches.outcomes import Outcome, Trial, guarded, run_all
from tests.estimation.triads import Triad

STEP = 0.005
"""Of the records, s."""


def play(f: Array, width: float) -> Array:
    """Play of a half width about a series."""
    at, path = f[0], np.empty_like(f)
    for k, x in enumerate(f.tolist()):
        at = min(max(at, x - width), x + width)
        path[k] = at
    return path


LAWS: dict[str, tuple[Callable[[Array, Array, Array], Array], dict[str, float]]] = {
    "quadratic": (lambda t, f, warm: f**2, {}),
    "cubic": (lambda t, f, warm: f**3, {}),
    "odd_quadratic": (lambda t, f, warm: f * np.abs(f), {}),
    "scale_asymmetry": (lambda t, f, warm: np.abs(f), {}),
    "bias_step": (lambda t, f, warm: (t > 33.0).astype(float), {"instant": 33.0}),
    "scale_step": (lambda t, f, warm: f * (t > 27.0), {"instant": 27.0}),
    "bias_drift": (lambda t, f, warm: t - 30.0, {}),
    "scale_drift": (lambda t, f, warm: f * (t - 30.0), {}),
    "hysteresis": (lambda t, f, warm: play(f, 2.0), {"width": 2.0}),
    "creep": (lambda t, f, warm: lfilter([STEP / 4.0], [1.0, STEP / 4.0 - 1.0], f), {"tau": 4.0, "start": 0.0}),
    "temperature_bias": (lambda t, f, warm: warm - 30.0, {}),
    "temperature_scale": (lambda t, f, warm: f * (warm - 30.0), {}),
}
"""By effect: its law, with a coefficient of one, and the shape parameters at which it is that."""
NEES: dict[str, dict[str, float]] = {
    "nees": {},
    "noisy attitude": {"attitude_noise": 1e-3},
    "carried attitude": {"attitude_noise": 1e-3, "gyroscope": 2e-3, "every": 2},
}
"""Records whose errors are compared with the stated uncertainties: by kind, how they are drawn."""
D = 20.0
MOST_NULLS, LEAST_HIDDEN = 0.03, 0.95
"""Share of nulls in which something may be named, and of hidden effects that must be in a class on their axis alone."""
ALPHA = 0.01
PARAMETERS = 24


def outcome_of(trial: Trial) -> Outcome:
    """Draw, write, read, and fit or diagnose."""
    outcome: Outcome = {"key": trial.key, "kind": trial.kind}
    drawn = partial(
        Triad, 1000 * trial.seed + trial.number, hidden=trial.number % 3, warms=True, **NEES.get(trial.kind, {})
    )
    with tempfile.TemporaryDirectory() as name:
        folder, law = Path(name), None
        if trial.kind in LAWS:
            column, shape = LAWS[trial.kind]
            axis = "xyz"[trial.number % 3]
            effect = f"{trial.kind}_on_{axis}"
            model = Model.linear().add(effect, shapes={effect: shape} if shape else None)
            model = model.freeze(**{f"{effect}.{key}": value for key, value in shape.items()})
            quiet = verbs.fit(io.load_axes(drawn().write(folder)), model)
            size = D * quiet[effect].std
            outcome |= {"size": size, "axis": axis}
            law = lambda t, f, warm: size * column(t, f, warm)  # noqa: E731
        triad = drawn(law=law)
        axes = io.load_axes(triad.write(folder))
        fit = verbs.fit(axes)
        if trial.kind in NEES:
            truth = triad.true_values()
            errors = np.array([e.value - truth[e.name, e.axis] for e in fit.free])
            z = errors / np.sqrt(np.diag(fit.covariance))
            return outcome | {"nees": float(errors @ np.linalg.solve(fit.covariance, errors)), "z": z.tolist()}
        judged = verbs.diagnose(fit, axes)
    classes = {
        axis: sorted({m for tie in of.classes if tie.effect != "time_offset" for m in (tie.effect, *tie.members)})
        for axis, of in zip(judged.axes, judged.by_axis, strict=True)
    }
    return outcome | {"classes": classes, "effects": list(judged.effects), "sentence": judged.sentence}


def named(outcome: Outcome) -> list[str]:
    """Names beyond a delay, which every such sensor has."""
    return [name for name in outcome["effects"] if not name.startswith("time_offset")]


def right(outcome: Outcome) -> bool:
    """Whether what was hidden is in a class on its axis, and nothing is on the others."""
    return outcome["kind"] in outcome["classes"][outcome["axis"]] and not any(
        members for axis, members in outcome["classes"].items() if axis != outcome["axis"]
    )


def null(outcome: Outcome) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger, where nothing was hidden."""
    return ("triads", "", named(outcome)) if outcome["kind"] == "null" and "effects" in outcome else None


def report(outcomes: Sequence[Outcome]) -> bool:
    """Print figure, count and threshold of every claim; whether all hold."""
    failed = [o for o in outcomes if "error" in o]
    for o in failed:
        print(f"{o['key']}: {o['error'].splitlines()[-1]}")
    whole = [o for o in outcomes if "error" not in o]
    nulls, hidden = ([o for o in whole if o["kind"] in kinds] for kinds in (("null",), LAWS))
    wrong, lost = [o for o in nulls if named(o)], [o for o in hidden if not right(o)]
    for o in (*wrong, *lost):
        print(f"  {o['key']} ({o.get('axis', '')}): {o['classes']}: {o['sentence']}")
    print(f"nulls: {len(wrong)} of {len(nulls)} named something (at most {MOST_NULLS:.0%})")
    print(
        f"hidden at d = {D:g}: {len(hidden) - len(lost)} of {len(hidden)} on their axis (at least {LEAST_HIDDEN:.0%})"
    )
    consistent = True
    for kind in NEES:
        of_fits = [o for o in whole if o["kind"] == kind]
        n = max(1, len(of_fits))
        low, high = chi2.ppf([ALPHA / 2.0, 1.0 - ALPHA / 2.0], PARAMETERS * n) / n
        mean = float(np.mean([o["nees"] for o in of_fits])) if of_fits else float(PARAMETERS)
        print(f"{kind}: NEES {mean:.2f} of {PARAMETERS} over {n} fits (99 %: {low:.2f} to {high:.2f})")
        if of_fits:
            print("rms z", " ".join(f"{z:.2f}" for z in np.sqrt(np.mean(np.square([o["z"] for o in of_fits]), axis=0))))
        consistent &= low <= mean <= high
    held = len(wrong) <= MOST_NULLS * len(nulls) and len(hidden) - len(lost) >= LEAST_HIDDEN * len(hidden)
    return held and consistent and not failed


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=100, help="nulls; 3 in 5 as many with an effect, twice for NEES")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/triads"))
    wanted = parser.parse_args(arguments)
    kinds = tuple(LAWS)
    trials = [Trial(kinds[n % len(kinds)], n, wanted.seed) for n in range(3 * wanted.records // 5)]
    trials += [Trial("null", n, wanted.seed) for n in range(wanted.records)]
    for kind, share in zip(NEES, (2.0, 0.2, 0.2), strict=True):
        trials += [Trial(kind, n, wanted.seed) for n in range(int(share * wanted.records))]
    outcomes = run_all(partial(guarded, outcome_of), trials, wanted.out / "triads.jsonl", wanted.workers, null)
    return 0 if report(outcomes) else 1


if __name__ == "__main__":
    raise SystemExit(main())
