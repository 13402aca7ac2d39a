"""What is left above the noise is said, also where it is too little for a name."""

import numpy as np
import pytest

from fmucorrect.discovery.decide import Decision
from fmucorrect.discovery.discover import rest
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.problem import Model

ROWS = 5000
SETTING = Setting(np.zeros(ROWS), Nuisances(np.zeros((ROWS, 0))), np.zeros((ROWS, 0)), np.zeros(0), 1.0)


def decision(verdict: str, s2: float, unexplained: float) -> Decision:
    nothing = np.zeros(ROWS)
    fitted = Fitted(Model(), nothing, nothing, s2, 0.0, np.zeros((ROWS, 0)), ())
    return Decision(verdict, fitted, (), (), (), unexplained)


@pytest.mark.parametrize("verdict", ["named", "ambiguous", "none"])
def test_more_than_chance_is_said(verdict):
    (text,) = rest(SETTING, decision(verdict, 1.2, 4e-4))
    assert "1.2 times the variance" in text
    assert "2 % of the amplitude" in text


def test_chance_is_not():
    assert rest(SETTING, decision("named", 1.05, 1e-4)) == []  # sqrt(2 / 5000) is 0.02


def test_what_is_unexplained_says_so_itself():
    assert rest(SETTING, decision("unexplained", 30.0, 0.5)) == []
