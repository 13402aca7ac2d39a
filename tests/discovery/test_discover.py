"""Discovery from a study file to a proved model, on two masses whose truth is integrated by scipy, not by this package."""

import json
import re
import zipfile
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

import fmpy

from fmucorrect import records
from fmucorrect.cli import main
from fmucorrect.discovery import discover, nuisances
from fmucorrect.discovery.evidence import Nuisances, independent
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.output import sensor_rows
from fmucorrect.discovery.problem import load
from fmucorrect.errors import StudyError
from fmucorrect.pairs import simulate
from fmucorrect.report.discovery import content
from fmucorrect.signals import Channel, Record
from fmucorrect.study import load_study

FMU = Path(__file__).resolve().parent.parent.parent / "fmus" / "oscillator" / "oscillator.fmu"
STEP, SECONDS, NOISE = 0.001, 3.0, 0.01  # s, s, mm
M, K, C, WALL = (1.0, 1.5), (1200.0, 800.0), (5.0, 4.0), (1500.0, 3.0)
CUBIC = 2.0e7  # N/m3, at joint 2
FRICTION = 0.25  # N, at joint 1


def push(name, t):
    """Force on mass 2, N: sweeps of two sizes from 0.5 to 8 Hz, and another one that is held out. The FMU holds its inputs, so
    the study gives them half a step ahead."""
    size, sign = {"large": (6.0, 1.0), "small": (1.5, 1.0), "held out": (4.0, -1.0)}[name]
    s = t / SECONDS
    low, high = (0.5, 8.0) if sign > 0.0 else (8.0, 0.5)
    return size * np.sin(2.0 * np.pi * SECONDS * (low * s + 0.5 * (high - low) * s**2)) * np.minimum(1.0, 10.0 * s)


@cache  # the same law is measured in several tests
def truth(name, law):
    """Displacements (T, 2) of both masses in mm. law: force in both joints from their (d, v), opposing them."""
    t = np.arange(round(SECONDS / STEP) + 1) * STEP

    def rate(at, x):
        d, v = np.array([x[0], x[1] - x[0]]), np.array([x[2], x[3] - x[2]])
        f = np.array(K) * d + np.array(C) * v + law(d, v)
        right = WALL[0] * x[1] + WALL[1] * x[3]
        return [x[2], x[3], (f[1] - f[0]) / M[0], (push(name, at) - f[1] - right) / M[1]]

    return 1e3 * solve_ivp(rate, (0.0, t[-1]), np.zeros(4), "LSODA", t, rtol=1e-8, atol=1e-11).y[:2].T


def write(path, record):
    with records.writer(path) as out:
        out.write("/data", record)


def for_this_machine(path):
    """The oscillator with this machine's library alone: what is found would be compiled for each that it has."""
    with zipfile.ZipFile(FMU) as source, zipfile.ZipFile(path, "w") as out:
        for item in source.infolist():
            if not item.filename.startswith("binaries/") or f"/{fmpy.platform}/" in item.filename:
                out.writestr(item, source.read(item))
    return path


def write_study(folder, law, unit="mm", garbage=False, fmu=None, force="N", scale=1.0):
    """fmu: the oscillator for this machine alone unless given. scale: from mm to the measured numbers."""
    fmu = fmu or for_this_machine(folder / "oscillator.fmu")
    t_ns = np.arange(round(SECONDS / STEP) + 1) * round(STEP * 1e9)
    rng = np.random.default_rng(3)
    start = f"masses = 2.0, m1 = {M[0]}, m2 = {M[1]}, k1 = {K[0]}, k2 = {K[1]}, c1 = {C[0]}, c2 = {C[1]}"
    text = f"""format = 1
name = "two masses"
[simulation]
fmu = {json.dumps(str(fmu))}
step_size = {STEP}
parameters = {{ {start}, k_end = {WALL[0]}, c_end = {WALL[1]} }}
"""
    for i in (1, 2):
        text += (
            f'[[channels]]\nname = "x{i}"\nsimulation = "mass{i}.x"\nmeasurement = "s{i}"\nquantity = "displacement"\n'
        )
        text += f'unit = "{unit}"\nnoise = {NOISE * scale}\n'
        text += f'[[joints]]\nname = "joint {i}"\nforce = "joint{i}.f"\ndisplacement = "joint{i}.d"\n'
        text += f'velocity = "joint{i}.v"\nnominal_force = "joint{i}.F"\n'
        text += f'[[adjustable]]\nparameter = "k{i}"\nminimum = 100.0\nmaximum = 5000.0\ntolerance = 0.02\n'
    for name in ("large", "small", "held out"):
        role = "evaluation" if name == "held out" else "development"
        measured = truth(name, law) + rng.normal(0.0, NOISE, (len(t_ns), 2))
        if garbage and role == "evaluation":
            measured = rng.normal(0.0, 1.0, measured.shape)
        file = f"{name.replace(' ', '_')}"
        channels = (Channel("s1", unit=unit), Channel("s2", unit=unit))
        write(folder / f"{file}.mcap", Record(t_ns, measured * scale, channels))
        given = push(name, t_ns * 1e-9 + 0.5 * STEP)[:, None]
        write(folder / f"{file}.csv", Record(t_ns, given, (Channel("mass2.f", unit=force),)))
        text += (
            f'[[conditions]]\nname = "{name}"\nrole = "{role}"\ninputs = "{file}.csv"\nmeasurement = "{file}.mcap"\n'
        )
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def cubic(d, v):
    return np.array([0.0, CUBIC * d[1] ** 3])


def friction(d, v):
    return np.array([FRICTION * np.tanh(v[0] / 1e-4), 0.0])


STOP = (1.5e-3, 6000.0)  # m, N/m: met by joint 1 from below alone


def stop(d, v):
    return np.array([STOP[1] * max(d[0] - STOP[0], 0.0), 0.0])


def nothing(d, v):
    return np.zeros(2)


def test_a_cubic_spring_is_named_with_its_value_and_proved(found):
    folder, report = found
    (effect,) = report["effects"]
    assert (report["verdict"], effect["effect"], effect["joint"]) == ("named", "cubic_stiffness", "joint 2")
    value = effect["parameters"]["cubic_stiffness"]
    assert value["unit"] == "N/m3"
    assert value["value"] == pytest.approx(CUBIC, rel=0.03)
    assert abs(value["value"] - CUBIC) < 5.0 * value["std"]
    (gap,) = [row for row in report["gap"] if row["role"] == "evaluation"]
    assert gap["nrmse_before"] > 3.0 * gap["noise_floor"]
    assert gap["nrmse_after"] < 1.15 * gap["noise_floor"]
    assert report == json.loads((folder / "out" / "report.json").read_text())
    assert "cubic stiffness" in (folder / "out" / "report.html").read_text()
    assert f"<td>{effect['equation']}</td>" in report._repr_html_()


@pytest.mark.slow
def test_a_stop_at_one_side_is_named_with_its_place(tmp_path):
    """As one at both sides it would ask for a preload and a sensor's offset beside it."""
    report = discover(write_study(tmp_path, stop), tmp_path / "out")
    (effect,) = report["effects"]
    assert (report["verdict"], effect["effect"], effect["joint"]) == ("named", "bump_stop", "joint 1")
    for name, value in zip(("limit", "stiffness"), STOP, strict=True):
        assert effect["parameters"][name]["value"] == pytest.approx(value, rel=0.05)
    assert effect["parameters"]["side"]["value"] == 1.0


def test_what_the_page_takes_is_what_is_written(found):
    """A key that only one of the two knows would be missing on the page without a word."""
    report = found[1]
    rows = [(content.Discovery, report), (content.Effect, report["effects"][0]), (content.Where, report["where"])]
    rows += [
        (content.Candidate, report["candidates"][0]),
        (content.Gap, next(row for row in report["gap"] if row["role"] == "evaluation")),
        (content.Cost, report["cost"]),
    ]
    rows += [(content.Study, report["study"]), (content.Sensor, report["sensors"][0])]
    unwritten = {
        f"{kind.__name__}.{field.name}" for kind, row in rows for field in fields(kind) if field.name not in row
    }
    ended = {"Discovery.time_limit", "Discovery.not_looked_at"}  # by a time limit
    other = {
        "Effect.class_probability",
        "Where.pictures",
        "Gap.nrmse_moved",
    }  # of what is not beyond doubt, or has no name
    assert unwritten == ended | other


def test_the_rivals_stand_behind_what_was_found(found):
    """Laws that leave more, here and at the other joint: compared at last, or given up before, without a probability."""
    first, *behind = found[1]["candidates"]
    (effect,) = found[1]["effects"]
    assert first["members"] == [{"effect": "cubic_stiffness", "joint": "joint 2"}]
    assert (first["behind"], first["probability"]) == (0.0, effect["probability"])
    assert len(behind) >= 3
    assert all(row["behind"] > 0.0 and row["error"] > first["error"] for row in behind)
    compared = [row["probability"] for row in found[1]["candidates"] if row["probability"] is not None]
    assert sum(compared) <= 1.0 + 1e-9
    sets = [{(member["effect"], member["joint"]) for member in row["members"]} for row in (first, *behind)]
    assert all(len(one) == 1 and one not in sets[:i] for i, one in enumerate(sets))


def test_the_augmented_fmu_and_its_study_need_nothing_of_this(found):
    """In fmpy, with the inputs of the condition that was held out: as close to the truth as the report says."""
    folder, report = found
    t = np.arange(round(SECONDS / STEP) + 1) * STEP
    signals = np.array(
        list(zip(t, push("held out", t + 0.5 * STEP), strict=True)), dtype=[("time", float), ("mass2.f", float)]
    )
    assert not load_study(folder / "out" / "study.toml").parameters  # the FMU brings them with it
    result = fmpy.simulate_fmu(
        str(folder / "out" / "augmented.fmu"),
        stop_time=SECONDS,
        output_interval=STEP,
        step_size=STEP,
        input=signals,
        output=["mass1.x", "mass2.x"],
    )
    shown = 1e3 * np.stack([result["mass1.x"], result["mass2.x"]], axis=1)
    real = truth("held out", cubic)
    error = np.mean(np.sqrt(np.mean((shown - real) ** 2, axis=0)) / np.ptp(real, axis=0)) * 100.0
    (gap,) = [row for row in report["gap"] if row["role"] == "evaluation"]
    assert error < 0.5 * gap["noise_floor"] < 0.1 * gap["nrmse_before"]


def test_friction_is_named_and_goes_into_the_fmu_for_every_machine(tmp_path):
    report = discover(write_study(tmp_path, friction, fmu=FMU), tmp_path / "out")
    (effect,) = report["effects"]
    assert (report["verdict"], effect["effect"], effect["joint"]) == ("named", "coulomb_friction", "joint 1")
    assert effect["parameters"]["friction_force"]["value"] == pytest.approx(FRICTION, rel=0.05)
    made, given = (fmpy.supported_platforms(str(path)) for path in (tmp_path / "out" / "augmented.fmu", FMU))
    assert sorted(made) == sorted(given)
    assert len(made) > 1


def test_where_nothing_is_missing_nothing_is_named(tmp_path):
    """By the command, which explains a missing column and a kind that is none as well."""
    study = write_study(tmp_path, nothing)
    done = CliRunner().invoke(main, ["discover", str(study), "-o", str(tmp_path / "out"), "--json"])
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert (report["verdict"], report["effects"]) == ("none", [])
    assert not (tmp_path / "out" / "augmented.fmu").exists() or report["adjusted"]
    assert all(abs(z) < 3.0 for z in report["adjusted_by"].values())
    assert ("of their tolerances" in report["sentence"]) == bool(report["adjusted"])
    study.write_text(study.read_text().replace('measurement = "s1"', 'measurement = "s9"'))
    with pytest.raises(StudyError, match="s9"):
        discover(study, tmp_path / "again")
    kinds = study.read_text().replace('force = "joint1.f"', 'force = "joint1.f"\nkinds = ["spirng"]')
    study.write_text(kinds)
    with pytest.raises(StudyError, match=r"kinds names 'spirng'.* did you mean 'spring'"):
        discover(study, tmp_path / "again")
    failed = CliRunner().invoke(main, ["discover", str(study), "-o", str(tmp_path / "again")])
    assert failed.exit_code == 2
    assert "Traceback" not in failed.output


def test_the_evaluation_condition_decides_nothing_before_the_end(tmp_path, found):
    """With a meaningless evaluation measurement the same is found, and it is no longer called named."""
    report = discover(write_study(tmp_path, cubic, garbage=True), tmp_path / "out")
    assert report["verdict"] == "unexplained"
    (suspect,), (effect,) = report["suspects"], found[1]["effects"]
    assert suspect["parameters"] == effect["parameters"]
    assert [*report["where"]["pictures"]] == ["joint 2"]  # where it acts is told, as a force without a law
    assert "pictures" not in found[1]["where"]


RELABELLED = {"m": ("mm", 1e-3), "m/s": ("mm/s", 1e-3), "m/s2": ("mm/s2", 1e-3), "N": ("kN", 1e3)}


def relabelled(path):
    """The oscillator with the same numbers as mm and kN: a heavier one, in units as many a multibody program has them."""
    with zipfile.ZipFile(for_this_machine(path.with_name("light.fmu"))) as source, zipfile.ZipFile(path, "w") as out:
        for item in source.infolist():
            data = source.read(item)
            if item.filename == "modelDescription.xml":
                for unit, (other, factor) in RELABELLED.items():
                    data = data.replace(f'unit="{unit}"'.encode(), f'unit="{other}"'.encode())
                    declared = rf'Unit name="{unit}">(\s*)<BaseUnit '
                    data, n = re.subn(
                        declared.encode(), rf'Unit name="{other}">\1<BaseUnit factor="{factor}" '.encode(), data
                    )
                    assert n == 1
            out.writestr(item, data)
    return path


@pytest.mark.slow
def test_other_units_of_study_and_fmu_change_nothing(tmp_path, found):
    study = write_study(tmp_path, cubic, unit="m", fmu=relabelled(tmp_path / "heavy.fmu"), force="kN", scale=1e-6)
    report = discover(study, tmp_path / "out")
    (effect,), (before,) = report["effects"], found[1]["effects"]
    assert (effect["effect"], effect["joint"]) == (before["effect"], before["joint"])
    for name in ("value", "std"):  # kN/mm3
        assert 1e-12 * effect["parameters"]["cubic_stiffness"][name] == pytest.approx(
            before["parameters"]["cubic_stiffness"][name], rel=1e-3
        )
    motion, other = (
        motions(load_study(path), load_study(path).development) for path in (study, found[0] / "study.toml")
    )
    for joint in other:
        assert 1e3 * motion[joint].d == pytest.approx(other[joint].d, rel=1e-6)
        assert 1e-6 * motion[joint].stiffness == pytest.approx(other[joint].stiffness, rel=1e-6)


def test_recorded_simulations_alone_are_described_in_words(tmp_path):
    """A cubic spring that only the simulation lacks, without an FMU to run: no effect is named, the shape is told."""
    study = load_study(write_study(tmp_path, cubic))
    text = study.path.read_text()
    head, rest = text.split("[[channels]]", 1)
    text = f"{head.split('[simulation]')[0]}[simulation]\nstep_size = {STEP}\n[[channels]]{rest}"
    for table in ("joints", "adjustable"):
        text = re.sub(rf"(?s)\[\[{table}\]\].*?(?=\[\[)", "", text)
    for condition in study.conditions:
        file = condition.name.replace(" ", "_")
        write(tmp_path / f"simulated_{file}.mcap", simulate(study, condition))
        text = text.replace(f'inputs = "{file}.csv"', f'simulated = "simulated_{file}.mcap"')
    text = re.sub(r'simulation = "mass(\d).x"', r'simulation = "x\1"', text)
    study.path.write_text(text)
    report = discover(study.path, tmp_path / "out")
    assert (report["verdict"], report["effects"]) == ("unexplained", [])
    assert any("force ports" in note for note in report["notes"])
    assert sum("x1" in note or "x2" in note for note in report["notes"]) >= 2


def test_the_force_of_a_prescribed_motion_is_described_by_that_motion(tmp_path):
    """Friction that only the recorded simulation of a device lacks: the force's residual is told by the motion given."""
    t, rng = np.arange(4000) * STEP, np.random.default_rng(5)
    head = f'format = 1\nname = "device"\n[simulation]\nstep_size = {STEP}\n'
    head += '[[channels]]\nname = "F"\nsimulation = "F"\nmeasurement = "F"\nquantity = "force"\nunit = "N"\n'
    head += '[excitation]\nsimulation = "d"\nmeasurement = "d"\nkind = "actual"\n'
    for i, role in enumerate(("development", "development", "evaluation")):
        d = (1.0 + i) * np.sin(2.0 * np.pi * (1.0 + 0.5 * t) * t)
        spring, slide = 3.0 * d, 1.5 * np.tanh(np.gradient(d, STEP) / 0.05)
        for name, force in (("simulated", spring), ("measured", spring + slide + 0.02 * rng.normal(size=len(t)))):
            rows = "\n".join(f"{a:.6f},{b:.9g},{c:.9g}" for a, b, c in zip(t, force, d, strict=True))
            (tmp_path / f"{name}_{i}.csv").write_text(f"time [s],F [N],d [mm]\n{rows}\n")
        head += f'[[conditions]]\nname = "{i}"\nrole = "{role}"\nsimulated = "simulated_{i}.csv"\n'
        head += f'measurement = "measured_{i}.csv"\n'
    (tmp_path / "study.toml").write_text(head)
    report = discover(tmp_path / "study.toml", tmp_path / "out")
    (words,) = (note for note in report["notes"] if note.startswith("F: "))
    assert "1.5" in words
    assert "follows the velocity's sign" in words


def test_a_lag_that_all_conditions_have_is_one_of_every_channel(tmp_path):
    """Nuisances of a measurement that is late everywhere: gaps are shown through sensors that are."""
    study = load_study(write_study(tmp_path, nothing))
    with load(study, None) as problem:
        late = 0.8e-3
        still = [np.zeros((len(trial.measured), 2)) for trial in problem.trials]
        responses = [trial.measured for trial in problem.trials]
        columns = nuisances.sensors(problem, responses)
        delayed = [y - late * np.gradient(y, STEP, axis=0) for y in responses]
        belief = Nuisances(columns).believe(problem.stack(delayed) - problem.stack(responses), 1.0)
        gains, lags = nuisances.errors(belief.fitted, 2, len(still))
        found = np.stack([gains, lags.mean(axis=0)], axis=1)
    assert found[:, 1] == pytest.approx(late, rel=0.1)
    assert found[:, 0] == pytest.approx(0.0, abs=2e-3)
    told = sensor_rows(study.channels, found)
    assert [row["channel"] for row in told] == ["x1", "x2"]
    assert [row["lag"] / row["lag_by"] for row in told] == pytest.approx([nuisances.LAG] * 2)


def test_only_independent_rows_count():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(4000, 2))
    assert independent([white]) > 0.9
    again = np.tile(white[:40], (100, 1))  # one period, a hundred times
    assert independent([again]) < 0.05


def test_what_nuisances_explain_is_no_surprise():
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(500, 3)) * 5.0
    noise = rng.normal(size=500)
    nuisances = Nuisances(columns)
    quiet, moved = nuisances.believe(noise, 1.0), nuisances.believe(noise + columns @ [1.0, -1.0, 0.5], 1.0)
    assert moved.surprise - quiet.surprise < 12.0
    assert moved.s2 == pytest.approx(quiet.s2, rel=0.02)
    np.testing.assert_allclose(moved.fitted, [1.0, -1.0, 0.5], atol=0.05)
    foreign = nuisances.believe(noise + 5.0 * rng.normal(size=500), 1.0)
    assert foreign.s2 > 15.0
