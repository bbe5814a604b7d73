"""A user's file, a recorded channel, and what is said when they cannot be used."""

import hashlib

import numpy as np
import pytest

from accelcal.effects import CATALOGUE, EffectsFileError, effect, find, load_effects, side_channel, side_channels

from .motions import sines

GOOD = '''
"""Effects of our shaker."""
from accelcal.effects import effect

@effect("supply_ripple", unit="m/s²/V", symbol="cs", scale=1e-3, needs=("supply",))
def supply_ripple(s):
    """The output follows the supply."""
    return s.side["supply"]

@effect("fifth", unit="(m/s²)⁻⁴", symbol="K5", scale=1e-7)
def fifth(s):
    return s.a**5
'''


@pytest.fixture(autouse=True)
def untouched():
    before = dict(CATALOGUE)
    yield
    CATALOGUE.clear()
    CATALOGUE.update(before)


@pytest.fixture
def write(tmp_path):
    def write(text, name="mine.py"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def test_a_users_effect_is_an_effect_with_its_source_and_hash(write):
    path = write(GOOD)
    added = load_effects(path)
    assert [e.name for e in added] == ["supply_ripple", "fifth"]
    assert find("fifth") is added[1]
    assert added[0].text == GOOD
    assert added[0].digest == hashlib.sha256(path.read_bytes()).hexdigest()
    s = sines(n=100)
    np.testing.assert_array_equal(added[1].column(s), s.a**5)


def test_loading_again_takes_the_file_as_it_is_now(write):
    path = write(GOOD)
    first = load_effects(path)
    assert load_effects(path) == tuple(find(e.name) for e in first)
    write(GOOD.replace("a**5", "a**7").replace("fifth", "seventh"))
    assert [e.name for e in load_effects(path)] == ["supply_ripple", "seventh"]
    assert "fifth" not in CATALOGUE


ONE = '@effect("own", unit="1", symbol="c", scale=1.0)\ndef own(s):\n    return {}\n'
HEAD = "import numpy as np\nfrom accelcal.effects import Search, Shape, SizePrior, Variable, effect, family\n"


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("def f(:\n", 1, "syntax"),
        (HEAD + "raise SystemExit(3)\n", 3, "SystemExit"),
        (HEAD + "import no_such_module_anywhere\n", 3, "no_such_module_anywhere"),
        (HEAD + ONE.format("s.a").replace('"own"', '"cubic"'), 3, "'cubic' is already in the catalogue"),
        (HEAD + ONE.format("s.a[:-1]"), 3, "returns shape (63,) at 64 times; return (64,)"),
        (HEAD + ONE.format("1.0"), 3, "returns shape ()"),
        (HEAD + ONE.format("np.column_stack([s.a, s.v])"), 3, "returns shape (64, 2)"),
        (HEAD + ONE.format("np.full(len(s.t), np.nan)"), 3, "not finite"),
        (HEAD + ONE.format('s.side["supply"]'), 5, "there is no 'supply' here"),
        (HEAD + ONE.format("s.accel"), 5, "accel"),
        (HEAD + ONE.format("s.a").replace('unit="1"', 'unit="1", port="sideways"'), 3, "port 'sideways' is none of"),
        (HEAD + ONE.format("s.a").replace('unit="1"', 'unit="1", owner="nobody"'), 3, "owner 'nobody' is none of"),
        (
            HEAD + '@family(Variable("acceleration", "a", "m/s²"), coarse=1)\n' + ONE.format("s.a"),
            3,
            "1 of its 1 columns cannot be a coarser",
        ),
        (
            HEAD + ONE.format("s.a").replace("scale=1.0", "scale=SizePrior(0.0, mean=1.0)"),
            3,
            "needs a finite mean and a positive",
        ),
        (
            HEAD + ONE.format("s.a").replace('unit="1"', 'unit="1", shapes={"tau": Shape("s", (1, 2))}'),
            3,
            "declares the shape 'tau' but its function does not take it",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_one_sentence_with_its_line(write, text, line, message):
    path, before = write(text), dict(CATALOGUE)
    with pytest.raises(EffectsFileError) as caught:
        load_effects(path)
    sentence = str(caught.value)
    assert sentence.startswith(f"{path}, line {line}: ")
    assert message in sentence
    assert "\n" not in sentence
    assert before == CATALOGUE


def test_a_file_without_effects_or_without_a_file(write, tmp_path):
    with pytest.raises(EffectsFileError, match="adds no effect"):
        load_effects(write("x = 1\n"))
    with pytest.raises(EffectsFileError, match=r"absent\.py: no such file"):
        load_effects(tmp_path / "absent.py")
    (tmp_path / "latin.py").write_bytes(b"# caf\xe9\n")
    with pytest.raises(EffectsFileError, match="byte 5 is not UTF-8"):
        load_effects(tmp_path / "latin.py")


def test_two_files_cannot_share_a_name(write):
    load_effects(write(GOOD))
    with pytest.raises(EffectsFileError, match="'supply_ripple' is already in the catalogue"):
        load_effects(write(GOOD, "other.py"))
    assert find("supply_ripple").text == GOOD


def test_a_channel_is_a_candidate_under_its_own_name():
    s = sines(n=50)
    supply = side_channel("supply", "V")
    assert (supply.name, supply.unit, supply.needs) == ("supply", "m/s²/V", ("supply",))
    assert side_channel("supply", "V") is supply
    side = {"supply": np.linspace(4.9, 5.1, 50)}
    np.testing.assert_array_equal(supply.column(sines(n=50, side=side)), side["supply"])
    with pytest.raises(KeyError, match="supply"):
        supply.column(s)
    assert all(supply.line(label) for label in ("Equation", "Looks like", "Separate by"))


def test_a_channel_that_bears_the_name_of_an_effect_gets_another():
    tilt = side_channel("tilt", "rad")
    assert (tilt.name, tilt.needs) == ("tilt_channel", ("tilt",))
    assert side_channel("tilt", "rad") is tilt
    assert find("tilt").needs == ()


def test_channels_with_effects_of_their_own_are_not_offered_twice():
    names = [("temperature", "degC"), ("a_y", "m/s²"), ("humidity", "")]
    assert [e.name for e in side_channels(names)] == ["humidity", "humidity_scale"]
    rotation = [("rate_i", "rad/s"), ("alpha_o", "rad/s²")]  # by itself the latter is angular_acceleration
    assert [e.name for e in side_channels(rotation)] == ["rate_i", "rate_i_scale", "alpha_o_scale"]


def test_find_offers_the_nearest_names():
    with pytest.raises(ValueError, match=r"no effect called 'cubik'; did you mean cubic"):
        find("cubik")


def test_a_name_can_be_used_once():
    with pytest.raises(ValueError, match="already in the catalogue"):
        effect("cubic", unit="1", symbol="c", scale=1.0)(lambda s: s.a)


def test_a_function_that_is_defined_anew_takes_the_place_of_its_older_self():
    def enter(factor, name="pull"):
        @effect(name, unit="s⁻²", symbol="c", scale=1.0)
        def pull(s):
            return factor * s.p if factor else None

    s = sines(n=50)
    enter(1.0)
    enter(2.0)
    np.testing.assert_array_equal(find("pull").column(s), 2.0 * s.p)
    with pytest.raises(EffectsFileError, match="None"):
        enter(0.0)
    np.testing.assert_array_equal(find("pull").column(s), 2.0 * s.p)  # a wrong one leaves what was there

    with pytest.raises(ValueError, match="'pull' is already in the catalogue"):

        @effect("pull", unit="s⁻²", symbol="c", scale=1.0)
        def another(s):
            return s.p
