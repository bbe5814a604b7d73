"""Files become recordings here and only here: nothing guessed, nothing repaired silently."""

from accelcal._support.values import listing
from accelcal.io.atomic import atomic, atomic_write, together
from accelcal.io.dwells import has_three_outputs, load_declared, load_dwells, load_positions
from accelcal.io.loading import body_of_two, load, load_axes
from accelcal.io.sidecar import read_sidecar, sidecar_of
from accelcal.io.template import init, template
from accelcal.io.write import write_body, write_csv, write_parquet, write_sidecar

__all__ = [
    "atomic",
    "atomic_write",
    "body_of_two",
    "has_three_outputs",
    "init",
    "load",
    "load_axes",
    "load_declared",
    "load_dwells",
    "load_positions",
    "read_sidecar",
    "sidecar_of",
    "template",
    "together",
    "write_body",
    "write_csv",
    "write_parquet",
    "write_sidecar",
]


__dir__ = listing(globals())
