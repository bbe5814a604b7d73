"""Exports: the sensor's own calibration as C99, Rust, JSON and a draft certificate, with a proven error bound."""

from accelcal._support.values import listing
from accelcal.calibration.export.c99 import header
from accelcal.calibration.export.calibration import Calibration, calibrate
from accelcal.calibration.export.dcc import draft
from accelcal.calibration.export.finite import NotExportable
from accelcal.calibration.export.laboratory import Laboratory, LaboratoryError, read_laboratory
from accelcal.calibration.export.rust import module
from accelcal.calibration.export.schema import SchemaError, require_valid

__all__ = [
    "Calibration",
    "Laboratory",
    "LaboratoryError",
    "NotExportable",
    "SchemaError",
    "calibrate",
    "draft",
    "header",
    "module",
    "read_laboratory",
    "require_valid",
]


__dir__ = listing(globals())
