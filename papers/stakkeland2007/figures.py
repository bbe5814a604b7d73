"""Fig. 3 of the paper, output against acceleration, and Figs. 4 and 5, parameter estimates over time with the truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from accelcal._support.result import Storable
from accelcal.estimation.estimate import Fit
from accelcal.plots import matplotlib
from accelcal.plots.figure import Axis, Band, Figure, Level, Line, Mark, Panel, Role
from accelcal.plots.model import nonlinearity
from papers.stakkeland2007.rows import Item

if TYPE_CHECKING:
    from papers.stakkeland2007.question import ParameterTrack


UNITS = {"k": "1", "K0": "m/s²", "K2": "(m/s²)⁻¹", "K3": "(m/s²)⁻²"}
_ROLES: tuple[Role, ...] = ("band", "model")
"""Of the filters; the first is drawn below the others."""
WIDTH = 160
"""Characters of a line."""
_SPAN = 8.0
"""Half height of a panel, in standard deviations at a fifth of the record."""


def draw(fit: Fit, linear: Sequence[ParameterTrack], cubic: Sequence[ParameterTrack], out: Path) -> tuple[Path, ...]:
    """Write Figs. 3 to 5 as PNG, and return the files.

    Parameters
    ----------
    fit : of a curved sensor.
    linear, cubic : tracks of every filter.
    out : Path
        Directory; created if absent.
    """
    out.mkdir(parents=True, exist_ok=True)
    drawn = {
        "figure3.png": nonlinearity(fit),
        "figure4.png": _figure(linear, "Linear model: scale factor and bias"),
        "figure5.png": _figure(cubic, "Cubic model: scale factor, bias and nonlinear coefficients"),
    }
    for name, figure in drawn.items():
        matplotlib.save(matplotlib.draw(figure), out / name)
    return tuple(out / name for name in drawn)


def _figure(tracks: Sequence[ParameterTrack], headline: str) -> Figure:
    """Estimates of every filter with two standard deviations about the truth, and the motion under them."""
    time, panels = Axis("time", "s", range=(0.0, max(float(track.t[-1]) for track in tracks))), []
    for i, name in enumerate(tracks[0].names):
        truth, marks = float(tracks[0].truth[i]), list[Mark]()
        for track, role in zip(reversed(tracks), _ROLES, strict=True):
            estimate, reach = track.estimates[:, i], 2.0 * track.sigmas[:, i]
            label = f"{track.title}, ±2 sigma"
            marks += [
                Band(track.t, estimate - reach, estimate + reach, role=role, outlined=False),
                Line(track.t, estimate, label, role, solid=True),
            ]
        half = _SPAN * max(track.sigmas[len(track.t) // 5, i] for track in tracks)
        size = Axis(name, UNITS[name], range=(truth - half, truth + half))
        panels.append(Panel((*marks, Level(truth, name="truth")), time, size, height=160.0))
    motion = Line(tracks[0].t, tracks[0].motion, role="ink", opacity=0.5)
    panels.append(Panel((motion,), time, Axis("mean a²", "1", range=(0.0, 1.05)), height=160.0))
    return Figure(tuple(panels), headline, shared_x=True)


def render(items: Iterable[Item]) -> str:
    """Tables of what is claimed, expected and measured; then the claims that do not hold, the paper's first."""
    items, file = tuple(items), StringIO()
    console = Console(file=file, width=WIDTH, highlight=False)
    for item in items:
        cells = (
            [r.claim, r.by, r.expected, r.measured, str(r.n), r.threshold, "yes" if r.holds else "NO", r.remark]
            for r in item.rows
        )
        console.print(_table(f"{item.title} [{item.source}]", CLAIM, cells))
        console.print()
    rows = [row for item in items for row in item.rows]
    for by, whose in (("paper", "the paper's"), ("us", "our own")):
        claims = [row for row in rows if row.by == by]
        failed = [row for row in claims if not row.holds]
        console.print(f"{len(claims) - len(failed)} of {whose} {len(claims)} claims hold in these runs.")
        for row in failed:
            remark = f" ({row.remark})" if row.remark else ""
            text = f"  does not hold: {row.claim}: expected {row.expected}, measured {row.measured}{remark}"
            console.print(text, markup=False)
    return file.getvalue()


CLAIM = ("claim", "by", "expected", "measured", "n", "threshold", "holds", "remark")
"""Columns of a table of claims."""


def _table(title: str, names: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    columns = (Column(name, justify="right" if name == "n" else "left") for name in names)
    table = Table(*columns, title=escape(title), title_justify="left")
    for row in rows:
        table.add_row(*map(escape, row))
    return table


@dataclass(frozen=True, slots=True)
class Statement(Storable):
    """One statement of the paper."""

    derived: ClassVar[tuple[str, ...]] = ("state",)

    where: str
    text: str
    items: tuple[str, ...] = ()
    """Items of the reproduction that answer it."""
    product: str = ""
    """Where else the product does: a command, an effect."""
    open: str = ""
    """What is not answered yet."""
    impossible: str = ""
    """Why it, or a part of it, cannot be answered."""

    @property
    def answer(self) -> str:
        """Items and products, in words; empty where there are none."""
        return "; ".join(filter(None, [", ".join(self.items), self.product]))

    @property
    def state(self) -> str:
        """Closed, partly closed, open, or cannot be closed."""
        if self.open:
            return "partly" if self.answer else "open"
        if self.impossible:
            return "closed in part, the rest cannot be" if self.answer else "cannot be closed"
        return "closed"


LOST = "its body did not survive in the copies at hand; an independent simulation stands beside our figures"
NOT_PUBLIC = "their recordings were not published"

STATEMENTS: tuple[Statement, ...] = (
    Statement(
        "abstract", "test and characterise with a position sensor and nonlinear filters", ("consistency", "tracks")
    ),
    Statement("abstract, I", "simpler than tumble and vibration tests", ("standard_tests",)),
    Statement("abstract, I", "simpler than centrifuge and rotary table", ("centrifuge",), product="channels.angle"),
    Statement("abstract, I", "real-time estimation of the parameters", ("tracks",), product="LiveModel, firmware"),
    Statement(
        "I", "bandwidth of detectable variations", product="accelcal power: drift bandwidth beside a tumble test"
    ),
    Statement(
        "abstract", "part of a tracking or navigation system", ("gaps",), open="three dimensions and a navigation state"
    ),
    Statement("I", "multipoint tumble test: output = p'' - g", ("standard_tests",), product="accelcal dwells"),
    Statement("I", "vibration test: mean of the output", ("standard_tests",)),
    Statement("II-A", "ADXL105, CXL02TG3, encoder of 1 um at 833 Hz, two boards", ("consistency", "vibration", "gaps")),
    Statement(
        "II-A",
        "CXL02TG3: three axes and a bandwidth of 200 Hz",
        ("three_axes",),
        product="a_y, a_z; [channels] filters",
    ),
    Statement("II-A", "encoder bandwidth of 100 mm/s", ("encoder_speed",), product="effect encoder_lag"),
    Statement(
        "II-A", "encoder accuracy of 10 um", product="effects encoder_cyclic, encoder_nonlinearity, encoder_scale"
    ),
    Statement(
        "II-A",
        "aligning the input axis",
        ("alignment",),
        product="tilt and misalignment from turned and rolled runs",
    ),
    Statement("II-A", "temperature controller", product="channel temperature and its effects"),
    Statement("II-A", "clock skew between the boards", product="effect clock_skew"),
    Statement("II-B", "(1) to (6), K' = (1 + k) K", ("scale_update",)),
    Statement("II-B", "the linear model gives the same estimate in both forms", ("linear_filters",)),
    Statement(
        "II-B", "the extensive model of IEEE 1293", product="Kio, Kip, Kop, Koo, Kpp, Kspin, Kang with their channels"
    ),
    Statement("II-B1", "(7) and its cures: along gravity, rolled by 180 degrees", ("cross_axis",)),
    Statement("II-C", "(8), neglected terms corrupt k and K0", ("fourier",)),
    Statement(
        "II-D", "constant parameters, Markov processes", ("varying",), product="bias_*, scale_* as processes; LiveModel"
    ),
    Statement("II-E", "ACI (9) and CWPA (10)", ("consistency", "convergence")),
    Statement("II-F", "vibration of 200 Hz to 300 Hz growing with speed", ("vibration",)),
    Statement(
        "II-F",
        "noise correlated with the state is approximated",
        ("vibration",),
        product="effects on noise: accelcal add vibration",
    ),
    Statement("II-G, II-H", "orders, integrators, NEES and rms (15)", ("consistency", "convergence")),
    Statement("III-A1", "consistent when the model matches; CWPA converges faster", ("consistency", "convergence")),
    Statement("III-A2, Table I", "errors under vibration", ("vibration",), impossible=LOST),
    Statement("III-A2", "CWPA is often unstable", ("robustness",)),
    Statement("III-B1", "first and second order are the same for the linear model", ("linear_filters",)),
    Statement("III-B, Figs. 4, 5", "tracks of 130 s and 250 s of real data", ("tracks",), impossible=NOT_PUBLIC),
    Statement("III-B, Tables II, III", "gaps", ("gaps",), impossible=NOT_PUBLIC),
    Statement("IV", "ACI is less sensitive to mismatches", ("consistency",)),
    Statement("IV", "why the linear model tracked better", ("question", "varying")),
    Statement("IV, [4]", "a suboptimal design (Schmidt-Kalman)", ("consider",), product="FilterChoice(consider=...)"),
    Statement("Figs. 1, 2", "photograph and acquisition", impossible="they show hardware"),
    Statement("Fig. 3", "mapping between output and acceleration", ("mapping",), product="plots.nonlinearity"),
)
"""In the order of the paper."""


def coverage_text() -> str:
    """A table for the terminal, and how many statements are in each state."""
    file = StringIO()
    console = Console(file=file, width=WIDTH, highlight=False)
    names = ("where", "statement", "state", "by", "what is missing, or why")
    cells = ((s.where, s.text, s.state, s.answer, s.open or s.impossible) for s in STATEMENTS)
    console.print(_table("The paper, statement by statement", names, cells))
    counts = Counter(item.state for item in STATEMENTS)
    console.print("; ".join(f"{state}: {n}" for state, n in counts.items()))
    return file.getvalue()
