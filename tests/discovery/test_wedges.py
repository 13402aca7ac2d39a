"""Friction under what a joint carries: told with how it grows, not as other laws beside it. The truth is stepped here."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, STEP, SWEEP, T, sweep
from test_exchange import C, K, M, adjustable, decided

FINE = 50  # steps of the truth in one of the study
PUSH = 0.5  # N
CARRIED, GROWTH = 0.06, 40.0  # N, N/m: of the friction where the spring is as it was set, and with its deflection


def slid(*, growth: float, way: float = 1.0):
    """m, of the mass held by what slides or sticks (Karnopp, Journal of Dynamic Systems 107, 1985)."""
    x, v, rows, h, push = 0.0, 0.0, [0.0], STEP / FINE, sweep(PUSH)
    for k in range(len(T) - 1):
        for _ in range(FINE):
            most = max(CARRIED + way * growth * x, 0.0)
            other = push[k] - K * x - C * v
            if v == 0.0 and abs(other) <= most:
                continue
            after = v + h * (other - most * np.sign(v or other)) / M
            v = 0.0 if after * v < 0.0 else after
            x += h * v
        rows.append(x)
    return np.array(rows)


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["pressed", "lifted"])
def test_friction_that_grows_with_the_deflection_is_told_with_its_growth(library, tmp_path, way):
    text = MASS + JOINT + adjustable("m1") + adjustable("c1", tolerance=0.05) + SWEEP
    _, found = decided(tmp_path, library, text, slid(growth=GROWTH, way=way), **{"mass1.f [N]": sweep(PUSH)})
    assert found.verdict == "named"
    (term,) = found.best.model.terms
    assert (term.effect, term.law.form) == ("coulomb_friction", "loaded")
    assert term.values["friction_force"] == pytest.approx(CARRIED, rel=0.03)
    assert term.values["growth"] == pytest.approx(way * GROWTH, rel=0.1)


def test_friction_of_one_size_does_not_grow(library, tmp_path):
    text = MASS + JOINT + adjustable("m1") + adjustable("c1", tolerance=0.05) + SWEEP
    _, found = decided(tmp_path, library, text, slid(growth=0.0), **{"mass1.f [N]": sweep(PUSH)})
    (term,) = found.best.model.terms
    assert term.effect == "coulomb_friction"
    assert abs(term.values.get("growth", 0.0)) < 0.05 * GROWTH
