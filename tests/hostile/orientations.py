"""Valid records of a tracked body, an arm and a sensor at rest, and what becomes of them: cells, columns, rows, stamps
and lines of the sidecar changed, one mutation a case.

A case is a function of its section and its number: `case_of` makes its files.
"""

from __future__ import annotations

import copy
import functools
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.estimation import arms
from tests.estimation.triads import Triad

from .case import case_rng

Rng = np.random.Generator
G = 9.80665
SECONDS = 12.0
"""Length of a record."""
NO_NUMBERS = ("text", "--1", "0x10", "½", "1e", "true", "#N/A")
NOT_FINITE = ("nan", "inf", "-inf", "1e999")
HUGE = ("1e300", "-1e300", "1e30", "9e15")


@dataclass
class Record:
    """A table with its sidecar, and what it was simulated with."""

    columns: dict[str, list[str]]
    sidecar: str
    truth: Mapping[tuple[str, str], float]
    """Parameters by name and axis."""
    spoilt: dict[str, list[int]] = field(default_factory=dict)
    """Rows in which a cell was changed, from 0, by column."""

    def numbers(self, *names: str) -> np.ndarray:
        """Columns as numbers, (n, columns); an empty cell is NaN."""
        return np.array([[float(cell or "nan") for cell in self.columns[name]] for name in names]).T

    def put(self, names: tuple[str, ...], y: np.ndarray, rows: slice = slice(None)) -> None:
        """Write numbers, (n, columns), into rows of columns."""
        for name, column in zip(names, np.atleast_2d(y.T), strict=True):
            self.columns[name][rows] = ["" if np.isnan(x) else f"{x:.10g}" for x in column]

    def cell(self, name: str, row: int, text: str) -> None:
        """Write a cell."""
        self.columns[name][row] = text
        self.spoilt.setdefault(name, []).append(row)

    def lines(self, old: str, new: str) -> None:
        """Put lines of the sidecar in the place of others."""
        assert old in self.sidecar, old
        self.sidecar = self.sidecar.replace(old, new)

    def write(self, path: Path) -> None:
        """The table, and its sidecar beside it."""
        rows = zip(*self.columns.values(), strict=True)
        path.write_text("\n".join([",".join(self.columns), *map(",".join, rows)]) + "\n")
        path.with_suffix(".toml").write_text(self.sidecar)


def read(path: Path, truth: Mapping[tuple[str, str], float]) -> Record:
    """A record that a simulator wrote."""
    head, *rows = (line.split(",") for line in path.read_text().splitlines())
    columns = dict(zip(head, map(list, zip(*rows, strict=True)), strict=True))
    return Record(columns, path.with_suffix(".toml").read_text(), truth)


@functools.cache
def simulated(section: str) -> Record:
    """The record of a section before it is changed."""
    with tempfile.TemporaryDirectory() as folder:
        if section in ("attitude", "outputs"):
            triad = Triad(3, seconds=SECONDS, rate=100.0)
            return read(triad.write(Path(folder)), triad.true_values())
        if section == "angle":
            rig = arms.Rigged(seconds=SECONDS, rate=200.0)
            arms.record(rig, Path(folder))
            truth = {("bias", ""): rig.bias, ("scale_factor", ""): rig.k, ("time_offset", ""): rig.delay}
            return read(Path(folder, "arm.csv"), truth)
    return {"dwells": dwells, "faces": faces, "guide": guide}[section]()


def dwells() -> Record:
    """Twelve dwells on a dividing head, in steps of 30 degrees."""
    rng, angle, truth = np.random.default_rng(5), 30.0 * np.arange(12), {("bias", ""): 0.05, ("scale_factor", ""): 0.01}
    scatter, samples = 2e-3, 6000
    mean = 0.05 + 1.01 * 9.81 * np.sin(np.radians(angle)) + scatter / np.sqrt(samples) * rng.standard_normal(12)
    rows = np.column_stack([angle, mean, *np.multiply.outer([scatter, 60.0, 23.0, samples, 0.0], np.ones(12))])
    names = ("attitude_deg", "mean", "std", "duration_s", "temperature_degC", "samples", "group")
    record = Record({name: [""] * 12 for name in names}, DWELLS, truth)
    record.put(names, rows)
    return record


DWELLS = """[sensor]
noise = "20 ug/sqrt(Hz)"
bias_instability = "5 ug"
[channels]
accel = { column = "mean", unit = "m/s^2" }
[dwell]
angle_std = "0.001 deg"
gravity = "9.81 m/s^2"
"""
SCALE, ZERO = np.array([1.01, 0.985, 1.02]), np.array([0.03, -0.05, 0.02])
"""Of three outputs; the zero in g."""
FACES = """[channels]
time = { column = "t", unit = "s" }
accel_x = { column = "x", unit = "g" }
accel_y = { column = "y", unit = "g" }
accel_z = { column = "z", unit = "g" }
[dwell]
attitude = "unknown"
gravity = "9.81 m/s^2"
"""


def faces() -> Record:
    """Three outputs that are turned from face to face, 4 s on each, at 50 Hz."""
    rng, parts, before = np.random.default_rng(1), [], np.array([0.6, 0.0, 0.8])
    for face in range(6):
        up = np.eye(3)[face % 3] * (1.0 if face < 3 else -1.0)
        share = np.linspace(0.0, 1.0, 75)[:, None]
        parts += [(1.0 - share) * before + share * up + 0.2 * rng.standard_normal((75, 3)), np.tile(up, (200, 1))]
        before = up
    force = np.concatenate(parts)
    y = SCALE * force * 9.81 / G + ZERO + 1e-3 * rng.standard_normal(force.shape)
    truth = {("K", axis): 1.0 / k for axis, k in zip("xyz", SCALE, strict=True)}
    truth |= {("b", axis): G * zero for axis, zero in zip("xyz", ZERO, strict=True)}
    record = Record({name: [""] * len(y) for name in "txyz"}, FACES, truth)
    record.put(tuple("txyz"), np.column_stack([np.arange(len(y)) / 50.0, y]))
    return record


def guide() -> Record:
    """The same as lines that come one by one."""
    return faces()


# What becomes of a record: a function of it and random numbers; and what a refusal or a finding must name.

Change = Callable[[Record, Rng], None]
Q, PLACE, OUT = ("q_w", "q_x", "q_y", "q_z"), ("e", "n", "u"), ("accel_x", "accel_y", "accel_z")


def cell(names: tuple[str, ...], texts: tuple[str, ...]) -> Change:
    """A text in one cell of one of some columns."""

    def act(record: Record, rng: Rng) -> None:
        name = str(rng.choice(names))
        rows = [k for k, text in enumerate(record.columns[name]) if text]
        record.cell(name, int(rng.choice(rows)), str(rng.choice(texts)))

    return act


def column(names: tuple[str, ...], text: str) -> Change:
    """One text in every cell of some columns."""

    def act(record: Record, _: Rng) -> None:
        for name in names:
            record.columns[name] = [text] * len(record.columns[name])

    return act


def renumbered(names: tuple[str, ...], new: Callable[[np.ndarray, Rng], np.ndarray]) -> Change:
    """Some columns, (n, columns), as others."""

    def act(record: Record, rng: Rng) -> None:
        record.put(names, new(record.numbers(*names), rng))

    return act


def lines(old: str, new: str) -> Change:
    """Lines of the sidecar in the place of others."""
    return lambda record, _: record.lines(old, new)


def swapped(text: str, other: str) -> Change:
    """Two columns in each other's place, under their old names."""

    def act(record: Record, _: Rng) -> None:
        record.columns[text], record.columns[other] = record.columns[other], record.columns[text]

    return act


def without(names: tuple[str, ...]) -> Change:
    """A table that lacks columns."""

    def act(record: Record, _: Rng) -> None:
        for name in names:
            del record.columns[name]

    return act


def rows(which: Callable[[int, Rng], object]) -> Change:
    """Some rows of a table, in some order."""

    def act(record: Record, rng: Rng) -> None:
        n = len(next(iter(record.columns.values())))
        at = np.arange(n)[which(n, rng)]  # type: ignore[index]
        for name, cells in record.columns.items():
            record.columns[name] = [cells[k] for k in at]

    return act


def emptied(names: tuple[str, ...], length: int, text: str = "") -> Change:
    """A run of cells of some columns that are empty, or hold a text."""

    def act(record: Record, rng: Rng) -> None:
        n = len(record.columns[names[0]])
        begin = int(rng.integers(1, n - length))
        for name in names:
            for k in range(begin, begin + length):
                record.cell(name, k, text)

    return act


def part(change: Callable[[np.ndarray], np.ndarray], share: float = 0.5) -> Callable[[np.ndarray, Rng], np.ndarray]:
    """A change of all rows behind some instant near a share of the record."""

    def act(y: np.ndarray, rng: Rng) -> np.ndarray:
        begin = int(len(y) * share * rng.uniform(0.8, 1.2))
        return np.concatenate([y[:begin], change(y[begin:])])

    return act


def some(change: Callable[[np.ndarray], np.ndarray], count: int) -> Callable[[np.ndarray, Rng], np.ndarray]:
    """A change of some rows that hold a number."""

    def act(y: np.ndarray, rng: Rng) -> np.ndarray:
        y, at = y.copy(), rng.choice(np.flatnonzero(np.isfinite(y[:, 0])), count, replace=False)
        y[at] = change(y[at])
        return y

    return act


def every(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray, Rng], np.ndarray]:
    """A change of all rows."""
    return lambda y, _: change(y)


def euler(q: np.ndarray) -> np.ndarray:
    """Angles in degrees, and a zero, where quaternions were."""
    from scipy.spatial.transform import Rotation

    return np.column_stack([Rotation.from_quat(q, scalar_first=True).as_euler("xyz", degrees=True), 0.0 * q[:, 0]])


def exchanged(y: np.ndarray, rng: Rng) -> np.ndarray:
    """Two stretches of half a second in each other's place."""
    a, b = (int(x) for x in sorted(rng.choice(len(y) // 50 - 1, 2, replace=False) * 50))
    y = y.copy()
    y[a : a + 50], y[b : b + 50] = y[b : b + 50].copy(), y[a : a + 50].copy()
    return y


def but(change: Change, truth: Callable[[dict[tuple[str, str], float]], None]) -> Change:
    """A change after which the record has another truth."""

    def act(record: Record, rng: Rng) -> None:
        change(record, rng)
        record.truth = dict(record.truth)
        truth(record.truth)

    return act


def shifted(names: tuple[str, ...], count: int) -> Change:
    """Some columns later by some rows."""
    return renumbered(names, lambda y, _: np.concatenate([np.repeat(y[:1], count, axis=0), y[:-count]]))


CONJUGATE, MAPS = np.array([1.0, -1.0, -1.0, -1.0]), 'maps = "sensor to ENU"'
COLUMNS = 'columns = ["q_w", "q_x", "q_y", "q_z"]'
ATTITUDE: tuple[tuple[str, Change, str], ...] = (
    ("half the norm", renumbered(Q, every(lambda q: 0.5 * q)), "q_w, q_x, q_y, q_z.*length 1"),
    ("a norm of 1.01", renumbered(Q, every(lambda q: 1.01 * q)), ""),
    ("a norm of 1.03", renumbered(Q, every(lambda q: 1.03 * q)), "length 1"),
    ("a norm of 1e300", renumbered(Q, every(lambda q: 1e300 * q)), "q_w"),
    ("norms of 2 in some rows", renumbered(Q, some(lambda q: 2.0 * q, 3)), "length 1"),
    ("a zero", renumbered(Q, some(lambda q: 0.0 * q, 1)), "length 1"),
    ("zeros", renumbered(Q, part(lambda q: 0.0 * q)), "length 1"),
    ("nothing but zeros", column(Q, "0"), "length 1"),
    ("nothing but ones", column(Q, "1"), "length 1"),
    ("a body that never turns", renumbered(Q, every(lambda q: np.tile([1.0, 0.0, 0.0, 0.0], (len(q), 1)))), "turn"),
    ("attitude stands from the middle on", renumbered(Q, part(lambda q: np.tile(q[:1], (len(q), 1)))), "attitude"),
    ("no number", cell(Q, NO_NUMBERS), "q_"),
    ("not finite", cell(Q, NOT_FINITE), "attitude"),
    ("huge", cell(Q, HUGE), "q_|attitude"),
    ("an empty cell", cell(Q, ("",)), ""),
    ("empty column", column(Q[2:3], ""), "q_y"),
    ("no column", without(Q[3:]), "q_z"),
    ("sign from the middle on", renumbered(Q, part(lambda q: -q)), ""),
    ("signs of some rows", renumbered(Q, some(lambda q: -q, 300)), ""),
    ("conjugates from the middle on", renumbered(Q, part(lambda q: q * CONJUGATE)), "attitude"),
    ("conjugates", renumbered(Q, every(lambda q: q * CONJUGATE)), "maps|attitude"),
    ("scalar without its sign", renumbered(Q[:1], every(np.abs)), ""),
    ("minus x", renumbered(Q[1:2], every(np.negative)), "attitude"),
    ("x of the middle on", renumbered(Q[1:2], part(np.negative)), "attitude"),
    ("stretches exchanged", renumbered(Q, exchanged), "attitude"),
    ("reversed", renumbered(Q, every(lambda q: q[::-1])), "attitude"),
    ("x and y swapped", swapped("q_x", "q_y"), "attitude"),
    ("y and z swapped", swapped("q_y", "q_z"), "attitude"),
    ("scalar last", renumbered(Q, every(lambda q: np.roll(q, -1, axis=1))), "attitude"),
    ("degrees for quaternions", renumbered(Q, every(euler)), "length 1"),
    ("radians for quaternions", renumbered(Q, every(lambda q: np.radians(euler(q)))), "length 1"),
    ("three decimals", renumbered(Q, every(lambda q: np.round(q, 3))), "attitude|noise"),
    ("integers", renumbered(Q, every(np.rint)), "length 1"),
    ("late by 50 ms", shifted(Q, 5), "attitude"),
    ("a gap", emptied(Q, 40), ""),
    ("a gap of five seconds", emptied(Q, 500), ""),
    ("all but a second", emptied(Q, 1100), "excited"),
    ("a run of nan", emptied(Q, 20, "nan"), "attitude"),
    ("a run of zeros", emptied(Q, 20, "0"), "length 1"),
    ("every third row", lambda r, _: [r.cell(q, k, "") for q in Q for k in range(1200) if k % 3] and None, ""),
    ("no maps", lines(f", {MAPS}", ""), "maps"),
    ("the other sense", lines(MAPS, 'maps = "ENU to sensor"'), "maps|attitude"),
    ("another word", lines(MAPS, 'maps = "sensor to NED"'), "maps"),
    ("maps a number", lines(MAPS, "maps = 1"), "maps"),
    ("three columns", lines(COLUMNS, 'columns = ["q_w", "q_x", "q_y"]'), "columns"),
    ("one column four times", lines(COLUMNS, 'columns = ["q_w", "q_w", "q_w", "q_w"]'), "columns|q_w"),
    ("columns of another order", lines(COLUMNS, 'columns = ["q_x", "q_y", "q_z", "q_w"]'), "attitude"),
    ("columns that are none", lines(COLUMNS, 'columns = ["q_w", "q_x", "q_y", "qz"]'), "qz"),
    ("columns of the place", lines(COLUMNS, 'columns = ["q_w", "e", "n", "u"]'), "columns|length 1"),
    ("no columns", lines(f"{COLUMNS}, ", ""), "columns"),
    ("no attitude", lambda r, _: setattr(r, "sidecar", r.sidecar.partition("attitude")[0]), "attitude"),
    ("no place up", lines('position_u = { column = "u", unit = "m" }\n', ""), "position_u"),
    ("millimetres for metres", renumbered(PLACE, every(lambda p: 1e3 * p)), "place|position"),
    ("metres for millimetres", renumbered(PLACE, every(lambda p: 1e-3 * p)), "place|position"),
    ("a place that stands", column(PLACE, "0.5"), "place|position"),
    ("east and up swapped", swapped("e", "u"), "place|position"),
    ("east and north swapped", swapped("e", "n"), "place|position|attitude"),
    ("down for up", renumbered(PLACE[2:], every(np.negative)), "place|position"),
    ("a place beside all others", renumbered(PLACE, some(lambda p: p + 1.0, 1)), "place|position"),
    ("places beside all others", renumbered(PLACE, some(lambda p: p + 0.02, 8)), "place|position"),
    ("a jump of the place", renumbered(PLACE, part(lambda p: p + 0.3)), "place|position"),
    ("place reversed", renumbered(PLACE, every(lambda p: p[::-1])), "place|position"),
    ("no number in a place", cell(PLACE, NO_NUMBERS), '"[enu]"'),
    ("a place that is not finite", cell(PLACE, NOT_FINITE), "position_"),
    ("a huge place", renumbered(PLACE, some(lambda p: p + 1e30, 1)), "position_"),
    ("a gap of the place", emptied(PLACE, 100), ""),
    ("places in unlike rows", emptied(PLACE[:1], 300), ""),
    ("a stamp twice", lambda r, g: r.cell("t", 600, r.columns["t"][599]), "row 60[12]"),
    (
        "stamps twice",
        lambda r, g: [r.cell("t", k, r.columns["t"][k - 1]) for k in range(200, 220, 2)] and None,
        "time|t",
    ),
    ("a stamp back", lambda r, g: r.cell("t", 600, r.columns["t"][300]), "row"),
    ("reversed time", renumbered(("t",), every(lambda t: t[::-1])), "time|t"),
    ("rows reversed", rows(lambda n, g: slice(None, None, -1)), "time|t"),
    ("rows shuffled", rows(lambda n, g: g.permutation(n)), "row"),
    ("milliseconds for seconds", renumbered(("t",), every(lambda t: 1e3 * t)), "time|unit"),
    ("few rows", rows(lambda n, g: slice(0, int(g.integers(2, 12)))), "short|sample|reading|span"),
    ("one row", rows(lambda n, g: slice(0, 1)), "sample|reading|row"),
    ("no row", rows(lambda n, g: slice(0, 0)), "row"),
    ("a time of its own that is not there", lines(MAPS, f'{MAPS}, time = {{ column = "tq", unit = "s" }}'), "tq"),
    ("an input axis beside three outputs", lines("[channels]", '[rig]\ninput_axis = "x"\n[channels]'), "input_axis"),
)
ANGLE_UNIT, ARM, AXLE, AXIS = 'unit = "deg"', 'arm = "0.2 m"', 'axle = "horizontal"', 'input_axis = "radial"'
ARM_STD, TH = 'arm_std = "1 mm"\n', ("angle",)


def counted(modulus: float) -> Change:
    """An encoder of 10 000 counts a turn, whose counter runs over."""

    def act(record: Record, _: Rng) -> None:
        record.put(TH, np.rint(record.numbers("angle") / 360.0 * 1e4) % modulus)
        record.lines(ANGLE_UNIT, 'unit = "count", scale = "1e4 count/rev"')

    return act


def sooner(truth: dict[tuple[str, str], float]) -> None:
    """The truth of an output that comes 50 ms sooner, beside a late angle."""
    truth["time_offset", ""] -= 0.05


ANGLE: tuple[tuple[str, Change, str], ...] = (
    ("radians for degrees", lines(ANGLE_UNIT, 'unit = "rad"'), "angle"),
    ("degrees for radians", renumbered(TH, every(np.radians)), "angle|scale"),
    ("turns for degrees", lines(ANGLE_UNIT, 'unit = "rev"'), "angle"),
    ("a length for an angle", lines(ANGLE_UNIT, 'unit = "mm"'), "angle"),
    ("no unit", lines(f", {ANGLE_UNIT}", ""), "angle"),
    ("counts without a scale", lines(ANGLE_UNIT, 'unit = "count"'), "scale"),
    ("a scale of another unit", lines(ANGLE_UNIT, 'unit = "count", scale = "10 count/mm"'), "scale"),
    ("a scale of zero", lines(ANGLE_UNIT, 'unit = "count", scale = "0 count/rev"'), "scale"),
    ("counts", counted(1e9), ""),
    ("a counter that runs over each turn", counted(1e4), ""),
    ("a counter that runs over at 4096", counted(4096.0), ""),
    ("a counter that runs over at 64", counted(64.0), "angle"),
    ("wrapped", renumbered(TH, every(lambda a: a % 360.0)), ""),
    ("wrapped about zero", renumbered(TH, every(lambda a: (a + 180.0) % 360.0 - 180.0)), ""),
    ("wrapped at 90", renumbered(TH, every(lambda a: a % 90.0)), "angle"),
    ("wrapped at 180", renumbered(TH, every(lambda a: a % 180.0)), "angle"),
    ("without its sign", renumbered(TH, every(np.abs)), "angle|arm|residual|noise"),
    ("the other sense", renumbered(TH, every(np.negative)), "angle|arm|scale"),
    ("the other sense from the middle on", renumbered(TH, part(np.negative)), "angle"),
    ("a jump", renumbered(TH, part(lambda a: a + 20.0)), "angle"),
    ("a jump of half a turn", renumbered(TH, part(lambda a: a + 181.0)), "angle"),
    ("a jump of a turn", renumbered(TH, part(lambda a: a + 360.0)), ""),
    ("jumps and back", renumbered(TH, some(lambda a: a + 250.0, 3)), ""),
    ("small jumps and back", renumbered(TH, some(lambda a: a + 5.0, 6)), "angle"),
    ("stands", column(TH, "12"), "angle"),
    ("stands from the middle on", renumbered(TH, part(lambda a: 0.0 * a + a[:1])), "angle"),
    ("empty", column(TH, ""), "angle"),
    ("one reading", lambda r, _: r.columns.update(angle=["3", *[""] * 2399]), "angle"),
    ("two readings", lambda r, _: r.columns.update(angle=["3", *[""] * 2397, "9", ""]), "angle|readings|overlap|span"),
    ("no number", cell(TH, NO_NUMBERS), "angle"),
    ("not finite", cell(TH, NOT_FINITE), "angle"),
    ("huge", cell(TH, HUGE), "angle"),
    ("a run of nan", emptied(TH, 40, "nan"), "angle"),
    ("a run of zeros", emptied(TH, 41, "0"), "angle"),
    ("a gap", emptied(TH, 60), ""),
    ("a gap of five seconds", emptied(TH, 1000), ""),
    ("two decimals", renumbered(TH, every(lambda a: np.round(a, 2))), ""),
    ("whole degrees", renumbered(TH, every(np.rint)), ""),
    ("late by 50 ms", but(lambda r, _: r.put(TH, np.roll(r.numbers("angle"), 10, axis=0)), sooner), ""),
    ("reversed", renumbered(TH, every(lambda a: a[::-1])), "angle|scale"),
    ("stretches exchanged", renumbered(TH, exchanged), "angle"),
    ("reversed time", renumbered(("t",), every(lambda t: t[::-1])), "time|t"),
    ("rows reversed", rows(lambda n, g: slice(None, None, -1)), "time|t"),
    ("a stamp twice", lambda r, g: r.cell("t", 600, r.columns["t"][599]), "row 60[12]"),
    ("milliseconds for seconds", renumbered(("t",), every(lambda t: 1e3 * t)), "time|unit|arm|scale"),
    ("angle and output swapped", swapped("angle", "acc"), "angle|empty|scale|gap"),
    ("no column", without(TH), "angle"),
    ("no arm", lines(f"{ARM}\n{ARM_STD}", ""), "arm"),
    ("no length", lines(ARM, 'arm = ""'), "arm"),
    ("a negative arm", lines(ARM, 'arm = "-0.2 m"'), "arm"),
    ("an arm of zero", lines(ARM, 'arm = "0 m"'), "arm"),
    ("an arm without a unit", lines(ARM, "arm = 0.2"), "arm"),
    ("an arm in kilograms", lines(ARM, 'arm = "0.2 kg"'), "arm"),
    ("millimetres for metres", lines(ARM, 'arm = "0.2 mm"'), "arm"),
    ("metres for millimetres", lines(ARM, 'arm = "200 m"'), "arm"),
    ("an arm of 1e300", lines(ARM, 'arm = "1e300 m"'), "arm"),
    ("an arm that is not finite", lines(ARM, 'arm = "nan m"'), "arm"),
    ("twice the arm", lines(ARM, 'arm = "0.4 m"'), "arm|lever"),
    ("an uncertainty of zero", lines(ARM_STD, 'arm_std = "0 mm"\n'), "arm_std"),
    ("a negative uncertainty", lines(ARM_STD, 'arm_std = "-1 mm"\n'), "arm_std"),
    ("no uncertainty", lines(ARM_STD, ""), ""),
    ("a vertical axle", lines(AXLE, 'axle = "vertical"'), "axle|gravity|scale"),
    ("an axle at 30 degrees", lines(AXLE, 'axle = "30 deg"'), "axle|gravity|scale"),
    ("an axle at 300 degrees", lines(AXLE, 'axle = "300 deg"'), "axle"),
    ("an axle that is a vector", lines(AXLE, "axle = [0, 0, 1]"), "axle"),
    ("an axle of another word", lines(AXLE, 'axle = "sideways"'), "axle"),
    ("no axle", lines(f"{AXLE}\n", ""), "axle"),
    ("tangential for radial", lines(AXIS, 'input_axis = "tangential"'), "axis|scale"),
    ("axial for radial", lines(AXIS, 'input_axis = "axial"'), "axis|scale"),
    ("inward for outward", lines(AXIS, "input_axis = [-1, 0, 0]"), "axis|scale|sign"),
    ("an axis of zero", lines(AXIS, "input_axis = [0, 0, 0]"), "input_axis"),
    ("an axis of two", lines(AXIS, "input_axis = [1, 0]"), "input_axis"),
    ("an axis of texts", lines(AXIS, 'input_axis = ["a", "b", "c"]'), "input_axis"),
    ("an axis of 1e300", lines(AXIS, "input_axis = [1e300, 0, 0]"), "input_axis"),
    ("no axis", lines(f"{AXIS}\n", ""), "input_axis"),
    ("an attitude beside", lambda r, _: setattr(r, "sidecar", r.sidecar + f"[channels.attitude]\n{COLUMNS}\n{MAPS}\n"),
     "attitude|angle"),
    ("a zero two turns away", lines(ANGLE_UNIT, f'{ANGLE_UNIT}, zero = "720 deg"'), ""),
)  # fmt: skip
NUMBERS = ("attitude_deg", "mean", "std", "duration_s", "samples")
DWELL_TABLES: tuple[tuple[str, Change, str], ...] = (
    *((f"no number in {name}", cell((name,), NO_NUMBERS), name) for name in NUMBERS),
    *((f"{name} not finite", cell((name,), NOT_FINITE), name) for name in NUMBERS),
    *((f"huge {name}", cell((name,), ("1e300", "-1e300")), name) for name in NUMBERS),
    *((f"no {name}", without((name,)), "no column") for name in NUMBERS),
    *((f"an empty cell of {name}", cell((name,), ("",)), name) for name in NUMBERS),
    *((f"a zero of {name}", cell((name,), ("0",)), name) for name in NUMBERS[2:]),
    *((f"a negative {name}", cell((name,), ("-3",)), name) for name in NUMBERS[2:]),
    ("no number of a temperature", cell(("temperature_degC",), NO_NUMBERS), "temperature"),
    ("a huge temperature", cell(("temperature_degC",), ("1e300",)), "temperature"),
    ("below the absolute zero", cell(("temperature_degC",), ("-400",)), "temperature"),
    ("kelvin for celsius", column(("temperature_degC",), "296"), "temperature"),
    ("temperatures half empty", cell(("temperature_degC",), ("",)), "temperature"),
    ("text for a group", cell(("group",), ("A",)), "group"),
    ("each its group", lambda r, _: r.columns.update(group=[str(k) for k in range(12)]), "group|dwell"),
    ("angle and mean swapped", swapped("attitude_deg", "mean"), "scale|mean|attitude"),
    ("mean and std swapped", swapped("mean", "std"), "std|mean"),
    ("std and samples swapped", swapped("std", "samples"), "samples|std"),
    ("radians for degrees", renumbered(NUMBERS[:1], every(np.radians)), "attitude_deg|angle|scatter"),
    ("the other sense", renumbered(NUMBERS[:1], every(np.negative)), "scale|attitude|angle"),
    ("all level", column(NUMBERS[:1], "0"), "attitude|elevation|angle"),
    ("all means alike", column(NUMBERS[1:2], "3"), "scale|mean|scatter"),
    ("one angle wrong by 90 degrees", renumbered(NUMBERS[:1], some(lambda a: a + 90.0, 1)), "dwell|scatter|angle"),
    ("two rows exchanged", lambda r, _: r.put(NUMBERS[1:2], r.numbers("mean")[[0, 7, *range(2, 7), 1, *range(8, 12)]]),
     "dwell|scatter|angle"),
    ("g for m/s2", renumbered(NUMBERS[1:3], every(lambda y: y / G)), "scale|unit"),
    ("milli-g for m/s2", renumbered(NUMBERS[1:3], every(lambda y: 1e3 * y / G)), "scale|unit"),
    ("a row twice", rows(lambda n, g: [*range(n), 3]), "twice|dwell|row"),
    ("all rows twice", rows(lambda n, g: [*range(n), *range(n)]), "twice|dwell|row"),
    ("one row", rows(lambda n, g: [3]), "dwell"),
    ("two rows", rows(lambda n, g: [0, 3]), ""),
    ("no row", rows(lambda n, g: slice(0, 0)), "row|dwell"),
    ("reversed", rows(lambda n, g: slice(None, None, -1)), ""),
    ("no unit", lines(', unit = "m/s^2"', ""), "unit"),
    ("a unit of length", lines('unit = "m/s^2"', 'unit = "mm"'), "unit|mean|accel"),
    ("volts without a scale", lines('unit = "m/s^2"', 'unit = "V"'), "scale"),
    ("gravity of 98.1", lines("9.81 m", "98.1 m"), "gravity"),
    ("gravity of zero", lines("9.81 m", "0 m"), "gravity"),
    ("negative gravity", lines("9.81 m", "-9.81 m"), "gravity"),
    ("gravity in kilograms", lines("9.81 m/s^2", "9.81 kg"), "gravity"),
    ("a negative uncertainty", lines("0.001 deg", "-0.001 deg"), "angle_std"),
    ("an uncertainty of 400 degrees", lines("0.001 deg", "400 deg"), "angle_std"),
    ("an attitude beside the table", lines("[dwell]", '[dwell]\nattitude = "up"'), ""),
)  # fmt: skip
AXES = ("x", "y", "z")


def crossed(truth: dict[tuple[str, str], float]) -> None:
    """The truth of x as y, and the other way round."""
    for name in "Kb":
        truth[name, "x"], truth[name, "y"] = truth[name, "y"], truth[name, "x"]


def negated(truth: dict[tuple[str, str], float]) -> None:
    """The truth of minus y: the norm does not show its sign."""
    truth["b", "y"] *= -1.0


SIX_FACES: tuple[tuple[str, Change, str], ...] = (
    ("four faces", rows(lambda n, g: slice(0, 1100)), "position|face"),
    ("one face", rows(lambda n, g: slice(0, 270)), "position|face"),
    ("a face missing", rows(lambda n, g: slice(0, n - 275)), "z down"),
    ("a face twice", rows(lambda n, g: [*range(n), *range(n - 275)]), "row|time|stamp"),
    ("norms of 2", renumbered(AXES, part(lambda y: 2.0 * y)), "norm|residual|scatter|determine"),
    ("one face of norm 2", lambda r, g: r.put(AXES, 2.0 * r.numbers(*AXES)[75:275], slice(75, 275)), "norm|scatter"),
    ("x and y swapped", but(swapped("x", "y"), crossed), ""),
    ("x for y", lambda r, _: r.columns.update(y=list(r.columns["x"])), "position|face|determine|y"),
    ("a constant axis", column(("y",), "0.1"), "y"),
    ("an empty axis", column(("y",), ""), "accel_y|0 positions"),
    ("a missing axis", without(("y",)), "y"),
    ("an axis not declared", lines('accel_y = { column = "y", unit = "g" }\n', ""), "accel_y"),
    ("an axis of another unit", lines('column = "y", unit = "g"', 'column = "y", unit = "mm"'), "accel_y|y"),
    ("an axis in m/s2 of g", lines('column = "y", unit = "g"', 'column = "y", unit = "m/s^2"'), "y|unit|scale"),
    ("all in m/s2 of g", lines('unit = "g"', 'unit = "m/s^2"'), "unit|scale"),
    ("an axis reversed", but(renumbered(("y",), every(np.negative)), negated), ""),
    ("an axis reversed in time", renumbered(("y",), every(lambda y: y[::-1])), "position|face|rest|norm"),
    ("no number", cell(AXES, NO_NUMBERS), '"[xyz]"'),
    ("not finite", cell(AXES, NOT_FINITE), "accel_"),
    ("huge", cell(AXES, HUGE), "accel_"),
    ("an empty cell", cell(AXES, ("",)), "accel_|row"),
    ("a gap", emptied(("x", "y", "z"), 100), "positions"),
    ("never at rest", renumbered(AXES, lambda y, g: y + g.standard_normal(y.shape)), "rest|position"),
    ("clipped", renumbered(AXES, every(lambda y: np.clip(y, -0.9, 0.9))), "range|no rest"),
    ("a zero of gravity", lines("9.81 m", "0 m"), "gravity"),
    ("gravity of 98.1", lines("9.81 m", "98.1 m"), "gravity"),
    ("a known attitude", lines('"unknown"', '"up"'), "unknown"),
    ("no attitude", lines('attitude = "unknown"\n', ""), "unknown"),
    ("seconds in milliseconds", lines('column = "t", unit = "s"', 'column = "t", unit = "ms"'), "rest"),
    ("one row", rows(lambda n, g: slice(0, 1)), "row|rest|sample"),
    ("no row", rows(lambda n, g: slice(0, 0)), "row"),
    ("rows shuffled", rows(lambda n, g: g.permutation(n)), "row"),
    ("rows reversed", rows(lambda n, g: slice(None, None, -1)), "row|time|t"),
)
GUIDED = tuple(
    (name, change, f"{names}|no line could be used|positions" if names else "")
    for name, change, names in SIX_FACES
    if "attitude" not in name
)
OUTPUTS: tuple[tuple[str, Change, str], ...] = (
    *((f"{name} not declared", lines(f'{name} = {{ column = "{name}", unit = "m/s^2" }}\n', ""), name) for name in OUT),
    *((f"{name} empty", column((name,), ""), name) for name in OUT),
    ("no column", without(OUT[1:2]), "accel_y"),
    *((f"{name} stands", column((name,), "1.5"), name[-1]) for name in OUT),
    ("stands from the middle on", renumbered(OUT[1:2], part(lambda y: 0.0 * y + y[:1])), "y"),
    ("one in g", lines('column = "accel_y", unit = "m/s^2"', 'column = "accel_y", unit = "g"'), "y.*scale|scale|unit"),
    ("one of m/s2 read in g", renumbered(OUT[1:2], every(lambda y: y / G)), "scale|unit"),
    ("one of a length", lines('column = "accel_y", unit = "m/s^2"', 'column = "accel_y", unit = "mm"'), "accel_y"),
    ("one in volts", lines('column = "accel_y", unit = "m/s^2"', 'column = "accel_y", unit = "V"'), "scale"),
    ("one without a unit", lines('column = "accel_y", unit = "m/s^2"', 'column = "accel_y"'), "accel_y"),
    *((f"{name} of the other sign", renumbered((name,), every(np.negative)), "sign|scale") for name in OUT),
    ("one reversed in time", renumbered(OUT[2:], every(lambda y: y[::-1])), "z"),
    ("all reversed in time", renumbered(OUT, every(lambda y: y[::-1])), "scale|motion|relation|lag"),
    ("x and y swapped", swapped("accel_x", "accel_y"), "column|axis|scale|direction|turn"),
    ("y and z swapped", swapped("accel_y", "accel_z"), "column|axis|scale|direction|turn"),
    ("x for y", lambda r, _: r.columns.update(accel_y=list(r.columns["accel_x"])), "column|axis|scale|direction"),
    ("one column twice", lines('column = "accel_y"', 'column = "accel_x"'), "accel_x"),
    ("turned by 45 degrees", renumbered(OUT[:2], every(lambda y: y @ np.array([[1, 1], [-1, 1]]) / np.sqrt(2.0))),
     "axis|direction|scale|turn|misalign"),
    ("turned by 10 degrees", renumbered(OUT[:2], every(lambda y: y @ np.array([[0.985, 0.174], [-0.174, 0.985]]))),
     "misalign|direction|scale"),
    ("late by 50 ms", shifted(OUT[1:2], 5), "y|delay|time"),
    ("no number", cell(OUT, NO_NUMBERS), "accel_"),
    ("not finite", cell(OUT, NOT_FINITE), "accel"),
    ("huge", cell(OUT, HUGE), "accel"),
    ("an empty cell", cell(OUT, ("",)), ""),
    ("a gap of one", emptied(OUT[1:2], 60), ""),
    ("a run of nan", emptied(OUT[1:2], 60, "nan"), "accel"),
    ("a run of zeros", emptied(OUT[1:2], 60, "0"), ""),
    ("outliers", renumbered(OUT[1:2], some(lambda y: y + 30.0, 6)), ""),
    ("clipped", renumbered(OUT[2:], every(lambda y: np.clip(y, -9.0, 9.0))), "range|clip|satur|limit"),
    ("counts", renumbered(OUT, every(lambda y: np.rint(y / 0.5) * 0.5)), ""),
    ("without gravity", renumbered(OUT, lambda y, _: y - y.mean(axis=0)), "gravity|bias"),
    ("a scale of 1e6", renumbered(OUT[:1], every(lambda y: 1e6 * y)), "scale|range|unit"),
    ("a rig beside an arm", lines("[channels]", '[rig]\narm = "0.2 m"\n[channels]'), "arm|axle|angle"),
)  # fmt: skip
CHANGES = {
    "attitude": ATTITUDE, "angle": ANGLE, "dwells": DWELL_TABLES,
    "faces": SIX_FACES, "guide": GUIDED, "outputs": OUTPUTS,
}  # fmt: skip


def case_of(section: str, number: int) -> tuple[Record, str, str]:
    """The record of a case, what was changed, and what a refusal or a finding names; "" where the answer is right.

    Neighbours of one kind are far apart in number, so that a slice has some of each.
    """
    name, change, names = CHANGES[section][number * 37 % len(CHANGES[section])]
    record = copy.deepcopy(simulated(section))
    change(record, case_rng(section, number))
    return record, name, names
