"""Schemas of results: what `--json` prints and `-o` writes beside models. A number that is not known is null."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from accelcal.serialization.schema.leaves import Owner, Part
from accelcal.serialization.schema.model import Electrical, ModelFile

Known = float
Value = float | None
"""Null where it is not finite."""
Several = Value | list[Value]
"""One number; of an effect of several columns, a list."""


class Size(Part):
    """A contribution to the output, or to the encoder's reading."""

    m_per_s2: Value
    mg: Value
    percent_of_full_scale: Value
    m: Value


class Estimated(Part):
    """A parameter with its standard uncertainty."""

    name: str
    symbol: str
    unit: str
    value: Value
    std: Value
    owner: Owner
    run: int | None


class Sized(Estimated):
    """A parameter with its largest contribution over the used range."""

    largest_contribution: Size


class Sides(Part):
    """An error inside and outside the trained range."""

    inside: Value
    outside: Value


class Counts(Part):
    """Windows inside and outside the trained range."""

    inside: int
    outside: int


class BinsPart(Part):
    """Mean residual against one variable."""

    variable: str
    unit: str
    edges: list[Value]
    mean: list[Value]
    std: list[Value]


class RegionPart(Part):
    """The worst region of one variable; `p` is adjusted for the number of regions."""

    variable: str
    unit: str
    low: Value
    high: Value
    excess: Value
    excess_unit: str
    sigma: Value
    share: Value
    p: Value
    stretch_s: Annotated[list[Value], Field(min_length=2, max_length=2)] | None


class OutsidePart(Part):
    """Readings outside the trained range of one variable."""

    variable: str
    unit: str
    range: Annotated[list[Value], Field(min_length=2, max_length=2)] | None
    readings_outside: int
    readings: int
    one_step_rms_m: Sides
    coast_rms_m: dict[str, Sides]
    coast_starts: dict[str, Counts]


class NoiseScorePart(Part):
    """What one effect that acts on noise gains on a recording."""

    effect: str
    channel: str
    gain: Value
    std: Value
    count: int
    ratio: Value
    ratio_without: Value
    what: str
    sentence: str


class SetupBias(Part):
    """This run's constant minus that of the fit, m/s²."""

    value: Value
    std: Value


class RmsPart(Part):
    """A root mean square, and the interval that holds it in 95 of 100 such records."""

    value: Value
    low: Value
    high: Value


class NoiseFloorPart(Part):
    """What noise of the sensor alone would give, and where its density comes from."""

    source: Literal["rest", "declared", "fit"]
    density_m_per_s2_rthz: Value
    density_std: Value
    declared_m_per_s2_rthz: Value
    drift_rms_m: dict[str, RmsPart | None]
    simulated_rms_m: RmsPart


class ComparisonFile(Part):
    """A model compared with a recording: `compare`."""

    schema_: Literal["accelcal/compare/1"] = Field(alias="schema")
    recording: str
    one_step_rms_m: Value
    nis: Value
    k_step_rms_m: dict[str, Value]
    simulated_rms_m: Value
    coast_rms_m: dict[str, Value]
    coast_frozen_rms_m: dict[str, Value]
    coast_floor_m: dict[str, Value]
    noise_floor: NoiseFloorPart | None
    headline_horizon_s: Value
    coast_starts: dict[str, int]
    setup_bias_m_per_s2: SetupBias
    accel_rms_m_per_s2: Value
    band_hz: Value
    fit_percent: Value
    worst: str
    where_it_fails: list[RegionPart]
    bins: list[BinsPart]
    outside: list[OutsidePart]
    remarks: list[str]
    not_carried: list[str]
    noise_scores: list[NoiseScorePart]
    breaks: list[Value]
    left_out: list[str]


class Tolerance(Part):
    """Effects that matter and those below the declared tolerance."""

    m_per_s2: Value
    matters: list[str]
    below: list[str]
    not_comparable: list[str]


class PartSizesPart(Part):
    """Sizes of an effect in parts of the runs, over its size in all."""

    size: list[Value]
    std: list[Value]
    p: Value


class ConfoundedPart(Part):
    """Effects that a record does not tell apart, and the experiment that does."""

    effect: str
    members: list[str]
    experiment: str
    sizes_in_parts: PartSizesPart | None


class RemarkPart(Part):
    """A sentence that must be read with a verdict, with its numbers."""

    code: str
    sentence: str
    values: dict[str, Any]


class Dropped(Part):
    """Samples that were rejected as outliers."""

    recording: str
    channel: str
    count: int
    of: int
    sentence: str


class CandidatePart(Part):
    """An effect that would explain what is missing."""

    effect: str
    shape: dict[str, Value]
    estimate: Several
    unit: str
    std: Several
    snr: Value
    p_value: Value
    p_raw: Value
    log_evidence: Value
    class_: list[str] = Field(alias="class")
    largest_contribution: Size


class ChannelPart(Part):
    """A significant effect on the noise of a channel."""

    effect: str
    estimate: Value
    unit: str
    std: Value
    p_raw: Value
    sentence: str
    parts: dict[str, Value]


class Tile(Part):
    """Excess over one variable, in standard deviations."""

    variable: str
    unit: str
    edges: list[Value]
    sigma: list[Value]


class Where(Part):
    """Where a model fails."""

    worst: str
    regions: list[RegionPart]
    tiles: list[Tile]


class DiagnosisFile(Part):
    """What a model lacks on recordings: `diagnose`."""

    schema_: Literal["accelcal/diagnosis/1"] = Field(alias="schema")
    suspect_data: list[str]
    verdict: str
    sentence: str
    effects: list[str]
    largest_contributions: dict[str, Size]
    tolerance: Tolerance | None
    classes: list[ConfoundedPart]
    remarks: list[RemarkPart]
    inseparable: list[ConfoundedPart]
    dropped: list[Dropped]
    breaks: list[Value]
    used: list[list[Value]]
    candidates: list[CandidatePart]
    channels: list[ChannelPart]
    candidates_examined: int
    alpha: Value
    detection_limits: dict[str, Value]
    parameters: list[Sized]
    where: Where
    heldout: ComparisonFile | None = None


class DwellCandidatePart(Part):
    """What one effect explains on dwells."""

    effect: str
    unit: str
    estimate: Value
    std: Value
    sigma: Value
    p_value: Value


class DwellsLeft(Part):
    """What a fit leaves of its dwells."""

    name: str
    digest: str
    angle: list[Value]
    residual: list[Value]
    std: list[Value]
    zeros: list[Annotated[list[str | Value], Field(min_length=2, max_length=2)]]
    ratio: Value
    scatter: Value
    p_value: Value
    freedom: int
    remarks: list[str]


class DwellsFile(Part):
    """What a model lacks on static dwells: `diagnose` on tables of dwells."""

    schema_: Literal["accelcal/diagnosis-of-dwells/1"] = Field(alias="schema")
    verdict: str
    sentence: str
    members: list[str]
    candidates: list[DwellCandidatePart]
    dwells: DwellsLeft
    remarks: list[str]


class FindingPart(Part):
    """An effect that was found."""

    effect: str
    class_: list[str] = Field(alias="class")
    experiment: str
    estimate: Several
    std: Several
    unit: str
    sigma: Value
    largest_contribution: Size | None
    sizes_in_parts: PartSizesPart | None
    remarks: list[str]


class Left(Part):
    """What the last model still lacks."""

    verdict: str
    sentence: str
    effects: list[str]


class RulerPart(Part):
    """The one filter and band in which models are compared."""

    noise_m_per_s2_rthz: Value
    reading_std_m: Value
    band_hz: Value


class Change(Part):
    """Paired change of an error from one model to another, with its standard error and its 95 % interval."""

    measure: str
    unit: str
    before: Value
    after: Value
    percent: Value
    percent_std: Value
    percent_low: Value
    percent_high: Value
    sigma: Value
    stretches: int


class ImprovementStep(Part):
    """One model of an improvement."""

    effects: list[str]
    train: ComparisonFile
    heldout: ComparisonFile
    change: Change | None


class ImprovementFile(Part):
    """What a record shows and what its last model lacks: `improve`."""

    schema_: Literal["accelcal/improve/2"] = Field(alias="schema")
    suspect_data: list[str]
    verdict: str
    sentence: str
    effects: list[str]
    found: list[FindingPart]
    left: Left
    remarks: list[RemarkPart]
    largest_contributions: dict[str, Size]
    tolerance: Tolerance | None
    classes: list[ConfoundedPart]
    inseparable: list[ConfoundedPart]
    dropped: list[Dropped]
    breaks: list[Value]
    used: list[list[Value]]
    heldout_is_same_run: bool
    ruler: RulerPart
    steps: list[ImprovementStep]
    parameters: list[Sized]
    shapes: list[Estimated]
    channels: list[ChannelPart]
    detection_limits: dict[str, Value]
    candidates_examined: int
    alpha: Value
    model: ModelFile


DifferenceVerdict = Literal["better", "worse", "undecided", "too_short"]


class RecordingDifference(Part):
    """The difference of two models on one recording."""

    recording: str
    verdict: DifferenceVerdict
    change: Change | None


class DifferencePart(Part):
    """The error of one model against that of the first, paired, over all recordings and one by one."""

    model: str
    reference: str
    verdict: DifferenceVerdict
    recordings_disagree: bool
    sentence: str
    change: Change | None
    recordings: list[RecordingDifference]
    horizons: list[Change]


class ComparedRecording(Part):
    """All models on one recording."""

    recording: str
    ruler: RulerPart
    comparisons: list[ComparisonFile]


class PairedFile(Part):
    """Models on recordings: `compare`."""

    schema_: Literal["accelcal/compare-models/1"] = Field(alias="schema")
    models: list[str]
    horizon_s: Value
    differences: list[DifferencePart]
    recordings: list[ComparedRecording]


class ExportSensor(Part):
    """Name of the sensor."""

    model: str
    serial: str


class Reading(Part):
    """reading = zero + scale x output."""

    unit: str
    scale: Known
    zero: Known


class ExportParameter(Part):
    """A parameter that is applied."""

    name: str
    symbol: str
    unit: str
    value: Known
    std: Known
    stands_for: str


class ExportCovariance(Part):
    """Of the applied parameters that are free, SI."""

    names: list[str]
    matrix: list[list[Known]]


class ExportValidity(Part):
    """Where the bounds hold."""

    acceleration_m_per_s2: list[Known]
    temperature_degC: list[Known] | None


class LeftOutPart(Part):
    """An effect that is not exported."""

    effect: str
    owner: Owner
    why: str


class Warmth(Part):
    """How temperature enters."""

    centre: Known
    half: Known
    per_half: Known
    shift: Known


class Segment(Part):
    """One polynomial."""

    low: Known
    high: Known
    centre: Known
    per_half: Known
    coefficients: list[list[Known]]


class TestEntry(Part):
    """One line of the test vector."""

    reading: Known
    temperature: Known
    acceleration: Known
    outside: int


class CodePart(Part):
    """The calibration in one number format."""

    bound_m_per_s2: Known
    bound_of_polynomial_m_per_s2: Known
    bound_of_rounding_m_per_s2: Known
    tolerance_of_test_m_per_s2: Known
    temperature: Warmth | None
    segments: list[Segment]
    slopes_outside: list[Known]
    test_vector: list[TestEntry]


class SourceFile(Part):
    """A file that a calibration was made from."""

    file: str
    sha256: str


class ExportFile(Part):
    """A sensor's own calibration: `export`. No number of it is null."""

    schema_: Literal["accelcal/export/1"] = Field(alias="schema")
    version: str
    source: str
    sensor: ExportSensor
    reading: Reading
    model: str
    reference_degC: Value
    parameters: list[ExportParameter]
    covariance: ExportCovariance
    electrical: Electrical | None
    validity: ExportValidity
    std_m_per_s2: list[Known]
    left_out: list[LeftOutPart]
    remarks: list[str]
    double: CodePart
    float_: CodePart = Field(alias="float")
    data: list[SourceFile]


class DetectabilityPart(Part):
    """Detection limit of one effect."""

    effect: str
    unit: str
    shape: dict[str, Value]
    parts: list[str]
    d_per_unit: Several
    smallest_detectable: Several
    largest_contribution: Several
    largest_contribution_unit: str
    class_: list[str] = Field(alias="class")
    experiment: str


class Tie(Part):
    """Effects whose signatures are nearly equal."""

    members: list[str]
    correlation: Value
    experiment: str


class Tumble(Part):
    """What a tumble test shows."""

    seconds: Value
    frequency_Hz: Value
    bias: Value
    scale_factor: Value


class DriftBandwidthPart(Part):
    """Smallest sinusoidal changes that a record shows."""

    sigma: Value
    frequency_Hz: list[Value]
    bias: list[Value]
    scale_factor: list[Value]
    tumble: Tumble


class PowerFile(Part):
    """What a record or a planned motion can detect: `power`."""

    schema_: Literal["accelcal/power/1"] = Field(alias="schema")
    name: str
    candidates_examined: int
    blocks: int
    alpha: Value
    probability: Value
    effects: list[DetectabilityPart]
    ties: list[Tie]
    drift_bandwidth: DriftBandwidthPart | None


class PlannedDetectability(DetectabilityPart):
    """Detection limit of an effect that a motion was planned for."""

    typical_size: Value
    typical_d: Value


class Pair(Part):
    """Correlation of two effects on a motion."""

    effects: list[str]
    correlation: Value


class LimitsPart(Part):
    """Of the stage."""

    stroke_m: Value
    speed_m_per_s: Value
    acceleration_m_per_s2: Value


class BurstPart(Part):
    """One burst of a pattern."""

    seconds: Value
    low: Value
    high: Value
    level: Value


class RecipePart(Part):
    """How a motion is made."""

    bursts: list[BurstPart]
    share_of_moves: Value
    aligned: bool
    seed: int


class PlanFile(Part):
    """A motion that separates effects: `plan`."""

    schema_: Literal["accelcal/plan/1"] = Field(alias="schema")
    effects: list[PlannedDetectability]
    correlations: list[Pair]
    separated: bool
    seconds: Value
    limits: LimitsPart
    recipe: RecipePart
    motions_tried: int
    candidates_examined: int
    alpha: Value


class FormulaPart(Part):
    """One formula."""

    formula: str
    summands: list[str]
    coefficients: list[Value]
    std: list[Value]
    units: list[str]
    inner: Value
    inner_std: Value
    inner_unit: str | None
    gain: Value
    log_evidence: Value
    lack_of_fit: Value
    held_out_gain: Value


class FormulaFile(Part):
    """Short formulas for a curve: `formula`."""

    schema_: Literal["accelcal/formula/1"] = Field(alias="schema")
    curve: str
    variable: str
    unit: str
    origin: Value
    sentence: str
    examined: int
    p_value: Value
    formulas: list[FormulaPart]
    rejected: list[FormulaPart]


class FleetFile(Part):
    """Many sensors: `fleet`. Rows of `runs` hold one column for each parameter."""

    schema_: Literal["accelcal/fleet/1"] = Field(alias="schema")
    sentences: list[str]
    parameters: dict[str, dict[str, Any]]
    sensors: list[dict[str, Any]]
    charts: list[dict[str, Any]]
    runs: list[dict[str, Any]]
    errors: dict[str, str]


class TriadParameter(Part):
    """One of nine parameters."""

    value: Value
    std: Value


class TriadTerm(Part):
    """What a triad lacks."""

    members: list[str]
    t: Value
    p: Value


class TriadFile(Part):
    """Three axes calibrated by the norm of gravity: `dwells`."""

    schema_: Literal["accelcal/triad/1"] = Field(alias="schema")
    file: str
    gravity_m_per_s2: Value
    output_unit: str
    parameters: dict[str, TriadParameter]
    T: list[list[Value]]
    K: list[Value] | list[list[Value]]
    b: list[Value]
    positions: int
    residual_m_per_s2: list[Value]
    rms_m_per_s2: Value
    ratio: Value
    verdict: str
    sentence: str
    terms: list[TriadTerm]
    remarks: list[str]


class InnovationPart(Part):
    """One reading against what the filter expected."""

    t_s: Value
    e_m: Value
    std_m: Value


class RunningPart(Part):
    """A running mean, and where it lies with 99 % probability while the model holds."""

    value: Value
    low: Value
    high: Value
    readings: int


class AlarmPart(Part):
    """A block of innovations that the model does not explain."""

    t_s: Value
    kind: Literal["nis", "mean"]
    value: Value
    low: Value
    high: Value
    readings: int
    since_s: Value
    sentence: str


class RegressorBiasPart(Part):
    """What noise of the output biases the scale factor by."""

    value: Value
    sigma: Value
    sentence: str | None


class LinesPart(Part):
    """What became of the lines."""

    used: int
    broken: int
    out_of_order: int
    missing: int


class LiveFile(Part):
    """One line of `live --json`."""

    schema_: Literal["accelcal/live/1"] = Field(alias="schema")
    event: Literal["state", "alarm", "end"]
    source: str
    t_s: Value
    parameters: list[Estimated]
    regressor_bias: RegressorBiasPart | None
    innovation: InnovationPart | None
    nis: RunningPart | None
    holds: bool | None
    blocks: int
    alarms: int
    alarm: AlarmPart | None
    lines: LinesPart
    dropped_bytes: int
    outputs: int
    readings: int
    untested: int
    refused: int
    recorded_rows: int
    ended: str | None


class PaperFile(Part):
    """The paper reproduced: `paper`."""

    schema_: Literal["accelcal/paper/1"] = Field(alias="schema")
    quick: bool
    seed: int
    holds: int
    rows: int
    items: list[dict[str, Any]]
    figures: list[str]
    statements: list[dict[str, Any]]


class ResponsePoint(Part):
    """Sensitivity at one frequency; expanded uncertainties have k = 2."""

    frequency_hz: Known
    magnitude: Known
    magnitude_expanded: Value
    phase_deg: Known
    phase_expanded_deg: Value
    degrees_of_freedom: Known
    acceleration_m_per_s2: Value
    method: Literal["sine", "broadband"]
    start_s: Known
    end_s: Known


class ResponseParameter(Part):
    """A parameter of a response."""

    name: str
    unit: str
    value: Value
    std: Value
    expanded: Value


class ResponseStructure(Part):
    """A form of the response, fitted."""

    structure: str
    parameters: list[ResponseParameter]
    chi_square: Value
    degrees_of_freedom: int
    p: Value


class LinearityTerm(Part):
    """A coefficient of the sensor's curve by one way of measuring it."""

    name: Literal["K2", "K3"]
    source: str
    unit: str
    value: Value
    std: Value
    expanded: Value
    steps: int


class TimeDomainPart(Part):
    """A linear fit in the time domain, to compare with."""

    sentence: str
    gain: Value
    gain_std: Value
    delay_s: Value
    delay_std_s: Value


class ResponseFile(Part):
    """Sensitivity by frequency: `response`."""

    schema_: Literal["accelcal/response/1"] = Field(alias="schema")
    recording: str
    points: list[ResponsePoint]
    model: ResponseStructure | None
    not_separated: list[ResponseStructure]
    fails_at_hz: list[Known]
    deviations: list[Value]
    sentences: list[str]
    linearity: list[LinearityTerm]
    time_domain: TimeDomainPart | None
