"""How outputs answer to inputs at once, on a mass that is known."""

from pathlib import Path

import pytest

from fmucorrect.errors import FmuError
from fmucorrect.fmu.feedthrough import feedthrough

OSCILLATOR = Path(__file__).resolve().parent.parent.parent / "fmus" / "oscillator" / "oscillator.fmu"
MODEL = {"masses": 1.0, "k1": 1000.0, "c1": 1.0, "k_end": 0.0, "c_end": 0.0}


@pytest.mark.parametrize("mass", [1e-3, 1.0, 1e6])
def test_an_acceleration_answers_with_one_over_the_mass_and_a_displacement_not_at_all(mass):
    outputs = ["mass1.a", "mass1.x", "mass1.a"]
    model = MODEL | {"m1": mass, "k1": 1e3 * mass, "c1": mass}
    answers = feedthrough(OSCILLATOR, ["mass1.f", "joint1.f"], outputs, 1_000_000, model)
    assert answers[0] == pytest.approx([1 / mass, -1 / mass], rel=2e-3)
    assert (abs(answers[1]) < 1e-6 / mass).all()
    assert (answers[2] == answers[0]).all()


def test_it_begins_from_what_is_held_and_from_a_model_in_motion():
    moving = MODEL | {"m1": 2.0, "x1": 0.01}
    answers = feedthrough(OSCILLATOR, ["joint1.f"], ["mass1.a"], 1_000_000, moving, {"mass1.f": 5.0, "joint1.f": 1.0})
    assert answers[0, 0] == pytest.approx(-0.5, rel=2e-3)


def test_an_output_that_is_not_there_is_named():
    with pytest.raises(FmuError, match=r"mass1\.b"):
        feedthrough(OSCILLATOR, ["mass1.f"], ["mass1.b"], 1_000_000, MODEL)
