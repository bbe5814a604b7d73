"""Effects given as formulas: what is understood is exact, and nothing else is read."""

import numpy as np
import pytest

import accelcal as ac
from accelcal.effects import CATALOGUE, ExpressionError, effect, from_expression, load_effects
from accelcal.effects.own import DEEPEST, LONGEST, from_written, probe
from accelcal.simulation import ADXL105_RIG

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
    effect = from_expression("law_of_mine", text, channels=("humidity", "a_y"))
    s = probe(("humidity",))
    expected = law(s)
    np.testing.assert_allclose(effect.effect.column(s), expected, rtol=1e-15)  # the same operations in the same order
    assert effect.effect.needs == (("humidity",) if "humidity" in text else ())
    del CATALOGUE["law_of_mine"]
    path = tmp_path / "law_of_mine.py"
    path.write_text(effect.file)
    (loaded,) = load_effects(path)
    np.testing.assert_allclose(loaded.column(s), expected, rtol=1e-15)
    assert loaded.digest == effect.effect.digest  # a model made with one is read with the other
    assert (loaded.unit, loaded.port, loaded.owner, loaded.needs) == (
        effect.effect.unit,
        "output",
        "sensor",
        effect.effect.needs,
    )


@pytest.mark.parametrize("text", ["1/v", "log(a)", "sqrt(a)", "1/(a - a)", "2", "v - v + 1"])
def test_what_is_not_finite_or_never_changes_is_refused(text):
    with pytest.raises(ExpressionError, match=r"not finite|constant"):
        from_expression("probe_of_mine", text)


def test_names_are_kept_apart():
    effect = from_expression("law_of_mine", "a**3")
    assert from_expression("law_of_mine", "a ** 3").effect is effect.effect
    with pytest.raises(ExpressionError, match="choose another name"):
        from_expression("law_of_mine", "a**5")
    with pytest.raises(ExpressionError, match="choose another name"):
        from_expression("cubic", "a**3")
    for name in ("", "A", "1a", "a b", "a'b", 'a"', "a" * 33, "../a"):
        with pytest.raises(ExpressionError, match="expected small letters"):
            from_expression(name, "a**3")
    for unit in ('m"', "m\\", "x" * 41, "m\n"):
        with pytest.raises(ExpressionError, match="unit"):
            from_expression("law_of_mine2", "a**3", unit=unit)


@pytest.mark.parametrize(
    ("text", "unit", "wrong"),
    [
        ("a**5", "(m/s^2)^-4", "m"),
        ("v*abs(v)", "1/m", "m/s^2"),
        ("-jerk*temperature", "s/K", "s"),
        ("tanh(v/0.01)", "m/s²", "1/s"),  # 0.01 is a speed
        ("sqrt(abs(a))*p", "1/(m^0.5 s)", "1/s"),
        ("p + 0.3*p**2", "s⁻²", "m/s²"),  # 0.3 is 1/m
        ("(0.2 + v)**2", "1/m", "1"),
    ],
)
def test_unit_times_formula_is_that_of_what_it_adds_to(text, unit, wrong):
    assert from_expression("given_one", text, unit=unit, channels=("temperature",)).effect.unit == unit
    left = from_expression("left_one", text, channels=("temperature",)).effect.unit
    assert from_expression("again_one", text, unit=left, channels=("temperature",)).effect.unit == left
    with pytest.raises(ExpressionError, match="so that its coefficient is in"):
        from_expression("wrong_one", text, unit=wrong, channels=("temperature",))


def test_at_the_encoder_a_formula_adds_a_length():
    assert from_expression("at_encoder", "p*abs(p)", port="position").effect.unit == "1/m"
    with pytest.raises(ExpressionError, match="adds to m, so that"):
        from_expression("at_encoder_too", "p*abs(p)", port="position", unit="s^-2/m")


def test_what_has_no_known_unit_is_not_checked():
    assert from_expression("free_one", "a*humidity", unit="1/V", channels=("humidity",)).effect.unit == "1/V"
    assert from_expression("free_sum", "a + v", unit="s").effect.unit == "s"
    for number, text in enumerate(("1/(1 + (v/0.1)**2)", "(v/0.1)/(1 + (v/0.1)**2)", "0.01*p")):
        assert from_expression(f"wide_{number}", text, unit="m/s^2").effect.unit == "m/s^2"  # 0.1 is a speed


def test_a_unit_that_is_not_si_would_mislead():
    with pytest.raises(ExpressionError, match="variables are in SI, and ug is not"):
        from_expression("not_si", "a**3", unit="ug/g^3")


def test_a_formula_is_read_from_its_file_and_no_other_file_is():
    effect = from_expression("law_of_mine", "v*abs(v)*humidity", unit="1/m", channels=("humidity",))
    del CATALOGUE["law_of_mine"]
    entered = from_written("law_of_mine", effect.file)
    assert entered is not None
    assert entered.effect.digest == effect.effect.digest
    del CATALOGUE["law_of_mine"]
    for changed in (
        effect.file.replace("np.abs", "np.sign"),
        effect.file + "import os\n",
        effect.file.replace("scale=1.0", "scale=2.0"),
        "",
    ):
        assert from_written("law_of_mine", changed) is None
    assert from_written("another_law", effect.file) is None
    assert not {"law_of_mine", "another_law"} & set(CATALOGUE)


def fitted_with(name):
    rng = np.random.default_rng(5)
    recording = ac.simulate("tones", seconds=6.0, rig=ADXL105_RIG, parameters={"bias": 0.05}, rng=rng).recording
    return ac.fit(recording, ac.Model.linear().add(name))


def test_a_model_brings_its_own_formula(tmp_path):
    from_expression("drag_of_mine", "v*abs(v)")
    fit = fitted_with("drag_of_mine")
    fit.save(tmp_path / "m.json")
    del CATALOGUE["drag_of_mine"]
    again = ac.load_model(tmp_path / "m.json")
    assert again["drag_of_mine"].value == fit["drag_of_mine"].value
    s = probe(())
    np.testing.assert_array_equal(CATALOGUE["drag_of_mine"].column(s), s.v * np.abs(s.v))


def test_a_model_with_a_function_of_the_user_names_what_is_missing(tmp_path):
    @effect("pull_of_mine", unit="1/s^2", symbol="c", scale=1e-2)
    def pull_of_mine(s):
        return np.maximum(0.0, s.p)

    fitted_with("pull_of_mine").save(tmp_path / "m.json")
    del CATALOGUE["pull_of_mine"]
    with pytest.raises(ValueError, match=r"uses 'pull_of_mine'.*load_effects") as message:
        ac.load_model(tmp_path / "m.json")
    assert "damaged" not in str(message.value)
    file = tmp_path / "mine.py"
    file.write_text(
        "from accelcal.effects import effect\n@effect('pull_of_mine', unit='1/s^2', symbol='c', scale=1e-2)\n"
        "def pull(s):\n    return s.p\n"
    )
    load_effects(file)
    fitted_with("pull_of_mine").save(tmp_path / "m2.json")
    del CATALOGUE["pull_of_mine"]
    with pytest.raises(ValueError, match=r"uses 'pull_of_mine'.*--effects-file.*SHA-256") as message:
        ac.load_model(tmp_path / "m2.json")
    assert "damaged" not in str(message.value)
