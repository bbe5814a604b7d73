"""Columns that are multiples of one another are filtered once, and give the gains that each would have given."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.refine import in_step, profile_loss
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores
from accelcal.effects import BUILT_IN, Effect, find
from accelcal.estimation.columns import distinct, sizes
from accelcal.estimation.estimate import solve_runs
from accelcal.model import Model, terms_of
from accelcal.simulation.sensor import ADXL105_RIG, simulate
from tests.effects.motions import sines

WITH_BASIS = [effect for effect in BUILT_IN if effect.basis]


MOTION = sines()


def shape_of(effect: Effect, share: float) -> dict[str, float]:
    """Every shape parameter at a share of its span."""
    spans = {name: shape.span(MOTION) for name, shape in effect.shapes.items()}
    return {name: low + share * (high - low) for name, (low, high) in spans.items()}


@pytest.mark.parametrize("effect", WITH_BASIS, ids=lambda e: e.name)
@settings(deadline=None)  # the machine may be busy
@given(share=st.floats(0.0, 1.0), other_share=st.floats(0.0, 1.0))
def test_refined_shapes_set_the_sizes_of_columns_and_nothing_else(effect: Effect, share: float, other_share: float):
    s = MOTION
    before, after = shape_of(effect, share), shape_of(effect, other_share)
    factor = sizes(effect, after, s) / sizes(effect, before, s)
    np.testing.assert_allclose(effect.column(s, **before) * factor, effect.column(s, **after), rtol=1e-9, atol=1e-15)


def test_effects_that_share_a_basis_are_multiples_of_the_first_and_no_others_are():
    s = MOTION
    random_walk, markov, time, drift = (
        find(name) for name in ("bias_random_walk", "bias_gauss_markov", "shape_of_time", "bias_drift")
    )
    terms = [term for effect in (drift, random_walk, markov, time) for term in terms_of(effect, shape_of(effect, 0.5))]
    picked, places, factors = distinct(terms, s)
    mean = 1 + random_walk.width + markov.width - 1  # of the Gauss-Markov process: no cosine
    again = [k for k in range(1 + random_walk.width, len(terms)) if k != mean]
    assert picked == [term for k, term in enumerate(terms) if k not in again]
    for k, (place, factor) in enumerate(zip(places, factors, strict=True)):
        assert picked[place].effect is (random_walk if k in again else terms[k].effect)
        np.testing.assert_allclose(factor * picked[place].column(s), terms[k].column(s), rtol=1e-9, atol=1e-15)


def test_cosines_of_another_stretch_of_time_are_no_multiples():
    random_walk = find("bias_random_walk")
    here = shape_of(random_walk, 0.5)
    terms = [*terms_of(random_walk, here), *terms_of(random_walk, {**here, "length": 0.9 * here["length"]})]
    picked, places, factors = distinct(terms, MOTION)
    assert picked == terms
    assert list(places) == list(range(len(terms)))
    assert np.all(factors == 1.0)


def test_the_gain_along_a_size_is_that_of_columns_filtered_anew():
    recording = simulate("bursts", seconds=20.0, rig=ADXL105_RIG, parameters={}, rng=np.random.default_rng(3)).recording
    model = Model.linear()
    runs = [BaseProjection(state, model) for state in solve_runs(model, [recording]).states]
    effect = find("bias_gauss_markov")
    shape = {n: sh.grid(runs[0].column_filter.signals)[0] for n, sh in effect.shapes.items()}
    loss = profile_loss(Hypothesis(effect, shape), shape, "tau", runs[0].column_filter.signals)
    for tau in (0.5, 2.0, 7.0):
        anew = CandidateScores(runs, [Hypothesis(effect, {**shape, "tau": tau})]).gain(0)[0]
        assert -in_step(runs, [loss(tau)])[0] == pytest.approx(anew, rel=1e-6, abs=1e-9)
