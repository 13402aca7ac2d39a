"""Which effects are worth it: by what they take away of what was to be explained, and of what is left."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("sympy")

from fmucorrect.catalogue import find
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.terms import ForceTerm, SignalTerm
from fmucorrect.discovery.worth import admissible, complete, credible, first_of, names

ROWS = 4000
STOP = ("bump_stop", {"gap": 1e-3, "stiffness": 1e4})
DRY = ("coulomb_friction", {"friction_force": 0.1, "stick_displacement": 5e-4})
HYSTERESIS = (
    "bouc_wen_hysteresis",
    {"stiffness": 200.0, "alpha": 0.0, "beta": 1500.0, "gamma": 1000.0, "exponent": 1.0},
)
SQUARE = ("quadratic_damping", {"quadratic_damping": 3.0})
SPRING = ("linear_stiffness", {"stiffness": 10.0})
DAMPER = ("viscous_damping", {"damping": 1.0})
MASS = ("added_mass", {"mass": 0.1})


def setting(floor: float = 1.0) -> Setting:
    nothing = np.zeros((ROWS, 0))
    return Setting(np.zeros(ROWS), Nuisances(nothing), np.zeros((ROWS, 1)), np.zeros(0), 1.0, floor, 100)


def made(s2: float, *effects, far: float = 0.0) -> Fitted:
    """A set that leaves s2; its surprise is that of white noise, with what the members cost. far: of a base parameter."""
    terms = []
    for joint, (effect, values) in effects:
        law = find(effect, values)
        terms.append(ForceTerm(law, joint, (), law.complete(values)))
    cost = 30.0 * len(terms) + far**2
    model = Model(tuple(terms), (far,))
    rows = np.zeros(ROWS)
    return Fitted(model, rows, rows, s2, float(ROWS * (1.0 + np.log(s2))) + cost, np.zeros((ROWS, 1)), (0.0,))


def kept(base, *sets, floor=1.0):
    return [names(fitted) for fitted in admissible(setting(floor), base, sets)]


@pytest.mark.parametrize(
    ("left", "with_it", "is_worth_it"),
    [
        (1.30, 1.25, False),  # what an idealised law leaves
        (4.00, 2.00, True),  # more than 4 % of the amplitude of all
        (1.30, 1.02, True),  # less, but all that is left
        (1.30, 1.15, False),
        (1.05, 1.00, False),  # all that is left, but too small: a rounded corner
    ],
)
def test_a_further_effect_takes_away_a_part_of_all_or_all_that_is_left(left, with_it, is_worth_it):
    base, one = made(1000.0), made(left, ("joint 1", STOP))
    two = made(with_it, ("joint 1", STOP), ("joint 2", SQUARE))
    assert two.surprise < one.surprise
    assert (names(two) in kept(base, one, two)) is is_worth_it


@pytest.mark.parametrize(("left", "is_worth_it"), [(1.10, True), (1.55, False)])
def test_a_law_that_contains_another_is_judged_by_what_that_member_explains(left, is_worth_it):
    base, stop = made(3000.0), made(80.0, ("joint 2", STOP))
    dry = made(1.60, ("joint 2", STOP), ("joint 1", DRY))
    more = made(left, ("joint 2", STOP), ("joint 1", HYSTERESIS))
    assert (names(more) in kept(base, stop, dry, more)) is is_worth_it


def test_a_law_that_contains_another_is_not_compared_with_sets_that_are_worse_than_the_one_that_it_takes_the_place_in():
    base, beside = made(3000.0), made(20.0, ("joint 2", STOP), ("joint 1", MASS))
    far = made(1.46, ("joint 2", STOP), ("joint 1", DRY), far=8.0)  # a parameter takes on what is the mass's
    near = made(1.46, ("joint 2", STOP), ("joint 1", DRY), ("joint 1", MASS))
    more = made(1.17, ("joint 2", STOP), ("joint 1", HYSTERESIS), ("joint 1", MASS))
    assert names(more) in kept(base, beside, far, near, more, floor=1.04)
    assert names(more) not in kept(base, beside, far, more, floor=1.04)


def test_linear_members_are_exact():
    base = made(1000.0)
    springs = [made(1.30, ("joint 1", SPRING)), made(1.25, ("joint 1", SPRING), ("joint 2", DAMPER))]
    assert [names(fitted) for fitted in springs] == kept(base, *springs)[1:]
    stop = made(1.20, ("joint 1", SPRING), ("joint 2", STOP))
    assert names(stop) in kept(base, springs[0], stop)  # 0.1 of 1.3: the spring has explained the rest exactly
    square = made(1.30, ("joint 1", SQUARE))
    stop = made(1.20, ("joint 1", SQUARE), ("joint 2", STOP))
    assert names(stop) not in kept(base, square, stop)


@pytest.mark.parametrize(
    ("left", "with_it", "is_believed"),
    [
        (30.0, 1.05, True),  # nothing stays
        (3.00, 1.50, True),  # 1.5 beside 0.4
        (3.00, 1.90, False),  # 1.1 beside 0.8
        (30.0, 12.0, False),
    ],
)
def test_beside_what_nothing_explains_a_small_further_effect_may_be_any(left, with_it, is_believed):
    one = made(left, ("joint 1", STOP))
    two = made(with_it, ("joint 1", STOP), ("joint 2", MASS))
    assert credible(setting(), made(1000.0), [one, two]) == ([one, two] if is_believed else [one])
    small = made(with_it, ("joint 1", STOP), ("joint 2", MASS), ("joint 1", SPRING))  # as if the spring did nothing
    assert small not in credible(setting(), made(1000.0), [one, two, small]) or with_it < 1.1


@pytest.mark.parametrize(
    ("more", "with_it", "is_believed"),
    [
        ([DRY, STOP], 12.0, True),  # all beside the simpler set are forces, that take away more than they leave
        ([DRY, STOP], 20.0, False),
        ([HYSTERESIS], 12.0, True),  # in the place of a law that it contains
        ([DRY, "gain"], 12.0, False),  # what the form of a law may be off by says nothing of sensors
    ],
)
def test_but_not_what_no_error_in_the_form_of_the_laws_could_do(more, with_it, is_believed):
    gain = SignalTerm(SIGNALS["sensor_gain"][0], "x1", (0,), {"gain": 1.2})
    one = made(30.0, ("joint 1", DRY))
    two = made(with_it, *(("joint 1", item) for item in more if item != "gain"))
    if "gain" in more:
        two = replace(two, model=replace(two.model, terms=(*two.model.terms, gain)))
    assert two.surprise < one.surprise
    assert credible(setting(), made(1000.0), [two, one]) == [one]
    for gained in (100.0, 1.0):  # by the larger set, where all their laws may be off
        both = credible(
            setting(), made(1000.0), [two, one], lambda fitted, gained=gained: 0.0 if fitted is two else gained
        )
        assert both == ([two, one] if is_believed and gained > 4.0 else [one])


@pytest.mark.parametrize(
    ("simple", "with_it", "is_believed"),
    [
        (280.0, 190.0, True),  # friction alone is no verdict, what contains it is one
        (280.0, 210.0, False),  # nor is that
        (190.0, 150.0, False),  # it does as well
    ],
)
def test_no_special_case_that_explains_too_little_takes_the_place_of_a_law_that_explains(simple, with_it, is_believed):
    one, two = made(simple, ("joint 1", DRY)), made(with_it, ("joint 1", HYSTERESIS))
    assert credible(setting(), made(1000.0), [two, one]) == ([two, one] if is_believed else [one])
    two = made(with_it, ("joint 1", DRY), ("joint 2", MASS))  # a further effect may be any, as ever
    assert credible(setting(), made(1000.0), [two, one]) == [one]


@pytest.mark.parametrize(("rest", "is_believed"), [(1.3, True), (3.0, False)])
def test_a_sensor_that_is_off_need_not_take_away_what_all_of_them_had_taken_on(rest, is_believed):
    one = made(rest, ("joint 1", STOP))
    gain = SignalTerm(SIGNALS["sensor_gain"][0], "x1", (0,), {"gain": 1.2})
    two = replace(one, model=replace(one.model, terms=(*one.model.terms, gain)), surprise=one.surprise - 700.0)
    assert credible(setting(), made(1000.0), [one, two]) == ([one, two] if is_believed else [one])


@pytest.mark.parametrize(("off", "is_believed"), [(2.0, False), (50.0, True)])
def test_beside_a_large_rest_too_a_sensor_is_told_that_is_off_by_much(off, is_believed):
    """off: the gain, in what is expected of it; a set without it leaves no more, since that was taken for the sensor's."""
    gain = SignalTerm(SIGNALS["sensor_gain"][0], "x1", (0,), {"gain": 1.2})
    expected = 0.5 * np.sin(np.arange(ROWS) / 50.0)[:, None]
    known = replace(setting(), sensors=Nuisances(expected))
    one = replace(made(3.0, ("joint 1", STOP)), residual=off * expected[:, 0])
    more = replace(one.model, terms=(*one.model.terms, gain))
    two = replace(one, model=more, residual=np.zeros(ROWS), surprise=one.surprise - 700.0)
    assert credible(known, made(1000.0), [one, two]) == ([one, two] if is_believed else [one])


def test_nothing_is_left_when_no_further_effect_could_be_worth_it():
    base = made(1000.0)
    for s2, finished in ((1.1, True), (1.4, False)):
        best = made(s2, ("joint 1", STOP))
        assert first_of([base, best]) is best
        assert complete(setting(), base, [best], best) is finished
