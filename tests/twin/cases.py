"""Models and records drawn by hypothesis, handed to both twins."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from accelcal import filters
from accelcal.data.recording import Channel
from tests.twin import reference

Array = np.ndarray
SIGMA = {"p": 1e-5, "v": 3e-3, "a": 3.0, "y": 3.0, "k": 0.02, "K0": 0.1, "K2": 1e-4, "K3": 1e-5}


@dataclass(frozen=True)
class Case:
    """One filter and one record, in the words of both twins."""

    choice: filters.FilterChoice
    settings: dict[str, Any]
    accel: Channel
    position: Channel

    def run(self, **more: Any) -> filters.FilterRun:
        return filters.run(self.choice, self.accel, self.position, **self.settings, **more)

    def twin(self) -> reference.Twin:
        choice, given = self.choice, self.settings
        processes = [given["parameters"].get(name) for name in filters.PARAMETERS["cubic"]]
        return reference.Twin(
            choice.system,
            choice.form,
            choice.interpolation,
            choice.integrator,
            choice.order,
            choice.carrier,
            q=given["q"],
            r_position=given["r_position"],
            r_accel=given["r_accel"] or 0.0,
            q_output=given["q_accel"] or 0.0,
            tau=given["tau"],
            rates=tuple(0.0 if w is None else 1 / w.tau for w in processes),
            drifts=tuple(0.0 if w is None else w.q for w in processes),
            gate=math.inf if given["gate"] is None else given["gate"],
            consider=tuple(choice.states(low_pass=given["tau"] != 0).index(name) for name in choice.consider),
        )

    def run_reference(self) -> reference.TwinRun:
        x0, P0 = self.settings["x0"], self.settings["P0"]
        return reference.run(self.twin(), x0, P0, self.accel.t, self.accel.y, self.position.t, self.position.y)


@st.composite
def cases(draw: st.DrawFn, **fixed: Any) -> Case:
    """A case with the fields of `FilterChoice` in `fixed` given and everything else drawn.

    `consider=True` draws at least one consider parameter; otherwise there is none.
    """

    def pick(name: str, *values: Any) -> Any:
        return fixed[name] if name in fixed else draw(st.sampled_from(values))

    choice = filters.FilterChoice(
        system=pick("system", "aci", "cwpa"),
        model=pick("model", "linear", "cubic"),
        form=pick("form", "inverse", "forward"),
        interpolation=pick("interpolation", "hold", "linear", "cubic"),
        integrator=pick("integrator", "rk2", "rk4", "exact"),
        order=pick("order", 1, 2),
        carrier=pick("carrier", "dense", "factored"),
    )
    if fixed.get("consider"):
        held = draw(st.lists(st.sampled_from(filters.PARAMETERS[choice.model]), min_size=1, unique=True))
        choice = replace(choice, consider=tuple(held))
    low_pass = pick("low_pass", False, True)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    names = choice.states(low_pass=low_pass)
    # A gap would blow up Runge-Kutta behind a low-pass, and a cubic through noise of close samples.
    explosive = low_pass and choice.integrator != "exact"
    accel, position, truth = record(draw, rng, even=explosive or choice.interpolation == "cubic")

    diffuse = {name: 10.0 ** draw(st.integers(-1, 1)) for name in ("v", "k", "K0", "K2", "K3")}
    sigma = np.array([SIGMA[name] * diffuse.get(name, 1.0) for name in names])
    mean = np.array([truth.get(name, 0.0) for name in names])
    correlation = random_correlation(rng, len(names))
    settings = {
        "q": {"aci": 1e-5, "cwpa": 1e3}[choice.system] * 10.0 ** draw(st.integers(-1, 1)),
        "r_position": 10.0 ** draw(st.integers(-12, -10)),
        "r_accel": 10.0 ** draw(st.integers(-5, -3)) if choice.system == "cwpa" else None,
        "q_accel": 1e-6 if choice.system == "cwpa" and low_pass else None,
        "x0": mean + sigma * rng.normal(size=len(names)) * 0.5,
        "P0": correlation * np.outer(sigma, sigma),
        "tau": 1e-3 if low_pass else 0.0,
        "parameters": draw(gauss_markov(choice.model)),
        "gate": draw(st.sampled_from([None, None, 4.0])),
    }
    return Case(choice, settings, accel, position)


def record(draw: st.DrawFn, rng: np.random.Generator, *, even: bool) -> tuple[Channel, Channel, dict[str, float]]:
    """Two irregular clocks with gaps and ties over the same motion; no gap if they must be even."""
    steps = st.sampled_from([3e-4, 6e-4, 1.2e-3] if even else [3e-4, 6e-4, 1.2e-3, 3e-3, 8e-3])
    t_u = np.cumsum(np.array(draw(st.lists(steps, min_size=2, max_size=14))) * rng.uniform(0.9, 1.1)) + 3.0
    early, late = t_u[0] - 5e-4, t_u[-1] + 5e-4
    t_z = np.unique(rng.uniform(early, late, draw(st.integers(1, 8))))
    if draw(st.booleans()):
        t_z = np.unique(np.concatenate([t_z, t_u[::2]]))
    w, A = 2 * math.pi * rng.uniform(2, 15), rng.uniform(1, 10)
    a = A * np.sin(w * t_u)
    u = 0.05 + 1.01 * a - 1e-4 * a**2 + 1e-5 * a**3 + rng.normal(0, 1e-2, len(t_u))
    z = -A / w**2 * np.sin(w * t_z) + rng.normal(0, 1e-6, len(t_z))
    start = min(t_u[0], t_z[0])
    truth = {"p": -A / w**2 * math.sin(w * start), "v": -A / w * math.cos(w * start), "a": A * math.sin(w * start)}
    return Channel("accel", t_u, u, "m/s²"), Channel("position", t_z, z, "m"), truth


@st.composite
def gauss_markov(draw: st.DrawFn, model: str) -> dict[str, filters.GaussMarkov]:
    """Some parameters are random walks, some Gauss-Markov, most constant."""
    kinds = st.sampled_from(["constant", "constant", "constant", "walk", "markov"])
    chosen = {name: draw(kinds) for name in filters.PARAMETERS[model]}
    taus = {"walk": math.inf, "markov": 2.0}
    return {
        n: filters.GaussMarkov(q=1e-2 * SIGMA[n] ** 2, tau=taus[kind]) for n, kind in chosen.items() if kind in taus
    }


def random_correlation(rng: np.random.Generator, n: int) -> Array:
    """A correlation matrix well inside the cone."""
    A = np.eye(n) + 0.3 * rng.normal(size=(n, n))
    C = A @ A.T
    d = np.sqrt(np.diag(C))
    return C / np.outer(d, d)
