"""The hidden-effect suite's own laws: with nothing hidden its truth is the FMU, its labels hold, its score is fair."""

import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("pyarrow")

TOOL = Path(__file__).resolve().parents[2] / "tools" / "hidden_effects"
sys.path.append(str(TOOL))

from bench import bench  # noqa: E402
from cases import QUICK, subset  # noqa: E402
from discovering import run_case  # noqa: E402
from hidden import KINDS, Numbers  # noqa: E402
from identities import tolerances  # noqa: E402
from judging import Places, judge  # noqa: E402
from looking_again import extend, remade  # noqa: E402
from making import Made, make, write  # noqa: E402
from physical import Placed, actual, sensed, simulate  # noqa: E402
from specs import Spec, Wanted  # noqa: E402
from table import write_score  # noqa: E402

from fmucorrect import pairs  # noqa: E402
from fmucorrect.study import load_study  # noqa: E402


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> tuple[Path, Made]:
    """One case on disk."""
    folder = tmp_path_factory.mktemp("suite")
    wanted = (Wanted("coulomb_friction", "joint 2", 0.2),)
    made = make(Spec("osc_made", "three_on_base", "single", 0.01, True, wanted, recorded="command"))
    write(made, folder)
    return folder, made


def placed(effect: str, place: str, *numbers: float, **parameters: float) -> Placed:
    return Placed(effect, place, (place,), Numbers(effect, numbers, parameters))


def test_a_bare_truth_is_what_the_fmu_itself_simulates(written):
    """Whole case on disk: nominal parameters, no effect, no noise; the study's own simulation is the reference."""
    folder, made = written
    study = load_study(folder / "cases" / "osc_made" / "study.toml")
    for run in made.bench.runs:
        theirs = pairs.simulate(study, study.condition(run.name)).values[:, : len(study.channels)]
        ours = simulate(made.bench, run, {}, ())
        assert np.abs(ours - theirs).max() < 1e-6 * np.abs(theirs).max()


def test_a_bare_truth_of_the_rig_is_its_fmu():
    on = bench("rig_sweep")
    run = on.development[0]
    coarse, fine = simulate(on, run, {}, (), fine=1), simulate(on, run, {}, ())
    assert np.abs(fine - coarse).max() < 5e-6 * np.abs(coarse).max()


@pytest.mark.parametrize(
    ("effect", "size", "parameter"),
    [("linear_stiffness", 300.0, "k1"), ("viscous_damping", 5.0, "c1"), ("added_mass", 0.5, "m1")],
)
def test_a_linear_law_is_the_parameter_behind_it(effect, size, parameter):
    """In the loop with the held steps of the truth: a change of the FMU's parameter is the closed form."""
    on = bench("two_on_base")
    run = on.runs[0]
    by_law = simulate(on, run, {}, [placed(effect, "joint 1", size)])
    by_parameter = simulate(on, run, {parameter: on.parameters[parameter] + size}, ())
    assert np.abs(by_law - by_parameter).max() < 1e-4 * np.abs(by_parameter).max()


def test_dry_friction_holds_exactly_and_then_slides():
    on = bench("two_before_wall")
    run = on.runs[0]
    push = np.abs(run.inputs["mass1.f"]).max()
    held = simulate(on, run, {}, [placed("coulomb_friction", "joint 1", 1.01 * push)], extra=["joint1.v"])
    assert np.abs(held[:, -1]).max() < 1e-6 * np.abs(simulate(on, run, {}, (), extra=["joint1.v"])[:, -1]).max()
    part = simulate(on, run, {}, [placed("coulomb_friction", "joint 1", 0.5 * push)], extra=["joint1.v"])
    rests = np.abs(part[1000:-1000, -1]) < 1e-9
    assert 0.05 < rests.mean() < 0.99


@pytest.mark.parametrize(
    "effect", ["cubic_stiffness", "bouc_wen_hysteresis", "stribeck_friction", "bump_stop", "backlash"]
)
def test_the_truth_has_converged(effect):
    made = make(Spec(f"osc_{effect}", "two_before_wall", "single", 0.01, False, (Wanted(effect, "joint 2", 0.2),)))
    run = made.bench.runs[0]
    once, twice = (simulate(made.bench, run, {}, made.effects, fine=fine) for fine in (20, 40))
    assert np.sqrt(((once - twice) ** 2).mean(0)).max() < 0.1 * made.noise.min()


def test_the_label_has_the_wanted_mark_and_lies_outside_the_case(written):
    folder, made = written
    (effect,) = made.label["effects"]
    assert effect["share"] == pytest.approx(0.2, rel=0.3)
    assert effect["mark"] > made.label["seen"]
    text = "".join(path.read_text() for path in (folder / "cases" / "osc_made").glob("*.toml"))
    assert "friction" not in text
    assert json.loads((folder / "labels" / "osc_made.json").read_text()) == json.loads(json.dumps(made.label))


@pytest.mark.parametrize(
    ("effect", "size", "found"),
    [("linear_stiffness", "stiffness", 2.0), ("parameter_offset", "value", 2.0), ("cubic_stiffness", "k", None)],
)
def test_the_label_says_how_many_tolerances_an_effect_moves_a_parameter(effect, size, found):
    on = bench("two_on_base")
    place = "k1" if effect == "parameter_offset" else "joint 1"
    value = 2.0 * 0.02 * on.value("k1", {})
    told = tolerances(on, Spec("x", on.name, "single", 0.01, True, ()), placed(effect, place, **{size: value}))
    assert told == (None if found is None else pytest.approx(found))


def test_the_case_shows_the_effect_and_the_noise_that_were_asked_for(written):
    folder, made = written
    study = load_study(folder / "cases" / "osc_made" / "study.toml")
    pair = pairs.pair(study, study.conditions[0])
    seen = np.sqrt(((pair.measured - pair.response) ** 2).mean(0))
    assert (seen > 3.0 * made.noise).all()
    quiet = pair.measured[50:900]
    assert np.std(quiet, axis=0) == pytest.approx(made.noise, rel=0.25)


def test_a_name_is_a_seed(written):
    _, made = written
    again = make(made.spec)
    assert json.dumps(again.label) == json.dumps(made.label)
    assert json.dumps(make(replace(made.spec, name="osc_other")).label) != json.dumps(made.label)


def test_a_parameter_that_the_study_leaves_out_is_right():
    wanted = (Wanted("added_mass", "joint 2", 0.2),)
    spec = Spec("osc_made", "two_on_base", "single", 0.01, True, wanted)
    every, less = (make(one).parameters for one in (spec, replace(spec, without=("m2",))))
    assert "m2" in every
    assert less == {name: value for name, value in every.items() if name != "m2"}


def test_effects_at_sensors_and_excitation_do_what_they_say():
    t = np.arange(4000) * 1e-3
    y = np.sin(2.0 * np.pi * 5.0 * t)
    late = sensed(y, Placed("sensor_lag", "x1", (), Numbers("", (), {"lag": 0.0123})))
    assert late[100:] == pytest.approx(np.sin(2.0 * np.pi * 5.0 * (t - 0.0123))[100:], abs=1e-4)
    slow = sensed(y, Placed("sensor_lowpass", "x1", (), Numbers("", (), {"cutoff": 5.0})))
    assert np.abs(slow[2000:]).max() == pytest.approx(np.sqrt(0.5), rel=1e-3)
    clipped = sensed(y, Placed("sensor_saturation", "x1", (), Numbers("", (), {"limit": 0.4e-3})))
    assert np.abs(clipped).max() == pytest.approx(0.4)
    run = bench("three_pushed").runs[0]
    stronger = actual(run, [Placed("excitation_gain", "excitation", (), Numbers("", (), {"gain": 1.2}))])
    assert stronger["mass3.f"] == pytest.approx(1.2 * run.inputs["mass3.f"])


def test_another_seed_has_as_many_other_cases():
    specs, others = subset("all"), subset("all", 1)
    assert Counter(spec.kind for spec in specs) == Counter(spec.kind for spec in others)
    assert not {spec.name for spec in specs} & {spec.name for spec in others}
    same = [a.effects == b.effects for a, b in zip(specs, others, strict=True) if a.effects]
    assert sum(same) < 0.05 * len(same)


def test_the_list_is_what_the_issue_asks_for():
    specs = subset("all")
    count = lambda kind: sum(spec.kind == kind for spec in specs)  # noqa: E731
    assert len(specs) >= 150
    assert count("null") >= 30
    assert count("outside") >= 20
    assert count("pair") >= 30
    assert {spec.name for spec in subset("quick")} <= {spec.name for spec in specs}
    assert len(subset("quick")) == len(QUICK)
    singles = {spec.effects[0].effect for spec in specs if spec.kind == "single"}
    assert singles == set(KINDS)
    hidden = {(spec.bench, item.place) for spec in specs for item in spec.effects}
    chains = {spec.bench for spec in specs if "rig" not in spec.bench}
    assert {(name, row["name"]) for name in chains for row in bench(name).joints} <= hidden


_CREEP = frozenset({"f11", "f22"})
GROUPS = Places({"upper joints": frozenset({"joint 2", "joint 3"}), "f11": _CREEP, "f22": _CREEP})


def label(
    *effects: tuple[str, str],
    kind: str = "single",
    marks: tuple[float, ...] = (),
    tolerances: float | None = None,
    **same_as: list,
) -> dict:
    rows = [
        {"effect": e, "joint": j, "known": True, "mark": m, "main": "stiffness", "parameters": {"stiffness": 100.0}}
        | {"same_as": same_as.get(e, []), "tolerances": tolerances}
        for (e, j), m in zip(effects, marks or (100.0,) * len(effects), strict=True)
    ]
    return {"effects": rows, "seen": 5.0, "spec": {"kind": kind, "bench": "two_on_base"}, "parameters": {}}


def said(verdict: str, *effects: tuple, **more: object) -> dict:
    rows = [
        {"effect": e, "joint": j, "probability": 0.9}
        | {"indistinguishable_from": [{"effect": a, "joint": b} for a, b in rivals]}
        | {"parameters": {"stiffness": {"value": 102.0, "std": 1.0, "unit": "N/m"}}}
        for e, j, *rivals in effects
    ]
    return {"verdict": verdict, "effects": rows, **more}


A, B, C, D = ("backlash", "joint 1"), ("cubic_stiffness", "joint 1"), ("preload", "joint 1"), ("bump_stop", "joint 1")


@pytest.mark.parametrize(
    ("hidden", "report", "score"),
    [
        (label(A), said("named", A), 1.0),
        (label(A), said("named", ("backlash", "joint 2")), 0.0),
        (label(A), said("named", A, B), 0.0),
        (label(A), said("ambiguous", (*B, A)), 0.5),
        (label(A), said("ambiguous", (*B, A, C)), 0.5),
        (label(A), said("ambiguous", (*B, A, C, D)), 0.0),
        (label(A), said("ambiguous", (*B, C)), 0.0),
        (label(A), said("unexplained"), 0.0),
        (label(A), None, 0.0),
        (label(A, marks=(2.0,)), said("none"), 1.0),
        (label(A, marks=(2.0,)), said("named", A), 0.0),
        (label(A, tolerances=3.0), said("none"), 1.0),
        (label(A, tolerances=3.0), said("named", A), 0.0),
        (label(A, tolerances=6.0), said("named", A), 1.0),
        (label(("parameter_offset", "f11, f22")), said("named", ("parameter_offset", "f11 and f22")), 1.0),
        (label(A, B, kind="pair"), said("named", B, A), 1.0),
        (label(A, B, kind="pair"), said("named", A), 0.0),
        (label(A, B, kind="pair"), said("ambiguous", A, (*C, B)), 0.5),
        (label(A, B, kind="pair", marks=(90.0, 2.0)), said("named", A), 1.0),
        (label(kind="null"), said("none"), 1.0),
        (label(kind="null"), said("named", A), 0.0),
        (label(kind="outside"), said("unexplained"), 1.0),
        (label(kind="outside"), said("named", A), 0.0),
        (label(("backlash", "upper joints")), said("named", ("backlash", "joint 2"), ("backlash", "joint 3")), 1.0),
        (label(("parameter_offset", "f11, f22")), said("named", ("parameter_offset", "f11")), 1.0),
        (label(A, B, kind="background"), said("named", A), 1.0),
        (label(A, B, kind="background"), said("named", A, B), 1.0),
        (label(A, B, kind="background"), said("named", A, C), 0.0),
    ],
)
def test_the_score_is_the_issues(hidden, report, score):
    assert judge(hidden, report, GROUPS).score == score


def test_another_name_of_the_same_equation_counts_but_not_strictly():
    twin = {"effect": "parameter_offset", "joint": "k1", "parameters": {"value": 100.0}}
    hidden = label(("linear_stiffness", "joint 1"), linear_stiffness=[twin])
    judged = judge(hidden, said("named", ("parameter_offset", "k1")), GROUPS)
    assert (judged.score, judged.strict) == (1.0, 0.0)
    judged = judge(hidden, said("ambiguous", ("linear_stiffness", "joint 1", ("parameter_offset", "k1"))), GROUPS)
    assert (judged.score, judged.strict) == (1.0, 0.5)


def test_what_else_is_judged():
    judged = judge(label(A, B, kind="background"), said("named", A, C), GROUPS)
    assert (judged.found, judged.wrong) == (1.0, ("preload at joint 1",))
    in_doubt = (*B, ("cubic_stiffness", "joint 2"))
    assert judge(label(A, B, kind="background"), said("ambiguous", A, in_doubt), GROUPS).found == 1.0
    assert judge(label(B, A, kind="background"), said("ambiguous", A, in_doubt), GROUPS).found == 0.5
    judged = judge(label(A), said("named", ("cubic_stiffness", "joint 2")), GROUPS)
    assert (judged.places, judged.claims) == ((False,), ((0.9, False),))
    assert judge(label(A), said("named", A), GROUPS).errors == (("backlash", pytest.approx(0.02)),)


def test_the_offset_of_a_parameter_holds_what_the_base_model_was_off_by():
    twin = {"effect": "parameter_offset", "joint": "k1", "parameters": {"value": 100.0}}
    hidden = label(("linear_stiffness", "joint 1"), linear_stiffness=[twin])
    hidden["parameters"] = {"k1": bench("two_on_base").value("k1", {}) + 20.0}
    told = said("named", ("parameter_offset", "k1"))
    told["effects"][0]["parameters"] = {"value": {"value": 117.0, "std": 1.0, "unit": "N/m"}}
    assert judge(hidden, told, GROUPS).errors == (("linear_stiffness", pytest.approx(3.0 / 120.0)),)


def test_a_failing_discovery_is_recorded_and_scored(written):
    folder, _ = written
    result = run_case(folder / "no_such_study.toml", folder / "results" / "osc_made")
    assert result["error"]
    assert result["peak_mb"] > 1.0
    text = write_score(folder)
    assert "ended in an error | 100 %" in text
    assert json.loads((folder / "score.json").read_text())["cases"][0]["score"] == 0.0


def test_the_test_that_a_report_asks_for_is_measured(written, tmp_path):
    folder, made = written
    extend("osc_made", folder, tmp_path, [{"like": "sweep_high", "scale": 0.5}])
    study = load_study(tmp_path / "cases" / "osc_made" / "study.toml")
    assert study.conditions[-1].name == "again_1"
    pair = pairs.pair(study, study.conditions[-1])
    first = pairs.pair(study, study.conditions[0])
    assert np.std(pair.response) == pytest.approx(0.5 * np.std(first.response), rel=0.02)
    again = simulate(made.bench, made.bench.runs[0], remade(made.label).parameters, remade(made.label).effects)
    assert again == pytest.approx(simulate(made.bench, made.bench.runs[0], made.parameters, made.effects))
