"""A joint that is held still: what holds it cannot be told, unless it is seen to give."""

import numpy as np
import pytest
from one_mass import JOINT, MASS, NOISE, SWEEP, T, shown, sweep, term_at, write

from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.held import KNOWN, held
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import load
from fmucorrect.study import load_study

WHERE = "joint 1"


def springs(folder, library, start, effect, **numbers):
    """The mass, measured with an effect at its joint, and what is found beside the fit of a spring there."""
    write(folder / "force.csv", "mass1.f [N]", sweep(0.05))
    write(folder / "measured.csv", "x1 [mm]", 0.0 * T)
    (folder / "study.toml").write_text(MASS + JOINT + SWEEP, encoding="utf-8")
    study = load_study(folder / "study.toml")
    y = shown(study, study.conditions[0], library, Model((term_at(study, effect, WHERE, **numbers),)), len(T))
    write(folder / "measured.csv", "x1 [mm]", y + NOISE * np.random.default_rng(5).normal(size=y.shape))
    with load(study, library, 2) as problem:
        setting, _, _ = begin(problem)
        fitted = fit(problem, setting, Model((term_at(study, "linear_stiffness", WHERE, stiffness=start),)), 20)
        assert fitted is not None
        return fitted, held(problem, setting, fitted)


@pytest.mark.parametrize("effect", ["coulomb_friction", "linear_stiffness"])
def test_without_give_friction_that_never_lets_go_is_as_likely(library, tmp_path, effect):
    numbers = {"friction_force": 5.0, "stick_displacement": 5e-5} if "friction" in effect else {"stiffness": 1e5}
    spring, found = springs(tmp_path, library, 5e4, effect, **numbers)
    (only,) = found
    (term,) = only.model.terms
    assert term.key == ("coulomb_friction", WHERE)
    assert only.s2 == pytest.approx(spring.s2, rel=0.01)
    assert 0.0 < only.surprise - spring.surprise < KNOWN**2
    assert (
        term.values["friction_force"] / term.values["stick_displacement"] > 2e4
    )  # twenty times the joint's own spring


@pytest.mark.parametrize("stiffness", [800.0, 2e4])
def test_a_spring_that_is_seen_to_give_is_a_spring(library, tmp_path, stiffness):
    spring, found = springs(tmp_path, library, stiffness, "linear_stiffness", stiffness=stiffness)
    (term,) = spring.model.terms
    assert term.values["stiffness"] == pytest.approx(stiffness, rel=0.4)
    assert found == []


def test_a_faint_spring_is_no_lock(library, tmp_path):
    spring, found = springs(tmp_path, library, 1.0, "linear_stiffness", stiffness=0.0)
    assert abs(spring.model.terms[0].values["stiffness"]) < 3.0 * spring.std()[0]["stiffness"]
    assert found == []
