"""Joints that slip bit by bit are one hysteresis, not the two or three laws that look like it. The truth is stepped here."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, STEP, SWEEP, T, sweep
from test_exchange import C, K, M, adjustable, decided

FINE = 50  # steps of the truth in one of the study
STIFF, REACH, PUSH = 600.0, 4e-4, 0.5  # N/m, m, N


class Bolted:
    """Two hundred springs that slip at stretches as many contacts have them, most at few (log-normal)."""

    def __init__(self):
        self.most = REACH * np.exp(0.8 * np.random.default_rng(0).normal(size=200))
        self.z = np.zeros(200)

    def __call__(self, change):
        self.z = np.clip(self.z + change, -self.most, self.most)
        return STIFF * self.z.mean()


class Rubber:
    """The friction of a rubber spring (Berg, Vehicle System Dynamics 30, 1998, equations 9 to 11): half of its force after
    `reach`, from where it last turned."""

    def __init__(self):
        self.f, self.x, self.turned, self.way = 0.0, 0.0, (0.0, 0.0), 0.0
        self.most, self.reach = STIFF * REACH, REACH

    def __call__(self, change):
        if change * self.way < 0.0:
            self.turned = self.x, self.f
        if change != 0.0:
            self.way = np.sign(change)
        self.x += change
        gone, begun = abs(self.x - self.turned[0]), self.way * self.turned[1] / self.most
        left = 1.0 - begun
        self.f = self.turned[1] + self.way * gone / (self.reach * left + gone) * self.most * left if gone else self.f
        return self.f


def moved(slips):
    """m, of the mass with the joint, by the explicit midpoint of its velocity."""
    x, v, rows, h, push = 0.0, 0.0, [0.0], STEP / FINE, sweep(PUSH)
    for k in range(len(T) - 1):
        for _ in range(FINE):
            change = h * v
            x += change
            v += h * (push[k] - K * x - C * v - slips(change)) / M
        rows.append(x)
    return np.array(rows)


@pytest.mark.parametrize("joint", [Bolted, pytest.param(Rubber, marks=pytest.mark.slow)])
def test_what_slips_bit_by_bit_is_one_hysteresis(library, tmp_path, joint):
    text = MASS + JOINT + adjustable("m1") + adjustable("c1", tolerance=0.05) + SWEEP
    _, found = decided(tmp_path, library, text, moved(joint()), **{"mass1.f [N]": sweep(PUSH)})
    assert found.verdict == "named"
    assert [(term.effect, term.law.form) for term in found.best.model.terms] == [("bouc_wen_hysteresis", "iwan")]
