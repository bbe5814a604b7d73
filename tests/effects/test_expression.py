"""Effects given as formulas: what is understood is exact, and nothing else is read."""

import numpy as np
import pytest

from accelcal.effects import CATALOGUE, ExpressionError, from_expression, load_effects
from accelcal.effects.own import DEEPEST, LONGEST, probe

HOSTILE = [
    "__import__('os').system('true')",
    "().__class__.__bases__[0].__subclasses__()",
    "a.__class__",
    "a.tofile('x')",
    "open('/etc/passwd')",
    "exec('1')",
    "eval('a')",
    "(lambda: a)()",
    "[a for a in (1,)]",
    "a if v else p",
    "a and v",
    "a < v",
    "a[0]",
    "f'{a}'",
    "'a' * 9",
    "b'a'",
    "None",
    "True * a",
    "1j * a",
    "...",
    "(a := v)",
    "sin(a, v)",
    "sin(x=a)",
    "sin(*a)",
    "np.sin(a)",
    "sin",
    "s",
    "a @ v",
    "a // v",
    "a % v",
    "~a",
    "not a",
    "9**9**9**9",
    "a**v",
    "a**1000",
    "a**-9",
    "1e400 * a",
    "a; v",
    "a\nv",
    "import os",
    "",
    "(" * 100,
    "-" * (LONGEST - 1) + "a",
    "a+" * LONGEST + "a",
    "sin(" * (DEEPEST + 1) + "a" + ")" * (DEEPEST + 1),
    "unknown * a",
]


@pytest.fixture(autouse=True)
def _catalogue():
    before = dict(CATALOGUE)
    yield
    CATALOGUE.clear()
    CATALOGUE.update(before)


@pytest.mark.parametrize("text", HOSTILE)
def test_anything_but_arithmetic_is_refused(text):
    before = dict(CATALOGUE)
    with pytest.raises(ExpressionError):
        from_expression("probe_of_mine", text)
    assert before == CATALOGUE


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ("a**3", lambda s: s.a**3),
        ("v*abs(v)", lambda s: s.v * np.abs(s.v)),
        ("-2.5*p**2 + (a - v)/4", lambda s: -2.5 * s.p**2 + (s.a - s.v) / 4.0),
        ("tanh(v/0.01)*exp(-abs(p))", lambda s: np.tanh(s.v / 0.01) * np.exp(-np.abs(s.p))),
        ("sqrt(abs(a)) - log(1 + v**2) + +jerk", lambda s: np.sqrt(np.abs(s.a)) - np.log(1 + s.v**2) + s.jerk),
        ("sin(3*t)*arctan(a)*cos(p) + t", lambda s: np.sin(3 * s.t) * np.arctan(s.a) * np.cos(s.p) + s.t),
        ("sign(v)*tan(p)", lambda s: np.sign(s.v) * np.tan(s.p)),
        ("humidity*a", lambda s: s.side["humidity"] * s.a),
    ],
)
def test_a_formula_means_what_it_says_here_and_in_its_file(tmp_path, text, law):
    own = from_expression("law_of_mine", text, unit="1/m", channels=("humidity", "a_y"))
    s = probe(("humidity",))
    expected = law(s)
    np.testing.assert_allclose(own.effect.column(s), expected, rtol=1e-15)  # the same operations in the same order
    assert own.effect.needs == (("humidity",) if "humidity" in text else ())
    del CATALOGUE["law_of_mine"]
    path = tmp_path / "law_of_mine.py"
    path.write_text(own.file)
    (loaded,) = load_effects(path)
    np.testing.assert_allclose(loaded.column(s), expected, rtol=1e-15)
    assert loaded.digest == own.effect.digest  # a model made with one is read with the other
    assert (loaded.unit, loaded.port, loaded.owner, loaded.needs) == ("1/m", "output", "sensor", own.effect.needs)


@pytest.mark.parametrize("text", ["1/v", "log(a)", "sqrt(a)", "1/(a - a)", "2", "v - v + 1"])
def test_what_is_not_finite_or_never_changes_is_refused(text):
    with pytest.raises(ExpressionError, match=r"not finite|constant"):
        from_expression("probe_of_mine", text)


def test_names_are_kept_apart():
    own = from_expression("law_of_mine", "a**3")
    assert from_expression("law_of_mine", "a ** 3").effect is own.effect
    with pytest.raises(ExpressionError, match="choose another name"):
        from_expression("law_of_mine", "a**5")
    with pytest.raises(ExpressionError, match="choose another name"):
        from_expression("cubic", "a**3")
    for name in ("", "A", "1a", "a b", "a'b", 'a"', "a" * 33, "../a"):
        with pytest.raises(ExpressionError, match="expected small letters"):
            from_expression(name, "a**3")
    for unit in ("", 'm"', "m\\", "x" * 41, "m\n"):
        with pytest.raises(ExpressionError, match="unit"):
            from_expression("law_of_mine2", "a**3", unit=unit)
