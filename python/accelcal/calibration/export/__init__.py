"""Exports: the sensor's own calibration as C99, Rust, JSON and a draft certificate, with a proven error bound; and
the live filter of a model for a device."""

from accelcal._support.values import listing
from accelcal.calibration.export.axes import PARAMETERS, SensorMatrix, c_files, rust_module
from accelcal.calibration.export.c99 import header
from accelcal.calibration.export.calibration import Calibration, NotExportable, SchemaError, calibrate, require_valid
from accelcal.calibration.export.certificate import Laboratory, LaboratoryError, draft, read_laboratory
from accelcal.calibration.export.filter import filter_files, live_filter
from accelcal.calibration.export.rust import module

__all__ = [
    "PARAMETERS",
    "Calibration",
    "Laboratory",
    "LaboratoryError",
    "NotExportable",
    "SchemaError",
    "SensorMatrix",
    "c_files",
    "calibrate",
    "draft",
    "filter_files",
    "header",
    "live_filter",
    "module",
    "read_laboratory",
    "require_valid",
    "rust_module",
]


__dir__ = listing(globals())
