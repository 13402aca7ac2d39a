"""Of a likely set is named what lasts: a member with another number in each condition does not take the others with it."""

import numpy as np
import pytest
from one_mass import JOINT, MASS, NOISE, T, shown, sweep, term_at, write

from fmucorrect.discovery.decide import decide
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.lasting import lasting
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.naming import Naming
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.worth import names
from fmucorrect.study import load_study

WHERE = "joint 1"
RUN = '[[conditions]]\nname = "{name}"\nrole = "development"\ninputs = "force.csv"\nmeasurement = "{name}.csv"\n'
FRICTION = {"friction_force": 0.4}
BENT = {"quiet": -20.0, "usual": 10.0, "loud": 60.0}  # N/m, of a spring that nobody named, day by day


def likeliest(folder, library, springs, named):
    """The mass with friction and a spring of another stiffness each day: the naming whose only set is `named`."""
    write(folder / "force.csv", "mass1.f [N]", sweep(3.0))
    for name in springs:
        write(folder / f"{name}.csv", "x1 [mm]", 0.0 * T)
    runs = "".join(RUN.format(name=name) for name in springs)
    (folder / "study.toml").write_text(MASS + JOINT + runs, encoding="utf-8")
    study = load_study(folder / "study.toml")
    rng = np.random.default_rng(8)
    for condition, stiffness in zip(study.conditions, springs.values(), strict=True):
        laws = [term_at(study, "coulomb_friction", WHERE, **FRICTION)]
        laws += [term_at(study, "linear_stiffness", WHERE, stiffness=stiffness)]
        y = shown(study, condition, library, Model(tuple(laws)), len(T))
        write(folder / f"{condition.name}.csv", "x1 [mm]", y + NOISE * rng.normal(size=y.shape))
    problem = load(load_study(folder / "study.toml"), library, 2)
    setting, at, _ = begin(problem)
    base = fit(problem, setting, problem.nominal, 8, at)
    terms = tuple(term_at(problem.study, effect, WHERE, **numbers) for effect, numbers in named.items())
    found = fit(problem, setting, Model(terms), 20)
    return problem, Naming(base, (found,), setting)


@pytest.mark.parametrize("same", [True, False], ids=["lasts", "differs each day"])
def test_a_member_that_differs_each_day_is_left_out_and_said(same, library, tmp_path):
    springs = dict.fromkeys(BENT, 20.0) if same else BENT
    both = {"coulomb_friction": FRICTION, "linear_stiffness": {"stiffness": 20.0}}
    problem, naming = likeliest(tmp_path, library, springs, both)
    with problem:
        decision = decide(naming)
        assert decision.verdict == "named"
        again, sizes, told = lasting(problem, naming, decision)
    assert all(size.lasts for size in sizes)
    friction, spring = ("coulomb_friction", WHERE), ("linear_stiffness", WHERE)
    assert names(again.best) == ({friction, spring} if same else {friction})
    assert again.verdict == "named"
    assert again.best.model.terms[0].values["friction_force"] == pytest.approx(0.4, rel=0.05)
    assert len(told) == (not same)
    assert same or "linear stiffness at joint 1 was left out again" in told[0]


def test_what_explains_little_without_it_stays_as_it_was(library, tmp_path):
    """The spring is what moves the mass: friction by itself is no verdict."""
    springs = {name: 8.0 * stiffness for name, stiffness in BENT.items()}
    both = {"coulomb_friction": FRICTION, "linear_stiffness": {"stiffness": 100.0}}
    problem, naming = likeliest(tmp_path, library, springs, both)
    with problem:
        decision = decide(naming)
        again, sizes, told = lasting(problem, naming, decision)
    assert again is decision
    assert not all(size.lasts for size in sizes)
    assert not told


def test_what_fewer_explain_is_named_though_as_many_as_there_may_be_leave_something(library, tmp_path):
    """Friction, and a spring that is another one each day: two further laws that take some of it on are no reason to say
    nothing."""
    also = {"cubic_stiffness": {"cubic_stiffness": 1e5}, "quadratic_damping": {"quadratic_damping": 1.0}}
    problem, naming = likeliest(tmp_path, library, BENT, {"coulomb_friction": FRICTION, **also})
    with problem:
        decision = decide(naming)
        assert decision.verdict == "unexplained"
        again, sizes, told = lasting(problem, naming, decision)
    assert again.verdict == "named"
    assert names(again.best) == {("coulomb_friction", WHERE)}
    assert all(size.lasts for size in sizes)
    assert len(told) == 2
