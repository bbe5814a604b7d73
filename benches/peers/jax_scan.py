"""JAX: `lax.scan` over pairs of steps, compiled, in f64 on one thread; W5 is its `vmap`."""

from __future__ import annotations

import os

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from benches.peers.workload import DT, R_OUTPUT, R_POSITION, Data, Ended, Q, Workload, timed, transition

jax.config.update("jax_enable_x64", True)

NAME = f"JAX {jax.__version__}, lax.scan"
STEPS = {"W1": 20_000, "W2": 20_000, "W3": 20_000, "W4": 20_000, "W5": 1000}

Belief = tuple[Any, Any]


def prepare(workload: Workload, data: Data) -> Callable[[], Ended]:
    """The run over a record, compiled before it is timed."""
    u, z = jnp.asarray(data.u), jnp.asarray(data.z)
    step = lambda u, z: follow(workload, u, z)  # noqa: E731
    run = jax.jit(jax.vmap(step) if workload.runs > 1 else step).lower(u, z).compile()
    return timed(lambda: tuple(np.asarray(a) for a in run(u, z)))


def follow(workload: Workload, u: Any, z: Any) -> Belief:
    """x and the diagonal of P after the last sample."""
    step = aci if workload.system == "aci" else cwpa(workload)
    position = jnp.eye(workload.states)[0]

    def pair(belief: Belief, given: Any) -> tuple[Belief, None]:
        u0, u1, u2, z2 = given
        x, P = step(workload, *step(workload, *belief, u0, u1), u1, u2)
        return update(x, P, position, z2 - x[0], R_POSITION), None

    start = (jnp.zeros(workload.states), jnp.asarray(workload.P0))
    (x, P), _ = lax.scan(pair, start, (u[0:-2:2], u[1:-1:2], u[2::2], z[2::2]))
    return x, jnp.diagonal(P)


def aci(workload: Workload, x: Any, P: Any, u0: Any, u1: Any) -> Belief:
    """A step of x and P: midpoint rule for W1, the classical one for W2."""
    um = 0.5 * (u0 + u1)
    dx1, dP1 = rates(workload, x, P, u0)
    dx2, dP2 = rates(workload, x + 0.5 * DT * dx1, P + 0.5 * DT * dP1, um)
    if workload.order == 1:
        return x + DT * dx2, P + DT * dP2
    dx3, dP3 = rates(workload, x + 0.5 * DT * dx2, P + 0.5 * DT * dP2, um)
    dx4, dP4 = rates(workload, x + DT * dx3, P + DT * dP3, u1)
    return x + DT / 6.0 * (dx1 + 2.0 * dx2 + 2.0 * dx3 + dx4), P + DT / 6.0 * (dP1 + 2.0 * dP2 + 2.0 * dP3 + dP4)


def acceleration(workload: Workload, x: Any, u: Any) -> Any:
    """The inverse sensor model (5)(6)."""
    w = u - x[3]
    linear = (1.0 - x[2]) * w
    return linear + x[4] * w**2 + x[5] * w**3 if workload.parameters == 4 else linear


def rates(workload: Workload, x: Any, P: Any, u: Any) -> Belief:
    """x' and P' of the ACI system (9), first or second order."""
    w = u - x[3]
    slope = 1.0 - x[2]
    row = jnp.zeros(workload.states).at[2].set(-w)
    if workload.parameters == 4:
        slope = slope + 2.0 * x[4] * w + 3.0 * x[5] * w**2
        row = row.at[4].set(w**2).at[5].set(w**3)
    row = row.at[3].set(-slope)
    a = acceleration(workload, x, u)
    if workload.order == 2:
        hessian = (
            jnp.zeros_like(P)
            .at[3, 3].set(2.0 * x[4] + 6.0 * x[5] * w)
            .at[2, 3].set(1.0).at[3, 2].set(1.0)
            .at[3, 4].set(-2.0 * w).at[4, 3].set(-2.0 * w)
            .at[3, 5].set(-3.0 * w**2).at[5, 3].set(-3.0 * w**2)
        )  # fmt: skip
        a = a + 0.5 * jnp.sum(hessian * P)
    F = jnp.zeros_like(P).at[0, 1].set(1.0).at[1].set(row)
    FP = F @ P
    dx = jnp.zeros_like(x).at[0].set(x[1]).at[1].set(a)
    return dx, (FP + FP.T).at[1, 1].add(Q * slope**2 if workload.public else Q)


def cwpa(workload: Workload) -> Callable[..., Belief]:
    """Prediction and the output's reading as one step."""
    F, noise = (jnp.asarray(part) for part in transition(workload))

    def sensed(x: Any) -> Any:
        linear = x[4] + (1.0 + x[3]) * x[2]
        return linear + x[5] * x[2] ** 2 + x[6] * x[2] ** 3 if workload.parameters == 4 else linear

    def step(workload: Workload, x: Any, P: Any, u0: Any, u1: Any) -> Belief:
        x, P = F @ x, F @ P @ F.T + noise
        expected, R = sensed(x), R_OUTPUT
        if workload.order == 2:
            spread = jax.hessian(sensed)(x) @ P
            expected = expected + 0.5 * jnp.trace(spread)
            R = R + 0.5 * jnp.sum(spread * spread.T)
        return update(x, P, jax.grad(sensed)(x), u1 - expected, R)

    return step


def update(x: Any, P: Any, H: Any, e: Any, R: Any) -> Belief:
    """A scalar reading, Joseph form."""
    PHt = P @ H
    gain = PHt / (H @ PHt + R)
    IKH = jnp.eye(len(x)) - jnp.outer(gain, H)
    return x + gain * e, IKH @ P @ IKH.T + R * jnp.outer(gain, gain)
