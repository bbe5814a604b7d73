"""Predictions of the sensor models alone (paper II-B, II-B1, II-C): equations (7), (8) and the scale update."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from accelcal.data.recording import Channel
from accelcal.data.rig import STANDARD_GRAVITY, Mount
from accelcal.filters.choice import FilterChoice
from accelcal.filters.record import FilterRun
from accelcal.paper.rows import SIGMAS, Item, Plan, Row
from accelcal.paper.tuning import ACI, CWPA, PLAIN_CXL02, filtered, prior_sigmas, start, tuned
from accelcal.simulation.motion import Motion, Tones
from accelcal.simulation.sensor import Simulated, simulate

NOISE_FREE = replace(PLAIN_CXL02, sensor=replace(PLAIN_CXL02.sensor, noise=0.0), resolution=None)
SECONDS = 60.0
CORRECTED = "corrected"


def fourier_item(plan: Plan) -> Item:
    """Fourier coefficients (8) of the output under a sine, and the linear fit that they bias."""
    return Item(
        name="fourier",
        title="Output under a = A sin(wt), A = 15 m/s²",
        source="II-C, equation (8)",
        rows=(*_harmonic_rows(), *_corruption_rows(plan)),
    )


def cross_axis_item(plan: Plan) -> Item:
    """Equation (7): the cross-axis product hides in the scale factor until the sensor is rolled."""
    k, product, runs = 0.01, 1e-3, plan.runs(4, 16)
    hidden = STANDARD_GRAVITY * product

    def once(rng: np.random.Generator) -> tuple[float, float, float]:
        sensor = {"bias": 0.05, "scale_factor": k, "cross_axis_gravity": product}
        normal, rolled = (_linear_fit(rng, sensor, mount) for mount in ("normal", "rolled"))
        return normal.states[-1, 2], rolled.states[-1, 2], float(np.sqrt(normal.variances[-1, 2] / runs))

    normal, rolled, sigma = np.mean(plan.repeat("cross axis", runs, once), axis=0).tolist()
    return Item(
        name="cross_axis",
        title="Cross-axis product Kin = 1e-3 (m/s²)⁻¹, k = 0.01",
        source="II-B1, equation (7)",
        rows=(
            _scalar_row("one orientation estimates k + g0 Kin", k + hidden, normal, sigma, runs),
            _scalar_row("a roll of 180 degrees gives k - g0 Kin", k - hidden, rolled, sigma, runs),
            _scalar_row("the mean of both gives k", k, (normal + rolled) / 2, sigma / np.sqrt(2), runs),
            _scalar_row("half the difference gives g0 Kin", hidden, (normal - rolled) / 2, sigma / np.sqrt(2), runs),
        ),
    )


def scale_update_item(plan: Plan) -> Item:
    """After K' = (1 + k) K the other coefficients must be divided by 1 + k: K0 (as printed), K2 and K3 as well."""
    sensor = {"bias": 0.5, "scale_factor": 0.2, "quadratic": -1e-3, "cubic": 1e-4}
    choice = replace(CWPA, model="cubic")
    rng = plan.repeat("scale update", 1, lambda rng: rng)[0]
    simulated = simulate("tones", seconds=SECONDS, rig=PLAIN_CXL02, parameters=sensor, rng=rng, position_noise=0.0)
    before = _fit(choice, simulated, simulated.recording.accel)
    s = 1.0 + before.estimate["k"]
    accel = simulated.recording.accel
    after = _fit(choice, simulated, replace(accel, y=accel.y / s), shrink=s)

    def row(by: Literal["paper", "us"], name: str, claim: str, factor: float, remark: str) -> Row:
        i = before.names.index(name)
        predicted, seen = before.states[-1, i] * factor, after.states[-1, i]
        deviate = float((seen - predicted) / np.sqrt(after.variances[-1, i]))
        return Row(
            by=by,
            claim=f"{name} {claim}",
            expected=f"{predicted:.4g}",
            measured=f"{seen:.4g} ({deviate:+.1f} sigma)",
            value=deviate,
            n=1,
            threshold="0.1 sigma: both fits see the same noise",
            holds=abs(deviate) < 0.1,
            remark=remark,
        )

    return Item(
        name="scale_update",
        title=f"Second fit after the scale update, 1 + k = {s:.4f}",
        source="II-B",
        rows=(
            row("paper", "K0", "is divided by 1 + k", 1.0 / s, "as printed"),
            row("us", "K2", "is divided by 1 + k", 1.0 / s, "missing in the text"),
            row("us", "K3", "is divided by 1 + k", 1.0 / s, "missing in the text"),
            row("paper", "K2", "stays as it is", 1.0, "implied by the text, which rescales K0 alone"),
            row("paper", "K3", "stays as it is", 1.0, "implied by the text, which rescales K0 alone"),
        ),
    )


def harmonics(sensor: Mapping[str, float], amplitude: float) -> dict[str, float]:
    """Mean, sin wt, cos 2wt and sin 3wt of the noise-free output under a sine of 5 Hz, over whole periods; m/s²."""
    w = 2.0 * np.pi * 5.0
    sine = Motion((Tones(np.array([-amplitude / w**2]), np.array([5.0]), np.zeros(1)),), 1.0)
    rng = np.random.default_rng(0)  # nothing is drawn: no noise
    y = simulate(
        sine, seconds=1.0, rig=NOISE_FREE, parameters=sensor, rng=rng, accel_rate=2000.0, position_noise=0.0
    ).recording.accel.y
    spectrum = np.fft.rfft(y) / len(y)
    return {
        "mean": float(spectrum[0].real),
        "b1": float(-2.0 * spectrum[5].imag),
        "a2": float(2.0 * spectrum[10].real),
        "b3": float(-2.0 * spectrum[15].imag),
    }


def _harmonic_rows() -> tuple[Row, ...]:
    K0, k, K2, K3, A = 0.05, 0.01, -1e-4, 1e-5, 15.0
    seen = harmonics({"bias": K0, "scale_factor": k, "quadratic": K2, "cubic": K3}, A)
    formulas = (
        ("mean = K0 + K2 A²/2", "mean", K0 + K2 * A**2 / 2, CORRECTED),
        ("mean = a0/2 with a0 = 4 K0 + 2 K2 A²", "mean", 2 * K0 + K2 * A**2, "as printed: twice the mean"),
        ("b1 = A (1 + k + 3/4 K3 A²)", "b1", A * (1 + k + 0.75 * K3 * A**2), "as printed"),
        ("a2 = -K2 A²/2", "a2", -K2 * A**2 / 2, "as printed"),
        ("b3 = -K3 A³/4", "b3", -K3 * A**3 / 4, CORRECTED),
        ("b3 = +K3 A³/4", "b3", K3 * A**3 / 4, "as printed: wrong sign"),
    )
    return tuple(
        Row(
            by="us" if remark == CORRECTED else "paper",
            claim=claim,
            expected=f"{value:.6g} m/s²",
            measured=f"{seen[name]:.6g} m/s²",
            value=seen[name],
            n=2000,
            threshold="1e-12 m/s²",
            holds=abs(seen[name] - value) < 1e-12,
            remark=remark,
        )
        for claim, name, value, remark in formulas
    )


def _corruption_rows(plan: Plan) -> tuple[Row, ...]:
    """The linear model on a cubic sensor: K0 gains K2 <a²>, k gains K3 <a⁴>/<a²> (derivations 2.2)."""
    sensor = {"bias": 0.05, "scale_factor": 0.01, "quadratic": -1e-3, "cubic": 1e-4}
    runs = plan.runs(4, 16)

    def once(rng: np.random.Generator) -> tuple[float, float, float, float]:
        simulated = simulate("tones", seconds=SECONDS, rig=PLAIN_CXL02, parameters=sensor, rng=rng, position_noise=0.0)
        a = simulated.truth.motion.acceleration(np.arange(0.0, SECONDS, 1e-3))
        track = _fit(CWPA, simulated, simulated.recording.accel)
        K0_expected = sensor["bias"] + sensor["quadratic"] * float(np.mean(a**2))
        k_expected = sensor["scale_factor"] + sensor["cubic"] * float(np.mean(a**4) / np.mean(a**2))
        return track.estimate["K0"], K0_expected, track.estimate["k"], k_expected

    K0, K0_expected, k, k_expected = np.mean(plan.repeat("corruption", runs, once), axis=0).tolist()
    return tuple(
        Row(
            by="paper",
            claim=claim,
            expected=f"{expected:.5f}{unit}",
            measured=f"{seen:.5f}{unit} (true value {true:g})",
            value=seen,
            n=runs,
            threshold="5 % of the predicted shift",
            holds=abs(seen - expected) < 0.05 * abs(expected - true),
        )
        for claim, seen, expected, true, unit in (
            ("a linear fit puts K2 <a²> into K0", K0, K0_expected, sensor["bias"], " m/s²"),
            ("a linear fit puts K3 <a⁴>/<a²> into k", k, k_expected, sensor["scale_factor"], ""),
        )
    )


def _linear_fit(rng: np.random.Generator, sensor: Mapping[str, float], mount: Mount) -> FilterRun:
    rig = replace(PLAIN_CXL02, mount=mount)
    simulated = simulate("tones", seconds=SECONDS, rig=rig, parameters=sensor, rng=rng, position_noise=0.0)
    choice = replace(ACI, interpolation="cubic")
    return _fit(choice, simulated, simulated.recording.accel)


def _fit(choice: FilterChoice, simulated: Simulated, accel: Channel, *, shrink: float = 1.0) -> FilterRun:
    """A filter with a wide prior of its parameters; `shrink` says by how much the output was divided."""
    noise = tuned(simulated.truth, simulated.recording.rig)
    sigma = prior_sigmas(choice)
    sigma[-2 if choice.model == "linear" else -4 :] *= 20.0
    recording = replace(simulated.recording, accel=accel)
    noise = replace(noise, output=noise.output / shrink**2)
    return filtered(choice, recording, noise, start(choice, simulated.truth), sigma)


def _scalar_row(claim: str, expected: float, seen: float, sigma: float, runs: int) -> Row:
    deviate = (seen - expected) / sigma
    return Row(
        by="paper",
        claim=claim,
        expected=f"{expected:.6f}",
        measured=f"{seen:.6f} ({deviate:+.1f} sigma)",
        value=float(seen),
        n=runs,
        threshold=f"{SIGMAS:.2f} sigma",
        holds=bool(abs(deviate) < SIGMAS),
    )
