"""The table of regimes: name -> profile, rig, length, and which names are honest there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tests.worlds.numerics import stream

from .filters import averages, bessel, blocking, butterworth, recursion, single_pole, windowed
from .motion import Motion, resonance, through_structure
from .profiles import PROFILES, STEP
from .rig import NOTHING, UG, Clocks, Planted, Record, Reference, Rig, Sensor, measure

PARAMETERS = ("bias", "scale_factor", "time_offset")
PAPER = Rig()
QUALITY = 3.0
"""Of a structure between set-point and stage."""


@dataclass(frozen=True, slots=True)
class Regime:
    """One kind of rig and motion."""

    name: str
    profile: str = "mixed"
    rig: Rig = PAPER
    seconds: float = 60.0
    structure: float | None = None
    """Natural frequency between set-point and stage, Hz."""
    honest: frozenset[str] = frozenset()
    """Effects that are rightly named: they are in the record."""
    compare: tuple[str, ...] = PARAMETERS
    """Parameters that mean the same in the record and in the product."""
    unexplained: bool = False
    """Whether a residual above the declared noise is rightly said."""
    refusal: bool = False
    """Whether a refusal to estimate is right."""
    expected: str = ""
    """The only right verdict, where there is one."""

    def motion(self, seed: int, seconds: float | None = None) -> Motion:
        """Return the true motion for one seed."""
        moved = PROFILES[self.profile](seconds or self.seconds, stream(seed, 1))
        return moved if self.structure is None else through_structure(moved, self.structure, QUALITY, STEP)

    def build(self, seed: int, planted: Planted = NOTHING, seconds: float | None = None) -> Record:
        """Return the record of one seed; another length than that of the regime is for tests."""
        return measure(self.motion(seed, seconds), self.rig, seconds or self.seconds, seed, planted)


ADXL105 = Sensor(225.0, range=5.0)
CXL02 = Sensor(20.0, range=2.0)
SERVO = Sensor(1.0, range=2.0)
SENSORS = {"adxl105": ADXL105, "cxl02": CXL02, "servo": SERVO}
SHORT = {"trapezoid": "trap", "s_curve": "seg7", "minimum_jerk": "minjerk"}
STAGE = ("trapezoid", "s_curve", "cosine", "minimum_jerk", "smooth", "random", "chirp", "hand", "mixed")
BIAS_PROCESSES = frozenset({"bias_gauss_markov", "bias_random_walk", "bias_step"})
DELAYED = frozenset({"time_offset", "sensor_lag", "sensor_resonance"})
STAMPED = frozenset({"rounded_stamps"})
HELD = frozenset({"held_samples"})


def _short(profile: str) -> str:
    return SHORT.get(profile, profile)


def _profiles() -> Iterator[Regime]:
    """Every profile with three classes of sensor; steps through structures; sensors without a low-pass."""
    for profile in STAGE:
        for name, sensor in SENSORS.items():
            yield Regime(f"a-{_short(profile)}-{name}", profile, Rig(sensor))
    for profile in ("trapezoid", "s_curve", "cosine", "smooth"):
        for f0 in (30.0, 60.0, 150.0):
            yield Regime(f"a-{_short(profile)}-str{f0:g}", profile, Rig(CXL02), structure=f0)
    yield Regime("a-trap-servo-str60", "trapezoid", Rig(SERVO), structure=60.0)
    for profile in ("trapezoid", "cosine", "random"):
        for name, sensor in SENSORS.items():
            yield Regime(f"a-{_short(profile)}-{name}-norc", profile, Rig(replace(sensor, corner=None)))


NM = ((1667.03, 1666.71, 225.0), (10_000.0, 10_000.3, 225.0), (1000.0, 1000.09, 22.5), (1000.0, 4000.3, 22.5))
"""Rates of accelerometer and reference, Hz, and noise of the sensor, ug/sqrt(Hz)."""
FRACTIONS = (0.05, 0.1, 0.15, 0.25, 0.4, 0.6, 1.0)
"""Crossover over the accelerometer's rate."""
LEAST = 4e-10
"""A better reference than this is not written to the file, m."""


def reference_noise(density: float, rate: float, crossover: float) -> float:
    """Return the noise of one reading, m, at which both noises meet at a frequency: N^2 = 2 s^2/f_p (2 pi f)^4."""
    return float(density * UG * np.sqrt(rate / 2) / (2 * np.pi * crossover) ** 2)


def _references() -> Iterator[Regime]:
    """References that are better than the accelerometer up to high frequencies, and lasers of ordinary quality."""
    for rate, reading_rate, density in NM:
        for fraction in FRACTIONS:
            sigma = reference_noise(density, reading_rate, fraction * rate)
            if sigma < LEAST:
                continue
            step = None if density < 100 else float(f"{sigma:.0e}")
            rig = Rig(Sensor(density, rate=rate, corner=None), Reference(sigma, step, reading_rate))
            name = f"b-nm-{rate / 1000:.2g}k-{reading_rate / 1000:.2g}k-{fraction:g}"
            yield Regime(name, "random" if rate > 5000 else "mixed", rig, 6.0 if rate > 5000 else 30.0)
    laser = Reference(1e-7, 1e-8, 10_000.3)
    for profile in ("random", "smooth", "cosine"):
        rig = Rig(replace(ADXL105, rate=10_000.0, corner=1000.0), laser)
        yield Regime(f"b-laser-{profile}", profile, rig, 20.0)


MOCAP = Reference(2e-4, None, 120.0)
LOOSE = Clocks(tolerance=5e-3)


def phone(rate: float) -> Sensor:
    """Return the accelerometer of a phone."""
    return Sensor(150.0, range=4.0, rate=rate, corner=None)


def _people() -> Iterator[Regime]:
    """Motion capture, satellites, buildings: the position is coarser than the sensor."""
    for profile, label in (("tremor", ""), ("hand", "-still")):
        for rate in (100.3, 200.7):
            yield Regime(f"c-phone-{rate:.0f}{label}", profile, Rig(phone(rate), MOCAP, LOOSE))
    rounded = replace(LOOSE, rounding=1e-3)
    for profile, label in (("tremor", ""), ("hand", "-still")):
        yield Regime(f"c-phone-ms{label}", profile, Rig(phone(200.7), MOCAP, rounded), honest=STAMPED)
    irregular = replace(LOOSE, irregular=0.2)
    yield Regime("c-phone-irregular", "tremor", Rig(phone(100.3), MOCAP, irregular))
    yield Regime("c-phone-missing", "tremor", Rig(phone(100.3), MOCAP, replace(LOOSE, missing_position=(0.3, 30))))
    turning = Rig(replace(phone(100.3), tilt=3.0), MOCAP, LOOSE)
    yield Regime("c-phone-turning", "tremor", turning, unexplained=True, compare=(), expected="unexplained")
    building = Rig(Sensor(20.0, range=2.0, rate=200.3, corner=None), Reference(1e-4, None, 100.1), Clocks(1e-3))
    yield Regime("d-structure", "hand", building)
    gnss = Reference(5e-3, None, 10.0)
    yield Regime("e-gnss", "hand", Rig(phone(100.3), gnss, LOOSE), 300.0)
    coloured = replace(gnss, multipath=(1e-2, 20.0))
    yield Regime("e-gnss-multipath", "hand", Rig(phone(100.3), coloured, LOOSE), 300.0, compare=PARAMETERS[1:])
    held = Rig(phone(200.7), MOCAP, replace(LOOSE, held=100.0))
    yield Regime("s-held-phone", "tremor", held, honest=HELD)


def _laboratory() -> Iterator[Regime]:
    """Shakers, undeclared filters, coarse encoders, noise that is not white or not Gaussian."""
    lvdt = Reference(2e-6, None, 1666.71)
    yield Regime("f-shaker", "shaker", Rig(reference=lvdt))
    yield Regime("f-shaker-tone", "tone", Rig(reference=lvdt))
    lagging = Rig(reference=replace(lvdt, lag=318e-6))
    honest = frozenset({"time_offset", "encoder_lag"})
    yield Regime("f-shaker-lvdt-lag", "shaker", lagging, honest=honest, compare=("bias",))
    yield Regime("f-mixed-lvdt-lag", "mixed", lagging, honest=honest, compare=("bias",))
    filtered = Rig(replace(ADXL105, undeclared=tuple(resonance(400.0, 2**-0.5))))
    for profile in ("mixed", "chirp"):
        yield Regime(f"g-filter400-{profile}", profile, filtered, honest=DELAYED, compare=PARAMETERS[:2])
    tolerant = Rig(replace(ADXL105, corner_error=0.05))
    yield Regime("g-rc-tolerance", "mixed", tolerant, compare=PARAMETERS[:2])
    coarse = Reference(1e-6, 20e-6)
    for profile, sensor in (("mixed", CXL02), ("smooth", CXL02), ("trapezoid", CXL02), ("smooth", ADXL105)):
        label = "-adxl" if sensor is ADXL105 else ""
        yield Regime(f"h-coarse-{_short(profile)}{label}", profile, Rig(sensor, coarse))
    outliers = frozenset({"accelerometer_outliers"})
    yield Regime("i-student", "mixed", Rig(replace(ADXL105, freedom=4.0)), honest=outliers)
    for level in (10.0, 100.0):
        rig = Rig(replace(ADXL105, instability=level))
        yield Regime(f"i-flicker-{level:g}", "mixed", rig, honest=BIAS_PROCESSES, compare=PARAMETERS[1:])


SMOOTHING = ((0.2, 0.4, 0.2), (1.0, -0.4, 0.2))
"""A biquad: gain 1 at rest, 0.74 at 200 Hz where it runs at 1667 Hz."""


def _filters() -> Iterator[Regime]:
    """Declared filters of more than one pole, digital ones, high-passes, and filters of the position."""
    outputs = {
        "butter50": (butterworth(50.0, 4),),
        "bessel100": (bessel(100.0, 2),),
        "biquad": (recursion(*SMOOTHING),),
        "mean8": (averages(8, 1),),
        "sinc3": (averages(16, 3),),
        "fir31": (windowed(31, 0.09),),
        "rc-rc": (single_pole(159.0), single_pole(300.0)),
        "rc-mean8": (single_pole(300.0), averages(8, 1)),
    }
    for name, filters in outputs.items():
        for sensor, label in ((ADXL105, ""), (CXL02, "-cxl02")):
            yield Regime(f"t-{name}{label}", "mixed", Rig(replace(sensor, corner=None, filters=filters)))
    for profile in ("random", "smooth"):
        rig = Rig(replace(ADXL105, corner=None, filters=outputs["butter50"]))
        yield Regime(f"t-butter50-{profile}", profile, rig)
    for tau in (1.0, 0.1):
        for low in ((), (single_pole(159.0),)):
            rig = Rig(replace(ADXL105, corner=None, filters=(*low, blocking(tau))))
            label = "-rc" if low else ""
            yield Regime(f"t-highpass{tau:g}{label}", "mixed", rig, compare=PARAMETERS[1:])
    references = {"lag200": single_pole(200.0), "butter200": butterworth(200.0, 2), "butter50": butterworth(50.0, 4)}
    for name, reference in references.items():
        yield Regime(f"t-position-{name}", "mixed", Rig(reference=Reference(filters=(reference,))))
        yield Regime(f"t-position-{name}-cxl02", "mixed", Rig(CXL02, Reference(filters=(reference,))))
    coupled = Rig(reference=Reference(filters=(blocking(1.0),)))
    yield Regime("t-position-highpass1", "mixed", coupled, compare=PARAMETERS[1:])


def _lengths() -> Iterator[Regime]:
    for seconds in (5.0, 10.0, 20.0, 300.0):
        yield Regime(f"j-{seconds:g}s", "mixed", Rig(), seconds)
    yield Regime("j-20s-cosine", "cosine", Rig(CXL02), 20.0)
    slow = Rig(phone(100.3), Reference(5e-3, None, 10.0), LOOSE)
    yield Regime("j-1h", "hand", slow, 3600.0)


def _holes() -> Iterator[Regime]:
    """Readings and samples that are missing, one by one or in blocks of 0.12 s and of 5 ms."""
    blocks = {"random": 1, "blocks": 100}
    for share in (0.1, 0.3, 0.6):
        for kind, length in blocks.items():
            rig = Rig(clocks=Clocks(missing_position=(share, length)))
            yield Regime(f"k-miss{100 * share:.0f}-{kind}", "mixed", rig)
    for profile in ("trapezoid", "s_curve", "cosine", "minimum_jerk", "chirp", "hand"):
        for share, kind in ((0.1, "blocks"), (0.3, "random")):
            rig = Rig(CXL02, clocks=Clocks(missing_position=(share, blocks[kind])))
            yield Regime(f"k-miss{100 * share:.0f}-{kind}-{_short(profile)}", profile, rig)
    for share, length in ((0.01, 1), (0.1, 1), (0.3, 1), (0.1, 8), (0.3, 8)):
        label = "-blocks" if length > 1 else ""
        for name, sensor in (("cxl02", CXL02), ("adxl105", ADXL105)):
            rig = Rig(sensor, clocks=Clocks(missing_accel=(share, length)))
            yield Regime(f"k-accel{100 * share:.0f}{label}-{name}", "mixed", rig)
    for profile in ("trapezoid", "cosine"):
        rig = Rig(CXL02, clocks=Clocks(missing_accel=(0.01, 1)))
        yield Regime(f"k-accel1-{_short(profile)}", profile, rig)


def _unusual() -> Iterator[Regime]:
    """Little excitation, odd declarations, temperatures, slow clocks, zeroed encoders, two clocks."""
    yield Regime("l-creep", "creep", refusal=True)  # 1 mm/s: one record in some excites nothing at all
    yield Regime("l-creep-cxl02", "creep", Rig(CXL02))
    yield Regime("l-rest", "rest", compare=("bias",), refusal=True)
    yield Regime("m-oneside", "one_sided")
    offset = frozenset({"time_offset"})  # nothing is declared, and the clocks do differ by up to 20 us
    yield Regime("n-bare", "mixed", Rig(replace(ADXL105, corner=None), bare=True), honest=offset)
    yield Regime("o-noise-x3", "mixed", Rig(replace(ADXL105, declared=675.0)))
    yield Regime("o-noise-d3", "mixed", Rig(replace(ADXL105, declared=75.0)), unexplained=True)
    for kind in ("constant", "noisy", "ramp"):
        yield Regime(f"p-temp-{kind}", "mixed", Rig(temperature=kind))
    for rate, reading_rate in ((200.3, 1.0), (100.3, 1.0), (100.3, 10.0)):
        rig = Rig(phone(rate), Reference(1e-4, None, reading_rate), LOOSE)
        yield Regime(f"q-{rate:.0f}Hz-{reading_rate:g}Hz", "hand", rig, 120.0)
    yield Regime("q-100Hz-bumps", "cosine", Rig(replace(CXL02, rate=100.3, corner=None), Reference(rate=100.1)))
    step = frozenset({"encoder_step"})
    yield Regime("r-zeroed", "smooth", Rig(reference=Reference(zeroed=True)), honest=step)
    glued = Rig(reference=Reference(zeroed=True), clocks=Clocks(gap=2.0))
    yield Regime("r-glued", "mixed", glued, honest=step)
    yield Regime("r-lost-counts", "mixed", Rig(reference=Reference(lost=5e-4)), honest=step)
    late = frozenset({"time_offset"})
    yield Regime("s-two-clocks", "mixed", Rig(clocks=Clocks(offset=5e-3)), honest=late)
    skewed = Rig(clocks=Clocks(offset=5e-3, skew=5e-5))
    yield Regime("s-skew", "mixed", skewed, honest=late | {"clock_skew"})
    jittered = Rig(clocks=Clocks(jitter=1e-4))
    yield Regime("s-jitter", "mixed", jittered, honest=frozenset({"timing_jitter"}))
    logger = Rig(replace(ADXL105, rate=1000.3, corner=None), clocks=Clocks(held=400.0))
    yield Regime("s-held", "mixed", logger, honest=HELD)
    rounded = Rig(Sensor(20.0, range=2.0, rate=200.3, corner=None), Reference(rate=100.1), Clocks(1e-3, rounding=1e-3))
    yield Regime("s-rounded", "hand", rounded, honest=STAMPED)


def _all() -> Iterator[Regime]:
    for part in (_profiles, _references, _people, _laboratory, _filters, _lengths, _holes, _unusual):
        yield from part()


TABLE: dict[str, Regime] = {regime.name: regime for regime in _all()}
"""Every regime by name."""

FAILING = ("a-trap", "a-seg7-cxl02", "a-seg7-servo", "a-cosine", "a-minjerk-servo", "a-smooth-servo", "b-nm", "c-phone")
FAILING += (
    "f-shaker-lvdt",
    "f-mixed-lvdt",
    "h-coarse",
    "i-flicker-100",
    "k-miss10-blocks-cosine",
    "l-",
    "r-",
    "e-gnss-",
)
"""Beginnings of the names of regimes that carried false names in the first measurement: 40 records each."""
