"""Stone Soup: extended predictor and updater; it integrates no covariance and has no second order, which leaves W3."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from importlib.metadata import version

import numpy as np
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater

from benches.peers import plain
from benches.peers.workload import DT, R_OUTPUT, R_POSITION, Array, Data, Ended, Workload, timed, transition

NAME = f"Stone Soup {version('stonesoup')}"
STEPS = {"W3": 200}


class Output(NonLinearGaussianMeasurement):  # type: ignore[misc]
    """The accelerometer's reading (3) with its gradient."""

    ndim_meas = 1
    workload: Workload

    def function(self, state, noise=False, **_):  # type: ignore[no-untyped-def]
        """Expected output."""
        return StateVector([plain.sensed(self.workload, np.ravel(state.state_vector).astype(float))[0]])

    def jacobian(self, state, **_):  # type: ignore[no-untyped-def]
        """(1, N)."""
        return plain.sensed(self.workload, np.ravel(state.state_vector).astype(float))[1][None]

    def rvs(self, num_samples=1, **_):  # type: ignore[no-untyped-def]
        """Nothing is drawn here."""
        raise NotImplementedError

    def pdf(self, state1, state2, **_):  # type: ignore[no-untyped-def]
        """Nothing is weighed here."""
        raise NotImplementedError


def prepare(workload: Workload, data: Data) -> Callable[[], Ended]:
    """The run over a record."""
    return timed(lambda: follow(workload, data))


def follow(workload: Workload, data: Data) -> tuple[Array, Array]:
    """x and the diagonal of P after the last sample."""
    N = workload.states
    F, noise = transition(workload)
    predictor = ExtendedKalmanPredictor(
        LinearGaussianTimeInvariantTransitionModel(transition_matrix=F, covariance_matrix=CovarianceMatrix(noise))
    )
    output = Output(ndim_state=N, mapping=(2,), noise_covar=CovarianceMatrix([[R_OUTPUT]]))
    output.workload = workload
    position = LinearGaussian(ndim_state=N, mapping=(0,), noise_covar=CovarianceMatrix([[R_POSITION]]))
    updater = ExtendedKalmanUpdater()
    start = datetime.datetime(2007, 1, 1)
    state = GaussianState(np.zeros((N, 1)), workload.P0, timestamp=start)
    for j in range(1, data.steps + 1):
        now = start + datetime.timedelta(seconds=j * DT)
        state = predictor.predict(state, timestamp=now)
        readings = [(output, data.u[j]), *([(position, data.z[j])] if j % 2 == 0 else [])]
        for model, value in readings:
            detection = Detection([[value]], timestamp=now, measurement_model=model)
            state = updater.update(SingleHypothesis(as_prediction(state), detection))
    return np.ravel(state.state_vector).astype(float), np.diag(np.asarray(state.covar, dtype=float))


def as_prediction(state):  # type: ignore[no-untyped-def]
    """A second reading at the same instant starts from the posterior of the first."""
    from stonesoup.types.prediction import GaussianStatePrediction

    if isinstance(state, GaussianStatePrediction):
        return state
    return GaussianStatePrediction(state.state_vector, state.covar, timestamp=state.timestamp)
