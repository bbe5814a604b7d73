"""Three outputs of one sensor: matrix and offsets as other programs take them, and as C99 or Rust for a device.

An output is y = b + M f + e(f) with f the specific force in the axes of the attitude: M has the scale factors on its
diagonal and, beside it, the directions of the axes. M = S R: S upper triangular is the sensor, R its mounting.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import scipy

from accelcal._support.result import Result
from accelcal.calibration.export.c99 import header
from accelcal.calibration.export.calibration import Calibration, NotExportable, calibrate, identifier
from accelcal.calibration.export.rust import module
from accelcal.data import Array
from accelcal.estimation.estimate import Fit

EXACT = 1e-12
"""Share of the specific force that the iteration between the axes may leave."""
ACROSS = {"x": "yz", "y": "zx", "z": "xy"}
"""Axes that the two directions across an axis are."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SensorMatrix(Result):
    """Matrix, offsets and lever arms of a sensor with three outputs, in the axes of the attitude of its body."""

    derived: ClassVar[tuple[str, ...]] = ("upper", "lower", "inverse")
    tables_in: ClassVar[str] = "results.experiments"

    M: Array
    """(3, 3): output per specific force."""
    bias: Array
    """(3,) m/s²."""
    M_std: Array
    bias_std: Array
    lever: Array
    """(3, 3) m: of the x, y and z element, from the tracked point."""
    noise: Array
    """Density of the noise of each output, (3,) (m/s²)/sqrt(Hz)."""
    delay: float
    """By which the outputs are late, s."""
    source: str = ""

    @classmethod
    def of(cls, fit: Fit, source: str = "") -> SensorMatrix:
        """Return what a fit of three outputs says.

        Raises
        ------
        NotExportable
            If the fit is not of three outputs.
        """
        if set(fit.axes) != set(ACROSS):
            raise NotExportable(
                f"{source or 'the model'}: a fit of {len(fit.axes) or 'one'} outputs; a matrix needs all three, as "
                "`accelcal fit` estimates where accel_x, accel_y and accel_z are mapped beside [channels.attitude]"
            )
        M, M_std, lever = np.eye(3), np.zeros((3, 3)), np.zeros((3, 3))
        bias, noise = np.zeros((2, 3)), np.zeros(3)
        for i, (axis, others) in enumerate(ACROSS.items()):
            alone = fit.of_axis(axis)
            by_name = defaultdict(lambda: (0.0, 0.0), {e.name: (e.value, e.std) for e in alone.estimates})
            M[i, i], M_std[i, i] = np.add((1.0, 0.0), by_name["scale_factor"])
            for k, other in enumerate(others, start=1):
                M[i, "xyz".index(other)], M_std[i, "xyz".index(other)] = by_name[f"body_misalignment.{k}"]
            bias[:, i] = by_name["bias"]
            lever[i] = [by_name[f"lever_arm.{j}"][0] for j in ACROSS]
            noise[i] = alone.runs[0].noise.all.density
        return cls(M, bias[0], M_std, bias[1], lever, noise, fit["time_offset"].value, source)

    @property
    def upper(self) -> tuple[Array, Array]:
        """S and R of M = S R: scale factors and angles between the axes, upper triangular, and the mounting."""
        S, R = scipy.linalg.rq(self.M)
        sign = np.sign(np.diag(S))
        return S * sign, (R.T * sign).T

    @property
    def lower(self) -> tuple[Array, Array]:
        """L and Q of M = L Q, L lower triangular: the same with the x axis of the sensor as that of its frame."""
        Q, U = np.linalg.qr(self.M.T)
        sign = np.sign(np.diag(U))
        return (U.T * sign), (Q * sign).T

    @property
    def inverse(self) -> Array:
        """(3, 3): specific force per output."""
        return np.asarray(np.linalg.inv(self.M))

    def correct(self, y: Array) -> Array:
        """Specific force of outputs (n, 3) by matrix and offsets alone, (n, 3) m/s²."""
        return np.asarray((y - self.bias) @ self.inverse.T)


FRAMES = (
    "Axes are those of the attitude of the body, right-handed; specific force, +g along an axis that points up (ENU)."
)


def listed(values: Array) -> str:
    """Numbers as YAML and C take them."""
    return "[" + ", ".join(f"{value + 0.0:.9g}" for value in np.ravel(values)) + "]"


def kalibr(m: SensorMatrix) -> str:
    """The accelerometer of an IMU file of Kalibr (model scale-misalignment-size-effect): y = M C f + b, M lower
    triangular.

    Its arms are those of the y and z element from the x element, in the axes of the sensor; its time offset is what is
    added to a stamp.
    """
    L, C = m.lower
    rows = "\n".join(f"    - {listed(row)}" for row in L)
    levers = "\n".join(
        f"    r{axis}_i: {listed(C @ (row - m.lever[0]))}" for axis, row in zip(ACROSS, m.lever, strict=True)
    )
    body = "\n".join(f"  - {listed(row)}" for row in np.block([[C, -(C @ m.lever[0])[:, None]], [np.zeros(3), 1.0]]))
    return (
        f"# {FRAMES}\n# T_i_b: from the body's axes, at the tracked point, to the sensor's, at its x element.\n"
        f"# offsets, m/s^2, which Kalibr estimates anew: {listed(m.bias)}\n"
        f"imu0:\n  T_i_b:\n{body}\n  model: scale-misalignment-size-effect\n"
        f"  accelerometer_noise_density: {float(np.mean(m.noise)):.6g}\n  time_offset: {-m.delay:.9g}\n"
        f"  accelerometers:\n    M:\n{rows}\n{levers}\n"
    )


def imu_tk(m: SensorMatrix) -> str:
    """Misalignment, scale and bias as imu_tk writes them: f = T K (y - b), T upper triangular with unit diagonal."""
    TK = np.linalg.inv(m.upper[0])
    K = np.diag(np.diag(TK))
    return (
        "\n\n".join(
            "\n".join(" ".join(f"{x:.9g}" for x in row) for row in A) for A in (TK / np.diag(TK), K, m.bias[:, None])
        )
        + "\n"
    )


def ros(m: SensorMatrix) -> str:
    """Parameters of the ROS package imu_calib: f = SM y - bias."""
    return f"# {FRAMES}\nSM: {listed(m.inverse)}\nbias: {listed(m.inverse @ m.bias)}\n"


PARAMETERS = {"kalibr": kalibr, "imu_tk": imu_tk, "ros": ros}
"""By the name of a format, what writes it."""


def calibrations(fit: Fit, without: Sequence[str], source: str) -> dict[str, Calibration]:
    """The calibration of each axis along itself."""
    return {
        axis: calibrate(
            fit.of_axis(axis),
            without=[name for name in without if name in fit.of_axis(axis).model.effects],
            source=source,
        )
        for axis in ACROSS
    }


def rounds(m: SensorMatrix) -> int:
    """Passes over the axes, each with what the pass before says of the others, after which nothing is left of them."""
    off = np.abs(m.M - np.diag(np.diag(m.M))) / np.diag(m.M)[:, None]
    largest = float(np.max(np.sum(off, axis=1)))
    if largest >= 1.0:
        raise NotExportable(
            "the axes of the sensor are not those of the attitude: its directions differ by more than 45 degrees"
        )
    return 1 if largest == 0.0 else max(2, math.ceil(math.log(EXACT) / math.log(largest)))


def across(m: SensorMatrix, scale: float) -> Array:
    """Reading per specific force along the other axes, (3, 3)."""
    return np.asarray((m.M - np.diag(np.diag(m.M))) * scale)


def c_files(fit: Fit, name: str, without: Sequence[str] = (), source: str = "") -> Mapping[str, str]:
    """A C99 header for three outputs and those of its axes, by file name.

    Raises
    ------
    NotExportable
        As `calibrate`, or if the outputs are not along the axes of the attitude.
    """
    m, stem = SensorMatrix.of(fit, source), Path(name).stem
    word = identifier(stem)
    names = {axis: f"{stem}_{axis}.h" for axis in ACROSS}
    files = {names[a]: header(c, names[a]) for a, c in calibrations(fit, without, source).items()}
    rows = ", ".join("{" + listed(row)[1:-1] + "}" for row in across(m, fit.rig.sensor.scale or 1.0))
    others = (f"M[{i}][0] * f[0] + M[{i}][1] * f[1] + M[{i}][2] * f[2]" for i in range(3))
    calls = "\n".join(
        f"        outside |= {identifier(f'{stem}_{axis}')}_acceleration(y[{i}] - ({of}), &g[{i}]);"
        for i, (axis, of) in enumerate(zip(ACROSS, others, strict=True))
    )
    includes = "\n".join(f'#include "{names[axis]}"' for axis in ACROSS)
    guard = f"{word.upper()}_THREE_OUTPUTS_H"
    files[name] = f"""\
/*
 * From the readings of three outputs to specific force in the axes of the body, m/s^2, gravity included.
 * {FRAMES}
 * Each axis is corrected along itself, less what it reads of the other two; {rounds(m)} passes leave {EXACT:g} of them.
 * Returns 0 inside the range of every axis, else the flags of its headers.
 */
#ifndef {guard}
#define {guard}

{includes}

static inline unsigned {word}_specific_force(const double y[3], double f[3])
{{
    static const double M[3][3] = {{{rows}}};
    unsigned outside = 0;
    f[0] = f[1] = f[2] = 0.0;
    for (int pass = 0; pass < {rounds(m)}; ++pass) {{
        double g[3];
        outside = 0;
{calls}
        f[0] = g[0];
        f[1] = g[1];
        f[2] = g[2];
    }}
    return outside;
}}

#endif
"""
    return files


def rust_module(fit: Fit, without: Sequence[str] = (), source: str = "") -> str:
    """A Rust module for three outputs, without the standard library; errors are those of `c_files`."""
    m = SensorMatrix.of(fit, source)
    parts = "\n".join(
        f"/// Along the {a} axis.\npub mod {a} {{\n{module(c)}}}\n"
        for a, c in calibrations(fit, without, source).items()
    )
    rows = ", ".join(f"[{', '.join(f'{float(x)!r}' for x in row)}]" for row in across(m, fit.rig.sensor.scale or 1.0))
    calls = "\n".join(
        f"        let of_{a} = {a}::acceleration(y[{i}] - (M[{i}][0] * f[0] + M[{i}][1] * f[1] + M[{i}][2] * f[2]));"
        for i, a in enumerate(ACROSS)
    )
    return f"""\
//! From the readings of three outputs to specific force in the axes of the body, m/s^2, gravity included.
//! {FRAMES}

{parts}
/// Specific force, and 0 inside the range of every axis, else the sum of its flags; {rounds(m)} passes over the axes.
#[allow(dead_code)]
pub const fn specific_force(y: [f64; 3]) -> ([f64; 3], u8) {{
    const M: [[f64; 3]; 3] = [{rows}];
    let (mut f, mut outside, mut pass) = ([0.0; 3], 0, 0);
    while pass < {rounds(m)} {{
{calls}
        f = [of_x.acceleration, of_y.acceleration, of_z.acceleration];
        outside = of_x.outside | of_y.outside | of_z.outside;
        pass += 1;
    }}
    (f, outside)
}}
"""
