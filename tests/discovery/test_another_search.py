"""Another search in the place of today's: an exhaustive one over a few laws finds the same set, by the same ledger, on a chain
and on a solver that this project did not make. The truth is integrated by scipy and by numpy."""

import json
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

sys.path.append(str(Path(__file__).resolve().parent.parent / "wrapping"))

from foreign import foreign
from test_discover import CUBIC

from fmucorrect.discovery import discover
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.look import around
from fmucorrect.discovery.naming import name
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.sets import share_of
from fmucorrect.study import load_study

LAWS = ("cubic_stiffness", "quadratic_damping", "coulomb_friction")
STEP, SECONDS, NOISE = 1e-3, 4.0, 0.005  # s, s, mm
FRICTION = 3.0  # N


def exhaustive(problem, ledger, budget, progress):
    """Fits each of a few laws at each joint, and all pairs of them."""
    with ledger.during("exhaustive", budget):
        setting, at, _ = begin(problem)
        base = fit(
            problem, replace(setting, share=share_of(problem, setting, setting.measured - at)), problem.nominal, 8, at
        )
        curves = {curve.key: curve for curve in around(problem, base).curves(base) if curve.effect in LAWS}
        setting = replace(setting, base=base.base, candidates=len(curves))
        sets = [part for count in (1, 2) for part in combinations(curves.values(), count)]
        for i, part in enumerate(sets):
            progress("sets", i, len(sets))
            terms = tuple(curve.term(curve.size) for curve in part)
            fit(problem, setting, replace(base.model, terms=terms), 20, parent=base)


def named(report):
    return {(row["effect"], row["joint"]) for row in report["effects"]}


def test_an_exhaustive_search_finds_what_todays_does(found, tmp_path):
    folder, stepped = found
    seen = []
    report = discover(
        folder / "study.toml", tmp_path, search=exhaustive, progress=lambda stage, done, total: seen.append(stage)
    )
    assert report["verdict"] == stepped["verdict"] == "named"
    assert named(report) == named(stepped) == {("cubic_stiffness", "joint 2")}
    values = [one["effects"][0]["parameters"]["cubic_stiffness"]["value"] for one in (report, stepped)]
    assert values == pytest.approx([CUBIC, CUBIC], rel=0.05)
    assert seen.count("sets") == 21  # 6 laws at joints and their 15 pairs
    assert "calibration" not in seen
    assert report["complete"]


def test_a_search_that_is_stopped_has_its_fits_compared(found, tmp_path, monkeypatch):
    folder, _ = found
    monkeypatch.setattr("fmucorrect.discovery.budget.time.monotonic", lambda: now[0])
    now = [0.0]

    def over(stage, done, total):
        now[0] = np.inf if (stage, done) == ("sets", 6) else 0.0

    report = discover(folder / "study.toml", tmp_path, search=exhaustive, time_limit=1e9, progress=over)
    assert not report["complete"]
    assert named(report) == {("cubic_stiffness", "joint 2")}
    assert report["not_looked_at"] == ["equivalents of what was found, and its numbers to their end"]


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory):
    """A study of a solver in C that begins again whenever an input changes: a mass of 10 kg on a spring whose base moves; it
    rubs against the ground, which the model does not know."""
    folder = tmp_path_factory.mktemp("rubbing")
    foreign(folder / "mass.fmu", "restarting", 2)
    t = np.arange(round(SECONDS / STEP) + 1) * STEP
    rng, text = np.random.default_rng(1), ""
    for run, size in (("small", 2.0), ("large", 4.0), ("held", 3.0)):
        base = size * np.sin(2.0 * np.pi * (0.5 + 0.75 * t) * t)  # mm, 0.5 to 6.5 Hz
        x, v, fine, seen = 1e-3, 0.0, 50, []
        for u in base:
            seen.append(1e3 * x)
            for _ in range(fine):
                v += STEP / fine * (4000.0 * (1e-3 * u - x) - 20.0 * v) / 10.0
                rub = STEP / fine * FRICTION / 10.0
                v = np.sign(v) * max(abs(v) - rub, 0.0)  # brings it to rest, and no further
                x += STEP / fine * v
        for file, heads, column in ((f"{run}_in", "u [mm]", base), (f"{run}_out", "s [mm]", seen)):
            noise = NOISE * rng.normal(size=len(t)) if file.endswith("out") else 0.0
            rows = np.column_stack([t, column + noise])
            np.savetxt(folder / f"{file}.csv", rows, "%.9g", ",", header=f"time,{heads}", comments="")
        role = "evaluation" if run == "held" else "development"
        text += (
            f'[[conditions]]\nname = "{run}"\nrole = "{role}"\ninputs = "{run}_in.csv"\nmeasurement = "{run}_out.csv"\n'
        )
    (folder / "study.toml").write_text(
        f"""format = 1
[simulation]
fmu = {json.dumps(str(folder / "mass.fmu"))}
step_size = {STEP}
[[channels]]
name = "x"
simulation = "x"
measurement = "s"
quantity = "displacement"
unit = "mm"
noise = {NOISE}
[[joints]]
name = "guide"
force = "f"
displacement = "x"
velocity = "v"
sign = -1
"""
        + text
    )
    return folder / "study.toml"


@pytest.mark.slow
def test_both_find_the_friction_of_a_solver_that_is_not_ours(rubbing, tmp_path):
    ways = {"stepwise": {}, "by response": {"few_runs": True}, "exhaustive": {"search": exhaustive}}
    for way, asked in ways.items():
        report = discover(rubbing, tmp_path / way, **asked)
        assert report["verdict"] == "named", report["sentence"]
        assert named(report) == {("coulomb_friction", "guide")}
        assert report["effects"][0]["parameters"]["friction_force"]["value"] == pytest.approx(FRICTION, rel=0.05)


@pytest.mark.slow
def test_the_ledger_has_every_fit_with_what_it_came_from_and_cost(rubbing, library):
    with load(load_study(rubbing), library, 2) as problem:
        before = problem.budget.runs
        best = name(problem).best
        ledger, spent = problem.ledger, problem.budget.runs - before
        assert [row.number for row in ledger.rows] == list(range(len(ledger.rows)))
        assert all(row.parent is None or row.parent < row.number for row in ledger.rows)
        assert all(row.runs > 0 and set(row.conditions) == {"small", "large"} for row in ledger.rows)
        line = ledger.ancestors(best.number)
        assert {term.key for term in line[0].model.terms} == {("coulomb_friction", "guide")}
        assert line[-1].model.terms == ()
        assert "looked/look" in {row.move for row in line}
        assert 0 < sum(row.runs for row in ledger.rows) < sum(ledger.runs.values()) <= spent
        assert min(ledger.runs.values()) >= 0
