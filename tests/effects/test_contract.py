"""What every effect of the catalogue promises, whatever it describes."""

import dataclasses
import inspect
import itertools
import re
import time
from pathlib import Path

import numpy as np
import pint
import pytest

import accelcal.effects as effects
from accelcal.data.orientation import ACROSS, ANGULAR_ACCELERATION, BENDING, LEVELS, LEVERS, OF_ARM, RATES, TURNED
from accelcal.data.rig import Rig
from accelcal.effects import BUILT_IN, Effect, cards, find
from accelcal.effects.processes import card
from accelcal.effects.registry import CARD
from accelcal.signals.signals import Signals

from ..worlds import CATALOGUE as WORLDS
from .motions import sines

UNSEEN, UNSEARCHED = "No motion of a level, untouched rig can show it.", "A diagnosis does not search for it."
IDENTIFIERS = re.findall(
    r"\w+",
    """
    bias scale_factor
    quadratic cubic odd_quadratic scale_asymmetry dead_zone saturation hysteresis temperature_bias temperature_scale
    temperature_rate warm_up self_heating bias_drift bias_step bias_random_walk bias_gauss_markov scale_drift scale_step
    scale_random_walk scale_gauss_markov
    velocity velocity_squared velocity_odd coulomb presliding acceleration_velocity rail_slope rail_curve rail_wave
    rail_second_wave time_offset time_offset_step clock_skew timing_jitter sensor_lag sensor_resonance creep cross_axis
    cross_axis_quadratic cross_coupling cross_axis_z cross_axis_quadratic_z cross_coupling_z cross_axis_product
    spin angular_acceleration tone vibration vibration_rectification accelerometer_outliers encoder_outliers
    quantisation encoder_cyclic encoder_backlash encoder_nonlinearity encoder_step tilt misalignment encoder_scale
    cross_axis_gravity shape_of_time shape_of_position shape_of_velocity shape_of_acceleration shape_of_jerk
    shape_of_temperature shape_since_reversal encoder_shape_of_position shape_of_a_y
    shape_of_position_and_velocity shape_of_position_and_acceleration
    shape_of_temperature_and_velocity shape_of_time_and_velocity
    lowpass_error encoder_lag ac_coupling rounded_stamps held_samples gyroscope_tilt lever_arm
    axle_tilt angle_eccentricity axle_wobble arm_bending body_misalignment world_tilt
    """,
)

NO_WORLD = re.findall(
    r"\w+",
    """
    angle_eccentricity arm_bending axle_tilt axle_wobble
    bias scale_factor ac_coupling angular_acceleration cross_axis_product cross_axis_quadratic_z cross_axis_z
    cross_coupling_z encoder_lag gyroscope_tilt held_samples lever_arm lowpass_error rail_second_wave rounded_stamps
    spin body_misalignment world_tilt
    """,
)
"""Effects that `tests/worlds` does not hide: the base, a nuisance of every world, and what tests of its own hide."""
UNCOVERED = {"scale_factor", "time_offset", "tone", "vibration_rectification"}
"""Effects of one variable that no curve covers: straight lines of the base, a line of the spectrum, and a shift of the
bias by vibration, which has the speed for its measure only."""

every = pytest.mark.parametrize("effect", BUILT_IN, ids=lambda e: e.name)


def trials(effect: Effect, s: Signals) -> list[dict[str, float]]:
    grids = [shape.grid(s) for shape in effect.shapes.values()]
    return [dict(zip(effect.shapes, map(float, values), strict=True)) for values in itertools.product(*grids)]


def middle(effect: Effect, s: Signals) -> dict[str, float]:
    """One choice of shape parameters that is not at an edge."""
    item = trials(effect, s)
    return item[len(item) // 2]


def test_the_catalogue_holds_exactly_the_promised_names():
    assert sorted(e.name for e in BUILT_IN) == sorted(IDENTIFIERS)
    unseen = {"tilt", "misalignment", "encoder_scale", "cross_axis_gravity", "lowpass_error"}
    unseen |= {"gyroscope_tilt", "lever_arm", "axle_tilt", "body_misalignment", "world_tilt"}
    assert {e.name for e in BUILT_IN if not e.traits.visible} == unseen
    assert {e.name for e in BUILT_IN if e.family} == {name for name in IDENTIFIERS if "shape_" in name}


def test_a_card_calls_unseen_what_sets_of_runs_show_and_unsearched_what_a_fit_adds_by_itself():
    says = {sentence: {e.name for e in BUILT_IN if sentence in card(e)} for sentence in (UNSEEN, UNSEARCHED)}
    assert says[UNSEEN] == {"tilt", "misalignment", "encoder_scale", "cross_axis_gravity"}
    assert says[UNSEARCHED] == {
        "lowpass_error",
        "gyroscope_tilt",
        "lever_arm",
        "axle_tilt",
        "body_misalignment",
        "world_tilt",
    }


def test_every_effect_is_hidden_by_a_world_or_stands_among_those_that_none_hides():
    assert set(WORLDS) == {e.name for e in BUILT_IN if not e.family} - set(NO_WORLD)


def other_motion(s: Signals, letter: str) -> Signals:
    """Signals that are equal in one variable only."""
    motion = {name: 1.3 * getattr(s, name)[::-1] + 0.01 for name in ("p", "v", "a", "jerk") if name != letter}
    side = {name: y if name == letter else 1.3 * y[::-1] + 0.01 for name, y in s.side.items()}
    t = s.t if letter == "t" else s.t + 3.0
    return dataclasses.replace(s, t=t, **motion, side=side, a_corner=s.a_width, v_corner=s.v_width)


@pytest.mark.parametrize(
    "family", [e for e in BUILT_IN if e.family and not e.family.variable.per], ids=lambda e: e.name
)
def test_a_curve_covers_every_effect_that_depends_on_its_variable_alone(family):
    s = sines(n=4096)
    changed = other_motion(s, family.family.variable.letter)

    def follows(effect: Effect) -> bool:
        y = effect.column(s, **middle(effect, s))
        return bool(np.ptp(y) > 0.0) and np.array_equal(y, effect.column(changed, **middle(effect, s)))

    alike = [e for e in BUILT_IN if e.port == family.port and e.traits.visible and not (e.family or e.traits.memory)]
    alone = {effect.name for effect in alike if follows(effect)} - UNCOVERED
    assert alone == set(family.covers), (
        "an effect of one variable alone stands in `covers` of its curve, effects/curves.py"
    )


def test_a_function_of_the_acceleration_without_shape_is_a_term_of_the_static_characteristic():
    plain = [e for e in map(find, find("shape_of_acceleration").covers) if not e.shapes]
    assert len(plain) >= 4
    assert not [e.name for e in plain if e.traits.static is None], "declare Traits(static=Static(...)): export needs it"


@every
def test_every_trial_gives_one_finite_row_per_time_and_the_same_again(effect):
    s = sines()
    for shape in trials(effect, s):
        y = effect.column(s, **shape)
        assert y.shape == ((len(s.t),) if effect.width == 1 else (len(s.t), effect.width))
        assert np.all(np.isfinite(y))
        assert np.all(0.0 * y == 0.0)  # a zero coefficient changes nothing
        assert np.array_equal(y, effect.column(s, **shape))


@every
def test_a_stage_at_rest_gives_finite_columns(effect):
    t = np.arange(64) * 0.01
    still = np.zeros(64)
    turning = (*TURNED, *LEVERS, *RATES, ANGULAR_ACCELERATION, *OF_ARM, *ACROSS, *LEVELS)
    side = {name: still for name in ("temperature", "a_y", "a_z", *turning)}
    s = Signals(t=t, p=still, v=still, a=still, jerk=still, scale=1.0, rig=Rig(), side=side)
    for shape in trials(effect, s):
        assert np.all(np.isfinite(effect.column(s, **shape)))


@every
def test_motion_is_not_written_to(effect):
    s = sines(n=512)
    for y in (s.t, s.p, s.v, s.a, s.jerk, *s.side.values()):
        y.flags.writeable = False
    effect.column(s, **middle(effect, s))


@every
def test_the_card_is_complete(effect):
    assert len(effect.card.splitlines()[0]) > 15
    for label in CARD:
        assert effect.line(label), label
    assert effect.experiment == effect.line("Separate by")
    assert effect.unit
    assert effect.symbol
    assert effect.prior.source
    assert effect.prior.scale > 0.0
    mentioned = re.findall(r"\b[a-z]+_[a-z_]+[a-z]\b", effect.line("Easily confused with"))
    assert set(mentioned) <= {*IDENTIFIERS, "a_y", "a_z"}
    assert set(effect.search.includes) <= set(IDENTIFIERS)
    assert len(set(effect.parts)) == effect.width
    taken = inspect.signature(effect.function).parameters.values()
    keywords = [parameter.name for parameter in taken if parameter.kind is not parameter.VAR_KEYWORD][1:]
    assert keywords == list(effect.shapes)[: len(keywords)]


@every
def test_a_shape_that_is_not_declared_is_refused_and_one_that_is_missing(effect):
    s = sines(n=64)
    shape = middle(effect, s)
    with pytest.raises(TypeError):
        effect.column(s, **shape, undeclared=1.0)
    refined = [name for name, declared in effect.shapes.items() if declared.refined and not declared.added]
    for name in refined[:1]:
        with pytest.raises((TypeError, KeyError)):
            effect.column(s, **{key: value for key, value in shape.items() if key != name})


def test_the_page_of_cards_is_the_catalogue():
    page = Path(__file__).parents[2] / "docs" / "effects.md"
    assert page.read_text() == cards(BUILT_IN), "run make pages"


@every
def test_trials_lie_within_the_bounds(effect):
    for s in (sines(), sines(n=600, start=1e3)):
        for name, shape in effect.shapes.items():
            low, high = shape.span(s)
            grid = shape.grid(s)
            assert len(grid) == shape.trials, name
            slack = 1e-12 * max(abs(low), abs(high))  # of the geometric series
            assert np.all((grid >= low - slack) & (grid <= high + slack)), name


@every
def test_an_effect_reads_no_channel_that_it_does_not_name(effect):
    s = sines(n=256)
    shape = middle(effect, s)
    only = {name: s.side[name] for name in effect.needs}
    assert np.array_equal(effect.column(dataclasses.replace(s, side=only), **shape), effect.column(s, **shape))
    for name in effect.needs:
        without = {other: y for other, y in only.items() if other != name}
        with pytest.raises(KeyError, match=name):
            effect.column(dataclasses.replace(s, side=without), **shape)


LOOKS_AHEAD = {"temperature_rate": 1.0, "sensor_resonance": 0.02}
"""How far derivatives look to either side, s; nothing else depends on what comes later."""


@every
def test_a_value_depends_neither_on_later_samples_nor_on_where_the_record_ends(effect):
    s = sines()
    if effect.mechanism is not None:  # what a record remembers that begins in motion is taken from how it goes on
        s = dataclasses.replace(s, v=np.where(s.t < s.t[0] + 0.2, 0.0, s.v))
    shape = middle(effect, s)
    half = np.arange(len(s.t)) < len(s.t) // 2  # spans the same range as the whole
    begun = effect.column(s.at(half), **shape)
    keep = s.t[half] < s.t[half][-1] - LOOKS_AHEAD.get(effect.name, 0.0) + 1e-9
    whole = effect.column(s, **shape)[half]
    # Ranges of the halves agree to 1e-12 or so, and with them the widths of corners and slacks.
    np.testing.assert_allclose(begun[keep], whole[keep], rtol=1e-9, atol=1e-9 * np.max(np.abs(whole)))


@every
def test_a_moved_origin_gives_the_effect_itself_and_what_it_includes(effect):
    s = sines(n=4000)
    columns = [
        effect.column(s, **middle(effect, s)),
        *(effects.find(name).column(s) for name in effect.search.includes),
    ]
    if effect.port == "position":
        # A constant is the start position; the straight line is encoder_scale, for which k stands in every base.
        columns += [np.ones_like(s.t), s.p]
    basis, _ = np.linalg.qr(np.column_stack(columns))
    for origin in ("t", "p", "temperature", "a_y", "a_z"):
        if origin in s.side:
            moved = dataclasses.replace(s, side={**s.side, origin: s.side[origin] + 0.7})
        else:
            moved = dataclasses.replace(s, **{origin: getattr(s, origin) + 0.7})
        new = effect.column(moved, **middle(effect, moved)).reshape(len(s.t), -1)
        left = new - basis @ (basis.T @ new)
        assert np.max(np.abs(left)) < 1e-9 * np.max(np.abs(new)), origin


FIXED_SIZE = {"tilt", "misalignment", "cross_axis_gravity"}
"""These hold g0, a number that does not follow the unit of length or time."""
FIXED_TIME = {"temperature_rate", "shape_since_reversal", "gyroscope_tilt"}
"""These hold times of their own."""
ONLY_FIRST = {"encoder_nonlinearity"}
"""Units of the further columns are listed behind a comma."""

registry = pint.UnitRegistry()


def dimensions(unit: str) -> dict[str, float]:
    """Exponents of length and time in a unit of the catalogue."""
    plain = unit.split(",")[0].replace("√s", "s**0.5").replace("⁻¹ s", "⁻¹ * s")
    for raised, exponent in (("⁻¹", "-1"), ("⁻²", "-2"), ("²", "2"), ("³", "3")):
        plain = plain.replace(raised, f"**({exponent})")
    result = registry.parse_expression(plain) * registry.dimensionless
    return {axis: float(result.dimensionality.get(f"[{axis}]", 0.0)) for axis in ("length", "time")}


def powers(unit: str, metre: float, second: float) -> float:
    exponent = dimensions(unit)
    return metre ** exponent["length"] * second ** exponent["time"]


SCALED = [
    pytest.param(effect, metre, second, id=f"{effect.name}-{axis}")
    for effect in BUILT_IN
    for axis, metre, second in (("length", 4.0, 1.0), ("time", 1.0, 4.0))
    if effect.name not in FIXED_SIZE and (axis == "length" or effect.name not in FIXED_TIME)
]
"""Every effect and axis but those that hold a number of their own."""


@pytest.mark.parametrize(("effect", "metre", "second"), SCALED)
def test_the_declared_unit_is_the_unit_that_the_function_has(effect, metre, second):
    s = sines(n=4000, p_std=1e-7, v_std=1e-6, a_std=1e-3)
    shape = middle(effect, s)

    def say(y, unit):
        return y * powers(unit, metre, second)

    other = dataclasses.replace(
        s,
        t=say(s.t, "s"),
        p=say(s.p, "m"),
        v=say(s.v, "m/s"),
        a=say(s.a, "m/s²"),
        jerk=say(s.jerk, "m/s³"),
        cutoff=say(s.cutoff, "1/s"),
        side={
            **s.side,
            **{n: say(s.side[n], "m/s²") for n in ("a_y", "a_z")},
            **{n: say(s.side[n], "s⁻²" if n.startswith("lever") else "m/s²") for n in (*LEVERS, *ACROSS, *LEVELS)},
            **{n: say(s.side[n], "s⁻¹") for n in RATES},
            **{n: say(s.side[n], "m/s²") for n in OF_ARM},
            BENDING: say(s.side[BENDING], "m/s⁴"),
            ANGULAR_ACCELERATION: say(s.side[ANGULAR_ACCELERATION], "s⁻²"),
        },
        p_std=say(s.p_std, "m"),
        v_std=say(s.v_std, "m/s"),
        a_std=say(s.a_std, "m/s²"),
    )
    shapes = {name: say(value, effect.shapes[name].unit) for name, value in shape.items()}
    unit = {"position": "m", "output": "m/s²", "process": "m/s²", "noise": "(m/s²)²"}[effect.port]
    if effect.port == "noise" and effect.owner == "encoder":
        unit = "m²"
    expected = say(effect.column(s, **shape), unit) / powers(effect.unit, metre, second)
    result = effect.column(other, **shapes)
    if effect.name in ONLY_FIRST:
        expected, result = expected[:, 0], result[:, 0]
    np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-9 * np.max(np.abs(expected)))


def test_the_unit_test_sees_a_wrong_unit():
    assert powers("(m/s²)⁻¹", 4.0, 1.0) != powers("(m/s²)⁻²", 4.0, 1.0)
    assert powers("(m/s²)/√s", 1.0, 4.0) == 4.0**-2.5
    assert powers("m⁻¹ s⁻²", 4.0, 1.0) == 0.25


def test_the_whole_catalogue_with_all_trials_costs_no_more_than_five_running_sums_a_column():
    # A tenth of a second on an idle machine; the pace of the machine is in both.
    s = sines()
    assert len(s.t) == 25_000
    ratios = []
    for _ in range(3):
        count, columns, begin = 0, 0, time.process_time()
        for effect in BUILT_IN:
            for shape in trials(effect, s):
                effect.column(s, **shape)
                count, columns = count + 1, columns + effect.width
        middle = time.process_time()
        for _ in range(columns):
            np.cumsum(s.a)  # serial on every processor, as an arctangent is not
        ratios.append((middle - begin) / (time.process_time() - middle))
    print(
        f"{len(BUILT_IN)} effects, {count} trials, {columns} columns of {len(s.t)}: {min(ratios):.2f} running sums each"
    )
    assert min(ratios) < 5.0
