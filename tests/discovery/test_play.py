"""Play in a joint, told with what it takes away. The truth is integrated by scipy."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, SWEEP, sweep
from test_exchange import C, K, M, adjustable, decided, force, integrated

GAP = 1e-4
"""m, to each side."""


@pytest.mark.parametrize(("damped", "form"), [(False, "undamped"), (True, "")])
def test_play_takes_the_dampers_force_too_or_leaves_it(library, tmp_path, damped, form):
    """As a coupling has it: between the flanks nothing is touched. No damper of the model's is off."""

    def rate(t, y):
        x, v = y
        touched = abs(x) > GAP
        held = K * (x - np.clip(x, -GAP, GAP)) + C * v * (damped or touched)
        return [v, (force(t) - held) / M]

    text = MASS + JOINT + adjustable("m1") + adjustable("c1", tolerance=0.05) + SWEEP
    _, found = decided(tmp_path, library, text, integrated(rate, 2)[0], **{"mass1.f [N]": sweep(0.5)})
    (term,) = found.best.model.terms
    assert found.verdict == "named"
    assert (term.effect, term.law.form) == ("backlash", form)
    assert term.values["gap"] == pytest.approx(GAP, rel=0.05)
    assert np.abs(found.best.model.base).max() < 2.0
