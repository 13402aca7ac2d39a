"""What is left above the noise is said, also where it is too little for a name."""

from typing import Any

import numpy as np
import pytest

from fmucorrect.discovery.confirm import Gap
from fmucorrect.discovery.decide import Decision
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.output import gap_row
from fmucorrect.discovery.report import Report
from fmucorrect.discovery.terms import OF_FACTOR
from fmucorrect.discovery.wording import rest, sentence
from fmucorrect.discovery.worth import left
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.signals import Condition

ROWS = 5000
SETTING = Setting(np.zeros(ROWS), Nuisances(np.zeros((ROWS, 0))), np.zeros((ROWS, 0)), np.zeros(0), 1.0)


def decision(verdict: str, s2: float, unexplained: float) -> Decision:
    nothing = np.zeros(ROWS)
    fitted = Fitted(Model(), nothing, nothing, s2, 0.0, np.zeros((ROWS, 0)), ())
    return Decision(verdict, fitted, (), (), (), unexplained)


@pytest.mark.parametrize("verdict", ["named", "ambiguous", "none"])
def test_more_than_chance_is_said(verdict):
    (text,) = rest(SETTING, decision(verdict, 1.2, 4e-4), told=True)
    assert "1.2 times the variance" in text
    assert "2 % of the amplitude" in text


def test_chance_is_not():
    assert rest(SETTING, decision("named", 1.05, 1e-4), told=True) == []  # sqrt(2 / 5000) is 0.02


def test_a_noise_that_is_not_known_is_told_nowhere():
    (text,) = rest(SETTING, decision("named", 1.2, 4e-4), told=False)
    assert "times" not in text
    assert "noise with it, 2 % of the amplitude" in text
    unknown = np.full(1, np.nan)
    gap = Gap(Condition("385"), np.zeros(0), *[np.zeros((0, 1))] * 3, unknown, 19.1, 0.42, np.nan, 0.1, 0.9)
    row = told("backlash", "mount", gap=(1.2e-4, "m", "free travel"))
    said = sentence(Discovery.read({"verdict": "named", "effects": [row], "unexplained": 1e-4}), [gap])
    assert said.endswith("the error at 385 falls from 19.1 to 0.42 %.")
    assert gap.agrees
    held = gap_row(gap) | {"noise_floor": None}  # as report.json has it
    report = Report(verdict="none", sentence=said, effects=[], gap=[held])
    assert report.lines()[-1].endswith("19.1 -> 0.42 % (noise unknown)")
    assert "unknown" in report._repr_html_()


def test_parameters_that_moved_have_a_line_with_their_errors():
    moved = {
        "adjusted_from": {"c": 2.5, "k": 1e3},
        "adjusted": {"c": 4.0, "k": 1001.0},
        "adjusted_by": {"c": 3.0, "k": 0.1},
    }
    report = Report(verdict="named", sentence="", effects=[], gap=[], adjusted_std={"c": 0.01}, **moved)
    assert report.lines()[1:] == ["  c: 2.5 -> 4 +- 0.01, +3 tolerances"]


def test_what_is_unexplained_says_so_itself():
    assert rest(SETTING, decision("unexplained", 30.0, 0.5), told=True) == []


def moved(s2: float, residual: float, z: float) -> Fitted:
    """A model whose base parameter of one column, 3 units of noise a tolerance, has moved by z."""
    column = np.full((ROWS, 1), 3.0)
    nothing = np.zeros(ROWS)
    return Fitted(Model((), (z,)), nothing, np.full(ROWS, residual), s2, 0.0, column, (z,))


def test_what_is_left_is_a_share_of_what_the_parameters_do_not_take():
    assert left(moved(6.0, 0.0, 0.0), moved(100.0, 11.0, 1.0), 1.0) == pytest.approx(5.0 / 120.0)


def test_where_they_take_it_all_it_is_a_share_of_what_they_took():
    assert left(moved(1.03, 0.0, 0.0), moved(1.03, 1.0, -4.0), 1.0) == pytest.approx(0.03 / (11.0**2 - 1.0), rel=1e-6)
    assert left(moved(1.0, 0.0, 0.0), moved(1.0, 1.0, 0.0), 1.0) == 0.0


def told(effect: str, joint: str, **parameters: tuple[float, str, str]) -> dict[str, Any]:
    """A named effect as the report has it."""
    numbers = {n: {"value": x, "unit": unit, "meaning": meaning} for n, (x, unit, meaning) in parameters.items()}
    return {"effect": effect, "joint": joint, "parameters": numbers, "indistinguishable_from": []}


def test_what_is_named_is_told_with_its_size():
    play = told("backlash", "mount", gap=(1.2e-4, "m", "free travel"), stiffness=(8.7e6, "N/m", "lost"))
    weak = told("parameter_offset", "scale_left and scale_right", value=(-0.605, "1", OF_FACTOR))
    soft = told("parameter_offset", "bush_kx", value=(-4.23e6, "N/m", "added to the start value"))
    gap = Gap(Condition("385"), np.zeros(0), *[np.zeros((0, 1))] * 3, np.ones(1), 19.1, 0.42, 0.41, 0.1, 0.9)
    text = sentence(Discovery.read({"verdict": "named", "effects": [play, weak, soft], "unexplained": 1e-4}), [gap])
    assert "backlash at mount (gap 0.120 mm)" in text
    assert "parameter offset of scale_left and scale_right (−60.5 %)" in text
    assert "parameter offset of bush_kx (−4.23 MN/m)" in text
    soft["changes"] = {"bush_kx": {"before": 13.72e6, "after": 9.49e6}}
    text = sentence(Discovery.read({"verdict": "named", "effects": [soft], "unexplained": 1e-4}), [gap])
    assert "parameter offset of bush_kx (13.7 MN/m → 9.49 MN/m)" in text


def test_what_cannot_be_told_apart_stands_with_the_effect_that_it_may_be():
    right = told("backlash", "mount, right")
    left_one = told("backlash", "mount, left", gap=(1e-4, "m", "free travel")) | {"indistinguishable_from": [right]}
    offset = told("sensor_offset", "RB", offset=(1.5e-5, "m", "added"))
    gap = Gap(Condition("385"), np.zeros(0), *[np.zeros((0, 1))] * 3, np.ones(1), 14.1, 0.23, 0.22, 0.1, 0.9)
    text = sentence(Discovery.read({"verdict": "ambiguous", "effects": [left_one, offset], "unexplained": 1e-4}), [gap])
    assert "(0.100 mm), or backlash at “mount, right”, which these data cannot tell apart; sensor offset of RB" in text
    assert "tell apart" not in sentence(
        Discovery.read({"verdict": "named", "effects": [offset], "unexplained": 1e-4}), [gap]
    )


@pytest.mark.parametrize(
    ("unexplained", "after", "said"),
    [
        (0.11, 0.33, True),
        (0.11, 0.20, False),
        (0.005, 0.33, False),
    ],  # the second is about the noise, the third is little
)
def test_much_that_a_name_leaves_is_told_with_it(unexplained, after, said):
    spring = told("cubic_stiffness", "joint 1", cubic_stiffness=(3.4e7, "N/m3", "of the cube"))
    gap = Gap(Condition("other"), np.zeros(0), *[np.zeros((0, 1))] * 3, np.ones(1), 1.67, after, 0.17, 0.9, 0.99)
    text = sentence(Discovery.read({"verdict": "named", "effects": [spring], "unexplained": unexplained}), [gap])
    assert text.endswith("33 % of the disagreement's amplitude stays unexplained.") == said


@pytest.mark.parametrize(
    ("lag_by", "said"), [(-5.3, "the lag of x1 by 5.3 standard deviations"), (1.0, "(m1): nothing")]
)
def test_agreement_by_a_sensor_that_is_far_off_is_said(lag_by, said):
    sensors = [{"channel": "x1", "gain_by": 0.4, "lag_by": lag_by}, {"channel": "x2", "gain_by": 0.1, "lag_by": 0.0}]
    report = {"verdict": "none", "adjusted_by": {"k1": 0.3, "m1": -2.4}, "sensors": sensors}
    text = sentence(Discovery.read(report), [])
    assert said in text
    assert "2.4 of their tolerances (m1)" in text


@pytest.mark.parametrize(
    ("by", "said"),
    [
        ({"bar.c": -1.5, "rack.m": -0.4}, "; with it and bar.c at 89.5 (from 115) the error"),
        ({"bar.c": -1.5, "rack.m": 1.1}, "; with it and bar.c at 89.5 (from 115) and rack.m at 30.0 (from 28.0) the"),
        (
            {"bar.c": 1.5, "rack.m": 1.1, "d": 1.0},
            "and 3 parameters that moved, bar.c at 89.5 (from 115) the farthest, the error",
        ),
        ({"rack.m": 0.9}, "; with it the error"),
    ],
)
def test_parameters_that_share_what_became_better_are_told_with_it(by, said):
    """A torsion bar that moved by a fifth within a wide tolerance took away as much as the friction that was named."""
    values = {"bar.c": (115.0, 89.5), "rack.m": (28.0, 30.0), "d": (0.1, 0.2)}
    adjusted = {
        "adjusted": {name: values[name][1] for name in by},
        "adjusted_from": {name: values[name][0] for name in by},
        "adjusted_by": by,
    }
    row = told("coulomb_friction", "rack", friction_force=(80.0, "N", "Coulomb force"))
    gap = Gap(Condition("weave"), np.zeros(0), *[np.zeros((0, 1))] * 3, np.ones(1), 11.9, 0.0514, 0.046, 0.1, 0.9)
    report = {"verdict": "named", "effects": [row], "unexplained": 1e-6, **adjusted}
    assert said in sentence(Discovery.read(report), [gap])


def test_a_line_of_a_condition_says_what_is_in_the_file():
    """Where what came nearest is no finding, what is written is a learned force, and leaves more."""
    gap = Gap(Condition("run4"), np.zeros(0), *[np.zeros((0, 1))] * 3, np.ones(1), 1.0, 0.0344, 0.0058, 0.1, 0.9)
    near, learned = gap_row(gap), gap_row(gap) | {"nrmse_after": 0.45}
    report = Report(
        verdict="unexplained",
        sentence="",
        effects=[],
        suspects=[told("backlash", "shaft", gap=(1.2e-4, "m", "free travel"))],
        gap=[near],
        learned={"gap": [learned]},
        files=["augmented.fmu"],
    )
    line = report.lines()[-1]
    assert "0.0344 % with what came nearest, which is in no file, 0.45 % with the learned force" in line
    assert "learned" not in Report(report | {"files": ["report.json"]}).lines()[-1]


def test_one_of_several_that_came_nearest_together_is_told_as_one_of_them():
    uneven = {"over": "displacement", "share": 0.6, "unit": "m", "places": [], "factors": []}
    rows = [
        told("cubic_stiffness", "seat", cubic_stiffness=(3.4e7, "N/m3", "of the cube")) | {"uneven": uneven},
        told("backlash", "seat", gap=(1.2e-4, "m", "free travel")),
    ]
    report = {"verdict": "unexplained", "unexplained": 0.1}
    one = sentence(Discovery.read(report | {"suspects": rows[:1]}), [])
    two = sentence(Discovery.read(report | {"suspects": rows}), [])
    assert "nearest comes cubic stiffness at seat, whose force would have to differ by 60 %" in one
    assert "nearest come 2 effects together; of cubic stiffness at seat the force would have to differ by 60 %" in two
