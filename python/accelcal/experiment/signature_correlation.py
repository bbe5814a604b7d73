"""Correlation of the signatures of effects on a record, with everything that the model explains projected out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from accelcal.data import Array
from accelcal.diagnosis.power import Power


@dataclass(frozen=True, slots=True)
class SignatureCorrelation:
    """Correlation of the signatures of some effects, each at its most visible shape."""

    names: tuple[str, ...]
    correlation: Array
    """(n, n)"""

    def of(self, names: list[str]) -> SignatureCorrelation:
        """The correlation of some of them, in a given order."""
        rows = [self.names.index(name) for name in names]
        return SignatureCorrelation(tuple(names), self.correlation[np.ix_(rows, rows)])


def signature_correlation(power: Power) -> SignatureCorrelation:
    """Correlate the signatures of all effects with one constant coefficient that a record can show.

    Parameters
    ----------
    power : from `accelcal.power`.
    """
    model = power.of_run
    G = model.evidence.G
    rows: dict[str, int] = {}
    for item, columns in zip(model.items, model.evidence.columns, strict=True):
        name = item.effect.name
        if item.effect.width > 1 or item.effect.port == "process" or not power[name].seen:
            continue
        best = all(item.shape.get(key) == value for key, value in power[name].shape.items())
        if best and G[columns.start, columns.start] > 0.0:
            rows[name] = columns.start
    kept = list(rows.values())
    size = np.sqrt(np.diag(G)[kept])
    return SignatureCorrelation(tuple(rows), G[np.ix_(kept, kept)] / np.outer(size, size))
