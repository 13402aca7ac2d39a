"""Preload: convergence, residual acceleration and loads of closed-form plants, and of the shipped roller rig."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmucorrect.errors import SignalError
from fmucorrect.railway.assess import assess
from fmucorrect.railway.assessment import load_assessment
from fmucorrect.railway.preload.assess import assess_preload
from fmucorrect.railway.preload.assessment import PreloadAssessment
from fmucorrect.railway.preload.mapping import Load, PreloadMapping, RodBush
from fmucorrect.railway.preload.supports import GROUND, Body, Support
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import Status, Step

ROOT = Path(__file__).parents[3]
STEP_NS = 10_000_000
Response = Callable[[np.ndarray, float], np.ndarray]
"""A channel over time (s) and the start value `lift` (m)."""


class Plant:
    """A Stepper of closed-form responses, by channel name; its start value is `lift`."""

    def __init__(self, responses: Mapping[str, tuple[str, Response]], channels: tuple[Channel, ...]) -> None:
        self._responses = [responses[channel.name] for channel in channels]
        self.channels = tuple(
            Channel(channel.name, unit=unit) for channel, (unit, _) in zip(channels, self._responses, strict=True)
        )
        self._lift = 0.0
        self.closed = 0

    def reset(self, condition: Condition) -> None:
        self._lift = condition.parameters.get("lift", 0.0)

    def process(self, record: Record) -> Record:
        seconds = record.t_ns * 1e-9
        values = np.stack([response(seconds, self._lift) for _, response in self._responses], axis=1)
        return Record(record.t_ns, values, self.channels)

    def step(self, t_ns: int, u: np.ndarray) -> Step:
        row = self.process(Record(np.array([t_ns]), np.zeros((1, 0)), ())).values[0]
        return Step(t_ns, row, row, np.zeros(len(row)), Status.OK)

    def close(self) -> None:
        self.closed += 1


def settling(end: float, rate: float, stiffness: float = 1e6) -> Response:
    """A force that settles on `end` from a lift, decaying with `rate` (1/s)."""
    return lambda t, lift: end + stiffness * lift * np.exp(-rate * t)


WEIGHT = 1000.0 * 9.81
MAPPING = PreloadMapping(
    duration=10.0,
    window=1.0,
    disturbance={"lift": 0.01},
    accelerations=("body.az", "body.pitch_acceleration"),
    arm=2.0,
    elements=("damper.F",),
    bodies=(Body("body", 1000.0, (0.2, 0.0, 0.5)),),
    supports=(
        Support("s+1", "body", GROUND, (1.0, 0.0, 0.0), vertical=1e6),
        Support("s-1", "body", GROUND, (-1.0, 0.0, 0.0), vertical=1e6),
        Support("roll", "body", GROUND, (0.0, 0.0, 0.0), roll=1e6),
    ),
    loads=(
        Load("front", "spring", ("front.F",), ("s+1",)),
        Load("rear", "spring", ("rear.F",), ("s-1",)),
        Load("both", "weight", ("front.F", "rear.F"), ("s+1", "s-1")),
    ),
)
RESPONSES: dict[str, tuple[str, Response]] = {
    "body.az": ("m/s2", lambda t, lift: 5.0 * lift * np.exp(-2.0 * t) + 0.01),
    "body.pitch_acceleration": ("rad/s2", lambda t, lift: 0.02 + 0.0 * t),
    "damper.F": ("kN", lambda t, lift: 1e3 * lift * np.exp(-2.0 * t)),
    "front.F": ("N", settling(0.6 * WEIGHT, 2.0)),
    "rear.F": ("kN", settling(0.4e-3 * WEIGHT, 2.0, 1e3)),
}


def assessed(mapping: PreloadMapping = MAPPING, **changed: tuple[str, Response]) -> PreloadAssessment:
    responses = {**RESPONSES, **{name.replace("__", "."): value for name, value in changed.items()}}
    return assess_preload(mapping, lambda channels: Plant(responses, channels), STEP_NS)


def test_a_sound_vehicle_passes_and_every_figure_is_the_closed_form() -> None:
    found = assessed()
    assert found.passed
    assert found.disturbed
    front, rear, both = found.loads
    assert front.value == pytest.approx(0.6 * WEIGHT, rel=1e-6)
    assert front.reference == pytest.approx(0.6 * WEIGHT, rel=1e-12)  # by moments about the rear support
    assert rear.value == pytest.approx(0.4 * WEIGHT, rel=1e-6)  # kN are converted
    assert both.determinate
    assert found.error < 1e-6
    by_name = {item.name: item for item in found.convergences}
    force = by_name["front.F"]
    assert force.start == pytest.approx(0.6 * WEIGHT)  # the first sample of the undisturbed model
    assert force.change == pytest.approx(1e4 * (math.exp(-18.0) - math.exp(-20.0)), rel=1e-3)
    # 1e4 exp(-2 t) falls below a thousandth of the force
    assert force.settling_time == pytest.approx(math.log(1e4 / (1e-3 * 0.6 * WEIGHT)) / 2.0, abs=0.02)
    assert by_name["damper.F"].unit == "N"


def test_residuals_are_the_largest_at_the_start_and_in_the_last_window() -> None:
    found = assessed()
    vertical, pitch = found.residuals
    assert vertical.start == pytest.approx(0.01)
    assert vertical.settled == pytest.approx(0.01 + 0.05 * math.exp(-18.0))
    assert pitch.settled == pytest.approx(0.04)  # 0.02 rad/s2 at 2 m
    assert found.residual == pytest.approx(0.04)
    loud = assessed(body__az=("m/s2", lambda t, lift: 0.11 + 0.0 * t))
    assert not loud.at_rest
    assert not loud.passed
    assert loud.converged
    assert loud.balanced


def test_a_force_that_goes_on_moving_has_not_converged() -> None:
    def creeping(t: np.ndarray, lift: float) -> np.ndarray:
        return 0.6 * WEIGHT * (1.0 + 0.002 * t)

    found = assessed(front__F=("N", creeping))
    item = next(item for item in found.convergences if item.name == "front.F")
    assert not item.converged
    assert item.share == pytest.approx(0.002 / 1.019, rel=1e-3)
    assert math.isnan(item.settling_time)
    assert not found.passed
    assert next(row for row in found.to_json()["elements"] if row["name"] == "front.F")["settling_time"] is None


def test_a_load_that_is_wrong_is_found_with_its_sign() -> None:
    found = assessed(front__F=("N", settling(0.54 * WEIGHT, 2.0)))
    assert found.error == pytest.approx(0.1, rel=1e-4)
    assert found.loads[0].error == pytest.approx(-0.1, rel=1e-4)
    assert not found.balanced
    assert {item.name for item in found.worst()} == {"front", "both"}
    assert assessed(replace(MAPPING, tolerance=0.11), front__F=("N", settling(0.54 * WEIGHT, 2.0))).balanced


def test_forces_that_ought_to_be_nothing_are_held_against_the_weight() -> None:
    """A damper at rest that trembles by 1 N: a share of its own force would be without meaning."""
    found = assessed(damper__F=("N", lambda t, lift: np.sin(20.0 * t)))
    item = next(item for item in found.convergences if item.name == "damper.F")
    assert item.share == pytest.approx(2.0 / (1e-3 * WEIGHT), rel=0.02)


def test_rod_bush_is_judged_by_its_external_force_and_not_by_its_preload() -> None:
    bush = RodBush("bush", "bush.F", 2000.0, 3e5, 1e5, internal="bush.F0", deformation="bush.d")
    mapping = replace(MAPPING, rod_bushes=(bush,))
    expected = 3e10 / 4e5 * 0.002 + 0.75 * 2000.0
    whole = {
        "bush.F": ("N", lambda t, lift: expected + 0.0 * t),
        "bush.F0": ("N", lambda t, lift: 2000.0 + 0.0 * t),
        "bush.d": ("mm", lambda t, lift: 2.0 + 0.0 * t),
    }
    found = assess_preload(mapping, lambda channels: Plant({**RESPONSES, **whole}, channels), STEP_NS)
    item = found.loads[-1]
    assert item.reference == pytest.approx(expected)
    assert item.error == pytest.approx(0.0, abs=1e-12)
    assert found.internal == {"bush": pytest.approx(2000.0)}
    # a model that reports the preload for the transmitted force is caught
    whole["bush.F"] = whole["bush.F0"]
    wrong = assess_preload(mapping, lambda channels: Plant({**RESPONSES, **whole}, channels), STEP_NS)
    assert wrong.loads[-1].error == pytest.approx(2000.0 / expected - 1.0)
    assert not wrong.balanced


def test_values_that_are_not_finite_are_refused_with_name_and_time() -> None:
    def broken(t: np.ndarray, lift: float) -> np.ndarray:
        return np.where(t > 2.995, np.nan, 1.0)

    with pytest.raises(SignalError, match=r"damper\.F is nan at t = 3 s"):
        assessed(damper__F=("N", broken))


def test_the_plant_is_closed_and_nothing_to_assess_is_said() -> None:
    plants: list[Plant] = []

    def plant(channels: tuple[Channel, ...]) -> Plant:
        plants.append(Plant(RESPONSES, channels))
        return plants[-1]

    assess_preload(MAPPING, plant, STEP_NS)
    assert plants[0].closed == 1
    with pytest.raises(SignalError, match="nothing to assess"):
        assess_preload(PreloadMapping(), plant, STEP_NS)
    with pytest.raises(SignalError, match="window is not within"):
        assess_preload(replace(MAPPING, window=10.0), plant, STEP_NS)


def test_progress_counts_every_sample_of_the_settling_run() -> None:
    counted: list[int] = []
    assess_preload(MAPPING, lambda channels: Plant(RESPONSES, channels), STEP_NS, counted.append)
    assert sum(counted) == 1001


def test_the_roller_rig_stands_as_its_independent_equilibrium_says() -> None:
    findings = assess(load_assessment(ROOT / "fmus" / "roller_rig" / "assess.toml"), ("preload",))
    shown = findings._repr_html_()
    assert "<td>preload</td><td>in order</td>" in shown
    assert "<td>critical speed</td><td>not assessed</td>" in shown
    found = findings.preload
    assert found is not None
    assert found.passed
    assert found.residual < 1e-6
    assert found.error < 1e-6
    by_name = {item.name: item for item in found.loads}
    # half of the dummy car body on the bogie: m g 8.65 / 17.3
    assert by_name["ball joint"].reference == pytest.approx(34299.0 * 9.81 / 2.0, rel=1e-12)
    assert by_name["front axle"].reference == pytest.approx(
        (34299.0 / 2.0 + 4343.0 + 2 * 1936.0) * 9.81 / 2.0, rel=1e-12
    )


def test_the_full_vehicle_stands_as_its_independent_equilibrium_says() -> None:
    """The issue asks for 5 % and aims for 0.1 %; the paper's model has a residual acceleration of 0.0189 m/s2."""
    found = assess(load_assessment(ROOT / "fmus" / "full_vehicle" / "assess.toml"), ("preload",)).preload
    assert found is not None
    assert found.converged
    assert found.residual < 1e-6
    assert found.error < 1e-3
    assert len(found.loads) == 32
    assert all(value == pytest.approx(2000.0) for value in found.internal.values())
    bushes = [item.value for item in found.loads if item.group == "rod bush"]
    assert all(900.0 < value < 1100.0 for value in bushes)  # about half of the internal preload: equal branches


def test_a_model_that_carries_another_car_body_than_it_should_is_caught() -> None:
    """The FMU's car body is 5 t heavier than that of the vehicle that the mapping describes: 10 % of an axle load."""
    assessment = load_assessment(ROOT / "fmus" / "full_vehicle" / "assess.toml")
    assert assessment.preload is not None
    heavier = replace(assessment.preload, parameters={**assessment.preload.parameters, "car_mass": 34299.0 + 5000.0})
    found = assess(replace(assessment, preload=heavier), ("preload",)).preload
    assert found is not None
    assert found.converged
    assert found.at_rest
    assert not found.balanced
    errors = {item.name: item.error for item in found.worst()}
    total = 34299.0 + 2 * 4343.0 + 4 * 1936.0
    assert min(item.error for item in found.loads if item.group == "axle load") > 0.9 * 5000.0 / total
    assert errors["axle 1"] == pytest.approx(5000.0 / total, rel=0.05)


def test_a_model_that_does_not_start_at_rest_is_caught() -> None:
    assessment = load_assessment(ROOT / "fmus" / "full_vehicle" / "assess.toml")
    assert assessment.preload is not None
    lifted = replace(
        assessment.preload, parameters={**assessment.preload.parameters, "car_body.z": 0.02}, disturbance={}
    )
    found = assess(replace(assessment, preload=lifted), ("preload",)).preload
    assert found is not None
    assert found.converged
    assert found.balanced
    assert not found.at_rest
    by_name = {item.name: item for item in found.residuals}
    # at once four air springs and the series springs of four dampers, 0.26 and 6 MN/m, stretch by 20 mm
    assert by_name["car_body.az"].start == pytest.approx(4 * (0.26e6 + 6e6) * 0.02 / 34299.0, rel=0.01)
    assert by_name["car_body.az"].settled < 1e-6
