"""Figures of every result on short records of many kinds of rig are those that are written down beside this file.

A change that is to alter no figure is proved by this; one that is to alter some shows in git which they are. They are
no truth: whether they are right is what the other tests ask. `python -m tests.workflow.test_figures` writes them anew.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import accelcal as ac
from accelcal.data import ChannelFilter, Rig, RunLabels, Sensor
from accelcal.estimation.tracks import paths, track
from accelcal.estimation.triad import fit_triad
from accelcal.simulation import CXL02_RIG
from tests.estimation.arms import Rigged, record as of_arm
from tests.estimation.test_dwells import TRUTH as TUMBLED, tumble
from tests.estimation.test_triad import positions
from tests.estimation.test_triad_positions import held, still
from tests.estimation.triads import Triad

FILE = Path(__file__).with_name("figures.json")
TOLERANCE = 2e-3
"""Of a sum of relative changes; other kernels of BLAS and NumPy move one by 1e-4 at most, in one case of ten more,
where the shape of a candidate that nothing shows is sought on a flat likelihood."""
WHERE = "make compare-outputs REV=... shows the numbers; they were written with OPENBLAS_CORETYPE=Haswell"
DEPTH = 2
"""Keys, the number of the result first, that lead to a group of numbers."""
TINY = 1e-12
"""What is smaller is rounding, in m, m/s^2 or as a probability."""
BEGIN = 7.3
"""First instant of a record, s: at 0 much that begins with it looks right."""
PASSED = ("version", "digest", "schema", "session")
"""Keys of JSON outputs that hold no figure."""
DIGITS = re.compile(r"[-+]?[0-9][-+.e0-9]*")
"""Numbers within sentences: of a sentence only the words count, since a last digit that is printed may round either
way."""
Effect = Callable[["Motion"], np.ndarray | float]
Figures = dict[str, list[float]]


@dataclass(frozen=True)
class Motion:
    """Four tones in closed form at instants (n,), in SI."""

    t: np.ndarray
    p: np.ndarray
    v: np.ndarray
    a: np.ndarray
    rng: np.random.Generator

    @property
    def temperature(self) -> np.ndarray:
        """Of the sensor, which warms up by 8 K, degC."""
        return 28.0 - 8.0 * np.exp((BEGIN - self.t) / 9.0)

    @property
    def across(self) -> np.ndarray:
        """Acceleration across the axis, m/s^2."""
        return 0.8 * np.sin(2.0 * np.pi * 2.3 * self.t + 0.4) + 0.3 * np.cos(2.0 * np.pi * 5.1 * self.t)


def motion(seed: int, t: np.ndarray, scale: float = 1.0) -> Motion:
    rng = np.random.default_rng(seed)
    w = 2.0 * np.pi * np.array([0.7, 1.9, 3.1, 4.7])
    turned = 1j * (w[:, None] * t + rng.uniform(0.0, 2.0 * np.pi, (4, 1)))
    z = scale * np.array([0.08, 0.02, 0.012, 0.008])[:, None] * np.exp(turned)
    p, v, a = (np.imag((1j * w[:, None]) ** k * z).sum(axis=0) for k in range(3))
    return Motion(t, p, v, a, rng)


def record(
    seed: int,
    effect: Effect = lambda m: 0.0,
    reads: Effect = lambda m: 0.0,
    reference: str = "position",
    noise: float = 0.02,
    reading: float = 2e-5,
    rig: Rig | None = None,
    side: tuple[str, ...] = (),
    scale: float = 1.0,
    rate: float = 200.0,
    seconds: float = 30.0,
) -> ac.Recording:
    """A record whose output holds an effect, or whose reference does; k = 0.012, K0 = 0.08 m/s^2."""
    m = motion(seed, BEGIN + np.arange(0.0, seconds, 1.0 / rate), scale)
    output = 1.012 * m.a + 0.08 + effect(m) + noise * m.rng.standard_normal(len(m.t))
    place = {"position": m.p, "velocity": m.v, "reference_acceleration": m.a}[reference] + reads(m)
    unit = {"position": "m", "velocity": "m/s", "reference_acceleration": "m/s^2"}[reference]
    channels = {"temperature": (m.temperature, "degC"), "lateral": (m.across, "m/s^2")}
    return ac.Recording.from_arrays(
        m.t,
        output,
        place + reading * m.rng.standard_normal(len(m.t)),
        units={"accel": "m/s^2", reference: unit} | {name: channels[name][1] for name in side},
        side={name: channels[name][0] for name in side},
        rig=rig,
        reference=reference,  # type: ignore[arg-type]
        name=f"record {seed}",
    )


def improved(run: ac.Recording | list[ac.Recording], *side: str) -> Iterator[Any]:
    """What users ask of a record, or of several."""
    better = ac.improve(run)
    yield better
    without = ac.fit(run)
    yield ac.diagnose(without, run)
    yield ac.compare([without, better.best], record(90, scale=0.8, side=side), horizons=(1.0, 3.0))
    if len(better.best.model.effects) > len(without.model.effects):
        yield ac.drop(better.best, run, better.best.model.effects[-1])


def asked(run: ac.Recording, **questions: Any) -> Iterator[Any]:
    """What users ask of a record of which they know the model."""
    fit = ac.fit(run, ac.Model(("bias", "scale_factor", "time_offset", "quadratic")), **questions)
    yield from (fit, (diagnosis := ac.diagnose(fit, run)), ac.power(fit, run))
    if diagnosis.verdict == "tied":
        yield ac.next_experiments(diagnosis, run)


def spoilt(seed: int) -> ac.Recording:
    """Lost samples, two false outputs, a jump of the encoder."""
    run = record(seed, reads=lambda m: np.where(m.t > 17.0, 4e-4, 0.0))
    y = run.accel.y.copy()
    y[[1000, 3100]] += (9.0, -7.0)
    keep = np.ones(len(y), bool)
    keep[1500:1530] = keep[4000:4003] = False
    return replace(run, accel=replace(run.accel, t=run.accel.t[keep], y=y[keep]))


def behind(run: ac.Recording, b: list[float], a: list[float], *declared: ChannelFilter) -> ac.Recording:
    """The output behind a digital filter, settled, which the rig declares or not."""
    y = lfilter(b, a, np.r_[run.accel.y[:1] * np.ones(400), run.accel.y])[400:]
    return replace(run, accel=replace(run.accel, y=y), rig=replace(run.rig, output_filters=declared))


def simulated(profile: str, seed: int, **parameters: float) -> ac.Recording:
    rng = np.random.default_rng(seed)
    truth = {"bias": 0.05, "scale_factor": 0.01} | parameters
    return ac.simulate(
        profile, seconds=16.0, rig=CXL02_RIG, parameters=truth, rng=rng, accel_rate=400.0, position_rate=200.0
    ).recording


def resonated(m: Motion) -> np.ndarray:
    """What a mount at 40 Hz with Q = 8 adds to four tones, by their steady state."""
    w = 2.0 * np.pi * np.array([0.7, 1.9, 3.1, 4.7])
    ratio = w / (2.0 * np.pi * 40.0)
    basis = np.exp(1j * w[:, None] * m.t)
    size = np.linalg.lstsq(np.vstack([basis.real, basis.imag]).T, m.a, rcond=None)[0]
    return np.real(((1.0 / (1.0 - ratio**2 + 1j * ratio / 8.0) - 1.0) * (size[:4] - 1j * size[4:])) @ basis)


def declared(**settings: Any) -> Rig:
    return Rig(sensor=Sensor(noise=0.02 * math.sqrt(2.0 / 200.0), range=50.0), **settings)


def wiener_process(m: Motion, size: float) -> np.ndarray:
    return np.cumsum(m.rng.standard_normal(len(m.t))) * size * math.sqrt(m.t[1] - m.t[0])


def curve(run: ac.Recording) -> Iterator[Any]:
    fit = ac.fit(run)
    yield ac.formulas(fit, run, "shape_of_acceleration")


def static(dwells: ac.Dwells) -> Iterator[Any]:
    fit = ac.fit(dwells)
    yield from (fit, ac.diagnose(fit, dwells))


def written(rig: Rigged, folder: Path) -> Path:
    of_arm(rig, folder)
    return folder / "arm.csv"


def turned(truth: Any, write: Callable[[Any, Path], Path], load: Callable[[Path], Any]) -> Iterator[Any]:
    """Results of a simulator of bodies that turn, by a file of it."""
    with tempfile.TemporaryDirectory() as folder:
        recording = load(write(truth, Path(folder)))
    fit = ac.fit(recording)
    yield from (fit, ac.diagnose(fit, recording))


def differing_runs(count: int) -> Iterator[Any]:
    """Runs whose bias and delay differ, each with another number."""
    runs = []
    for n in range(count):
        run = record(40 + n, lambda m, n=n: 3e-3 * (n - 2) ** 2 + 0.0 * m.t)
        shifted = replace(run.position, t=run.position.t + 5e-4 * n)
        runs.append(replace(run, position=shifted, name=f"run {n}", digest=f"{n}"))
    fit = ac.fit(runs)
    yield from (fit, ac.diagnose(fit, runs), ac.compare(fit, runs[:2], horizons=(1.0,)))


def labelled(count: int) -> Iterator[Any]:
    """Runs of several days and two mountings, whose scale factor falls by the day."""
    runs = []
    for n in range(count):
        labels = RunLabels(date=20_000.0 + 2.0 * n**1.5, mounting="ab"[n % 2], operator="xyz"[n % 3])
        run = record(50 + n, lambda m, n=n: -4e-3 * n * m.a + 0.02 * (n % 2), side=("temperature",), seconds=15.0)
        warm = replace(run.side["temperature"], y=run.side["temperature"].y + (n - 2) ** 2)
        side = {"temperature": warm}
        runs.append(replace(run, labels=labels, side=side, name=f"day {n}", digest=f"{n}"))
    fit = ac.fit(runs)
    yield from (fit, ac.diagnose(fit, runs))


def noise_added(run: ac.Recording, *names: str) -> Iterator[Any]:
    """A model with effects that add variance, and what they gain on another record."""
    fit = ac.fit(run)
    grown = ac.add(fit, run, *names)
    yield from (grown, ac.diagnose(grown, run), ac.compare([fit, grown], replace(run, name="again"), horizons=(1.0,)))


def outlying(m: Motion, size: float) -> np.ndarray:
    """One sample in fifty is off by a size."""
    return size * m.rng.standard_normal(len(m.t)) * (m.rng.random(len(m.t)) < 0.02)


def rounded(run: ac.Recording, lsb: float) -> ac.Recording:
    """The output in steps of a converter, with a sample in twenty that repeats the one before."""
    y = lsb * np.round(run.accel.y / lsb)
    y[20::20] = y[19:-1:20]
    return replace(run, accel=replace(run.accel, y=y))


def stuck(seed: int) -> ac.Recording:
    """An output that repeats a value and that no motion explains, an encoder that stops and that jumps, a shock."""
    run = record(seed, rig=declared(reading_noise=2e-5))
    y, z = run.accel.y.copy(), run.position.y.copy()
    y[600:680], y[2000:2060], z[3500:3560] = y[600], 300.0, z[3500]
    z[[1200, 2800, 2801]] += 4e-3
    y[4500:4520] += 20.0 * np.exp(-np.arange(20) / 5.0)
    return replace(run, accel=replace(run.accel, y=y), position=replace(run.position, y=z))


def jumping(seed: int) -> ac.Recording:
    """Readings that jump and return, one and three."""
    run = record(seed)
    z = run.position.y.copy()
    z[[1400, 3800, 3801, 3802]] += 0.03, 0.02, 0.04, 0.02
    return replace(run, position=replace(run.position, y=z))


def followed_by_bias(m: Motion, tau: float, size: float) -> np.ndarray:
    """A bias that follows the size of the acceleration with a time constant, s."""
    share = 1.0 - math.exp(-(m.t[1] - m.t[0]) / tau)
    return size * lfilter([share], [1.0, share - 1.0], np.abs(m.a))


def dropped_out(seed: int) -> Iterator[Any]:
    """A velocity that is lost for some readings, in time and by frequency."""
    run = record(seed, reference="velocity", reading=1e-4, reads=lambda m: 0.3 * (np.arange(len(m.t)) % 701 > 697))
    yield from (ac.fit(run), ac.response.frequency_response(run, method="broadband"))


def followed(run: ac.Recording, *names: str) -> Iterator[Any]:
    """A model whose coefficients move: their paths, the readings that settle it, the models that it grew from."""
    fit = ac.add(ac.fit(run), run, *names)
    yield from (fit, ac.diagnose(fit, run), *paths(fit, run), *ac.nested(fit, run), track(fit, run))


def of_positions() -> Iterator[Any]:
    """Three outputs, in motion and in positions of unknown attitude."""
    triad = still(61)
    with tempfile.TemporaryDirectory() as folder:
        axes = ac.load_axes(triad.write(Path(folder)))
    yield fit_triad(positions(np.random.default_rng(60), second=2e-4))
    yield from (fit := ac.fit([*axes, held(triad)]), ac.diagnose(fit, [*axes, held(triad)]))


def planned() -> Iterator[Any]:
    rig, limits = declared(reading_noise=2e-5), {"stroke": 0.3, "v_max": 0.8, "a_max": 8.0}
    yield ac.plan(["quadratic", "velocity"], seconds=20.0, rig=rig, **limits)
    tied = record(20, lambda m: wiener_process(m, 4e-3))
    yield ac.next_experiments(ac.diagnose(ac.fit(tied), tied), tied)


def later(run: ac.Recording, by: float) -> ac.Recording:
    """The recording with stamps that begin at another time, s."""
    accel, position = (replace(channel, t=channel.t + by) for channel in (run.accel, run.position))
    return replace(run, accel=accel, position=position)


CASES: dict[str, Callable[[], Iterator[Any]]] = {
    "nothing": lambda: improved(record(1)),
    "declared noise": lambda: improved(record(2, rig=declared(resolution=1e-5))),
    "quadratic": lambda: improved(record(3, lambda m: 2e-3 * m.a**2)),
    "two of the output": lambda: improved(record(4, lambda m: 2e-3 * m.a**2 + 4e-4 * m.a**3)),
    "friction beside rests": lambda: improved(
        replace(
            run := simulated("interleaved", 5), accel=replace(run.accel, y=run.accel.y + 0.02 * np.tanh(run.accel.y))
        )
    ),
    "velocity": lambda: improved(record(6, lambda m: 0.03 * m.v, reference="velocity", reading=1e-4)),
    "acceleration": lambda: improved(
        record(7, lambda m: 3e-3 * m.a * np.abs(m.a), reference="reference_acceleration", reading=0.01)
    ),
    "a fine reference": lambda: improved(record(8, lambda m: 1e-3 * m.a**2, reading=1e-8)),
    "temperature": lambda: improved(
        record(9, lambda m: 4e-3 * (m.temperature - 20.0), side=("temperature",)), "temperature"
    ),
    "a channel across": lambda: improved(
        record(10, lambda m: 0.02 * m.across, side=("lateral", "temperature")), "lateral", "temperature"
    ),
    "spoilt": lambda: improved(spoilt(11)),
    "an encoder's wave": lambda: improved(record(12, reads=lambda m: 2e-5 * np.sin(2.0 * np.pi * m.p / 0.02))),
    "a hum": lambda: improved(record(13, lambda m: 0.06 * np.sin(2.0 * np.pi * 41.0 * m.t + 0.3))),
    "AC coupling": lambda: improved(
        behind(record(14), [0.999, -0.999], [1.0, -0.998], ChannelFilter("butterworth", "highpass", cutoff=0.0637))
    ),
    "an undeclared low-pass": lambda: improved(behind(record(15), [0.25], [1.0, -0.75])),
    "a declared low-pass": lambda: improved(simulated("tones", 16, cubic=2e-3)),
    "a resonance": lambda: improved(record(17, resonated)),
    "a step of the bias": lambda: improved(record(19, lambda m: np.where(m.t > 12.0, 0.01, 0.0))),
    "a walk of the bias": lambda: improved(record(20, lambda m: wiener_process(m, 4e-3))),
    "noise of motion": lambda: improved(record(21, lambda m: 0.02 * np.abs(m.v) * m.rng.standard_normal(len(m.t)))),
    "hysteresis": lambda: improved(record(22, lambda m: 0.03 * np.sign(m.v) * np.sqrt(np.abs(m.a)))),
    "the rail": lambda: improved(record(23, lambda m: 9.8 * 1e-3 * np.sin(2.0 * np.pi * m.p / 0.05))),
    "an upright axis": lambda: improved(record(24, lambda m: 9.81 + 1e-3 * m.a**2, rig=Rig(axis="up"))),
    "three runs": lambda: improved(
        [replace(record(30 + n, lambda m, n=n: 2e-3 * n * m.a), name=f"run {n}", digest=f"{n}") for n in range(3)]
    ),
    "a response": lambda: iter([ac.response.frequency_response(record(25, scale=0.6))]),
    "days": lambda: labelled(6),
    "vibration added": lambda: noise_added(
        record(62, lambda m: 0.3 * np.abs(m.v) * m.rng.standard_normal(len(m.t)), seconds=60.0), "vibration"
    ),
    "jitter and outliers added": lambda: noise_added(
        record(
            63,
            lambda m: 5e-4 * m.rng.standard_normal(len(m.t)) * np.gradient(m.a, m.t) + outlying(m, 0.2),
            reads=lambda m: outlying(m, 3e-4),
        ),
        "timing_jitter",
        "accelerometer_outliers",
        "encoder_outliers",
    ),
    "coarse counts": lambda: improved(rounded(record(64, noise=0.01), 0.2)),
    "counts added": lambda: noise_added(rounded(record(65, noise=0.01), 0.2), "quantisation", "held_samples"),
    "another range": lambda: improved(record(70, lambda m: np.where(m.t > 24.0, m.a, 0.0), rig=declared())),
    "stuck": lambda: improved(stuck(66)),
    "a process added": lambda: followed(record(67, lambda m: wiener_process(m, 6e-3)), "bias_gauss_markov"),
    "a process that follows": lambda: followed(
        record(68, lambda m: wiener_process(m, 3e-3) * m.a, seconds=60.0),
        "scale_factor_random_walk",
        "bias_random_walk",
    ),
    "positions of three outputs": of_positions,
    "drop-outs": lambda: dropped_out(71),
    "at rest and warm": lambda: iter(
        [ac.rest(record(69, lambda m: 8e-3 * m.temperature, scale=0.0, seconds=300.0, side=("temperature",)))]
    ),
    "at rest": lambda: iter([ac.rest(record(26, scale=0.0, seconds=120.0, reading=1e-6))]),
    "a model": lambda: asked(record(27, lambda m: 5e-4 * m.a**2 + 3e-4 * m.a**3)),
    "a model in the weak form": lambda: asked(record(28, lambda m: 5e-4 * m.a**2 + 2e-4 * m.a**3), method="weak"),
    "a part of a record": lambda: asked(record(29), start=4.0, end=21.0),
    "a filter of the paper": lambda: iter([ac.fit(record(30, seconds=10.0), method=ac.FilterChoice(order=2))]),
    "a curve and its formulas": lambda: curve(record(33, lambda m: 0.03 * np.sin(1.5 * m.a))),
    "a tumble test": lambda: static(tumble(np.random.default_rng(34), truth={**TUMBLED, "cubic": 9e-5})),
    "three outputs": lambda: turned(
        Triad(35, law=lambda t, f, warm: 1e-4 * f**3, seconds=30.0), Triad.write, ac.load_axes
    ),
    "an arm": lambda: turned(Rigged(seed=36, quadratic=2e-3, keys={"arm_std": '"1 um"'}), written, ac.load),
    "runs that differ": lambda: differing_runs(5),
    "a planned experiment": planned,
    "stamps of a day": lambda: improved(later(spoilt(37), 5e4)),
    "little evidence": lambda: improved(record(72, lambda m: 5.5e-5 * m.a**2)),
    "readings that jump": lambda: improved(jumping(73)),
    "a curve and its memory": lambda: curve(record(74, lambda m: followed_by_bias(m, 0.5, 0.05))),
    "samples as they are": lambda: iter([ac.fit(spoilt(31), reject_outliers=False)]),
}


def numbers(content: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float]]:
    """Numbers of a JSON value with the keys that lead to each; words as numbers."""
    if isinstance(content, dict):
        for key, value in content.items():
            if key not in PASSED:
                yield from numbers(value, (*path, key))
    elif isinstance(content, list):
        for n, value in enumerate(content):
            yield from numbers(value, (*path, str(n)) if isinstance(value, dict) else path)
    elif isinstance(content, str):
        if re.fullmatch(r"\(?[-+.e0-9]+j\)?", content):
            yield from ((path, part) for part in (complex(content).real, complex(content).imag))
        else:
            words = DIGITS.sub("#", content) if " " in content else content
            yield path, float(zlib.crc32(words.encode()))
    elif content is not None:
        yield path, float(content)


def sums(results: Iterable[Any]) -> Figures:
    """Of all numbers below two keys how many there are, and two sums that a change of any one changes."""
    leaves = defaultdict[tuple[str, ...], list[float]](list)
    for n, result in enumerate(results):
        for path, value in numbers(json.loads(result.to_json()), (str(n),)):
            leaves[path].append(value if abs(value) > TINY else 0.0)
    figures = defaultdict[str, list[float]](lambda: [0, 0.0, 0.0])
    for path, values in leaves.items():
        y, key = np.array(values), ".".join(path[:DEPTH])
        weights = 2.0 + np.cos(zlib.crc32(".".join(path).encode()) + 1.618 * np.arange(len(y)))
        rms = float(np.sqrt(np.mean(y**2))) or 1.0
        more = len(y), weights[0] * math.log(rms), np.mean(weights * y) / rms
        figures[key] = [a + b for a, b in zip(figures[key], more, strict=True)]
    return {key: [count, *(float(f"{value:.10g}") for value in both)] for key, (count, *both) in figures.items()}


def differing(a: Figures, b: Figures) -> list[str]:
    """Groups of numbers that are others, one line each."""
    return [
        f"{key}: {a.get(key)} -> {b.get(key)}"
        for key in sorted(a.keys() | b.keys())
        if np.max(np.abs(np.subtract(a.get(key, math.inf), b.get(key, -math.inf)))) > TOLERANCE
    ]


@pytest.mark.parametrize("name", CASES)
def test_figures_are_those_that_are_written_down(name: str) -> None:
    before = json.loads(FILE.read_text(encoding="utf-8"))[name]
    assert not differing(before, sums(CASES[name]())), WHERE


def test_a_change_of_any_number_by_half_a_percent_is_noticed() -> None:
    fit = ac.fit(record(30, seconds=10.0), method=ac.FilterChoice())
    before = sums([fit])
    for n, estimate in enumerate(fit.estimates):
        for key, value in (("value", estimate.value), ("std", estimate.std)):
            estimates = [replace(e, **{key: 1.005 * value}) if n == k else e for k, e in enumerate(fit.estimates)]
            assert len(differing(before, sums([replace(fit, estimates=tuple(estimates))]))) == (value != 0.0)


if __name__ == "__main__":
    FILE.write_text(json.dumps({name: sums(case()) for name, case in CASES.items()}, indent=0) + "\n", encoding="utf-8")
