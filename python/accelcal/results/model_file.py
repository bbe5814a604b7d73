"""The model file: a fit as JSON, out and in again, with where it came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from accelcal._support.arguments import checked
from accelcal._support.plain_text import visible
from accelcal._support.values import face, listing
from accelcal.effects import CATALOGUE, side_channel
from accelcal.effects.processes import side_channel_scale
from accelcal.estimation.estimate import Fit
from accelcal.io import atomic_write
from accelcal.model import OwnEffect, SideChannel
from accelcal.results.consistency import require_consistent
from accelcal.results.json_text import AGAIN, ModelFileError, dumps, plain, read_json
from accelcal.results.migrations import MODEL_SCHEMA, migrated

__all__ = ["MODEL_SCHEMA", "ModelFileError", "dumps", "from_dict", "load", "save", "to_dict"]


def to_dict(fit: Fit) -> dict[str, Any]:
    """Return a fit as the content of a model file."""
    return dict(plain(face("results.json").content(fit)))


@checked
def save(fit: Fit, path: str | Path) -> None:
    """Write a model file, whole or not at all.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> made = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(made.recording)
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "m.json")
    >>> fit.save(path)
    >>> ac.load_model(path)["bias"] == fit["bias"]
    True
    """
    atomic_write(path, dumps(to_dict(fit)))


@checked
def load(path: str | Path) -> Fit:
    """Read a model file.

    Raises
    ------
    ModelFileError
        If the file is missing, is no strict JSON, was written by a newer version, or holds a leaf or a combination of
        leaves that no fit has. The text names file and leaf.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> made = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(made.recording)
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "m.json")
    >>> fit.save(path)
    >>> ac.load_model(path).model.added
    ()
    """
    path = Path(path)
    content = read_json(path)
    try:
        return from_dict(content)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from None


def from_dict(content: Any) -> Fit:
    """Return the fit that the content of a model file holds; the recordings themselves are not in it.

    Raises
    ------
    ModelFileError
        If it does not follow the schema, or contradicts itself. The text names the path to the leaf.
    """
    known = dict(CATALOGUE)
    try:
        stored = migrated(content)
        enter_effects(stored.get("model"))
        fit: Fit = face("results.json").read(Fit, stored)
        require_coefficients(fit)
        require_consistent(fit)
    except ModelFileError as error:
        for name in set(CATALOGUE) - set(known):  # side channels of a file that is refused
            del CATALOGUE[name]
        said = visible(str(error), one_line=True)
        raise ModelFileError(f"{said}. The model file is damaged or incomplete: {AGAIN}") from None
    return fit


@dataclass(frozen=True)
class Needs:
    """Effects that a model takes from the user, and from recorded channels."""

    own: tuple[OwnEffect, ...]
    side_channels: Mapping[str, SideChannel]


def enter_effects(model: Any) -> None:
    """Enter side channels that a stored model uses, and require the user's file where it uses effects from one.

    Raises
    ------
    ModelFileError
        If a user's effect is not loaded; the text names the missing file.
    """
    if not isinstance(model, dict):
        return  # the schema refuses it
    try:
        needs = face("results.json").read(Needs, {key: model[key] for key in ("own", "side_channels") if key in model})
    except ModelFileError as error:
        raise ModelFileError(f"model.{error}") from None
    for stored in needs.side_channels.values():
        if stored.of == "output":
            side_channel(stored.channel, stored.unit.removeprefix("m/s²/").strip("()"))
        else:
            side_channel_scale(stored.channel, stored.unit.removesuffix("⁻¹").strip("()"))
    for own in needs.own:
        if own.name not in CATALOGUE:
            raise ModelFileError(
                f"the model uses {own.name!r} from a file of your own (SHA-256 {own.digest[:12]}…); name that "
                "file with --effects-file. Its source is stored in the model file under model.own"
            )
        if CATALOGUE[own.name].digest != own.digest:
            raise ModelFileError(
                f"{own.name!r} in the effects file is not the one that the model was fitted with: its source has "
                f"changed (SHA-256 {CATALOGUE[own.name].digest[:12]}… instead of {own.digest[:12]}…). Fit again, "
                "or name the old file"
            )


def require_coefficients(fit: Fit) -> None:
    """Compare the names of the estimates with the coefficients of the model.

    Raises
    ------
    ModelFileError
        If one is missing or foreign.
    """
    stored, expected = {e.name for e in fit.estimates}, {term.name for term in fit.model.terms}
    if stored != expected:
        raise ModelFileError(
            f"estimates: its coefficients are not those of its effects: {', '.join(sorted(stored ^ expected))} on one "
            "side only"
        )


__dir__ = listing(globals())
