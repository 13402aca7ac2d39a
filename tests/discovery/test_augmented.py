"""What was found as a model: augmented.fmu with its study answers as the model that was found, at every condition."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from fmucorrect import pairs
from fmucorrect.catalogue import find
from fmucorrect.discovery import native
from fmucorrect.discovery.augmented import augmented_study, found_of, toml, write_model
from fmucorrect.discovery.model import Model, runner, simulate
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm
from fmucorrect.records import writer
from fmucorrect.signals import Channel, Record
from fmucorrect.study import load_study

FMU = Path(__file__).resolve().parent.parent.parent / "fmus" / "oscillator" / "oscillator.fmu"
STEP = 0.001
OWN = {
    "sets both": "k1 = 900.0, c1 = 6.0",
    "sets one": "k2 = 700.0",
    "sets nothing": "",
    "held out": "k1 = 1300.0, k2 = 850.0",
}
"""Start values that each condition gives itself; those of the study are k1 = 1200, k2 = 800."""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Two masses, pushed once; what was measured matters to no test here."""
    folder = tmp_path_factory.mktemp("conditions")
    t_ns = np.arange(2001) * round(STEP * 1e9)
    push = np.where((t_ns > 2e8) & (t_ns < 4e8), 5.0, 0.0)
    with writer(folder / "push.csv") as out:
        out.write("/data", Record(t_ns, push[:, None], (Channel("mass2.f", unit="N"),)))
    with writer(folder / "measured.mcap") as out:
        out.write("/data", Record(t_ns, np.sin(t_ns * 1e-8)[:, None], (Channel("s1", unit="mm"),)))
    text = f"""format = 1   # a comment
name = "two masses, \\"twice\\""
[simulation]
fmu = {json.dumps(str(FMU))}
step_size = {STEP}
[simulation.parameters]  # of all conditions
masses = 2.0
k1 = 1200.0
k2 = 800.0
c1 = 5.0
[training.corrector]
families = ["window"]
epochs = [30, 60]
phase = true
[[channels]]
name = "x1"
simulation = "mass1.x"
measurement = "s1"
quantity = "displacement"
unit = "mm"
noise = 0.01
[[joints]]
name = "joint 1"
force = "joint1.f"
displacement = "joint1.d"
kinds = ["spring", "damper"]
[[adjustable]]
parameter = "k2"
minimum = 100.0
maximum = 5000.0
tolerance = 0.02
[[adjustable]]
parameter = "k1"
minimum = 100.0
maximum = 5000.0
"""
    for name, own in OWN.items():
        role = "evaluation" if name == "held out" else "development"
        text += (
            f'[[conditions]]\nname = "{name}"\nrole = "{role}"\ninputs = "push.csv"\nmeasurement = "measured.mcap"\n'
        )
        text += f"parameters = {{ {own} }}\n" if own else ""
    (folder / "study.toml").write_text(text)
    return load_study(folder / "study.toml")


def model_of(study):
    """k2 went by 1.5 of its tolerances of 2 %, k1 is off by 100 N/m."""
    offset = OffsetTerm(study.adjustable[1], "k1", 60.0, -1000.0, 1000.0, {"value": 100.0}, "N/m")
    return Model((offset,), (1.5,))


def test_what_a_condition_sets_itself_is_found_there(study):
    model = model_of(study)
    with load(study, None, workers=1) as problem:
        found = found_of(problem, model.terms, model.base, [{}])
    assert found.starts == {
        "sets both": {"k1": 1000.0},
        "sets one": {"k2": pytest.approx(700.0 * 1.03)},
        "sets nothing": {},
        "held out": {"k1": 1400.0, "k2": pytest.approx(850.0 * 1.03)},
    }
    assert found.set_by_conditions == ["k1", "k2"]


def test_the_study_on_the_augmented_fmu_answers_as_the_model_that_was_found(study, tmp_path):
    """Whether a parameter comes from the FMU, from the study or from the condition itself."""
    model = model_of(study)
    with load(study, native.build(tmp_path / "march"), workers=1) as problem:
        found = found_of(problem, model.terms, model.base, [{}])
        written, (note,) = write_model(study, found, tmp_path)
        assert written == ["effects.toml", "augmented.fmu", "study.toml"]
        assert "k1, k2" in note
        after = load_study(tmp_path / "study.toml")
        for condition in study.conditions:
            item = runner(study, condition, problem.library)
            wanted = simulate(study, item, condition, model, problem.tolerated)
            bare = simulate(study, item, condition, problem.nominal, problem.tolerated)
            item.close()
            y = pairs.simulate(after, after.condition(condition.name)).values[:, :1]
            np.testing.assert_allclose(y, wanted, rtol=0.0, atol=1e-9 * np.ptp(wanted))
            assert np.abs(bare - wanted).max() > 0.02 * np.ptp(wanted)


def test_where_conditions_set_nothing_there_is_no_note(study, tmp_path):
    conditions = tuple(replace(condition, parameters={}) for condition in study.conditions)
    with load(replace(study, conditions=conditions), None, workers=1) as problem:
        found = found_of(problem, (), (1.5,), (), (0.25,))
        (offset,) = (row for row in found.effects.offsets if row.remarks.std)
        assert offset.remarks.std == {"value": pytest.approx(0.25 * 0.02 * 800.0)}  # a quarter of its tolerance
    assert not any(found.starts.values())
    assert write_model(study, found, tmp_path)[1] == []


def test_everything_else_of_the_study_stays(study, tmp_path):
    before = tomllib.loads(study.path.read_text())
    (tmp_path / "study.toml").write_text(augmented_study(study, tmp_path, {"sets one": {"k2": 721.0}}))
    after = tomllib.loads((tmp_path / "study.toml").read_text())
    assert after["simulation"] == {"fmu": "augmented.fmu", "step_size": STEP}
    for old, new in zip(before["conditions"], after["conditions"], strict=True):
        for key in ("inputs", "measurement"):
            assert (tmp_path / new.pop(key)).resolve() == (study.path.parent / old.pop(key)).resolve()
        if old["name"] == "sets one":
            old["parameters"] = {"k2": 721.0}
    assert {k: v for k, v in after.items() if k != "simulation"} == {
        k: v for k, v in before.items() if k != "simulation"
    }


@pytest.mark.parametrize(
    "document",
    [
        {"a": 1, "b": [1.5, -2e-5, float("inf")], "c": 'say "é"\n\\', "d": True, "e": []},
        {
            "t": {"x": 1, "u v": {"y": [{"z": 1}, {"z": 2, "w": {"deep": [{"er": {}}]}}]}},
            "r": [{"k": {"1.2": "x"}}, {}],
        },
    ],
)
def test_a_table_is_read_again_as_it_was(document):
    assert tomllib.loads(toml(document)) == document


def test_a_force_that_turns_is_given_the_fmus_own_speed():
    """Rig A's conditions set the FMU's parameter `speed`, in m/s, to their own; the oscillator's know of none."""
    study = load_study(FMU.parents[1] / "roller_rig" / "A" / "study.toml")
    (rotation, *_) = study.rotations
    given = {"amplitude": 100.0, "order": 1.0, "radius": rotation.radius}
    law = find("periodic_force", given)
    joint = next(joint for joint in study.joints if joint.name == "contact, lateral, front")
    term = ForceTerm(law, joint.name, (joint,), law.complete(given))
    row = {"parameters": {}, "equation": law.equation, "probability": 1.0}
    with load(study, None) as problem:
        found = found_of(problem, (term,), problem.nominal.base, (row,))
    assert found.effects.rotations == (replace(rotation, speed="speed"),)
    assert [instance.speed for instance in found.effects.instances] == ["speed"]
