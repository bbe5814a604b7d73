"""The table of peers: times, ratios, bars; and its place in docs/benchmarks.md."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from accelcal import __version__
from accelcal.io import atomic_write
from benches.peers.comparison import FUSED, Found

PAGE = Path("docs/benchmarks.md")
START, END = "<!-- peers: written by python -m benches.peers --write -->\n", "<!-- end of peers -->\n"


@dataclass(frozen=True, slots=True)
class Bar:
    """How many times as long as we a peer takes at least."""

    peer: str
    """How its name begins."""
    workloads: tuple[str, ...]
    least: float
    ratio: float = float("nan")

    @property
    def met(self) -> bool:
        """Whether the smallest ratio is large enough; a peer that is not here proves nothing and fails nothing."""
        return not self.ratio < self.least


BARS = (
    Bar("FilterPy", ("W1", "W2"), 1000.0),
    Bar("JAX", ("W1", "W2", "W3", "W4"), 30.0),
    Bar("adskalman Joseph form", ("W3",), 8.0),
    Bar("Eigen", ("W1", "W2", "W3", "W4"), 4.0),
    Bar("SymPy", ("W1", "W2", "W3", "W4"), 1.0),
    Bar("numba", ("W1", "W2", "W3", "W4"), 1.0),
)


def bars(results: Found, asked: Sequence[Bar]) -> list[Bar]:
    """The smallest ratio of each bar, of the workloads that were run."""
    found_bars = []
    for bar in asked:
        ratios = []
        for result in results.results:
            us = results.of(FUSED, result.workload)
            if us is not None and result.peer.startswith(bar.peer) and result.workload in bar.workloads:
                ratios.append(result.nanoseconds / us.nanoseconds)
        if ratios:
            found_bars.append(Bar(bar.peer, bar.workloads, bar.least, min(ratios)))
    return found_bars


def markdown(results: Found) -> str:
    """Times with their ratios to ours, then the bars, then the peers that were not installed."""
    workloads = sorted({result.workload for result in results.results})
    names = sorted(
        dict.fromkeys(result.peer for result in results.results), key=lambda name: not name.startswith("accelcal")
    )
    lines = [f"| ns per step (times ours) | {' | '.join(workloads)} |", "|---|" + "---|" * len(workloads)]
    lines += [f"| {name} | {' | '.join(cell(results, name, workload) for workload in workloads)} |" for name in names]
    lines += ["", "| at least so many times ours | found | bar | |", "|---|---|---|---|"]
    for bar in bars(results, BARS):
        verdict = "met" if bar.met else "**missed**"
        lines.append(
            f"| {bar.peer}, {' '.join(bar.workloads)} | {figures(bar.ratio)} | {figures(bar.least)} | {verdict} |"
        )
    lines += [
        "",
        f"accelcal {__version__} on {processor()}; Python {platform.python_version()}; "
        f"{version_of('rustc')}; {version_of('c++')}.",
    ]
    lines += [f"Not installed: {name} ({why})." for name, why in results.missing.items()]
    return "\n".join(lines) + "\n"


def cell(results: Found, name: str, workload: str) -> str:
    """A time and its ratio, or why there is none."""
    result = results.of(name, workload)
    if result is None:
        return ""
    if not result.agrees:
        return f"**disagrees by {result.deviation:.1g}**"
    us = results.of(FUSED, workload) or results.of(
        next(r.peer for r in results.results if r.workload == workload), workload
    )
    assert us is not None
    return f"{figures(result.nanoseconds)} ({figures(result.nanoseconds / us.nanoseconds)})"


def figures(value: float) -> str:
    """Three figures, thousands set apart."""
    rounded = float(f"{value:.3g}")
    return f"{rounded:,.{2 if rounded < 10 else 1 if rounded < 100 else 0}f}".replace(",", " ")


def processor() -> str:
    """Its name, and how busy it was."""
    names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    return f"{len(names)} times {names[0].partition(': ')[2]}, load {os.getloadavg()[0]:.1f}"


def version_of(program: str) -> str:
    """First line of what a compiler says of its version."""
    if shutil.which(program) is None:
        return f"no {program}"
    done = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[0]


def write(text: str) -> None:
    """Put the table between its marks on the page."""
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(START)
    _, _, after = rest.partition(END)
    if not rest:
        raise ValueError(
            f"{PAGE}: the table goes between the lines {START.strip()!r} and {END.strip()!r}; put them back."
        )
    atomic_write(PAGE, before + START + "\n" + text + "\n" + END + after)
