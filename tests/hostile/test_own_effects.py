"""Formulas and files of a user's own: each is refused with a sentence, or means the same here and in its file."""

from __future__ import annotations

import dataclasses
import functools
import keyword
import time

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import accelcal as ac
from accelcal.data.arrays import Array
from accelcal.effects import (
    BUILT_IN,
    CATALOGUE,
    Effect,
    EffectsFileError,
    ExpressionError,
    Shape,
    SizePrior,
    effect,
    find,
    from_expression,
    load_effects,
    registry,
)
from accelcal.effects.guard import Guarded
from accelcal.effects.own import FUNCTIONS, MOTION, RESERVED, probe
from accelcal.signals.signals import Signals
from accelcal.simulation import CXL02_RIG

from .case import LONG, case_rng, cases

HEAD = (
    "import numpy as np\nfrom accelcal.effects import Shape, effect\n"
    '@effect("own", unit="1", symbol="c", scale=1.0, needs=("supply",)'
)
BODY = ")\ndef own(s):\n"


@pytest.fixture(autouse=True)
def _catalogue():
    before = dict(CATALOGUE)
    yield
    CATALOGUE.clear()
    CATALOGUE.update(before)


@pytest.fixture
def refused(tmp_path):
    """Load a file; return the sentence with which it is refused."""

    def run(text: str) -> str:
        path, before = tmp_path / "mine.py", dict(CATALOGUE)
        path.write_text(text)
        with pytest.raises(EffectsFileError) as caught:
            load_effects(path)
        message = str(caught.value)
        assert str(path) in message
        assert "'own'" in message
        assert "\n" not in message
        assert before == CATALOGUE
        return message

    return run


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("    return np.where(s.p > 0, np.nan, s.a)", "not finite at"),
        ("    return 1.0 / np.maximum(s.v, 0.0)", "not finite"),
        ("    return s.a + 1j", "complex numbers"),
        ("    return [s.a, s.v[:-1]]", "different lengths"),
        ("    return None", "returns None"),
        ("    pass", "returns None"),
        ("    return object()", "objects"),
        ("    return s", "objects"),
        ("    return {0: s.a}", "objects"),
        ("    return (y for y in s.a)", "objects"),
        ("    return [None] * len(s.t)", "objects"),
        ("    return s.a.astype(str)", "values of type <U"),
        ("    return np.zeros(len(s.t), dtype='datetime64[s]')", "values of type datetime64"),
        ("    return s.a[:, None]", "returns shape (64, 1)"),
        ("    return s.a[::2]", "returns shape (32,)"),
        ("    return 1.0", "returns shape ()"),
        ("    return np.outer(s.a, s.a)", "returns shape (64, 64)"),
        ("    s.a[:] = 0.0\n    return s.v", "read-only"),
        ("    s.t += 1.0\n    return s.v", "read-only"),
        ("    y = s.v\n    y *= 2.0\n    return y", "read-only"),
        ("    s.side['supply'][0] = 1.0\n    return s.v", "read-only"),
        ("    s.side['supply'] = s.a\n    return s.v", "does not support item assignment"),
        ("    s.a = s.v\n    return s.v", "cannot assign to field"),
        ("    s.rig.tolerance = 1.0\n    return s.v", "tolerance cannot be set"),
        ("    return s.side['other']", "there is no 'other' here"),
        ("    return own(s)", "RecursionError"),
        ("    raise KeyboardInterrupt if False else RuntimeError('so')", "RuntimeError: so"),
        ("    assert False", "AssertionError"),
        ("    raise RuntimeError('\\x1b[2J')", "RuntimeError"),
        ("    return np.zeros(10**15)", "MemoryError"),
    ],
)
def test_an_effect_that_misbehaves_is_refused_by_name(refused, body, message):
    sentence = refused(HEAD + BODY + body + "\n")
    assert message in sentence


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        (', shapes={"w": Shape("s", (float("nan"), 1.0))}', "has no bounds of w"),
        (', shapes={"w": Shape("s", (1.0, 0.0))}', "has no bounds of w"),
        (', shapes={"w": Shape("s", (0.0, 1.0), spacing="log")}', "begin above 0"),
        (', shapes={"w": Shape("s", lambda s: (1.0,))}', "has no bounds of w"),
        (', shapes={"w": Shape("s", lambda s: 1 / 0)}', "ZeroDivisionError"),
    ],
)
def test_a_shape_without_bounds_is_refused(refused, declared, message):
    assert message in refused(HEAD + declared + ")\ndef own(s, w=1.0):\n    return s.a\n")


def test_an_effect_that_takes_far_too_long_is_refused_by_its_processor_time(refused):
    busy = "    import time\n    end = time.thread_time() + 0.5\n    while time.thread_time() < end:\n        pass\n"
    message = refused(HEAD + BODY + busy + "    return s.a\n")
    assert "of processor time at 64 times; 0.2 s are allowed" in message
    slow = "    for y in s.a:\n        sum(range(12_000))\n    return s.a\n"
    assert "of processor time at 8192 times" in refused(HEAD + BODY + slow)


def test_a_loop_over_samples_and_a_slow_first_call_are_let_pass(tmp_path):
    loop = "    import time\n    global first\n    end = time.thread_time() + 0.4 * first\n    first = 0\n"
    loop += "    while time.thread_time() < end:\n        pass\n    return np.array([y * y for y in s.a])\n"
    path = tmp_path / "mine.py"
    path.write_text(HEAD + BODY + loop + "first = 1\n")
    (effect,) = load_effects(path)
    s = probe(("supply",))
    np.testing.assert_array_equal(effect.column(s), s.a**2)


def test_what_fails_on_a_record_alone_is_refused_there_by_name(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(HEAD + BODY + "    return np.where(s.t > 2.0, np.inf, s.a)\n")
    (effect,) = load_effects(path)
    late = probe(("supply",))
    late = late.at(np.arange(64))
    np.testing.assert_array_equal(effect.column(late), late.a)
    late.t[:] += 1.5
    with pytest.raises(EffectsFileError, match=r"mine\.py, line 3: effect 'own' returns values that are not finite at"):
        effect.column(late)
    broken = from_expression("late", "1/(t - 5)")
    late.t[7] = 5.0
    with pytest.raises(
        EffectsFileError, match=r"effect 'late', 1 / \(t - 5\), returns values that are not finite at 1"
    ):
        broken.effect.column(late)


def test_signals_that_are_not_finite_are_no_fault_of_the_effect(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(HEAD + BODY + "    return s.a**2\n")
    (effect,) = load_effects(path)
    s = probe(("supply",))
    s.a[3] = np.nan
    assert np.isnan(effect.column(s)[3])


@pytest.mark.parametrize("name", ["bad name", "a.b", "x\x1b[2J", "", "1a", "é", "x" * 65])
def test_the_name_of_an_effect_is_a_name(tmp_path, name):
    path = tmp_path / "mine.py"
    path.write_text((HEAD + BODY + "    return s.a\n").replace('"own"', repr(name)))
    with pytest.raises(EffectsFileError, match="needs a name of letters"):
        load_effects(path)


def test_a_file_of_effects_is_a_regular_file_of_moderate_size(tmp_path):
    import os

    os.mkfifo(tmp_path / "fifo.py")
    for bad in (tmp_path / "fifo.py", tmp_path, "/dev/zero"):
        with pytest.raises(EffectsFileError, match="not a regular file"):
            load_effects(bad)
    (tmp_path / "large.py").write_bytes(b"#" * (2**20 + 1))
    with pytest.raises(EffectsFileError, match="larger than 1 MB"):
        load_effects(tmp_path / "large.py")
    (tmp_path / "escape.py").write_text('x = "\x1b[2J"\n')
    with pytest.raises(EffectsFileError, match="control characters"):
        load_effects(tmp_path / "escape.py")


# Formulas.


@pytest.mark.parametrize("name", sorted({*RESERVED, *keyword.kwlist}))
def test_a_name_that_means_something_else_is_refused(name):
    with pytest.raises(ExpressionError, match=rf"name '{name}': "):
        from_expression(name, "a**3")


@pytest.mark.parametrize("text", ["sqrt(2)", "tan(1)", "exp(0)*3", "sign(abs(v))**0.5", "v*0 + 1", "t - t", "t**0"])
def test_what_is_constant_is_found_by_its_values(text):
    with pytest.raises(ExpressionError, match=r"constant|not finite"):
        from_expression("own_one", text)


@pytest.mark.parametrize("text", ["t", "sign(t - 500)", "tan(t)*a", "sign(supply - 3300)", "tanh(t/1000000)"])
def test_what_changes_beyond_an_ordinary_motion_is_no_constant(text):
    assert from_expression("own_one", text, channels=("supply",)).effect.name == "own_one"


@pytest.mark.parametrize("text", ["tanh(1/0)*a", "a*(-8)**0.5", "a + 0*exp(999)", "a + 0**-1", "a*tanh(log(0))"])
def test_a_constant_part_that_is_not_finite_is_refused(text):
    with pytest.raises(ExpressionError, match="not finite whatever the motion is"):
        from_expression("own_one", text)


@pytest.mark.parametrize("channel", [*sorted(RESERVED), "lambda", "two words", "x\x1b", "", "1st", "ﬁ", "a-b"])
def test_a_channel_with_a_name_of_another_meaning_changes_nothing(tmp_path, channel):
    effect = from_expression("own_one", "a*t + sin(v)", channels=(channel, "supply"))
    assert effect.effect.needs == ()
    s = probe((channel,))
    np.testing.assert_array_equal(effect.effect.column(s), s.a * s.t + np.sin(s.v))


LEAVES = st.sampled_from([*MOTION, "supply", "a_y"]) | st.floats(-100, 100).map(lambda y: f"{y!r}")
TREES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda x: f"({x[0]} {x[1]} {x[2]})"),
        st.tuples(inner, st.sampled_from([2, 3, -1, 0.5, 1.5, 0])).map(lambda x: f"({x[0]})**{x[1]}"),
        st.tuples(st.sampled_from(sorted(FUNCTIONS)), inner).map(lambda x: f"{x[0]}({x[1]})"),
        inner.map(lambda x: f"(-{x})"),
    ),
    max_leaves=8,
)


def values(effect: Effect, s: Signals) -> Array:
    """Column of an effect; empty where it is refused at these times."""
    try:
        return effect.column(s)
    except EffectsFileError:
        return np.empty(0)


def agree(text: str, path) -> bool:
    """Whether an expression is refused with a sentence, or its effect and its file have the same values."""
    CATALOGUE.pop("own_one", None)
    try:
        effect = from_expression("own_one", text, channels=("supply", "a_y"))
    except ExpressionError:
        return False
    del CATALOGUE["own_one"]
    path.write_text(effect.file)
    (loaded,) = load_effects(path)
    s = probe(("supply", "a_y"), 257)
    expected, result = values(effect.effect, s), values(loaded, s)
    size = float(np.max(np.abs(expected), initial=0.0))
    np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-12 * size)
    assert loaded.digest == effect.effect.digest
    return True


@given(text=TREES)
@settings(max_examples=4000 if LONG else 150, deadline=None)
def test_a_formula_and_its_file_agree(tmp_path_factory, text):
    agree(text, tmp_path_factory.getbasetemp() / "own_one.py")


def test_formulas_of_any_characters_end_in_a_sentence_or_in_an_effect(tmp_path):
    pieces = [*MOTION, *FUNCTIONS, *"+-*/()., \n\t\0\x1b'\"[]{}:;@%^&|~<>=!", "**", "//", "lambda", "supply", "1e999"]
    pieces += [
        "9" * 30,
        "0x10",
        "1j",
        "𝑎",
        "ﬁ",
        "\u202e",
        "__import__",
        "if",
        "else",
        "for",
        "in",
        "1_0",
        "s.a",
        "\ud800",
    ]
    began, accepted, numbers = time.process_time(), 0, cases(1500, 20_000)
    for number in numbers:
        rng = case_rng("expressions", number)
        text = "".join(str(piece) for piece in rng.choice(pieces, int(rng.integers(1, 12))))
        if rng.random() < 0.5:
            text = text.replace("(", "").replace(")", "")
        accepted += agree(text, tmp_path / "own_one.py")
    seconds = time.process_time() - began
    print(f"expressions: {len(numbers)}, {accepted} accepted, each agrees with its file; {seconds:.0f} s")
    assert accepted > 0


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda s: np.where(s.p > 0.0, np.nan, s.a), "not finite at"),
        (lambda s: s.a + 1j, "complex numbers"),
        (lambda s: s.a[:-1], "returns shape"),
        (lambda s: None, "returns None"),
        (lambda s: s.a.sort(), "does not evaluate"),
        (lambda s: [sum(range(20_000)) * 0.0 + a for a in s.a], "of processor time"),
    ],
    ids=["NaN", "complex", "shape", "None", "mutates", "slow"],
)
def test_an_effect_of_a_script_is_looked_at_as_one_of_a_file_is(function, message):
    before = dict(CATALOGUE)
    with pytest.raises(EffectsFileError, match=message) as caught:
        effect("own", unit="1", symbol="c", scale=1.0)(function)
    assert f"{__file__}, line " in str(caught.value)
    assert before == CATALOGUE


def test_an_effect_of_a_script_is_looked_at_whenever_it_is_evaluated():
    @effect("own", unit="1", symbol="c", scale=1.0)
    def law(s):
        return s.a / (len(s.t) != 100)

    assert law(probe(())).shape == (64,)
    with pytest.raises(EffectsFileError, match=r"not finite|does not evaluate"):
        find("own").column(probe((), 100))


MISBEHAVE = {
    "NaN": (lambda s: np.where(s.p > 0.0, np.nan, s.a), "not finite at"),
    "complex": (lambda s: s.a + 1j, "complex numbers"),
    "shape": (lambda s: s.a[:-1], "returns shape"),
    "None": (lambda s: None, "returns None"),
    "mutates": (lambda s: s.a.sort(), "does not evaluate"),
    "raises": (lambda s: s.side["gone"], "does not evaluate: there is no 'gone' here"),
    "slow": (lambda s: s.a + 0.0 * spin(0.3), "of processor time"),
}


def spin(seconds: float) -> float:
    """Work for a processor time, s."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass
    return end


@pytest.mark.parametrize("way", ["by hand", "registry", "replaced", "no function"])
@pytest.mark.parametrize("kind", MISBEHAVE)
def test_an_effect_is_looked_at_however_it_was_made(kind, way):
    function, message = MISBEHAVE[kind]
    if way == "no function":  # an object without file and line
        function = functools.partial(function)
    if way == "registry":
        registry.effect("own", unit="1", symbol="c", scale=1.0)(function)
        changed = find("own")
    elif way == "replaced":
        changed = dataclasses.replace(find("cubic"), name="own", function=function)
    else:
        changed = Effect("own", "1", "output", "sensor", "c", SizePrior(1.0), function, {})
    with pytest.raises(EffectsFileError, match=message) as caught:
        changed.column(probe(()))
    assert ("effect 'own'" if way == "no function" else f"{__file__}, line ") in str(caught.value)
    assert "'own'" in str(caught.value)


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        ({"name": "a\x1bb"}, "needs a name of letters"),
        ({"name": 1}, "needs a name of letters"),
        ({"unit": "m\n"}, "needs a unit of at most"),
        ({"symbol": "x" * 201}, "needs a symbol of at most"),
        ({"prior": SizePrior(1.0, None)}, "needs a source of at most"),
        ({"prior": SizePrior(float("nan"))}, "typical size nan"),
        ({"prior": SizePrior(-1.0)}, "typical size -1"),
        ({"shapes": {"w": Shape("s", (0.0, 1.0), spacing="log")}}, "begin above 0"),
        ({"shapes": {"w": Shape("s", (1.0, 0.0))}}, "has no bounds of w"),
    ],
)
def test_a_declaration_that_no_model_holds_is_refused_however_it_was_made(declared, message):
    given = {"name": "own", "unit": "1", "symbol": "c", "prior": SizePrior(1.0), "shapes": {}} | declared
    with pytest.raises(EffectsFileError, match=message):
        Effect(port="output", owner="sensor", function=lambda s, w=1.0: s.a, **given)


def test_effects_of_accelcal_are_not_looked_at_again():
    for existing in BUILT_IN:
        assert not isinstance(existing.function, Guarded), existing.name
    effect = Effect("own", "1", "output", "sensor", "c", SizePrior(1.0), lambda s: s.a, {})
    assert dataclasses.replace(effect, prior=SizePrior(2.0)).function is effect.function


def test_an_extra_that_misbehaves_is_refused_by_name():
    recording = ac.simulate(
        "interleaved", seconds=8.0, rig=CXL02_RIG, parameters={"bias": 0.05}, rng=np.random.default_rng(1)
    ).recording
    registry.effect("own", unit="1", symbol="c", scale=1.0)(lambda s: s.a[:-1])
    effect, base = find("own"), ac.fit(recording)
    with pytest.raises(EffectsFileError, match="effect 'own' returns shape"):
        ac.diagnose(base, recording, extra=(effect,))
    with pytest.raises(EffectsFileError, match="effect 'own' returns shape"):
        ac.add(base, recording, "own", extra=(effect,))
