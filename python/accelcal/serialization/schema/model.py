"""Schema of a model file: type, range and finiteness of every leaf."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from accelcal.data.references import Reference
from accelcal.serialization.schema.leaves import (
    MOST_COLUMNS,
    MOST_RUNS,
    Count,
    Digest,
    Identity,
    Name,
    Names,
    NotNegative,
    Number,
    Numbers,
    Owner,
    Part,
    Positive,
    Probability,
    Source,
    Span,
    Text,
    Texts,
)


class PriorPart(Part):
    """Normal distribution of a coefficient before the fit."""

    mean: Number
    std: Positive


class OwnEffect(Part):
    """An effect of the user, with the file that it comes from."""

    name: Name
    sha256: Digest
    source: Source


class SideChannel(Part):
    """An effect that is a recorded channel."""

    channel: Name
    unit: Name
    of: Literal["output", "scale_factor"]


class ModelPart(Part):
    """Which effects, which of their coefficients are free."""

    effects: Annotated[list[Name], Field(min_length=3, max_length=200)]
    fixed: dict[Name, Number]
    priors: dict[Name, PriorPart]
    shapes: dict[Name, dict[Name, Number]]
    per_run: Names
    own: Annotated[list[OwnEffect], Field(max_length=200)]
    side_channels: dict[Name, SideChannel]


class ShapeParameter(Part):
    """A shape parameter with its standard uncertainty."""

    name: Name
    symbol: Name
    unit: Name
    value: Number
    std: NotNegative
    owner: Owner
    run: Annotated[int, Field(ge=0, lt=MOST_RUNS)] | None


class Parameter(ShapeParameter):
    """A coefficient with its standard uncertainty, 0 where it was held."""

    stands_for: Text


class SpreadPart(Part):
    """How much a coefficient differs from run to run; null stands for infinity."""

    name: Name
    symbol: Name
    unit: Name
    value: NotNegative
    low: NotNegative
    high: NotNegative | None
    p_value: Probability
    runs: Annotated[list[Number], Field(min_length=1, max_length=MOST_RUNS)]
    mean_half: NotNegative | None
    next_half: NotNegative | None


class NoiseSpectrumPart(Part):
    """Power of the noise in blocks, at each frequency."""

    frequency_hz: Annotated[list[NotNegative], Field(max_length=100_000)]
    floor: Annotated[list[NotNegative], Field(max_length=100_000)]
    growth: dict[Name, Numbers]


class NoiseEffectPart(Part):
    """What an effect that acts on noise amounts to; a std that is not known is null."""

    name: Name
    symbol: Name
    unit: Name
    value: Number
    std: NotNegative | None
    owner: Owner
    p_value: Probability
    sentence: Text
    particulars: dict[Name, Number]
    spectrum: NoiseSpectrumPart | None
    without: NoiseSpectrumPart | None


class Covariance(Part):
    """Of the free coefficients, in their order, SI."""

    names: Names
    matrix: Annotated[list[Annotated[list[Number], Field(max_length=MOST_COLUMNS)]], Field(max_length=MOST_COLUMNS)]


class Quantity(Part):
    """A value with its standard uncertainty and unit."""

    value: Number
    std: NotNegative
    unit: Name


class Electrical(Part):
    """What a data sheet states: sensitivity and zero-g output."""

    sensitivity: Quantity
    zero_g_output: Quantity


class LevelPart(Part):
    """Noise of both channels over a part of a record, that of a reading in the unit of the reference; a std that is not
    known is null."""

    density_m_per_s2_rthz: Positive
    density_std: NotNegative | None
    reading_m: Positive
    reading_std: NotNegative | None
    count: Count


class GrowthPart(Part):
    """What an effect that acts on noise adds to both noises."""

    effect: Name
    q: NotNegative
    r: NotNegative
    mean: NotNegative


class NoisePart(Part):
    """Noise of one recording."""

    q: Positive
    r: Positive
    growth: Annotated[list[GrowthPart], Field(max_length=200)]
    all: LevelPart
    rest: LevelPart | None
    motion: LevelPart | None
    declared_m_per_s2_rthz: Positive | None
    ratio: NotNegative | None
    crossover_hz: Positive
    band_hz: Positive | None
    reference: Reference = "position"


class SensorPart(Part):
    """The accelerometer as its data sheet describes it."""

    model: Text
    serial: Text
    noise: Positive | None
    range: Positive | None
    scale: Number | None
    scale_unit: Name
    zero: Number | None
    bias_instability: Positive | None
    random_walk: Positive | None


class LowPassPart(Part):
    """A declared RC."""

    cutoff: Positive
    tolerance: Annotated[float, Field(ge=0.0, le=1.0)] | None


class FilterPart(Part):
    """A declared filter of a channel."""

    kind: Literal["RC", "butterworth", "bessel", "biquad", "sinc", "fir"]
    passes: Literal["lowpass", "highpass"]
    cutoff: Positive | None
    order: Annotated[int, Field(ge=1, le=10)]
    b: Annotated[list[Number], Field(max_length=10_000)]
    a: Annotated[list[Number], Field(max_length=3)]
    length: Annotated[int, Field(ge=0, le=10**6)]
    rate: Positive | None


class UncertaintyPart(Part):
    """Standard uncertainties declared for the budget."""

    encoder_scale: NotNegative | None
    level: NotNegative | None
    misalignment: NotNegative | None


class RigPart(Part):
    """Sensor, axis, mount, clocks and known filters."""

    sensor: SensorPart
    axis: Literal["level", "up", "down"]
    mount: Literal["normal", "reversed", "rolled"]
    gravity_along_axis: Annotated[float, Field(ge=-1e3, le=1e3)] | None
    offset_tolerance: NotNegative
    lowpass: LowPassPart | None
    output_filters: Annotated[list[FilterPart], Field(max_length=50)]
    position_filters: Annotated[list[FilterPart], Field(max_length=50)]
    resolution: Positive | None
    uncertainty: UncertaintyPart
    tolerance: Positive | None
    assumptions: Texts


class RunLabelsPart(Part):
    """When, how mounted and by whom a recording was made, as far as declared; the date in days since 1970-01-01."""

    date: Number | None = None
    mounting: Text = ""
    operator: Text = ""


class DataPart(Part):
    """One recording of the fit."""

    file: Text
    sha256: Identity
    session_sha256: Identity
    used_s: Span
    readings: Count
    samples: Count
    log_likelihood: Number
    nis: NotNegative | None
    labels: RunLabelsPart = Field(default_factory=RunLabelsPart)


class DwellsPart(Part):
    """What a fit leaves of its dwells."""

    name: Text
    digest: Identity
    angle: Numbers
    residual: Numbers
    std: Annotated[list[Positive], Field(max_length=100_000)]
    zeros: Annotated[list[Annotated[tuple[Name, Number], Field(strict=False)]], Field(max_length=100_000)]
    ratio: NotNegative | None
    scatter: NotNegative
    p_value: Probability
    freedom: Annotated[int, Field(ge=-(10**6), le=10**6)]
    remarks: Texts


class OriginsPart(Part):
    """Zero points of time, position and side channels."""

    t: Number
    p: Number
    temperature: Number
    side: dict[Name, Number] = Field(default_factory=dict)


class ModelFile(Part):
    """A fitted model with where it came from."""

    schema_: Literal["accelcal/model/2"] = Field(alias="schema")
    version: Annotated[str, Field(pattern=r"^\d{1,4}\.\d{1,4}\.\d{1,4}[0-9A-Za-z.+-]{0,20}$")]
    method: Name
    model: ModelPart
    parameters: Annotated[list[Parameter], Field(min_length=3, max_length=MOST_COLUMNS)]
    shapes: Annotated[list[ShapeParameter], Field(max_length=MOST_COLUMNS)]
    run_to_run: Annotated[list[SpreadPart], Field(max_length=MOST_COLUMNS)]
    noise_effects: Annotated[list[NoiseEffectPart], Field(max_length=200)]
    covariance: Covariance
    electrical: Electrical | None
    noise: Annotated[list[NoisePart], Field(max_length=MOST_RUNS)]
    rig: RigPart
    data: Annotated[list[DataPart], Field(max_length=MOST_RUNS)]
    dwells: DwellsPart | None
    origins: OriginsPart
    validity: dict[Name, Span]
    remarks: Texts
    tilt_deg: Annotated[float, Field(ge=0.0, le=180.0)]
    seed: int | None
