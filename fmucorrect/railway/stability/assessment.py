"""Critical speed of an FMU through a mapping: eigenvalues over speed, the paper's deceleration, and step-down.

The paper takes the speed at which a negligible lateral response becomes a sustained one (its section 4.1, 1124 km/h for its
vehicle). Here that value stands beside the linear critical speed and the bifurcation diagram of the same model, and beside
published ones with the conicity that they belong to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fmucorrect.brief import brief
from fmucorrect.railway.speed_parameter import SpeedParameter
from fmucorrect.railway.stability.bifurcation import Bifurcation, bifurcation
from fmucorrect.railway.stability.critical_speed import LinearStability, linear_stability
from fmucorrect.railway.stability.disturbance import Disturbance
from fmucorrect.railway.stability.limit_cycle import Deceleration, Observation, decelerate
from fmucorrect.railway.stability.linearisation import Lineariser, Method
from fmucorrect.railway.stability.ring_down import RingDown
from fmucorrect.railway.stability.speed_run import SpeedRun
from fmucorrect.signals import NANOSECONDS, Channel


@dataclass(frozen=True)
class Published:
    """A reference value: speed in m/s, kind "linear" or "nonlinear", the conicity that it belongs to (None: not said), and
    the relative tolerance within which it is to be met (None: only set beside)."""

    name: str
    speed: float
    kind: str = "nonlinear"
    conicity: float | None = None
    tolerance: float | None = None


@dataclass(frozen=True)
class DecelerationMapping:
    """highest, lowest: m/s. rate: m/s2. settling: s at the highest speed before it falls."""

    highest: float
    lowest: float
    rate: float
    settling: float = 10.0


@dataclass(frozen=True)
class BifurcationMapping:
    """speeds: m/s, rising. tolerance: m/s, of the speed where the limit cycle ends. small: share of the disturbance that the
    straight run is tried with. thresholds: at how many speeds the unstable branch is sought."""

    speeds: tuple[float, ...]
    tolerance: float
    small: float = 0.01
    thresholds: int = 0


@dataclass(frozen=True)
class CriticalSpeedMapping:
    """Which variables of an FMU are speed, lateral displacements and disturbance.

    parameters: start values. speeds: m/s, of the eigenvalues. method: of linearising, None for the first that the FMU allows.
    settle: s before each linearisation. states: names, for an FMU that does not list them. ring_down: for an FMU without
    states. conicity: equivalent conicity of these parameters, None where it is not known. outputs: the first one leads.
    flags: outputs that are not 0 where a motion is beyond the model.
    deceleration, bifurcation: None where they are not asked for.
    """

    speed: SpeedParameter
    speeds: tuple[float, ...]
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    method: Method | None = None
    settle: float = 0.0
    states: tuple[str, ...] = ()
    ring_down: RingDown | None = None
    conicity: float | None = None
    outputs: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    disturbance: Disturbance = field(default_factory=Disturbance)
    observation: Observation = field(default_factory=lambda: Observation(1e-4))
    deceleration: DecelerationMapping | None = None
    bifurcation: BifurcationMapping | None = None
    published: tuple[Published, ...] = ()

    @property
    def stages(self) -> int:
        """How often progress is told."""
        return 1 + (self.deceleration is not None) + (self.bifurcation is not None)


@dataclass(frozen=True)
class CriticalSpeedAssessment:
    """What was found; all speeds in m/s. deceleration, bifurcation: None where they were not asked for."""

    linear: LinearStability
    deceleration: Deceleration | None
    bifurcation: Bifurcation | None
    conicity: float | None
    published: tuple[Published, ...]

    __repr__ = brief

    def found(self, kind: str) -> float | None:
        """m/s, the critical speed of this kind: "linear"; "nonlinear" by step-down, else by deceleration; None if none."""
        if kind == "linear":
            return self.linear.critical_speed
        stepped = self.bifurcation.nonlinear_critical_speed if self.bifurcation else None
        slowed = self.deceleration.critical_speed if self.deceleration else None
        return slowed if stepped is None else stepped

    def met(self, published: Published) -> bool | None:
        """Whether a published value is met within its tolerance; None where it has none."""
        if published.tolerance is None:
            return None
        own = self.found(published.kind)
        return own is not None and abs(own - published.speed) <= published.tolerance * published.speed

    @property
    def raised(self) -> dict[str, float]:
        """By flag, m/s: the lowest speed at which it was not 0 in a motion that went on."""
        stepped = self.bifurcation.down + self.bifurcation.up if self.bifurcation else ()
        seen = [(motion.speed, motion.raised) for motion in stepped if motion.alive]
        if self.deceleration is not None:
            seen += zip(self.deceleration.speeds, self.deceleration.raised, strict=True)
        names = dict.fromkeys(name for _, raised in seen for name in raised)
        return {name: min(speed for speed, raised in seen if name in raised) for name in names}

    @property
    def passed(self) -> bool:
        """Whether the vehicle is stable at the lowest speed and nowhere falls over, and every published value with a
        tolerance is met."""
        stable = self.linear.stable_at_lowest and self.linear.divergent_from is None
        return stable and all(self.met(item) is not False for item in self.published)

    def to_json(self) -> dict[str, Any]:
        """For programs; speeds in m/s."""
        return {
            "passed": self.passed,
            "linear_critical_speed": self.found("linear"),
            "nonlinear_critical_speed": self.found("nonlinear"),
            "divergent_from": self.linear.divergent_from,
            "flags": self.raised,
            "conicity": self.conicity,
            "published": [asdict(item) | {"met": self.met(item)} for item in self.published],
            "linear": asdict(self.linear),
            "deceleration": None if self.deceleration is None else asdict(self.deceleration),
            "bifurcation": None if self.bifurcation is None else asdict(self.bifurcation),
        }


def assess_critical_speed(
    mapping: CriticalSpeedMapping,
    fmu: Path,
    step_ns: int,
    parameters: Mapping[str, float],
    advance: Callable[[int], object] = lambda _: None,
) -> CriticalSpeedAssessment:
    """Linearise over the speeds, then decelerate and step down where these are mapped; advance(1) after each.

    parameters: start values of the whole mapping file. Raises what linearising and running raise.
    """
    step, start = step_ns / NANOSECONDS, {**parameters, **mapping.parameters}
    with Lineariser(
        fmu,
        start=start,
        settle=mapping.settle,
        states=mapping.states,
        ring_down=mapping.ring_down,
        method=mapping.method,
        step_size=step,
    ) as model:
        linear = linear_stability(model, mapping.speed, mapping.speeds)
    advance(1)
    slowed: Deceleration | None = None
    stepped: Bifurcation | None = None
    if mapping.deceleration is not None or mapping.bifurcation is not None:
        channels = tuple(Channel(name, unit="") for name in mapping.outputs)
        with SpeedRun(
            fmu, mapping.speed, channels, mapping.disturbance, start=start, step_size=step, flags=mapping.flags
        ) as run:
            if mapping.deceleration is not None:
                slowed = decelerate(run, mapping.observation, **asdict(mapping.deceleration))
                advance(1)
            if mapping.bifurcation is not None:
                how = mapping.bifurcation
                stepped = bifurcation(
                    run,
                    mapping.observation,
                    how.speeds,
                    tolerance=how.tolerance,
                    small=how.small,
                    thresholds=how.thresholds,
                    linear=linear.critical_speed,
                )
                advance(1)
    return CriticalSpeedAssessment(linear, slowed, stepped, mapping.conicity, mapping.published)


def spread(lowest: float, highest: float, count: int) -> tuple[float, ...]:
    """`count` speeds from lowest to highest."""
    return tuple(np.linspace(lowest, highest, count).tolist())
