"""Start values that are not known: fitted to each record, and no effect made of them."""

import numpy as np
import pytest
from one_mass import APART, JOINT, MASS, NOISE, T, shown, sweep, term_at, write

from fmucorrect.discovery import discover
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.starts import columns, fitted
from fmucorrect.errors import FmuError
from fmucorrect.study import load_study

BEGUN = {"one": (0.002, -0.05), "two": (-0.0015, 0.08), "held": (0.001, 0.1)}  # m, m/s: as large as what the force does


def measured(folder, library, free, *terms):
    """The study file of a mass that is on its way when each of three records begins."""

    def conditions(known):
        role = {"held": "evaluation"}
        for name, (x, v) in BEGUN.items():
            yield f'[[conditions]]\nname = "{name}"\nrole = "{role.get(name, "development")}"\ninputs = "force.csv"\n'
            yield f'measurement = "{name}.csv"\n' + (f"parameters = {{ x1 = {x}, v1 = {v} }}\n" if known else free)

    write(folder / "force.csv", "mass1.f [N]", sweep(1.0))
    for name in BEGUN:
        write(folder / f"{name}.csv", "x1 [mm]", 0.0 * T)
    (folder / "true.toml").write_text(MASS + JOINT + "".join(conditions(True)), encoding="utf-8")
    (folder / "study.toml").write_text(MASS + JOINT + APART + "".join(conditions(False)), encoding="utf-8")
    true = load_study(folder / "true.toml")
    truth = Model(tuple(term_at(true, effect, "joint 1", **values) for effect, values in terms))
    for i, condition in enumerate(true.conditions):
        y = shown(true, condition, library, truth, len(T))[:, 0]
        noise = NOISE * np.random.default_rng(i).normal(size=len(y))
        write(folder / f"{condition.name}.csv", "x1 [mm]", y + noise)
    return folder / "study.toml"


def test_start_values_are_found_before_anything_else(tmp_path, library):
    study = load_study(measured(tmp_path, library, 'free = ["x1", "v1"]\n'))
    with load(study, library, 2) as problem:
        for trial in problem.trials:
            x, v = BEGUN[trial.condition.name]
            assert trial.condition.parameters["x1"] == pytest.approx(x, abs=2e-5)
            assert trial.condition.parameters["v1"] == pytest.approx(v, abs=5e-4)


def test_a_record_that_begins_in_motion_is_no_effect(tmp_path, library):
    report = discover(measured(tmp_path, library, 'free = ["x1", "v1"]\n'), tmp_path / "out")
    assert report["verdict"] == "none", report["sentence"]
    assert any("condition held: start values that are not known, fitted" in note for note in report["notes"])
    held = next(row for row in report["gap"] if row["condition"] == "held")
    assert held["nrmse_after"] < 1.1 * held["noise_floor"]
    assert any(warning["kind"] == "start not known" for warning in report["warnings"])


@pytest.mark.slow
def test_without_free_the_same_records_do_not_agree(tmp_path, library):
    report = discover(measured(tmp_path, library, ""), tmp_path / "out")
    assert report["verdict"] != "none"


@pytest.mark.slow
def test_an_effect_is_named_beside_unknown_starts(tmp_path, library):
    cubic = "cubic_stiffness", {"cubic_stiffness": 2.0e8}
    report = discover(measured(tmp_path, library, 'free = ["x1", "v1"]\n', cubic), tmp_path / "out")
    assert report["verdict"] == "named", report["sentence"]
    (effect,) = report["effects"]
    assert (effect["effect"], effect["joint"]) == ("cubic_stiffness", "joint 1")
    held = next(row for row in report["gap"] if row["condition"] == "held")
    assert held["nrmse_after"] < 1.2 * held["noise_floor"]


def test_of_a_nonlinear_system_the_start_is_found_too():
    t = np.linspace(0.0, 4.0, 400)

    def respond(starts):
        if abs(starts["x"]) > 3.0:
            raise FmuError("gives up")
        return 100.0 * starts["x"] * np.cos((1.0 + 0.3 * starts["x"] ** 2) * t)

    assert fitted(respond, {"x": 0.0}, respond({"x": 1.2}))["x"] == pytest.approx(1.2, rel=1e-3)


def test_what_changes_nothing_stays():
    rows, moves = columns(lambda starts: np.ones(5), {"x": 0.0}, np.ones(5), 2.0)
    assert not rows.any()
    assert not moves.any()
    assert fitted(lambda starts: np.ones(5), {"x": 0.5}, np.zeros(5)) == {"x": 0.5}
