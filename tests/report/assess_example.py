"""Findings of an assessment whose every figure is known: made from closed-form records, without an FMU."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmucorrect.railway.assess import Findings
from fmucorrect.railway.assessment import Assessment
from fmucorrect.railway.preload.assess import judge
from fmucorrect.railway.preload.assessment import PreloadAssessment
from fmucorrect.railway.preload.mapping import Load, PreloadMapping, RodBush
from fmucorrect.railway.preload.supports import GROUND, Body, Support
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
from fmucorrect.railway.stability.assessment import CriticalSpeedAssessment, CriticalSpeedMapping, Published
from fmucorrect.railway.stability.bifurcation import Bifurcation, Threshold
from fmucorrect.railway.stability.critical_speed import Branch, LinearStability
from fmucorrect.railway.stability.limit_cycle import Deceleration, Motion
from fmucorrect.railway.stability.mode import Mode
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import Status, Step

STEP_NS = 5_000_000
LOAD = 1000.0 * 9.81
PRELOAD = PreloadMapping(
    duration=10.0,
    window=2.0,
    disturbance={"z": 0.01},
    accelerations=("body.az",),
    elements=("damper_1l.F", "damper_1r.F"),
    bodies=(Body("body", 1000.0, (0.2, 0.0, 0.5)),),
    supports=(
        Support("front", "body", GROUND, (1.0, 0.0, 0.0), vertical=1e6),
        Support("rear", "body", GROUND, (-1.0, 0.0, 0.0), vertical=1e6),
        Support("roll", "body", GROUND, (0.0, 0.0, 0.0), roll=1e6),
    ),
    loads=(
        Load("front spring", "spring", ("front.F",), ("front",)),
        Load("rear spring", "spring", ("rear.F",), ("rear",)),
    ),
    rod_bushes=(RodBush("bush 1l", "bush.F", 2000.0, 1e5, 1e5, internal="bush.F0"),),
)


def preload(error: float = 0.0) -> PreloadAssessment:
    """A vehicle at rest; `error`: relative, of the front spring."""
    t_ns = np.arange(2001, dtype=np.int64) * STEP_NS
    decay = np.exp(-2e-9 * t_ns)
    columns = {
        "body.az": 0.01 + 2.0 * decay,
        "damper_1l.F": 500.0 * decay,
        "damper_1r.F": -500.0 * decay,
        "front.F": 0.6 * LOAD * (1.0 + error) + 1e3 * decay,
        "rear.F": 0.4 * LOAD + 1e3 * decay,
        "bush.F": 1000.0 + 0.0 * decay,
        "bush.F0": 2000.0 + 0.0 * decay,
    }
    channels = tuple(Channel(name, unit="m/s2" if name == "body.az" else "N") for name in columns)
    settling = Record(t_ns, np.stack(list(columns.values()), axis=1), channels)
    return judge(PRELOAD, settling.rows(1000, 1001), settling)


def critical_speed(conicity: float | None = 0.17) -> CriticalSpeedAssessment:
    """Stable up to 50 m/s, hunting down to 45 m/s."""
    speeds = tuple(np.linspace(10.0, 90.0, 9).tolist())
    hunting = tuple(Mode(v / 20.0, -(v - 50.0) / 500.0, (v - 50.0) / 10.0) for v in speeds)
    bounce = tuple(Mode(1.2, 0.3, -2.0) for _ in speeds)
    linear = LinearStability(
        method="directional derivatives",
        speeds=speeds,
        branches=(Branch(hunting), Branch(bounce), Branch((None, *bounce[1:]))),
        least_stable=hunting,
        divergence=tuple(0.0 for _ in speeds),
        critical_speed=50.0,
        tolerance=0.01,
        critical_mode=hunting[4],
        stable_at_lowest=True,
    )
    down = tuple(
        Motion(v, (1e-3 * (v - 40.0) / 10.0, 2e-3), 2.5, v > 45.0, True, 10.0) for v in (80.0, 60.0, 46.0, 44.0)
    )
    up = tuple(Motion(v, (0.0 if v < 50.0 else 2e-3, 0.0), None, v >= 50.0, True, 10.0) for v in (44.0, 48.0, 60.0))
    slow = tuple(np.linspace(80.0, 20.0, 31).tolist())
    return CriticalSpeedAssessment(
        linear,
        Deceleration(
            channels=("frame_1.y", "car.y"),
            units=("m", "m"),
            rate=2.0,
            speeds=slow,
            amplitude=(tuple(max(0.0, 1e-4 * (v - 42.0)) for v in slow), tuple(0.0 for _ in slow)),
            frequency=tuple(2.5 for _ in slow),
            raised=tuple(("wheel_lift",) if v > 70.0 else () for v in slow),
            alive_first=True,
            alive_last=False,
            critical_speed=42.0,
        ),
        Bifurcation(
            channels=("frame_1.y", "car.y"),
            units=("m", "m"),
            carry="saved state",
            down=down,
            up=up,
            unstable=(
                Threshold(speed=48.0, amplitude=(5e-4, 1e-4), size=0.5, size_below=0.49, direction="limit cycle"),
            ),
            nonlinear_critical_speed=45.0,
            died_out=44.0,
            equilibrium_lost=50.0,
        ),
        conicity,
        (
            Published("a closed form", 50.2, "linear", 0.17, 0.01),
            Published("the paper's full vehicle", 1124.0 / 3.6, "nonlinear"),
        ),
    )


class Curve:
    """A Stepper of two wheels in a curve whose Y, Q and flag follow from its radius."""

    def __init__(self, channels: tuple[Channel, ...]) -> None:
        units = {"lift": "1"}
        self.channels = tuple(Channel(channel.name, unit=units.get(channel.name, "kN")) for channel in channels)
        self._radius = 0.0

    def reset(self, condition: Condition) -> None:
        self._radius = condition.parameters["curve_radius"]

    def process(self, record: Record) -> Record:
        y = 0.0 if self._radius == 0.0 else 12e3 / self._radius
        values = {"1l.Y": y, "1r.Y": -0.2 * y, "1l.Q": 60.0 + y, "1r.Q": 60.0 - y, "lift": float(y > 45.0)}
        row = np.array([values[channel.name] for channel in self.channels])
        return Record(record.t_ns, np.tile(row, (len(record), 1)), self.channels)

    def step(self, t_ns: int, u: np.ndarray) -> Step:
        row = self.process(Record(np.array([t_ns]), np.zeros((1, 0)), ())).values[0]
        return Step(t_ns, row, row, np.zeros(len(row)), Status.OK)

    def close(self) -> None:
        pass


def safety(tightest: float = 300.0) -> RunningSafety:
    """Three radii, run at 20 m/s; Y = 12 kN m / R."""
    radii = (tightest, 600.0, 1200.0)
    runs = tuple(
        Run(
            f"{radius:g} m",
            radius,
            20.0,
            (TrackSection(f"{radius:g} m", 20.0, 100.0, radius),),
            {"curve_radius": radius},
        )
        for radius in radii
    )
    mapping = SafetyMapping(
        speed=SpeedParameter("speed"),
        wheels=tuple(Wheel(f"1{s[0]}", "1", s, f"1{s[0]}.Y", f"1{s[0]}.Q", 60e3) for s in ("left", "right")),
        runs=runs,
        flags=("lift",),
        references=(
            ReferenceOrder("lateral_force", "left", "another code", dict(zip(radii, (30.0, 20.0, 10.0), strict=True))),
            ReferenceOrder(
                "lateral_force", "left", "a doubtful code", dict(zip(radii, (10.0, 20.0, 30.0), strict=True))
            ),
        ),
    )
    return assess_running_safety(mapping, Curve, STEP_NS)


def findings(*sections: str, error: float = 0.0, tightest: float = 300.0, name: str = "Test vehicle") -> Findings:
    """With these sections, or all three."""
    chosen = sections or ("preload", "critical_speed", "safety")
    mapped = {
        "preload": PRELOAD,
        "critical_speed": CriticalSpeedMapping(SpeedParameter(), (1.0, 2.0)),
        "safety": SafetyMapping(SpeedParameter(), (), ()),
    }
    assessment = Assessment(
        path=Path("assess.toml"),
        name=name,
        fmu=Path("vehicle.fmu"),
        step_ns=1_000_000,
        parameters={"mu": 0.3},
        **{section: mapped[section] for section in chosen},  # type: ignore[arg-type]
    )
    return Findings(
        assessment,
        preload(error) if "preload" in chosen else None,
        critical_speed() if "critical_speed" in chosen else None,
        safety(tightest) if "safety" in chosen else None,
        12.0,
    )
