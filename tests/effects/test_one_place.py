"""An effect lives in one place: no other part of the package knows an effect by its name."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import accelcal
from accelcal.effects import BUILT_IN
from accelcal.model import NOMINAL

PACKAGE = Path(accelcal.__file__).parent
NAMES = {effect.name for effect in BUILT_IN} - set(NOMINAL)
"""All names but those of the nominal output: bias, scale_factor, time_offset, clock_skew and lowpass_error."""
MAKERS = ("effects", "simulation", "paper", "demo.py", "app/tasks.py")
"""Where names belong: the catalogue, and what makes recordings of known effects or repeats the paper's figures."""
HOMONYMS = {
    ("app/screens/data.py", "cubic"): "model of `fit`: linear or cubic",
    ("app/workbench.py", "cubic"): "model of `fit`: linear or cubic",
    ("app/state.py", "cubic"): "model of `fit`: linear or cubic",
    ("fleet/summary.py", "cubic"): "model of `fit`, and the simulated example",
    ("calibration/agreement.py", "velocity"): "variable of the motion",
    ("calibration/characteristic.py", "encoder_scale"): "key of a sidecar",
    ("calibration/characteristic.py", "misalignment"): "key of a sidecar",
    ("calibration/export/axes.py", "body_misalignment"): "an element of the matrix that is exported",
    ("calibration/export/axes.py", "lever_arm"): "exported beside the matrix",
    ("cli/data.py", "quadratic"): "option of `simulate`",
    ("cli/data.py", "cubic"): "option of `simulate`",
    ("cli/models.py", "cubic"): "model of `fit`: linear or cubic",
    ("data/orientation.py", "arm_bending"): "a side channel",
    ("data/orientation.py", "lever_arm"): "in the sentence on what the turning of a body leaves open",
    ("estimation/estimate.py", "sensor_resonance"): "what the tolerance of a declared resonance leaves open",
    ("estimation/smoothing.py", "lever_arm"): "the place at which effects of the sensor see the force",
    ("data/orientation.py", "quadratic"): "K2 in the sentence on what the turning of an arm leaves open",
    ("data/recording.py", "velocity"): "a reference",
    ("diagnosis/findings.py", "ac_coupling"): "key of the sidecar that declares that filter",
    ("diagnosis/findings.py", "encoder_lag"): "key of the sidecar that declares that filter",
    ("diagnosis/findings.py", "sensor_lag"): "key of the sidecar that declares that filter",
    ("diagnosis/checks.py", "sensor_resonance"): "the column of the second derivative, which measures a resonance",
    ("diagnosis/checks.py", "tilt"): "the cause that a check judges, and the class that it enters",
    ("results/model_file.py", "encoder_scale"): "key of a sidecar",
    ("results/model_file.py", "misalignment"): "key of a sidecar",
    ("results/model_file.py", "tilt"): "the field of a fit, an angle",
    ("estimation/run.py", "cubic"): "interpolation",
    ("estimation/drive.py", "cubic"): "interpolation",
    ("estimation/engines.py", "cubic"): "model of a live filter: linear or cubic",
    ("estimation/run_fit.py", "velocity"): "a reference",
    ("filters/choice.py", "cubic"): "interpolation",
    ("filters/stream.py", "cubic"): "interpolation",
    ("io/sidecar.py", "encoder_scale"): "key of a sidecar",
    ("io/sidecar.py", "misalignment"): "key of a sidecar",
    ("io/write.py", "velocity"): "a reference",
    ("live/tracker.py", "cubic"): "parameter of a live filter",
    ("live/tracker.py", "quadratic"): "parameter of a live filter",
    ("plots/signature.py", "velocity"): "variable of the motion",
    ("report/view.py", "velocity"): "variable of the motion",
    ("validation/regions.py", "velocity"): "variable of the motion",
}
"""Words that name something else in a file, and what."""


def names_in(source: str) -> Iterator[str]:
    """Effect names among the text constants of a file, whole or before a dot (tone.sin)."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            name = node.value.partition(".")[0]
            if name in NAMES:
                yield name


def found_in(package: Path) -> set[tuple[str, str]]:
    """File and name of every effect that is written out where no name belongs."""
    paths = {path: path.relative_to(package).as_posix() for path in sorted(package.rglob("*.py"))}
    return {
        (file, name)
        for path, file in paths.items()
        if not file.startswith(tuple(f"{maker}/" for maker in MAKERS)) and file not in MAKERS
        for name in names_in(path.read_text(encoding="utf-8"))
    }


def test_no_effect_is_known_by_name_outside_the_catalogue():
    assert not found_in(PACKAGE) - set(HOMONYMS)


def test_every_homonym_is_still_there():
    assert set(HOMONYMS) <= found_in(PACKAGE)


def test_a_name_outside_the_catalogue_is_found(tmp_path):
    # The twin that must fail: a side table of effects in a file of its own.
    (tmp_path / "diagnosis").mkdir()
    (tmp_path / "effects").mkdir()
    (tmp_path / "diagnosis" / "table.py").write_text('"""Of bias and tone."""\nLINES = ("tone", "creep.tau", "bias")\n')
    (tmp_path / "effects" / "lines.py").write_text('NAME = "tone"\n')
    assert found_in(tmp_path) == {("diagnosis/table.py", "tone"), ("diagnosis/table.py", "creep")}
