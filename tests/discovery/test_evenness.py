"""A law of the right form has the right size everywhere; one of the wrong form is told where, and by how much, it is off."""

import numpy as np
from one_mass import JOINT, MASS, NOISE, SWEEP, T, shown, sweep, term_at, write

from fmucorrect.discovery.discrepancy import PIECES, TOO_UNEVEN, uneven
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import begin, stands_out
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.wording import sentence
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.study import load_study

WHERE = "joint 1"
CUBIC, DAMPING = 4e6, 8.0  # N/m3, N s2/m2


def looked_at(folder, library, truth, named, peak=2.0):
    """The mass, measured with the effects `truth` at its joint: a fit of `named`, and what is uneven of it."""
    write(folder / "force.csv", "mass1.f [N]", sweep(peak))
    write(folder / "measured.csv", "x1 [mm]", 0.0 * T)
    (folder / "study.toml").write_text(MASS + JOINT + SWEEP, encoding="utf-8")
    study = load_study(folder / "study.toml")
    hidden = Model(tuple(term_at(study, effect, WHERE, **numbers) for effect, numbers in truth.items()))
    y = shown(study, study.conditions[0], library, hidden, len(T))
    write(folder / "measured.csv", "x1 [mm]", y + NOISE * np.random.default_rng(5).normal(size=y.shape))
    with load(study, library, 2) as problem:
        setting, _, _ = begin(problem)
        model = Model(tuple(term_at(study, effect, WHERE, **numbers) for effect, numbers in named.items()))
        fitted = fit(problem, setting, model, 20)
        assert fitted is not None
        return setting, fitted, uneven(problem, setting, fitted)


def test_where_nothing_is_left_nothing_is_asked(library, tmp_path):
    cubic = {"cubic_stiffness": {"cubic_stiffness": CUBIC}}
    setting, fitted, found = looked_at(tmp_path, library, cubic, cubic)
    assert not stands_out(setting, fitted)
    assert found == (None,)


def test_a_straight_spring_for_a_cubic_one_is_too_stiff_in_the_middle_and_too_soft_outside(library, tmp_path):
    truth, named = {"cubic_stiffness": {"cubic_stiffness": CUBIC}}, {"linear_stiffness": {"stiffness": 50.0}}
    setting, fitted, (found,) = looked_at(tmp_path, library, truth, named)
    assert stands_out(setting, fitted)
    assert found is not None
    assert found.over == "displacement"
    assert found.share > TOO_UNEVEN
    assert 0.5 < found.explains <= 1.0
    assert len(found.places) == len(found.factors) == PIECES
    assert list(found.places) == sorted(found.places)
    true = np.square(found.places) / np.mean(np.square(found.places))
    np.testing.assert_allclose(found.factors, true, atol=0.35)


def test_a_law_that_is_right_is_even_beside_something_that_is_not_told(library, tmp_path):
    """Quadratic damping is left: out of a spring it makes no other spring."""
    spring = {"linear_stiffness": {"stiffness": 200.0}}
    setting, fitted, (found,) = looked_at(
        tmp_path, library, spring | {"quadratic_damping": {"quadratic_damping": DAMPING}}, spring
    )
    assert stands_out(setting, fitted)
    assert found is None


def test_and_the_sentence_says_so():
    close = {"effect": "stribeck_friction", "joint": "slide", "varies": None}
    close["uneven"] = {"over": "displacement", "share": 0.316}
    other = {"effect": "added_mass", "joint": "frame", "varies": None, "uneven": None}
    report = {"verdict": "unexplained", "effects": [], "suspects": [other, close], "unexplained": 0.05}
    assert (
        "of Stribeck friction at slide the force would have to differ by 32 % with the displacement there"
        in sentence(Discovery.read(report), [])
    )
