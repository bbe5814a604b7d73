"""Detections of an effect hidden in records of independent worlds, against their predicted probability."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache

import numpy as np
from scipy.stats import ncx2

from accelcal import io
from accelcal.diagnosis.experiment import Plan, plan
from accelcal.diagnosis.experiment.detectability import DetectionModel
from accelcal.diagnosis.experiment.power_analysis import detectability_of, with_drift
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA
from accelcal.diagnosis.search.beam import distance_for_gain, entry_gains
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scan import scan
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.run_state import RunState
from accelcal.model import Model
from accelcal.signals.signals import Origins
from accelcal.simulation import ADXL105_RIG, CXL02_RIG
from accelcal.simulation.motion import Motion
from tests.worlds import MOTIONS, Hidden, World

SECONDS = 30.0
UNCOUNTED = 10_000
"""Seed of the record on which the size of an effect is chosen."""
DRAWS = 2000
"""Of the scores, for each prediction; over the records of a pair their errors of one point average out."""
RIGS = {"ADXL105": ADXL105_RIG, "CXL02": CXL02_RIG}

Row = tuple[float, bool]
"""Predicted probability of detection, and whether anything was found."""


def predicted_detection(d: float, examined: int, alpha: float, **costs: int) -> float:
    """Probability that an effect enters on its own at `d` standard deviations from zero; costs as of `entry_gains`."""
    required = max(entry_gains(examined, **{"blocks": 2} | costs, alpha=alpha))
    return float(ncx2.sf(required, costs.get("dof", 1), d**2 + 1e-300))


def least_distance(examined: int, blocks: int, alpha: float, dof: int = 1) -> float:
    """Distance from zero, in standard deviations, at which an effect enters on its own in 19 of 20 records."""
    return distance_for_gain(max(entry_gains(examined, blocks, alpha, dof=dof)), dof)


@dataclass(frozen=True, slots=True)
class Pair:
    """An effect on a kind of motion, with the size at which it is `d` standard deviations from zero."""

    effect: str
    motion: str
    sensor: str
    d: float
    shape: Mapping[str, float] = field(default_factory=dict)
    """Its shape parameters, as the world names them."""

    @property
    def label(self) -> str:
        return f"{self.effect}, {self.motion}, {self.sensor}"

    def sized(self) -> Sized:
        """Choose the magnitude on a record that is not counted."""
        state = fitted(World(self.motion, self.sensor, seconds=SECONDS, seed=UNCOUNTED))
        limits = with_drift(detectability_of(state, Model.linear()))
        truth, unit = hypothesis_of(self, state, limits.detection_model)
        if truth.effect.port == "process":
            smallest = limits[self.effect].smallest[0]
            return Sized(self, self.d / least_distance(limits.examined, limits.blocks, FAMILYWISE_ALPHA) * smallest)
        return Sized(self, self.d / limits.detection_model.distance(truth, unit))


@dataclass(frozen=True, slots=True)
class Sized:
    """A pair with the magnitude of its effect."""

    pair: Pair
    magnitude: float

    def record(self, seed: int) -> RunState:
        """The linear model fitted to one record with the effect in it."""
        pair = self.pair
        hidden = (Hidden(pair.effect, self.magnitude, pair.shape),)
        return fitted(World(pair.motion, pair.sensor, hidden, seconds=SECONDS, seed=seed))

    def predicted(self, state: RunState, factor: float = 1.0) -> float:
        """Probability of detection on a record, for an effect `factor` times as large."""
        detection_model = hypotheses_on(state)
        truth, unit = hypothesis_of(self.pair, state, detection_model)
        return detection_model.detection(truth, factor * self.magnitude * unit, DRAWS)

    def row(self, seed: int) -> Row:
        """Prediction and outcome of one record."""
        state = self.record(seed)
        return self.predicted(state), any_enters(state)


@dataclass(frozen=True, slots=True)
class Planned:
    """An effect on a motion that was planned for it, predicted from limits and data sheet alone."""

    effect: str
    others: tuple[str, ...]
    """Effects that the motion should separate from it."""
    sensor: str
    d: float

    @property
    def label(self) -> str:
        return f"{self.effect}, planned, {self.sensor}"

    def sized(self) -> Predicted:
        """Plan the motion, choose the magnitude and predict."""
        motion = planned_motion((self.effect, *self.others), self.sensor)
        size = self.d / motion.power[self.effect].d[0]
        return Predicted(self, size, motion.power.detection(self.effect, size))


@dataclass(frozen=True, slots=True)
class Predicted:
    """A planned motion with the magnitude of the hidden effect, and its predicted probability of detection."""

    planned_pair: Planned
    magnitude: float
    probability: float

    def row(self, seed: int) -> Row:
        """The prediction, and the outcome of one record."""
        planned_pair = self.planned_pair
        motion = planned_motion((planned_pair.effect, *planned_pair.others), planned_pair.sensor).motion
        name = registered(motion, planned_pair.label)
        hidden = (Hidden(planned_pair.effect, self.magnitude),)
        return self.probability, any_enters(
            fitted(World(name, planned_pair.sensor, hidden, seconds=SECONDS, seed=seed))
        )


@cache
def planned_motion(effects: tuple[str, ...], sensor: str) -> Plan:
    """The motion that `plan` makes for a stage of 0.2 m, 0.1 m/s and 20 m/s²."""
    limits = {"stroke": 0.2, "v_max": 0.1, "a_max": 20.0}
    return plan(effects, **limits, seconds=SECONDS, rig=RIGS[sensor])


def registered(motion: Motion, name: str) -> str:
    """Register a motion among those of the worlds, whose own splines run through its positions; return its name."""
    MOTIONS[name] = lambda knots, _seconds, _rng: motion.position(knots)
    return name


def fitted(world: World) -> RunState:
    """The linear model on a world's record, read from its file."""
    with tempfile.TemporaryDirectory() as folder:
        recording = io.load(world.record().write(folder))
    return solve_runs(Model.linear(), [recording]).states[0]


@lru_cache(maxsize=1)
def hypotheses_on(state: RunState) -> DetectionModel:
    """What a diagnosis would examine on a record; that of the last is kept, for another size."""
    return DetectionModel.of(state, Model.linear())


def any_enters(state: RunState) -> bool:
    """Whether any effect enters."""
    return bool(scan([state], Model.linear()).detected)


def hypothesis_of(pair: Pair, state: RunState, detection_model: DetectionModel) -> tuple[Hypothesis, np.ndarray]:
    """An effect of a world as a hypothesis of the product, and its coefficients per unit of the magnitude."""
    shape, sizes = shape_and_coefficients(pair.effect, pair.shape, state.run.origins)
    return detection_model.item(pair.effect, shape), np.array(sizes)


def shape_and_coefficients(
    effect: str, shape: Mapping[str, float], origins: Origins
) -> tuple[dict[str, float], tuple[float, ...]]:
    """Shape parameters and coefficients, with the origins of time and position moved to the product's."""
    if effect in ("bias_step", "scale_step", "encoder_step"):
        return {"instant": shape["instant"] - origins.t}, (1.0,)
    if effect == "warm_up":
        return dict(shape), (math.exp(-origins.t / shape["tau"]),)
    if effect in ("rail_wave", "encoder_cyclic"):
        phase = shape["phase"] + 2.0 * math.pi * origins.p / shape["period"]
        return {"period": shape["period"]}, (math.cos(phase), math.sin(phase))
    if effect == "encoder_nonlinearity":
        cubic = shape["cubic_per_m"]
        return {}, (1.0 + 3.0 * cubic * origins.p, cubic)
    return dict(shape), (1.0,)


PAIRS = (
    Pair("quadratic", "interleaved", "ADXL105", 3.5),
    Pair("quadratic", "tones", "CXL02", 4.5),
    Pair("cubic", "interleaved", "CXL02", 4.0),
    Pair("cubic", "fast", "ADXL105", 5.0),
    Pair("odd_quadratic", "bursts", "CXL02", 5.5),
    Pair("scale_asymmetry", "interleaved", "CXL02", 4.0),
    Pair("bias_drift", "bursts", "CXL02", 5.0),
    Pair("velocity_squared", "moves", "CXL02", 4.0),
    Pair("coulomb", "interleaved", "CXL02", 3.5),
    Pair("acceleration_velocity", "fast", "CXL02", 4.5),
    Pair("rail_slope", "moves", "ADXL105", 4.5),
    Pair("bias_step", "interleaved", "CXL02", 4.5, {"instant": 11.3}),
    Pair("scale_step", "bursts", "ADXL105", 5.0, {"instant": 17.9}),
    Pair("warm_up", "moves", "CXL02", 5.0, {"tau": 7.0}),
    Pair("self_heating", "fast", "ADXL105", 4.5, {"tau": 5.0}),
    Pair("rail_wave", "interleaved", "CXL02", 5.5, {"period": 0.045, "phase": 1.0}),
    Pair("encoder_cyclic", "moves", "ADXL105", 5.0, {"period": 0.02, "phase": 2.0}),
    Pair("encoder_nonlinearity", "fast", "ADXL105", 5.0, {"cubic_per_m": 8.0}),
    Pair("encoder_step", "bursts", "CXL02", 6.0, {"instant": 8.7}),
    Pair("bias_random_walk", "interleaved", "ADXL105", 4.0),
)
"""One coefficient; with a shape to be found; two columns, with a shape and without; a random process."""

PLANS = (
    Planned("quadratic", ("cubic",), "ADXL105", 4.5),
    Planned("cubic", ("quadratic",), "CXL02", 4.5),
    Planned("rail_curve", ("velocity_odd",), "ADXL105", 4.5),
)
