"""Figures of what a recording can detect: smallest sizes, drift, and which signatures look alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from accelcal.effects import find, spelled
from accelcal.experiment import Detectability, DriftBandwidth, Power
from accelcal.experiment.signature_correlation import SignatureCorrelation, signature_correlation
from accelcal.plots.figure import Axis, Figure, Line, Panel, Points, Tiles, sentence
from accelcal.results import words as formatting

MOST_SIZES, MOST_SIGNATURES = 50, 20
"""Effects that are drawn at each port, and on the map of signatures."""
PERIODS = 10.0
"""Half periods over which the limit of a tumble test is drawn, its slowest change over the fastest."""


def detectable_at(power: Power, port: str) -> list[Detectability]:
    """Effects that are detectable at the sensor ("output") or at the encoder ("position"), smallest first."""
    return sorted(
        (s for s in power.detectabilities if s.seen and (find(s.effect).port == "position") == (port == "position")),
        key=lambda s: s.largest,
    )


def detectable_sizes(power: Power) -> Figure:
    """Draw the size of each effect that is found with 95 % probability, as its largest contribution.

    Parameters
    ----------
    power : from `accelcal.power`.
    """
    panels = []
    for port, unit, title in (("output", "m/s²", "at the sensor"), ("position", "m", "at the encoder")):
        several = detectable_at(power, port)[:MOST_SIZES]
        if several:
            largest, rows = np.array([s.largest for s in several]), np.arange(float(len(several)))
            names = [spelled(s.effect) for s in several]
            said = [
                f"{name}: {min(s.smallest):.3g} {s.unit}, at most {s.largest:.3g} {unit}"
                for name, s in zip(names, several, strict=True)
            ]
            sizes = Axis(
                "largest contribution at the smallest detectable size",
                unit,
                "log",
                (0.7 * float(largest[0]), 1.4 * float(largest[-1])),
            )
            effects = Axis(range=(len(several) - 0.5, -0.5), ticks=(rows.tolist(), names))
            points = Points(largest, rows, hover=said)
            panels.append(Panel((points,), sizes, effects, title, 20.0 * (len(several) + 1)))
    if not panels:
        return sentence("Detection limits", "No effect is detectable on this record.")
    undetectable = [spelled(s.effect) for s in power.detectabilities if not s.seen]
    return Figure(
        tuple(panels),
        f"Detection limits of this record: 95 % probability, {power.examined} alternatives",
        f"not detectable: {', '.join(undetectable)}" if undetectable else "",
    )


def drift_limits(found: DriftBandwidth) -> Figure:
    """Draw the smallest sinusoidal change that a record shows at 5 standard deviations, and that of a tumble test.

    Parameters
    ----------
    found : from `accelcal.power(...).drift`.
    """
    tumble, panels = found.tumble, []
    slow = np.array([tumble.frequency / PERIODS, tumble.frequency])
    for name, smallest, limit, unit in (
        ("bias", found.bias, tumble.bias, "m/s²"),
        ("scale factor", found.scale_factor, tumble.scale_factor, "1"),
    ):
        shown = np.isfinite(smallest)
        marks = (
            Line(found.frequency[shown], smallest[shown], "this record"),
            Line(slow, np.full(2, limit), f"tumble test of {tumble.seconds / 60.0:.0f} min", "other"),
        )
        every = np.append(smallest[shown], limit)
        frequency = Axis("frequency of the change", "Hz", "log", (float(slow[0]), 1.2 * float(found.frequency[-1])))
        size = Axis(f"amplitude of the {name}", unit, "log", (0.6 * float(every.min()), 1.6 * float(every.max())))
        panels.append(Panel(marks, frequency, size))
    best = int(np.argmin(found.scale_factor))
    least = float(found.scale_factor[best])
    headline = "This record shows no change of the scale factor"
    if np.isfinite(least):
        blind = np.flatnonzero(found.scale_factor > 2.0 * least)
        first = int(np.max(blind[blind < best], initial=-1)) + 1
        last = int(np.min(blind[blind > best], initial=len(found.frequency))) - 1
        low, high = (formatting.number(float(found.frequency[i]), 2) for i in (first, last))
        size_text = formatting.number(2.0 * least, 2)
        headline = f"Changes of the scale factor by {size_text} are shown at 5 sigma from {low} to {high} Hz"
    note = (
        "smallest amplitude that is shown, whatever its phase; the tumble has 24 dwells, the noise of this "
        "record and angles to 0.001 degrees"
    )
    return Figure(tuple(panels), headline, note, columns=2)


def chosen(power: Power, first: Sequence[str] = (), most: int = MOST_SIGNATURES) -> SignatureCorrelation:
    """Effects in `first`, then confounded ones, then the best detectable; correlated ones next to each other.

    Parameters
    ----------
    power : of the record.
    first : effects that must be on the map, if they have one column.
    most : effects on the map.
    """
    whole = signature_correlation(power)
    tied = [name for group in power.ties for name in group.members]
    rest = sorted(whole.names, key=lambda name: power[name].largest)
    wanted = [n for n in dict.fromkeys([*first, *tied, *rest]) if n in whole.names][:most]
    return whole.of(_chain(whole.of(wanted)))


def signatures(power: Power, first: Sequence[str] = ()) -> Figure:
    """Draw the correlation of the signatures of effects on a record.

    Parameters
    ----------
    power : from `accelcal.power`.
    first : effects that must be on the map.
    """
    seen = chosen(power, first)
    if len(seen.names) < 2:
        return sentence("Signatures", "Fewer than two effects are detectable on this record.")
    names, rho = [spelled(n) for n in seen.names], seen.correlation
    text = [[f"{100 * v:.0f}" if abs(v) >= 0.5 else "" for v in row] for row in rho]
    hover = [
        [f"{a} and {b}: ρ = {v:.3f}" for b, v in zip(names, row, strict=True)]
        for a, row in zip(names, rho, strict=True)
    ]
    tiles = Tiles(rho, names, names, text, hover, 1.0, slanted=True)
    panel = Panel((tiles,), Axis("effect (ρ has unit 1)"), Axis(), height=24.0 * len(names))
    return Figure(
        (panel,),
        "Correlation of the signatures of effects on this record, base parameters projected out",
        "ρ in percent where |ρ| is 50 or more, orange where it is positive; beyond 95 % two effects are confounded",
        legend=False,
    )


def _chain(seen: SignatureCorrelation) -> list[str]:
    """An order in which each effect follows the one that it correlates with most."""
    order = list(range(min(1, len(seen.names))))
    while len(order) < len(seen.names):
        left = [i for i in range(len(seen.names)) if i not in order]
        order.append(max(left, key=lambda i: abs(float(seen.correlation[order[-1], i]))))
    return [seen.names[i] for i in order]
