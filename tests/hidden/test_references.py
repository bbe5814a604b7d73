"""Hidden effects where a vibrometer or an accelerometer is the reference; make bench-references counts many."""

import pytest

from benches.references import D, Referred, run
from tests.hidden.trials import Trial
from tests.hidden.verdicts import falsely_named, in_class


def test_a_cubic_behind_a_velocity_is_in_a_reported_class():
    outcome = run(Referred(Trial(2, 1, 1, ("cubic",), D), "velocity"))
    assert in_class(outcome, "cubic"), outcome


@pytest.mark.always
def test_nothing_is_named_behind_an_acceleration_where_nothing_is_hidden():
    outcome = run(Referred(Trial(1, 3, 1), "reference_acceleration"))
    assert not falsely_named(outcome), outcome
