"""Dampers with a power of the velocity or a knee, and what looks like them and is not. Truths are integrated by scipy."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, SWEEP, sweep
from test_exchange import C, K, M, adjustable, decided, force, integrated

PACE = 0.02  # m/s


def found_on(folder, library, damper):
    """What is decided of a mass with a damper beside its own."""
    x = integrated(lambda t, y: [y[1], (force(t) - K * y[0] - C * y[1] - damper(y[1])) / M], 2)[0]
    text = MASS + JOINT + adjustable("m1") + adjustable("c1", tolerance=0.05) + SWEEP
    return decided(folder, library, text, x, **{"mass1.f [N]": sweep(0.5)})[1]


def test_a_power_of_the_velocity_is_told_with_its_exponent(library, tmp_path):
    found = found_on(tmp_path, library, lambda v: 0.2 * np.sign(v) * (abs(v) / PACE) ** 0.4)
    assert found.verdict == "named"
    (term,) = found.best.model.terms
    assert term.effect == "power_damping"
    assert term.values["exponent"] == pytest.approx(0.4, rel=0.1)
    at = term.values["damping"] * PACE * (PACE / term.values["reference_velocity"]) ** (term.values["exponent"] - 1)
    assert at == pytest.approx(0.2, rel=0.05)


KNEES = {
    "blows off": (lambda v: np.clip(30.0 * v, -0.3, 0.3), 0.0),
    "digressive": (lambda v: 30.0 * v - 24.0 * (v - np.clip(v, -0.01, 0.01)), 0.2),
}


@pytest.mark.parametrize("damper", KNEES)
def test_a_damper_with_a_knee_is_told_with_it(library, tmp_path, damper):
    force, ratio = KNEES[damper]
    found = found_on(tmp_path, library, force)
    assert found.verdict == "named"
    (term,) = found.best.model.terms
    assert (term.effect, term.law.form) == ("damper_saturation", "knee")
    assert term.values["damping"] == pytest.approx(30.0, rel=0.03)
    assert term.values["velocity"] == pytest.approx(0.01, rel=0.03)
    assert term.values["ratio"] == pytest.approx(ratio, abs=0.06)


def test_a_damper_that_bends_smoothly_is_one_damper(library, tmp_path):
    found = found_on(tmp_path, library, lambda v: 30.0 * v / (1.0 + abs(v) / 0.01))
    assert [term.effect for term in found.best.model.terms] == ["damper_saturation"]


OTHERS = {
    "quadratic_damping": lambda v: 300.0 * v * abs(v),
    "coulomb_friction": lambda v: 0.1 * np.tanh(v / 1e-4),
}


@pytest.mark.parametrize("effect", OTHERS)
def test_what_has_a_name_of_its_own_keeps_it(library, tmp_path, effect):
    found = found_on(tmp_path, library, OTHERS[effect])
    assert [term.effect for term in found.best.model.terms] == [effect]
