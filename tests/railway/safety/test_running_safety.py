"""Runs through curves by a mapping: speeds, signs, flags and references, on a plant whose wheel forces are known."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from fmucorrect.errors import SignalError
from fmucorrect.railway.safety.quantities import Wheel
from fmucorrect.railway.safety.running_safety import (
    ReferenceOrder,
    Run,
    RunningSafety,
    SafetyMapping,
    assess_running_safety,
)
from fmucorrect.railway.safety.track_sections import TrackSection
from fmucorrect.railway.speed_parameter import SpeedParameter
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import Status, Step

STEP_NS = 5_000_000


class Curve:
    """Y = m v^2 / R of the outer (left) wheel, counted inwards; Q of both 50 kN, or NaN in the curve of 400 m."""

    def __init__(self, channels: tuple[Channel, ...]) -> None:
        self.channels = tuple(
            Channel(channel.name, unit="1" if channel.name == "lift" else "N") for channel in channels
        )
        self._values: Mapping[str, float] = {}
        self.closed = 0

    def reset(self, condition: Condition) -> None:
        radius, speed = condition.parameters["radius"], condition.parameters["speed"] / 3.6
        q = np.nan if radius == 400.0 else 50e3
        self._values = {"l.Y": -5e3 * speed**2 / radius, "r.Y": 0.0, "l.Q": q, "r.Q": q, "lift": float(radius < 300.0)}

    def process(self, record: Record) -> Record:
        row = np.array([self._values[channel.name] for channel in self.channels])
        return Record(record.t_ns, np.tile(row, (len(record), 1)), self.channels)

    def step(self, t_ns: int, u: np.ndarray) -> Step:
        row = self.process(Record(np.array([t_ns]), np.zeros((1, 0)), ())).values[0]
        return Step(t_ns, row, row, np.zeros(len(row)), Status.OK)

    def close(self) -> None:
        self.closed += 1


def assessed(*radii: float, outward: int = -1) -> RunningSafety:
    """At 30 m/s, which the plant takes in km/h."""
    runs = tuple(
        Run(f"{r:g}", r, 30.0, (TrackSection(f"{r:g}", 20.0, 80.0, r),), {"radius": r, "speed": 1.0}) for r in radii
    )
    mapping = SafetyMapping(
        speed=SpeedParameter("speed"),
        wheels=tuple(Wheel(s, "1", side, f"{s}.Y", f"{s}.Q", 50e3) for s, side in (("l", "left"), ("r", "right"))),
        runs=runs,
        outward={"l": outward},
        flags=("lift",),
        references=tuple(
            ReferenceOrder("lateral_force", "left", "theirs", {r: 1.0 / r for r in radii}) for _ in radii[1:2]
        ),
    )
    return assess_running_safety(mapping, Curve, STEP_NS, 3.6)


def test_forces_by_radius_are_those_of_the_speed_and_counted_outwards() -> None:
    found = assessed(500.0, 1000.0)
    assert found.assessment.by_radius("lateral_force", "left") == pytest.approx({500.0: 9e3, 1000.0: 4.5e3})
    assert found.assessment.by_radius("derailment_quotient", "left")[500.0] == pytest.approx(0.18)
    assert found.speeds == {500.0: 30.0, 1000.0: 30.0}
    assert found.comparisons[0].agreement == "full"
    assert found.passed
    inwards = assessed(500.0, 1000.0, outward=1)
    assert inwards.assessment.by_radius("lateral_force", "left")[500.0] == pytest.approx(-9e3)
    assert inwards.comparisons[0].agreement == "none"


def test_flags_and_limits_are_told() -> None:
    found = assessed(200.0, 1000.0)
    assert [(item.run, item.flag, item.share) for item in found.raised] == [("200", "lift", 1.0)]
    assert not found.passed
    steep = assessed(500.0, 60.0)  # Y 75 kN against Q 50 kN: beyond Nadal's 1.2, and Prud'homme's 43 kN
    assert steep.exceeded == ("derailment_quotient at l, 60", "sum_of_lateral_forces at 1, 60")


def test_forces_that_are_not_finite_name_the_run() -> None:
    with pytest.raises(SignalError, match=r"run '400': l\.Q is nan at t = 0 s"):
        assessed(500.0, 400.0)


def test_a_run_lasts_until_its_last_section_has_passed() -> None:
    sections = (TrackSection("a", 0.0, 50.0), TrackSection("b", 50.0, 90.0))
    assert Run("run", 0.0, 30.0, sections).duration == pytest.approx(90.0 / 30.0 + 1.0)
