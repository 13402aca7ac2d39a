"""Simulation: the same numbers as FmuStepper, back to a saved state to the bit, turned while it runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmucorrect.errors import FmuError
from fmucorrect.fmu import FmuStepper
from fmucorrect.fmu.simulation import Simulation
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import grid, run

START = {"x1": 0.01, "k1": 400.0, "c1": 0.3}
WATCHED = (Channel("mass1.x", unit="mm"), Channel("joint1.F", unit=""))


def test_it_gives_what_the_stepper_gives(oscillator: Path) -> None:
    with FmuStepper(oscillator, WATCHED, parameters=START) as stepper:
        expected = run(stepper, Condition("free"), grid(0.5, 1_000_000))
    assert expected is not None
    with Simulation(oscillator, WATCHED, step_size=1e-3) as simulation:
        simulation.start(START)
        first = simulation.read()
        rows = np.concatenate([first[None], simulation.run(200), simulation.run(0), simulation.run(300)])
    assert simulation.channels == expected.channels
    assert np.abs(rows - expected.values).max() < 1e-12 * np.abs(expected.values).max()


def test_a_saved_state_repeats_to_the_bit_until_a_new_run(oscillator: Path) -> None:
    with Simulation(oscillator, WATCHED, step_size=1e-3) as simulation:
        simulation.start(START)
        simulation.run(50)
        saved = simulation.save()
        once = simulation.run(50)
        simulation.restore(saved)
        assert np.array_equal(simulation.run(50), once)
        assert simulation.holds(saved)
        simulation.start(START)
        assert not simulation.holds(saved)
        with pytest.raises(FmuError, match="of an earlier run"):
            simulation.restore(saved)


def test_inputs_are_driven_step_by_step(oscillator: Path) -> None:
    """A constant force of k d opposes nothing but the spring: x of a heavily damped mass ends at f / k."""
    with Simulation(oscillator, WATCHED, step_size=1e-2) as simulation:
        simulation.start({"m1": 1.0, "k1": 400.0, "c1": 40.0, "masses": 1.0})
        simulation.run(500, ("mass1.f",), np.full((500, 1), 8.0))
        assert simulation.read()[0] == pytest.approx(1e3 * 8.0 / 400.0, rel=1e-9)
        assert simulation.get(("x1", "mass1.f")) == pytest.approx([0.02, 8.0], rel=1e-9)
        simulation.set({"mass1.f": 0.0})
        simulation.run(500)
        assert abs(simulation.read()[0]) < 1e-9


def test_directional_derivatives_are_the_equations_of_motion(oscillator: Path) -> None:
    """x'' = -(k x + c x') / m of one mass."""
    with Simulation(oscillator, (), step_size=1e-2) as simulation:
        structure = simulation.structure
        assert structure.directional
        simulation.start({"m1": 2.0, "k1": 400.0, "c1": 6.0, "masses": 1.0})
        matrix = simulation.directional(structure.derivatives, structure.states)
    names = [variable.name for variable in structure.states]
    x, v = names.index("x1"), names.index("v1")
    expected = np.array([[0.0, 1.0], [-200.0, -3.0]])
    assert matrix[np.ix_([x, v], [x, v])] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_what_it_refuses(oscillator: Path) -> None:
    with Simulation(oscillator, WATCHED, step_size=1e-2) as simulation:
        with pytest.raises(FmuError, match="is not running"):
            simulation.run(1)
        simulation.start({})
        with pytest.raises(FmuError, match="cannot be changed while it runs: x1"):
            simulation.set({"x1": 1.0})
        with pytest.raises(FmuError, match="start values do not fit"):
            simulation.start({"nothing": 1.0})
    with pytest.raises(FmuError, match="communication step is not known"):
        Simulation(oscillator, WATCHED, step_size=0.0)
