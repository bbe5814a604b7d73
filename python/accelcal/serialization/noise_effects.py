"""Effects that act on noise, in model files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from accelcal.estimation.noise_effects import NoiseEffect, NoiseSpectrum


def noise_effect_to_dict(one: NoiseEffect) -> dict[str, Any]:
    """Plain values; a standard deviation that is not known is null."""
    return {
        "name": one.name,
        "symbol": one.symbol,
        "unit": one.unit,
        "value": one.value,
        "std": one.std if math.isfinite(one.std) else None,
        "owner": one.owner,
        "p_value": one.p_value,
        "sentence": one.sentence,
        "particulars": dict(one.particulars),
        "spectrum": _spectrum_to_dict(one.spectrum),
        "without": _spectrum_to_dict(one.without),
    }


def noise_effect_from_dict(content: Mapping[str, Any]) -> NoiseEffect:
    """The inverse, of a content that follows the schema."""
    std = content["std"]
    return NoiseEffect(
        str(content["name"]),
        str(content["symbol"]),
        str(content["unit"]),
        float(content["value"]),
        math.inf if std is None else float(std),
        str(content["owner"]),
        float(content["p_value"]),
        str(content["sentence"]),
        {key: float(value) for key, value in content["particulars"].items()},
        _spectrum_from_dict(content["spectrum"]),
        _spectrum_from_dict(content["without"]),
    )


def _spectrum_to_dict(spectrum: NoiseSpectrum | None) -> dict[str, Any] | None:
    if spectrum is None:
        return None
    growth = {name: one.tolist() for name, one in spectrum.growth.items()}
    return {"frequency_hz": spectrum.f.tolist(), "floor": spectrum.floor.tolist(), "growth": growth}


def _spectrum_from_dict(content: Mapping[str, Any] | None) -> NoiseSpectrum | None:
    if content is None:
        return None
    f, floor = (np.array(content[key], dtype=np.float64) for key in ("frequency_hz", "floor"))
    growth = {str(name): np.array(one, dtype=np.float64) for name, one in content["growth"].items()}
    return NoiseSpectrum(f, floor, growth)
