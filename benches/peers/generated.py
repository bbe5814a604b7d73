"""Straight-line C++ that symbolic algebra wrote: a dense filter's step as its zeros and common subexpressions leave it.

SymPy unrolls RK2 and RK4, keeps the upper triangle of P and the short update; nothing in it knows our block scheme. The
program is built with -O3 for AVX-512VL where the processor has it, for AVX2 and FMA elsewhere.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache

import sympy
from sympy import Expr, Matrix, Symbol

from benches.peers import native
from benches.peers.workload import DT, JERK, R_OUTPUT, R_POSITION, WORKLOADS, Data, Ended, Q, Workload

NAME = f"SymPy {sympy.__version__}, generated C++"
STEPS = {"W1": 20_000, "W2": 20_000, "W3": 20_000, "W4": 20_000}
Assignments = list[tuple[Expr, Expr]]
dt, q, jerk, u, u0, um, z, S = sympy.symbols("dt q jerk u u0 um z S")
r_position, r_output = sympy.symbols("r_position r_output")


def prepare(workload: Workload, data: Data) -> Callable[[], Ended]:
    """The run over a record."""
    return native.run([program(), str(workload.number)], data)


@cache
def program() -> str:
    """The program of all four workloads."""
    works = [function(workload) for workload in WORKLOADS[:4]]
    main = "int main(int count, char** arguments) { return run(count, arguments, {w1, w2, w3, w4}); }\n"
    source = native.TARGET / "generated.cpp"
    source.parent.mkdir(parents=True, exist_ok=True)
    source.write_text('#include "record.hpp"\n' + "\n".join([*works, main]), encoding="utf-8")
    march = "x86-64-v4" if native.has_avx512vl() else "x86-64-v3"
    return native.cpp("generated", source, march, "-I", str(native.HERE))


def function(workload: Workload) -> str:
    """C++ from a record to x and the diagonal of P."""
    x = Matrix(sympy.symbols(f"x:{workload.states}"))
    P = Matrix(workload.states, workload.states, lambda i, j: Symbol(f"P{min(i, j)}{max(i, j)}"))
    step = aci(workload, x, P) if workload.system == "aci" else cwpa(workload, x, P)
    position = Matrix([[1, *[0] * (workload.states - 1)]])
    read = update(x, P, position, z - x[0], r_position)
    variances = [f"{P[i, i]} = {float(workload.P0[i, i])!r};" for i in range(workload.states)]
    declared = ", ".join(f"{name} = 0.0" for name in [*x, *sorted(set(P), key=str)])
    ended = ", ".join(map(str, [*x, *P.diagonal()]))
    return (
        f"std::vector<double> w{workload.number}(const Data& data) {{\n"
        f"constexpr double dt = {DT!r}, q = {Q!r}, jerk = {JERK!r};\n"
        f"constexpr double r_position = {R_POSITION!r}, r_output = {R_OUTPUT!r};\n"
        f"double {declared};\n{''.join(variances)}\n"
        "for (std::size_t j = 1; j < data.u.size(); ++j) {\n"
        "const double u0 = data.u[j - 1], u = data.u[j], um = 0.5 * (u0 + u), z = data.z[j];\n"
        f"{step}if (!std::isnan(z)) {read}}}\nreturn {{{ended}}};\n}}\n"
    )


def aci(workload: Workload, x: Matrix, P: Matrix) -> str:
    """A step of x and P: midpoint rule for W1, the classical one for W2."""

    def moved(h: Expr, *rates: Matrix) -> tuple[Matrix, Matrix]:
        return x + rates[0] * h, P + rates[1] * h

    first = rates(x, P, u0)
    second = rates(*moved(dt / 2, *first), um)
    if workload.order == 1:
        return assigned(x, P, *moved(dt, *second))
    third = rates(*moved(dt / 2, *second), um)
    fourth = rates(*moved(dt, *third), u)
    four = zip(first, second, third, fourth, strict=True)
    return assigned(x, P, *moved(dt / 6, *(a + 2 * b + 2 * c + d for a, b, c, d in four)))


def rates(x: Matrix, P: Matrix, u: Expr) -> tuple[Matrix, Matrix]:
    """x' and P' of the ACI system (9), first or second order."""
    states, w = len(x), u - x[3]
    K2, K3 = (x[4], x[5]) if states == 6 else (0, 0)
    F, hessian = sympy.zeros(states), sympy.zeros(states)
    F[0, 1], F[1, 2], F[1, 3] = 1, -w, -(1 - x[2] + 2 * K2 * w + 3 * K3 * w**2)
    if states == 6:
        F[1, 4], F[1, 5] = w**2, w**3
        hessian[3, 3], hessian[2, 3] = 2 * K2 + 6 * K3 * w, 1
        hessian[3, 4], hessian[3, 5] = -2 * w, -3 * w**2
        hessian[3, 2], hessian[4, 3], hessian[5, 3] = 1, -2 * w, -3 * w**2
    a = (1 - x[2]) * w + K2 * w**2 + K3 * w**3 + sympy.expand((hessian * P).trace() / 2)
    FP = F * P
    dP = FP + FP.T
    dP[1, 1] += q
    return Matrix([x[1], a, *[0] * (states - 2)]), dP


def cwpa(workload: Workload, x: Matrix, P: Matrix) -> str:
    """Prediction, and the output's reading."""
    F, noise = sympy.eye(len(x)), sympy.zeros(len(x))
    F[0, 1] = F[1, 2] = dt
    F[0, 2] = dt**2 / 2
    for i in range(3):
        for j in range(3):
            power = 5 - i - j
            noise[i, j] = jerk * dt**power / (power * sympy.factorial(2 - i) * sympy.factorial(2 - j))
    predicted = assigned(x, P, F * x, F * P * F.T + noise)
    a = x[2]
    expected = x[4] + (1 + x[3]) * a + (x[5] * a**2 + x[6] * a**3 if workload.parameters == 4 else 0)
    H, extra = Matrix([[sympy.diff(expected, s) for s in x]]), sympy.Integer(0)
    if workload.order == 2:
        spread = sympy.hessian(expected, list(x)) * P
        expected, extra = expected + spread.trace() / 2, (spread * spread).trace() / 2
    return predicted + update(x, P, H, u - expected, r_output + extra)


def update(x: Matrix, P: Matrix, H: Matrix, e: Expr, R: Expr) -> str:
    """A scalar reading, short form."""
    PHt = P * H.T
    inverse = Symbol("inverse")
    variance = lines([(S, (H * PHt)[0] + R)])
    corrected = assigned(x, P, x + PHt * (inverse * e), P - PHt * PHt.T * inverse)
    return f"{{double S;\n{variance}const double inverse = 1.0 / S;\n{corrected}}}\n"


def assigned(x: Matrix, P: Matrix, new_x: Matrix, new_P: Matrix) -> str:
    """Assignments of what changes, P by its upper triangle."""
    pairs = list(zip(x, new_x, strict=True)) + [(P[i, j], new_P[i, j]) for i in range(len(x)) for j in range(i, len(x))]
    return lines([(name, value) for name, value in pairs if name != value])


def lines(pairs: Assignments) -> str:
    """C++ of assignments that all read what was there before, common subexpressions first."""
    shared, values = sympy.cse([value for _, value in pairs], symbols=sympy.numbered_symbols("t"))
    text = [f"const double {name} = {c(value)};" for name, value in shared]
    text += [f"const double new_{name} = {c(value)};" for (name, _), value in zip(pairs, values, strict=True)]
    text += [f"{name} = new_{name};" for name, _ in pairs]
    return "{" + "\n".join(text) + "}\n"


def c(value: Expr) -> str:
    """C++ of a formula, powers as products."""
    return re.sub(
        r"pow\((\w+), (\d)\)", lambda power: "(" + "*".join([power[1]] * int(power[2])) + ")", sympy.ccode(value)
    )
