"""The next test on a mass on a spring: what a larger excitation splits is told so, and what nothing splits as well."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, NOISE, SECONDS, STEP, T, shown, term_at, write

from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Setting, begin
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.nexttest import SPLIT, next_test
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.repeats import exciting, repeats
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm
from fmucorrect.signals import Condition
from fmucorrect.study import Excitation, load_study

REST = 0.5
HEAD = f"""{MASS}{JOINT}nominal_force = "joint1.F"
[[adjustable]]
parameter = "k1"
minimum = 200.0
maximum = 4000.0
tolerance = 0.02
[[adjustable]]
parameter = "c1"
minimum = 2.0
maximum = 40.0
tolerance = 0.02
"""
CONDITIONS = {"weak": 0.3, "strong": 0.6}  # N, peak


def drive(peak: float) -> np.ndarray:
    """A sweep through the resonance at 5 Hz."""
    t = np.clip(T - REST, 0.0, SECONDS - 2 * REST)
    window = np.clip(np.minimum(T - REST, SECONDS - REST - T) / 0.3, 0.0, 1.0)
    return peak * window * np.sin(2 * np.pi * (1.5 + 0.7 * t) * t)


def term(study, effect: str, **values: float) -> ForceTerm:
    return term_at(study, effect, "joint 1", **values)


def problem_of(folder: Path, library: Path, conditions: dict[str, float], truth: str, **values: float):
    """The study on disk, measured with one effect in it."""
    folder.mkdir(exist_ok=True)
    text = [HEAD]
    for name, peak in conditions.items():
        write(folder / f"{name}.csv", "mass1.f [N]", drive(peak))
        (folder / f"measured_{name}.csv").write_text("time,x1 [mm]\n0,0\n", encoding="utf-8")
        text.append(f'[[conditions]]\nname = "{name}"\nrole = "development"\nstart = {REST}\nquiet = [0.0, 0.4]\n')
        text.append(f'inputs = "{name}.csv"\nmeasurement = "measured_{name}.csv"\n')
    (folder / "study.toml").write_text("".join(text), encoding="utf-8")
    study = load_study(folder / "study.toml")
    rng = np.random.default_rng(1)
    for condition in study.conditions:
        y = shown(study, condition, library, Model((term(study, truth, **values),)), len(T))
        noisy = y[:, 0] + NOISE * rng.normal(size=len(T))
        write(folder / f"measured_{condition.name}.csv", "x1 [mm]", noisy)
    return load(study, library, 2)


def setting_of(problem) -> Setting:
    setting, _, _ = begin(problem)
    return replace(setting, candidates=10)


def fitted_with(problem, setting, term):
    fitted = fit(problem, setting, replace(problem.nominal, terms=(term,)), 12)
    assert fitted is not None
    return fitted


def cubic_or_stop(problem, setting):
    cubic = fitted_with(problem, setting, term(problem.study, "cubic_stiffness", cubic_stiffness=1e6))
    return cubic, fitted_with(problem, setting, term(problem.study, "bump_stop", gap=1e-3, stiffness=10.0))


def test_a_larger_excitation_tells_a_cubic_spring_from_a_bump_stop(library, tmp_path):
    """Once more with the condition that was asked for: -2 log p differs as was promised."""
    truth = {"cubic_stiffness": 1e6}
    with problem_of(tmp_path / "first", library, CONDITIONS, "cubic_stiffness", **truth) as problem:
        setting = setting_of(problem)
        cubic, stop = cubic_or_stop(problem, setting)
        found = next_test(problem, setting, cubic, [stop], True)
    assert abs(cubic.surprise - stop.surprise) < 12.0  # one class
    assert found is not None
    (asked,) = found["conditions"]
    assert asked == {"like": "strong", "scale": 4.0}
    assert [row["effect"] for row in found["separates"]] == ["cubic_stiffness", "bump_stop"]
    rows = {row["condition"]: row["separation"] for row in found["tried"]}
    assert len(rows) == 8
    promised = rows.pop("condition strong with 4 times its excitation")
    assert promised == max(promised, *rows.values()) > SPLIT
    assert min(rows.values()) < SPLIT
    assert found["text"].startswith("Repeat condition strong with 4 times its excitation: ")
    assert "the response still differs by up to" in found["text"]
    assert found["text"].endswith("with bump stop at joint 1 in the place of cubic stiffness at joint 1.")
    more = CONDITIONS | {"again": asked["scale"] * CONDITIONS[asked["like"]]}
    with problem_of(tmp_path / "again", library, more, "cubic_stiffness", **truth) as problem:
        cubic, stop = cubic_or_stop(problem, setting_of(problem))
    assert promised / 2.0 < stop.surprise - cubic.surprise < promised * 2.0


def test_a_stiffness_is_never_told_from_the_parameter_behind_it(library, tmp_path):
    with problem_of(tmp_path, library, CONDITIONS, "linear_stiffness", stiffness=200.0) as problem:
        setting = setting_of(problem)
        spring = fitted_with(problem, setting, term(problem.study, "linear_stiffness", stiffness=180.0))
        offset = OffsetTerm(problem.study.adjustable[0], "k1", 20.0, -800.0, 3000.0, {"value": 180.0}, "N/m")
        found = next_test(problem, setting, spring, [fitted_with(problem, setting, offset)], True)
        assert next_test(problem, setting, spring, [], True) is None
    assert found is not None
    assert found["conditions"] == found["separates"] == []
    assert max(row["separation"] for row in found["tried"]) < 1.0
    assert "with parameter offset of k1 in the place of linear stiffness at joint 1: they act alike" in found["text"]


def test_what_follows_the_excitation_is_scaled_with_it(library, tmp_path):
    with problem_of(tmp_path, library, CONDITIONS, "linear_stiffness", stiffness=200.0) as problem:
        study = problem.study
    moved = replace(study, excitation=Excitation("base.d", "drive", "command"))
    names, x = ("base.v", "base.d", "mass1.f"), drive(1.0)
    inputs = np.column_stack([np.gradient(x, STEP), x, drive(1.0)[::-1]])
    assert exciting(moved, names, inputs) == [True, True, False]
    assert exciting(study, names, inputs) == [True] * 3


def test_other_speeds_and_an_amplitude_among_the_parameters(library, tmp_path):
    """The parameters c1, proportional to the speed, and m1, equal to the amplitude, stand for what a rig's FMU has."""
    with problem_of(tmp_path, library, CONDITIONS, "linear_stiffness", stiffness=200.0) as problem:
        slow, fast = (
            replace(
                trial,
                condition=replace(
                    trial.condition, speed=v, amplitude=0.5, parameters={"c1": v / 3.6, "m1": 0.5, "k1": 3.0}
                ),
            )
            for trial, v in zip(problem.trials, (100.0, 200.0), strict=True)
        )
        held_out = Condition("held out", "evaluation", speed=150.0)
        study = replace(problem.study, conditions=(slow.condition, fast.condition, held_out))
        rig = replace(problem, study=study, trials=(slow, fast))
        asked = repeats(rig, True)
        assert repeats(rig, False) == asked[:8]
        rig.close()
    assert [item.speed for item in asked[8:]] == [230.0, 70.0]  # 150 km/h is held out
    assert [item.k for item in asked[8:]] == [1, 0]
    assert asked[8].condition.parameters == pytest.approx({"c1": 230.0 / 3.6, "m1": 0.5, "k1": 3.0})
    assert asked[0].condition.parameters == {"c1": 100.0 / 3.6, "m1": 2.0, "k1": 3.0}
    assert (asked[0].scale, asked[0].condition.amplitude) == (4.0, 2.0)
