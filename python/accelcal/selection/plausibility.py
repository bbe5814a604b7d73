"""Physical plausibility of an effect that is to enter a model: no correction is larger than what is corrected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from accelcal.data.recording import Recording
from accelcal.diagnosis.contribution import Size
from accelcal.diagnosis.policy import PLAUSIBLE_ENCODER_SHARE
from accelcal.diagnosis.remarks import Remark, remark
from accelcal.effects import find


def implausible(name: str, size: Size | None, recordings: Sequence[Recording]) -> Remark | None:
    """Why an effect is no finding: a contribution beyond full scale, or beyond a tenth of the travel at the encoder.

    Parameters
    ----------
    name : the effect.
    size : its largest contribution over the used range; None where it has none.
    recordings : the fitted runs; full scale is the declared range, or the span of the readings where none is declared.

    Returns
    -------
    The remark; None where the effect is plausible. A step of the encoder's zero and a lag are no error of its scale.
    """
    effect = find(name)
    if size is None:
        return None
    if size.at_encoder:
        of_scale = "instant" not in effect.shapes and "time_offset" not in effect.search.includes
        most = PLAUSIBLE_ENCODER_SHARE * max(float(np.ptp(each.position.y)) for each in recordings)
        limit, unit = f"{100.0 * PLAUSIBLE_ENCODER_SHARE:.0f} % of the travel", "m"
        possible = size.value <= most or not of_scale
    else:
        spans = [each.rig.sensor.range or float(np.ptp(each.accel.y)) for each in recordings]
        declared = recordings[0].rig.sensor.range is not None
        most, unit = max(spans), "m/s²"
        limit = "declared range" if declared else "span of all readings"
        possible = size.value <= most
    if possible:
        return None
    return remark("implausible", effect=name, size=size.value, unit=unit, limit=limit, most=most)
