"""The keys lowpass and highpass: every kind is read and written back, and a mistake is one sentence."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from accelcal import io
from accelcal.data.recording import RecordingError
from accelcal.data.rig import ChannelFilter, LowPass, Rig
from accelcal.io.sidecar import Source, read_sidecar
from accelcal.results import model_file

ALL = """
[channels.accel]
column = "u"
unit = "m/s^2"
lowpass = [
    { kind = "butterworth", fc = "50 Hz", order = 4 }, { kind = "bessel", fc = "100 Hz", order = 2, rate = "5 kHz" },
    { kind = "biquad", b = [0.2, 0.4, 0.2], a = [1.0, -0.4, 0.2] }, { kind = "RC", fc = "300 Hz" },
    { kind = "sinc", length = 16, order = 3, rate = "16670 Hz" }, { kind = "fir", taps = [0.25, 0.5, 0.25] },
    { kind = "resonance", f0 = "30.12 Hz", Q = 9.8, tolerance = 0.02 },
]
highpass = { kind = "RC", tau = "1 s" }
[channels.position]
column = "p"
unit = "m"
lowpass = { kind = "RC", fc = "200 Hz" }
highpass = { kind = "biquad", b = [1, -1], a = [1, -0.999] }
"""


def read(folder, text: str) -> Rig:
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    return read_sidecar(path).rig


def test_every_kind_is_read(tmp_path) -> None:
    rig = read(tmp_path, ALL)
    assert rig.lowpass is None
    assert rig.output_filters == (
        ChannelFilter("RC", "highpass", cutoff=1 / (2 * math.pi)),
        ChannelFilter("butterworth", cutoff=50.0, order=4),
        ChannelFilter("bessel", cutoff=100.0, order=2, rate=5000.0),
        ChannelFilter("biquad", b=(0.2, 0.4, 0.2), a=(1.0, -0.4, 0.2)),
        ChannelFilter("RC", cutoff=300.0),
        ChannelFilter("sinc", length=16, order=3, rate=16670.0),
        ChannelFilter("fir", b=(0.25, 0.5, 0.25)),
        ChannelFilter("resonance", cutoff=30.12, quality=9.8, tolerance=0.02),
    )
    assert [f.kind for f in rig.position_filters] == ["biquad", "RC"]
    assert not rig.coupled
    assert not any("no low-pass" in sentence for sentence in rig.assumptions)


def test_one_rc_is_the_low_pass_of_before(tmp_path) -> None:
    both = 'lowpass = [{ fc = "159 Hz", tolerance = 0.05 }], highpass = { tau = "10 s" }'
    rig = read(tmp_path, f'[channels]\naccel = {{ column = "u", unit = "g", {both} }}')
    assert rig.lowpass == LowPass(159.0, 0.05)
    assert [f.name for f in rig.output_filters] == ["RC high-pass at 0.0159155 Hz"]


def test_filters_survive_writing_and_model_files(tmp_path) -> None:
    rig = replace(read(tmp_path, ALL), assumptions=())
    io.write_sidecar(rig, {"accel": Source("u", "m/s^2"), "position": Source("p", "m")}, tmp_path / "again.toml")
    assert replace(read_sidecar(tmp_path / "again.toml").rig, assumptions=()) == rig


def test_a_model_file_holds_filters(tmp_path, simulated_fit) -> None:
    rig = read(tmp_path, ALL)
    content = json.loads(model_file.dumps(model_file.to_dict(replace(simulated_fit, rig=rig))))
    assert model_file.from_dict(content).rig == rig


@pytest.fixture(scope="module")
def simulated_fit():
    from accelcal.estimation.estimate import estimate
    from accelcal.model import Model
    from accelcal.simulation.sensor import CXL02_RIG, simulate

    simulation = simulate("tones", seconds=10.0, rig=CXL02_RIG, parameters={}, rng=np.random.default_rng(1))
    return estimate(Model.linear(), simulation.recording)


@pytest.mark.parametrize(
    ("entry", "key", "text"),
    [
        ('lowpass = { kind = "cauer" }', "lowpass.kind", "found 'cauer', expected \"RC\" or"),
        ('lowpass = { kind = "butterworth", fc = "50 Hz" }', "lowpass", "fc and order are needed"),
        ('lowpass = { kind = "butterworth", fc = "50 Hz", order = 0 }', "lowpass", "order: found 0, expected a whole"),
        (
            'lowpass = { kind = "butterworth", fc = "50 Hz", order = 2.5 }',
            "lowpass.order",
            "found 2.5, expected a whole",
        ),
        (
            'lowpass = { kind = "bessel", fc = "60 Hz", order = 2, rate = "100 Hz" }',
            "lowpass",
            "less than half the rate",
        ),
        ('lowpass = { kind = "biquad", b = [1], a = [1, -1.1] }', "lowpass", "unstable, a pole has the magnitude 1.1"),
        ('lowpass = { kind = "biquad", b = [1], a = [0, 1] }', "lowpass", "the first of a not zero"),
        ('lowpass = { kind = "biquad", b = [1, -1], a = [1] }', "lowpass", "is no lowpass"),
        ('lowpass = { kind = "fir", taps = [] }', "lowpass", "expected at least one number that is not zero"),
        ('lowpass = { kind = "fir", taps = ["1"] }', "lowpass.taps", "expected a list of numbers"),
        ('lowpass = { kind = "sinc", order = 3 }', "lowpass", "length is needed"),
        ('lowpass = { kind = "sinc", length = 1 }', "lowpass", "length: found 1, expected a whole number of samples"),
        ('lowpass = { kind = "RC", fc = "9 Hz", tau = "1 s" }', "lowpass", "or tau, not both"),
        (
            'lowpass = { kind = "RC", order = 2, fc = "9 Hz" }',
            "lowpass.order",
            "no key of RC; known keys here: kind, fc",
        ),
        ('lowpass = [{ fc = "9 Hz" }, { fc = "9" }]', "lowpass.2.fc", "expected a frequency"),
        ('lowpass = { kind = "resonance", f0 = "9 Hz" }', "lowpass", "f0 and Q are needed"),
        (
            'lowpass = [{ kind = "resonance", f0 = "9 Hz", Q = 3 }, { fc = "9 Hz", tolerance = 0.1 }]',
            "",
            "of its resonance",
        ),
        ('lowpass = { kind = "resonance", f0 = "9 Hz", Q = 3, tolerance = 2 }', "lowpass", "a share of f0 from 0 to 1"),
        ('lowpass = { kind = "resonance", f0 = "9 Hz", Q = 0 }', "lowpass.Q", "a pure number that is positive"),
        ('highpass = { kind = "resonance", f0 = "9 Hz", Q = 3 }', "highpass", "a spring passes it"),
        ("lowpass = []", "lowpass", "found an empty list"),
        ('highpass = { kind = "sinc", length = 4 }', "highpass", "an average does not"),
        ('highpass = { kind = "RC", tau = "1 s", tolerance = 0.1 }', "", "leave out tolerance"),
        ('lowpass = [{ fc = "9 Hz", tolerance = 0.1 }, { fc = "90 Hz" }]', "", "leave out tolerance"),
    ],
)
def test_a_mistake_names_file_key_and_what_was_expected(tmp_path, entry: str, key: str, text: str) -> None:
    place = re.escape(".".join(filter(None, ("channels.accel", key))))
    with pytest.raises(RecordingError, match=rf"run\.toml: {place}: ") as error:
        read(tmp_path, f'[channels]\naccel = {{ column = "u", unit = "g", {entry} }}')
    assert text in str(error.value)
