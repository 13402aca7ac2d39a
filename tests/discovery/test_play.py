"""Play in a joint, told with what it takes away. The truth is integrated by scipy."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, SWEEP, begun, sweep, term_at
from test_exchange import C, K, M, adjustable, decided, force, integrated, measured

from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.paring import pared
from fmucorrect.discovery.worth import first_of

GAP = 1e-4
"""m, to each side."""


def motion(damped):
    """m. damped: whether the damper acts in the gap, too."""

    def rate(t, y):
        x, v = y
        touched = abs(x) > GAP
        held = K * (x - np.clip(x, -GAP, GAP)) + C * v * (damped or touched)
        return [v, (force(t) - held) / M]

    return integrated(rate, 2)[0]


@pytest.mark.parametrize(("damped", "form"), [pytest.param(False, "undamped", marks=pytest.mark.slow), (True, "")])
def test_play_takes_the_dampers_force_too_or_leaves_it(library, tmp_path, damped, form):
    """As a coupling has it: between the flanks nothing is touched. No damper of the model's is off."""
    text = MASS + JOINT + adjustable("m1") + adjustable("c1", tolerance=0.05) + SWEEP
    _, found = decided(tmp_path, library, text, motion(damped), **{"mass1.f [N]": sweep(0.5)})
    (term,) = found.best.model.terms
    assert found.verdict == "named"
    assert (term.effect, term.law.form) == ("backlash", form)
    assert term.values["gap"] == pytest.approx(GAP, rel=0.05)
    assert np.abs(found.best.model.base).max() < 2.0


def test_play_that_leaves_the_damper_is_told_by_the_form_with_fewer_numbers(library, tmp_path):
    text = MASS + JOINT + adjustable("m1") + SWEEP
    with measured(tmp_path, library, text, motion(True), **{"mass1.f [N]": sweep(0.5)}) as problem:
        setting, base = begun(problem)
        play = term_at(problem.study, "backlash", "joint 1", gap=GAP, stiffness=K, damping=0.1 * C)
        fitted = fit(problem, setting, replace(problem.nominal, terms=(play,)), 20)
        assert fitted.model.terms[0].law.form == "undamped"
        _, found = pared(problem, setting, base, [fitted])
        (term,) = first_of(found).model.terms
        assert (term.effect, term.law.form) == ("backlash", "")
