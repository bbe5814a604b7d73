"""Every command lists the same faults of a file, once, with the command that cuts; the cut file knows of them."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import accelcal as ac
from accelcal.cli import app
from accelcal.plots import timeline
from tests.field.rigs import MOTIONS, G, Rig, moved

COMMAND = "; a file without that: accelcal "


@dataclass(frozen=True)
class Fault:
    """One kind of fault in files of two users: names of their columns and units."""

    code: str
    columns: tuple[tuple[str, str, str], tuple[str, str, str]]
    cuts: bool = True


FAULTS = {
    "touched": Fault("disturbed", (("Zeit [s]", "Weg [mm]", "Beschl [g]"), ("t", "x", "a"))),
    "junk": Fault("denied", (("temps", "deplacement", "accel"), ("時刻", "変位", "加速度"))),
    "absurd": Fault("denied", (("时间", "位移", "加速度"), ("clock", "scale mm", "out"))),
    "jump": Fault("position_step", (("tiempo", "regla", "salida"), ("t_s", "enc", "y")), cuts=False),
    "idle": Fault("stuck", (("tijd", "weg", "versnelling"), ("tempo", "riga", "uscita"))),
}


def planted(kind: str, user: int) -> tuple[Rig, np.ndarray, np.ndarray]:
    """A rig, its output and its position with a fault of one kind."""
    rig = moved(300 + 10 * list(FAULTS).index(kind) + user, "stage", 0.01)
    rng, t = rig.rng, rig.t
    u, z = rig.output(), rig.read()
    match kind:
        case "touched":
            u += (0.7 - 0.2 * user) * np.exp(-0.5 * ((t - (0.55 + 0.1 * user) * t[-1]) / 0.35) ** 2)
        case "junk":
            u[: 25 + 20 * user] = rng.uniform(-15.0, 15.0, 25 + 20 * user)
        case "absurd":
            u[rng.choice(len(t), 3, replace=False)] = [3e6, -8e7, 2e8]
        case "jump":
            z[t < 0.7 + 0.5 * user] += 0.012
        case "idle":
            middle = len(t) // 2
            u[middle : middle + int((2.0 + user) / t[1])] = 0.0 if user else u[middle]
    return rig, u, z


def written(kind: str, user: int, folder: Path) -> tuple[Rig, Path]:
    """A file with a fault, and the rig that it is of."""
    rig, u, z = planted(kind, user)
    time, position, output = FAULTS[kind].columns[user]
    millimetres, gravities = user == 0, kind in ("touched", "idle")
    rig.columns = {time: rig.t, position: z * (1e3 if millimetres else 1.0), output: u / (G if gravities else 1.0)}
    rig.declare(
        f'time = {{ column = "{time}", unit = "s" }}',
        f'accel = {{ column = "{output}", unit = "{"g" if gravities else "m/s^2"}" }}',
        f'position = {{ column = "{position}", unit = "{"mm" if millimetres else "m"}" }}',
    )
    path = folder / "run.csv"
    lines = [
        ",".join(rig.columns),
        *(",".join(f"{y:.9g}" for y in row) for row in zip(*rig.columns.values(), strict=True)),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = "\n".join(f"[{table}]\n{lines}" for table, lines in rig.lines.items() if lines)
    path.with_suffix(".toml").write_text(text + "\n", encoding="utf-8")
    return rig, path


def printed(*words: str) -> str:
    """What a command prints."""
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


@pytest.mark.parametrize(
    ("kind", "user"), [("touched", 1), ("junk", 0), ("absurd", 1), ("jump", 0), ("idle", 0), ("idle", 1)]
)
def test_every_command_lists_the_same_faults(kind: str, user: int, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    rig, path = written(kind, user, tmp_path)
    fault, recording = FAULTS[kind], ac.load(Path(path.name))
    fit = ac.fit(recording)
    noticed = [note for note in fit.remarks if note.place == "data"]
    assert [note.code for note in noticed] == [fault.code]
    (sentence,) = (note.sentence for note in noticed)
    assert not fit.tilt
    for name, truth in (("bias", rig.bias), ("scale_factor", rig.k)):
        assert abs(fit[name].value - truth) < 4.5 * fit[name].std
    judged = ac.diagnose(fit, recording)
    assert judged.suspect == (sentence,)
    assert set(judged.effects) <= {"encoder_step"}
    if kind != "touched":  # the residual of a fit alone shows it
        assert f"suspect data: {sentence}" in printed("check", path.name)
        assert [note.sentence for note in timeline.marks(recording).remarks] == [sentence]
    evaluation = ac.compare(fit, recording)[0]
    assert evaluation.left_out == (sentence,) or kind == "touched"
    assert (COMMAND in sentence) == fault.cuts
    if fault.cuts:
        printed(*shlex.split(sentence.partition(COMMAND)[2]))
        rest = ac.load(Path("run_cut.csv"))
        assert fault.code not in {note.code for note in ac.fit(rest).remarks}
        if kind != "touched":
            assert [finding.text for finding in rest.findings if finding.kind == fault.code] == [
                f"before the cut: {sentence.partition(COMMAND)[0]}"
            ]


def test_a_disturbed_held_out_recording_is_judged_without_the_disturbance(tmp_path: Path) -> None:
    recordings = []
    for user, name in enumerate(("fitted", "unseen")):
        (tmp_path / name).mkdir()
        recordings.append(ac.load(written("touched", user, tmp_path / name)[1]))
    fit = ac.fit(recordings[0])
    evaluation = ac.compare(fit, recordings[1])[0]
    assert any("something disturbed the record between" in text for text in evaluation.left_out)
    assert evaluation.coast_rms[1.0] < 3.0 * ac.compare(fit, recordings[0])[0].coast_rms[1.0]


def test_a_gap_of_both_channels_is_no_impact(tmp_path: Path) -> None:
    """Steps of the output and of the position across a gap stand beside each other."""
    for seed in range(3):
        rig = moved(seed, "stage", 0.01)
        units = {"accel": "m/s^2", "position": "m"}
        whole = ac.Recording.from_arrays(rig.t, rig.output(), rig.read(), units=units)
        rest = whole.without((10.0, 13.1))
        assert "break" not in {note.code for note in ac.fit(rest).remarks}


@pytest.mark.parametrize(("seed", "kind"), [(5, "stage"), (6, "shaker")])
def test_a_few_lost_samples_stop_no_improvement(seed: int, kind: str) -> None:
    """Two accelerometers, 900 readings of each, of which 8 are lost one by one."""
    rig = moved(seed, kind, 0.01)
    n = 900
    step = max(1, int(0.02 * len(rig.t) / n * MOTIONS[kind][1] / 20.0))
    rows = slice(0, n * step, step)
    there = np.ones(n, dtype=np.bool_)
    there[rig.rng.choice(n, 8, replace=False)] = False
    u, a = rig.output()[rows], rig.a[rows] + 2e-3 * rig.rng.standard_normal(n)
    units = {"accel": "m/s^2", "reference_acceleration": "m/s^2"}
    lost = np.where(there, u, np.nan), np.where(np.roll(there, 5), a, np.nan)
    recording = ac.Recording.from_arrays(rig.t[rows], *lost, units=units, reference="reference_acceleration")
    improved = ac.improve(recording, most=1)
    assert improved.effects == ()
    assert abs(improved.steps[-1].fit["scale_factor"].value - rig.k) < 4.5 * improved.steps[-1].fit["scale_factor"].std


@pytest.mark.parametrize(("seed", "rate", "column", "constant"), [(1, 62.5, "quer", 9.80665), (2, 80.0, "側", -9.7)])
def test_gravity_on_a_transverse_channel_leaves_the_named_effect(
    seed: int, rate: float, column: str, constant: float, tmp_path: Path
) -> None:
    """Any triaxial sensor on a level rail: a constant that is no motion."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 24.0, 1.0 / rate)
    w = 2.0 * np.pi * np.array([1.7, 2.9, 5.1])
    tones = 4e-5 * np.sin(np.outer(t, w) + rng.uniform(0.0, 6.0, 3))
    a_y = constant + 0.06 * rng.standard_normal(len(t))
    u = 0.05 + 1.01 * (tones @ -(w**2)) + 0.02 * a_y + 5e-4 * rng.standard_normal(len(t))
    z = np.sum(tones, axis=1) + 2e-8 * rng.standard_normal(len(t))
    path = tmp_path / "run.csv"
    rows = (f"{1e3 * a:.6f},{1e6 * b:.6f},{c / G:.9f},{d:.7f}" for a, b, c, d in zip(t, z, u, a_y, strict=True))
    path.write_text("\n".join([f"ms,weg,aus,{column}", *rows]) + "\n", encoding="utf-8")
    path.with_suffix(".toml").write_text(
        '[rig]\naxis = "level"\n[channels]\ntime = { column = "ms", unit = "ms" }\n'
        'position = { column = "weg", unit = "um" }\naccel = { column = "aus", unit = "g" }\n'
        f'a_y = {{ column = "{column}", unit = "m/s^2" }}\n',
        encoding="utf-8",
    )
    improved = ac.improve(ac.load(path), most=2)
    assert improved.effects == ("cross_axis",)
    estimate = improved.steps[-1].fit["cross_axis"]
    assert abs(estimate.value - 0.02) < 3.0 * estimate.std
