"""One recording of two loggers: the output of one on the clock of the position of the other."""

from __future__ import annotations

import hashlib
from dataclasses import replace

from accelcal.data.alignment import align, shifted, spacing
from accelcal.data.recording import Finding, Recording
from accelcal.io.sidecar import ASSUMED_OFFSET_TOLERANCE


def joined(output: Recording, reference: Recording) -> Recording:
    """One recording of two loggers: the output of one, shifted onto the clock of the position of the other.

    Parameters
    ----------
    output : recording whose position is not used.
    reference : recording whose output is not used; filters and resolution of the position are those of its rig.

    Raises
    ------
    RecordingError
        If they cannot be aligned.
    """
    rig = replace(
        output.rig,
        position_filters=output.rig.position_filters or reference.rig.position_filters,
        resolution=reference.rig.resolution if output.rig.resolution is None else output.rig.resolution,
    )
    delay = 0.0 if rig.lowpass is None else rig.lowpass.tau
    name = f"{output.name} with {reference.name}"
    found = align(output.accel, reference.position, polarity=rig.polarity, delay=delay, name=name)
    assumptions = tuple(each for each in rig.assumptions if each != ASSUMED_OFFSET_TOLERANCE)
    drifted = 4.0 * found.std + abs(found.skew) * found.overlap
    free = max(rig.offset_tolerance, drifted, *(spacing(c) for c in (output.accel, reference.position)))
    note = Finding("alignment", "accel", 1, found.middle, found.sentence, "warning" if found.is_ambiguous else "note")
    side = {key: shifted(channel, found.shift) for key, channel in output.side.items()}
    return replace(
        output,
        accel=shifted(output.accel, found.shift),
        position=reference.position,
        rig=replace(rig, offset_tolerance=free, assumptions=assumptions),
        side={**{key: each for key, each in reference.side.items() if key not in side}, **side},
        name=name,
        digest=hashlib.sha256(f"{output.digest} at {found.shift!r} on {reference.digest}".encode()).hexdigest(),
        findings=(note, *output.findings, *reference.findings),
        position_steps=reference.position_steps,
        reference=reference.reference,
    )
