"""One size everywhere: parts of a record, bands of frequency, and what happens again."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from accelcal.diagnosis.search.homogeneity import PartSizes, direction_of
from accelcal.diagnosis.search.scan import scan
from accelcal.model import Model
from accelcal.simulation.sensor import Simulated
from tests.diagnosis.search.records import fitted


def test_equal_sizes_are_refused_as_often_as_stated() -> None:
    rng = np.random.default_rng(1)
    information = np.array([400.0, 25.0, 1.0, 100.0, 4.0, 60.0, 30.0, 9.0])
    chances = [PartSizes.of(rng.standard_normal(8) * np.sqrt(information), information).p_value for _ in range(4000)]
    assert np.mean(np.array(chances) < 0.05) < 0.07  # 0.05 is expected; the share that counts as equal lowers it
    assert sum(p < 1e-3 for p in chances) <= 12  # 4 are expected; 13 or more have a probability of 0.03 %


def test_parts_that_hardly_excite_an_effect_do_not_count() -> None:
    assert PartSizes.of(np.array([0.0, 30.0]), np.array([400.0, 1.0])).homogeneous
    assert not PartSizes.of(np.array([0.0, 90.0]), np.array([400.0, 90.0])).homogeneous


def test_the_tenth_of_a_strong_effect_counts_as_equal() -> None:
    information = np.full(8, 1e8)
    assert PartSizes.of(0.05e8 * np.array([1.0, -1.0] * 4), information).homogeneous
    assert not PartSizes.of(0.4e8 * np.array([1.0, -1.0] * 4), information).homogeneous


def test_an_effect_that_grows_in_the_record_is_no_effect_of_acceleration_alone(plain: Simulated) -> None:
    motion = plain.truth.motion
    end = float(plain.recording.accel.t[-1])

    def cubic(size: float, begin: float, t: np.ndarray) -> np.ndarray:
        return np.where(t > begin, size, 0.0) * motion.acceleration(t) ** 3

    steady = scan([fitted(plain, lambda t: cubic(4e-4, 0.0, t))], Model.linear())
    late = scan([fitted(plain, lambda t: cubic(8e-4, 0.5 * end, t))], Model.linear())
    assert [f.effect for f in steady.detected][:1] == ["cubic"]
    assert steady.changing == ()
    assert steady.detected[0].parts.homogeneous
    assert len(steady.detected[0].parts.size) > 4
    assert "cubic" not in [f.effect for f in late.detected]


def test_a_step_that_comes_and_goes_is_no_step(plain: Simulated) -> None:
    once = scan([fitted(plain, lambda t: np.where(t > 17.0, 2e-3, 0.0))], Model.linear())
    assert any("bias_step" in f.members for f in once.detected)
    several = scan([fitted(plain, lambda t: np.where(np.floor(t / 3.0) % 2 == 1, 2e-3, 0.0))], Model.linear())
    assert "bias_step" not in [f.effect for f in several.detected]


def test_a_part_with_more_noise_has_no_other_size(plain: Simulated) -> None:
    motion = plain.truth.motion
    end = float(plain.recording.accel.t[-1])
    chances = []
    for seed in range(6):
        rng = np.random.default_rng([3, seed])

        def cubic_and_noise(t: np.ndarray, rng: np.random.Generator = rng) -> np.ndarray:
            more = np.where(t > 0.75 * end, 0.1, 0.0) * rng.standard_normal(len(t))
            return 2e-3 * motion.acceleration(t) ** 3 + more

        result = scan([fitted(plain, cubic_and_noise)], Model.linear()).detected
        chances += [effect.parts.p_value for effect in result if "cubic" in effect.members]
    assert len(chances) >= 5
    assert min(chances) > 1e-3  # each by chance in one of a thousand


def test_the_direction_of_a_hypothesis_holds_nothing_that_others_explain() -> None:
    rng = np.random.default_rng(7)
    B = rng.standard_normal((40, 6))
    columns = [slice(0, 2), slice(2, 3), slice(3, 6)]
    estimate = np.array([0.7, -1.3])
    evidence = SimpleNamespace(G=B.T @ B, columns=columns, gain=lambda *_: (0.0, 0, estimate, None))
    alone = direction_of(evidence, 0, ())
    np.testing.assert_array_equal(alone, [0.7, -1.3, 0.0, 0.0, 0.0, 0.0])
    direction = direction_of(evidence, 0, (2,))
    np.testing.assert_array_equal(direction[:3], [0.7, -1.3, 0.0])
    np.testing.assert_allclose(B[:, 3:].T @ B @ direction, 0.0, atol=1e-10)
    assert np.linalg.norm(B @ direction) < np.linalg.norm(B @ alone)
