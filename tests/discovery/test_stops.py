"""Stops that give back less than they take, told without a friction beside them. The truth is integrated by scipy."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, SWEEP, sweep
from test_exchange import C, K, M, adjustable, decided, force, integrated

GAP, HARD = 6e-4, 3000.0  # m, N/m


def pounded(x, v):
    """Hunt and Crossley's contact at both sides. v: m/s."""
    deep = max(abs(x) - GAP, 0.0)
    return np.sign(x) * HARD * deep * max(1.0 + 8.0 * v * np.sign(x), 0.0)


def buffered(x, v):
    """A spring and a damper side by side, as buffers of rubber are often modelled: its force jumps where it is met."""
    return max(HARD * (x - GAP) + 15.0 * v, 0.0) if x > GAP else 0.0


def sprung(x, v):
    return HARD * (x - np.clip(x, -GAP, GAP))


@pytest.mark.parametrize(
    ("stop", "form", "main"),
    [
        pytest.param(pounded, "damped", "gap", id="pounded"),
        pytest.param(buffered, "one_sided_damped", "limit", id="buffered", marks=pytest.mark.slow),
        pytest.param(sprung, "", "gap", id="sprung", marks=pytest.mark.slow),
    ],
)
def test_a_stop_is_told_with_what_it_takes_of_a_blow(library, tmp_path, stop, form, main):
    x = integrated(lambda t, y: [y[1], (force(t) - K * y[0] - C * y[1] - stop(*y)) / M], 2)[0]
    text = MASS + JOINT + adjustable("m1") + adjustable("c1", tolerance=0.05) + SWEEP
    _, found = decided(tmp_path, library, text, x, **{"mass1.f [N]": sweep(0.5)})
    (term,) = found.best.model.terms
    assert found.verdict == "named"
    assert (term.effect, term.law.form) == ("bump_stop", form)
    assert term.values[main] == pytest.approx(GAP, rel=0.05)
    assert term.values["stiffness"] == pytest.approx(HARD, rel=0.1)
