"""One number must do for all conditions: what noise scatters is no change, what a wrong law needs is one."""

from dataclasses import replace

import numpy as np
import pytest

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.discovery.decide import Decision
from fmucorrect.discovery.discover import confirmed
from fmucorrect.discovery.discrepancy import TOO_MUCH, TOO_UNEVEN, VARIES, Uneven, varying
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.lasting import Size
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.discovery.wording import sentence
from fmucorrect.report.discovery.content import Discovery

CONDITIONS, ROWS = 4, 1000
(LAW,) = CATALOGUE["cubic_stiffness"]
ROWS_OF = [slice(k * ROWS, (k + 1) * ROWS) for k in range(CONDITIONS)]


def fitted(moves: list[float], seed: int = 0, background: float = 0.0) -> tuple[Setting, Fitted]:
    """A law whose number each condition would move by so much of it, by noise of 1 and by an error that is none of it."""
    rng = np.random.default_rng(seed)
    n = CONDITIONS * ROWS
    slopes = rng.normal(scale=30.0, size=(n, 1))
    residual = slopes[:, 0] * np.repeat(moves, ROWS) + rng.normal(size=n) + background * rng.normal(size=n)
    nothing = np.zeros((n, 0))
    setting = Setting(residual, Nuisances(nothing), nothing, np.zeros(0), 1.0)
    term = ForceTerm(LAW, "joint", (), LAW.complete({LAW.estimated[0]: 5.0}))
    s2 = float(np.mean(residual**2))
    return setting, Fitted(Model((term,)), residual, residual, s2, 0.0, nothing, (), slopes)


@pytest.mark.parametrize("seed", range(5))
def test_noise_changes_nothing(seed):
    setting, best = fitted([0.0] * CONDITIONS, seed)
    assert varying(ROWS_OF, setting, best) == (0.0,)


def test_an_error_beside_it_that_is_as_large_as_what_is_named_changes_little():
    setting, best = fitted([0.0] * CONDITIONS, background=15.0)
    assert varying(ROWS_OF, setting, best) == (0.0,)


def test_all_alike_is_no_change():
    setting, best = fitted([0.4] * CONDITIONS)
    assert varying(ROWS_OF, setting, best) == (0.0,)


def test_a_number_that_differs_between_conditions_is_told():
    moves = [-0.4, -0.1, 0.1, 0.4]
    setting, best = fitted(moves)
    (share,) = varying(ROWS_OF, setting, best)
    assert share == pytest.approx(np.std(moves, ddof=1), rel=0.05)


def test_a_number_that_is_next_to_nothing_beside_the_force_that_acts_need_not_be_the_same_each_time():
    """Friction that is all breakaway, and falls with the speed: what slides is lost in what it may be off by."""
    law = next(law for law in CATALOGUE["stribeck_friction"] if not law.form)
    setting, best = fitted([-0.4, -0.1, 0.1, 0.4])
    for sliding, told in ((10.0, True), (0.01, False)):
        falling = {"friction_force": sliding, "breakaway_force": 12.0, "stribeck_velocity": 0.1}
        term = ForceTerm(law, "joint", (), law.complete({**falling, "smoothing_velocity": 1e-3}))
        others = np.zeros((CONDITIONS * ROWS, len(term.estimated) - 1))
        own = replace(best, model=Model((term,)), slopes=np.concatenate([best.slopes, others], axis=1))
        (share,) = varying(ROWS_OF, setting, own)
        assert (share > VARIES) is told


def test_a_single_condition_says_nothing():
    setting, best = fitted([-0.4, -0.1, 0.1, 0.4])
    assert varying(ROWS_OF[:1], setting, best) == (0.0,)


@pytest.mark.parametrize("verdict", ["named", "ambiguous", "none", "unexplained"])
def test_a_law_that_does_not_carry_over_between_conditions_or_places_is_no_finding(verdict):
    decision = Decision(verdict, fitted([0.0] * CONDITIONS)[1], (1.0,), ((),), (), 0.01)
    here = Uneven("velocity", 0.9 * TOO_UNEVEN, 0.5, (), ())
    lasts = (Size(), Size(VARIES), Size(0.0, here))
    assert confirmed(decision, []) == confirmed(decision, [], lasts) == verdict
    gone = "none" if verdict == "none" else "unexplained"
    assert confirmed(decision, [], (Size(), Size(TOO_MUCH))) == gone
    assert confirmed(decision, [], (Size(0.0, replace(here, share=TOO_UNEVEN)),)) == gone


@pytest.mark.parametrize(
    ("share", "said"),
    [
        (0.414, "friction force would have to differ by 41 % between"),
        (0.2, "nearest: added mass at frame; Coulomb friction at damper, beside which 5 % of"),
    ],
)
def test_and_the_sentence_says_so(share, said):
    close = {"effect": "coulomb_friction", "joint": "damper", "uneven": None} | {
        "varies": {"parameter": "friction_force", "share": share}
    }
    other = {"effect": "added_mass", "joint": "frame", "varies": None, "uneven": None}
    report = {"verdict": "unexplained", "effects": [], "suspects": [other, close], "unexplained": 0.05}
    text = sentence(Discovery.read(report), [])
    assert said in text
    assert ("nearest come 2 effects together; of Coulomb friction at damper the" in text) == (share > TOO_MUCH)
