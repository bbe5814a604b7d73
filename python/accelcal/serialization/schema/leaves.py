"""Kinds of leaves of a file: numbers with a range, texts that a terminal can show, names, digests, lists."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from accelcal._support.errors import AccelcalError
from accelcal._support.plain_text import OBEYED, OBEYED_IN_NAMES
from accelcal.serialization.json_text import LONGEST_TEXT

LARGEST = 1e15
"""Largest magnitude of any number: products of a few of them stay finite."""
MOST_RUNS = 10_000
"""Recordings of one fit."""
MOST_COLUMNS = 2_000
"""Coefficients of one model."""
LONGEST_NAME, LONGEST_SOURCE = 200, 2_000_000


def _without_control(text: str) -> str:
    if OBEYED_IN_NAMES.search(text):
        raise AccelcalError("a text without control characters")
    return text


def _source(text: str) -> str:
    if OBEYED.search(text.replace("\r\n", "\n").replace("\f", "")):
        raise AccelcalError("source text without control characters")
    return text


def _without_sign(value: float) -> float:
    if math.copysign(1.0, value) < 0.0:
        raise AccelcalError("0 without a sign")
    return value


class Part(BaseModel):
    """One object of a file: every key is expected, no other is allowed, nothing is converted."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
"""Finite; a whole number is one, a truth value is not."""
NotNegative = Annotated[float, Field(ge=0.0, le=LARGEST), AfterValidator(_without_sign)]
Positive = Annotated[float, Field(gt=1e-60, le=LARGEST)]
"""Far enough from 0 that its inverse, and the inverse of its square, are finite."""
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Count = Annotated[int, Field(ge=0, le=10**15)]
Share = Annotated[float, Field(ge=-1.0, le=1.0)]
Name = Annotated[str, Field(max_length=LONGEST_NAME), AfterValidator(_without_control)]
"""Of an effect, a channel or a unit."""
Text = Annotated[str, Field(max_length=LONGEST_TEXT), AfterValidator(_without_control)]
"""A sentence, or the name of a file or of a sensor."""
Source = Annotated[str, Field(max_length=LONGEST_SOURCE), AfterValidator(_source)]
"""Source text of a user's effect."""
Digest = Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]
"""SHA-256, hex; empty where there was no file."""
Identity = Annotated[str, Field(max_length=LONGEST_NAME), AfterValidator(_without_control)]
"""Digest of a recording, or what stands for it where the recording was made in memory."""
Span = Annotated[list[Number], Field(min_length=2, max_length=2)]
"""Least and largest value."""
Numbers = Annotated[list[Number], Field(max_length=100_000)]
Texts = Annotated[list[Text], Field(max_length=1_000)]
Names = Annotated[list[Name], Field(max_length=MOST_COLUMNS)]
Owner = Literal["sensor", "mounting", "rig", "encoder", "timing"]
