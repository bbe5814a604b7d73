"""Dwells of several files as one set."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from accelcal.data.dwells import Dwells
from accelcal.data.recording import Recording, RecordingError, require_same_sensor


def with_dwells(several: Recording | Dwells | Sequence[Recording | Dwells]) -> list[Recording] | Dwells:
    """Recordings, all dwells among them given to the first; the dwells themselves where there is no recording."""
    given = [several] if isinstance(several, Recording | Dwells) else list(several)
    recordings = [one for one in given if isinstance(one, Recording)]
    dwells = [one for one in given if isinstance(one, Dwells)]
    if not recordings:
        return together(dwells)
    return dwells_with_first(recordings, dwells)


def dwells_with_first(recordings: Sequence[Recording], further: Sequence[Dwells] = ()) -> list[Recording]:
    """The recordings, all their dwells and further ones with the first; a table that several sidecars name counts
    once."""
    own = {r.dwells.digest or str(number): r.dwells for number, r in enumerate(recordings) if r.dwells is not None}
    every = [*own.values(), *(one for one in further if not one.digest or one.digest not in own)]
    if not every:
        return list(recordings)
    first, *others = recordings
    return [first.with_dwells(together(every)), *(replace(r, dwells=None) for r in others)]


def together(several: Sequence[Dwells]) -> Dwells:
    """Dwells of several files as one set; groups of two files have angle zeros of their own.

    Raises
    ------
    RecordingError
        If they are not of one sensor, or declare different gravity or uncertainty of the angle.
    """
    first, *others = several
    if not others:
        return first
    for one in others:
        for key, words in (("gravity", "local gravity"), ("angle_std", "an angle_std")):
            if getattr(one, key) != getattr(first, key):
                raise RecordingError(
                    f"{one.name}: {words} of {getattr(one, key):.6g} is declared, but {first.name} has "
                    f"{getattr(first, key):.6g}; dwells of one fit share it: correct [dwell] in one of the sidecars"
                )
        for key in ("noise", "bias_instability", "random_walk"):
            if getattr(one.rig.sensor, key) != getattr(first.rig.sensor, key):
                raise RecordingError(
                    f"{one.name}: sensor.{key} is not that of {first.name}; dwells of one fit share it: declare the "
                    "same in both sidecars"
                )
        if one.rig.uncertainty.level != first.rig.uncertainty.level:
            raise RecordingError(
                f"{one.name}: uncertainty.level is not that of {first.name}; declare the same in both sidecars"
            )
        require_same_sensor(one, first.rig, first.name)
        if one.digest and one.digest in {first.digest, *(other.digest for other in others if other is not one)}:
            raise RecordingError(f"{one.name} is given twice: its dwells would count twice. Give it once")
    warm = [one.temperature for one in several]
    return replace(
        first,
        angle=np.concatenate([one.angle for one in several]),
        mean=np.concatenate([one.mean for one in several]),
        std=np.concatenate([one.std for one in several]),
        duration=np.concatenate([one.duration for one in several]),
        samples=np.concatenate([one.samples for one in several]),
        group=tuple(f"{k}: {group}" if group else str(k) for k, one in enumerate(several) for group in one.group),
        temperature=None if any(each is None for each in warm) else np.concatenate([w for w in warm if w is not None]),
        name=" and ".join(one.name for one in several),
        digest=hashlib.sha256(" ".join(one.digest for one in several).encode()).hexdigest(),
        assumptions=tuple(dict.fromkeys(text for one in several for text in one.assumptions)),
    )
