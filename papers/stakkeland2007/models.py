"""Predictions of the sensor models alone (paper II-B, II-B1, II-C): equations (7), (8) and the scale update."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from accelcal.data import STANDARD_GRAVITY, Array, Channel, ChannelFilter, Mount, Recording, Rig
from accelcal.estimation.estimate import Fit, estimate
from accelcal.filters.choice import FilterChoice
from accelcal.filters.record import FilterRun
from accelcal.model import Model
from accelcal.signals.processing import applied, memory, response
from accelcal.simulation.motion import Motion, Tones
from accelcal.simulation.sensor import CXL02_RIG, Simulated, simulate
from papers.stakkeland2007.rows import (
    ACCEL_RATE,
    ACI,
    CURVED_SENSOR,
    CWPA,
    LARGEST,
    PAPER_SENSOR,
    PLAIN_ADXL105,
    PLAIN_CXL02,
    SIGMAS,
    Item,
    Plan,
    Row,
    filtered,
    prior_sigmas,
    start,
    tuned,
)

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
        predicted, measured = before.states[-1, i] * factor, after.states[-1, i]
        deviate = float((measured - predicted) / np.sqrt(after.variances[-1, i]))
        return Row(
            by=by,
            claim=f"{name} {claim}",
            expected=f"{predicted:.4g}",
            measured=f"{measured:.4g} ({deviate:+.1f} sigma)",
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
    measured = harmonics({"bias": K0, "scale_factor": k, "quadratic": K2, "cubic": K3}, A)
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
            measured=f"{measured[name]:.6g} m/s²",
            value=measured[name],
            n=2000,
            threshold="1e-12 m/s²",
            holds=abs(measured[name] - value) < 1e-12,
            remark=remark,
        )
        for claim, name, value, remark in formulas
    )


def _corruption_rows(plan: Plan) -> tuple[Row, ...]:
    """The linear model on a cubic sensor: K0 gains K2 <a²>, k gains K3 <a⁴>/<a²> (derivations 2.2)."""
    sensor, runs = CURVED_SENSOR, plan.runs(4, 16)

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
            measured=f"{measured:.5f}{unit} (true value {true:g})",
            value=measured,
            n=runs,
            threshold="5 % of the predicted shift",
            holds=abs(measured - expected) < 0.05 * abs(expected - true),
        )
        for claim, measured, expected, true, unit in (
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


def _scalar_row(claim: str, expected: float, measured: float, sigma: float, runs: int) -> Row:
    deviate = (measured - expected) / sigma
    return Row(
        by="paper",
        claim=claim,
        expected=f"{expected:.6f}",
        measured=f"{measured:.6f} ({deviate:+.1f} sigma)",
        value=float(measured),
        n=runs,
        threshold=f"{SIGMAS:.2f} sigma",
        holds=bool(abs(deviate) < SIGMAS),
    )


LEVEL = math.radians(0.05)
"""Accuracy of the paper's level, and the tilt of the rail here."""
AXIS_ANGLE = math.radians(0.03)
"""Angle of the input axis to the rail here."""
SENSOR = {"bias": 0.05, "scale_factor": 0.01, "misalignment": AXIS_ANGLE}
MOUNTS: tuple[Mount, ...] = ("normal", "reversed", "rolled")
ALIGNMENT_SECONDS = 20.0
"""Of each run."""
RIGS = {"ADXL105": PLAIN_ADXL105, "CXL02": PLAIN_CXL02}


def alignment_item(plan: Plan) -> Item:
    """One run, a turned one, and a rolled one beside it."""
    rows: list[Row] = []
    for name, rig in RIGS.items():
        runs = plan.repeat(f"alignment {name}", 1, lambda rng, rig=rig: mounted(rng, rig))[0]  # type: ignore[misc]
        single, turned, all_three = (estimate(Model.linear(), runs[:count]) for count in (1, 2, 3))
        rows += [
            _bias_row(
                f"{name}, one run: the bias holds the tilt of the rail and the angle of the axis",
                single,
                LEVEL + AXIS_ANGLE,
            ),
            _bias_row(f"{name}, and one turned: the tilt is separated, the angle is not", turned, AXIS_ANGLE),
            _angle_row(name, all_three),
        ]
    return Item(
        name="alignment",
        title=f"Rail tilted by 0.05 deg, input axis off by 0.03 deg, runs of {ALIGNMENT_SECONDS:g} s",
        source="II-A",
        rows=tuple(rows),
    )


def mounted(rng: np.random.Generator, rig: Rig) -> Sequence[Recording]:
    """A run in each mount, on a rail that is declared level and is not."""
    runs = []
    for mount in MOUNTS:
        declared = replace(rig, mount=mount)
        tilted = replace(declared, gravity_along_axis=STANDARD_GRAVITY * math.sin(LEVEL))
        simulation = simulate("tones", seconds=ALIGNMENT_SECONDS, rig=tilted, parameters=SENSOR, rng=rng, a_rms=4.0)
        runs.append(replace(simulation.recording, rig=declared))
    return runs


def _bias_row(claim: str, fit: Fit, angle: float) -> Row:
    expected, error = STANDARD_GRAVITY * angle, fit["bias"].value - SENSOR["bias"]
    sigma = abs(error - expected) / fit["bias"].std
    return Row(
        by="us",
        claim=claim,
        expected=f"K0 off by {1e3 * expected:.2f} mm/s² = g0 {math.degrees(angle):.2g} deg",
        measured=f"{1e3 * error:.2f} ± {1e3 * fit['bias'].std:.1g} mm/s²",
        value=error,
        n=1,
        threshold=f"{LARGEST:g} sigma ({sigma:.1f})",
        holds=sigma < LARGEST,
        remark="0.05 deg of the level alone is 8.6 mm/s²" if angle > LEVEL else "",
    )


def _angle_row(name: str, fit: Fit) -> Row:
    truth = {"bias": SENSOR["bias"], "tilt": LEVEL, "misalignment": AXIS_ANGLE}
    worst = max(abs(fit[item].value - value) / fit[item].std for item, value in truth.items())
    tilt, axis = (
        f"{math.degrees(fit[item].value):.5f} ± {math.degrees(fit[item].std):.1g}" for item in list(truth)[1:]
    )
    return Row(
        by="us",
        claim=f"{name}, and one rolled: bias, tilt and angle of the axis are separate",
        expected="0.05 deg, 0.03 deg, K0 = 50 mm/s²",
        measured=f"{tilt} deg, {axis} deg, K0 {1e3 * fit['bias'].value:.3f} ± {1e3 * fit['bias'].std:.1g} mm/s²",
        value=worst,
        n=1,
        threshold=f"{LARGEST:g} sigma ({worst:.1f}), angles finer than a tenth of the level",
        holds=worst < LARGEST and max(fit["tilt"].std, fit["misalignment"].std) < 0.1 * LEVEL,
        remark="the rail must keep its tilt while the sensor is turned",
    )


OWN_POLE = ChannelFilter("RC", cutoff=200.0)
"""Bandwidth of the sensor itself, a single pole."""
DECLARED = replace(CXL02_RIG, output_filters=(OWN_POLE,))
AXES = {"a_y": "cross_axis", "a_z": "cross_axis_z"}
"""Effect of each transverse channel."""
CROSS = 0.03
"""Sensitivity of both transverse axes, 1."""
FOLLOWS = {"a_y": 0.02, "a_z": -0.01}
"""Share of the acceleration that each transverse axis shows: its angle to the rail."""
SHAKING = 0.3
"""Amplitude of each of three tones of the transverse motion, m/s²."""
SYMBOLS = {"scale_factor": "k", "quadratic": "K2", "cubic": "K3"}
LAG = 1.0 / (2.0 * np.pi * 200.0)
"""Delay of the sensor's own pole, s."""


def three_axes_item(plan: Plan) -> Item:
    """What each declaration is worth."""
    recording = plan.repeat("three axes", 1, record)[0]
    plain = Model.cubic()
    full = plain.add(*AXES.values())
    declared, unknown = recording, replace(recording, rig=CXL02_RIG)
    both, no_pole, no_axes = estimate(full, declared), estimate(full, unknown), estimate(plain, declared)
    lag = no_pole["time_offset"]
    follows = CROSS * sum(FOLLOWS.values())
    return Item(
        name="three_axes",
        title=f"CXL02TG3: own pole at 200 Hz behind the RC of 159 Hz, transverse axes of {CROSS:.0%}",
        source="II-A",
        rows=(
            _row("pole and transverse axes declared: k, K2, K3 are right", both, True),
            _row("own pole not declared: k is not", no_pole, False),
            _row("transverse axes left out: k is not", no_axes, False),
            Row(
                by="us",
                claim="the time offset takes the delay of a pole that is not declared",
                expected=f"{1e3 * LAG:.3f} ms = 1/(2 pi 200 Hz)",
                measured=f"{1e3 * lag.value:.3f} ± {1e3 * lag.std:.1g} ms",
                value=lag.value,
                n=1,
                threshold="1 %",
                holds=abs(lag.value / LAG - 1.0) < 0.01,
                remark="its loss of amplitude, (f/200 Hz)²/2, remains in k",
            ),
            Row(
                by="us",
                claim="transverse axes that follow the rail are a scale factor",
                expected=f"k off by {follows:.1g}",
                measured=f"{_error(no_axes):+.2g} ± {no_axes['scale_factor'].std:.1g}",
                value=_error(no_axes),
                n=1,
                threshold=f"{LARGEST:g} sigma",
                holds=abs(_error(no_axes) - follows) < LARGEST * no_axes["scale_factor"].std,
                remark="3 % of a_y = 0.02 a and of a_z = -0.01 a",
            ),
        ),
    )


def record(rng: np.random.Generator) -> Recording:
    """One record of the sensor, its transverse axes as channels of their own."""
    simulation = simulate("tones", seconds=40.0, rig=DECLARED, parameters=PAPER_SENSOR, rng=rng, a_rms=4.0)
    accel = simulation.recording.accel
    across = {name: transverse(share, simulation.truth.motion, accel.t, rng) for name, share in FOLLOWS.items()}
    chain = (ChannelFilter("RC", cutoff=159.0), OWN_POLE)
    H, reach = response(chain, ACCEL_RATE), memory(chain, ACCEL_RATE)
    added = applied(CROSS * sum(across.values(), np.zeros(len(accel.t))), 1.0 / ACCEL_RATE, H, reach)
    side = {name: Channel(name, accel.t, y, "m/s²") for name, y in across.items()}
    return replace(simulation.recording, accel=replace(accel, y=accel.y + added), side=side)


def transverse(share: float, motion: Motion, t: Array, rng: np.random.Generator) -> Array:
    """Acceleration across the rail at t (n,) s: a share of that along it, and three tones; m/s²."""
    tones = zip(rng.uniform(2.0, 15.0, 3), rng.uniform(0.0, 2.0 * np.pi, 3), strict=True)
    shaken = sum((SHAKING * np.sin(2.0 * np.pi * f * t + phase) for f, phase in tones), np.zeros(len(t)))
    return np.asarray(share * motion.acceleration(t) + shaken)


def _error(fit: Fit, name: str = "scale_factor", truth: Mapping[str, float] = PAPER_SENSOR) -> float:
    return fit[name].value - truth[name]


def _row(claim: str, fit: Fit, right: bool) -> Row:
    worst = max(abs(_error(fit, name)) / fit[name].std for name in SYMBOLS)
    errors = ", ".join(f"{symbol} {_error(fit, name):+.1e} ± {fit[name].std:.1g}" for name, symbol in SYMBOLS.items())
    return Row(
        by="us",
        claim=claim,
        expected=f"errors {'below' if right else 'above'} {LARGEST:g} sigma",
        measured=f"{errors}; {worst:.1f} sigma",
        value=worst,
        n=1,
        threshold=f"{LARGEST:g} sigma",
        holds=(worst < LARGEST) == right,
    )
