"""Draws virtual rigs at random: what is hidden in each follows from its seed alone, and is told in words and numbers.

Severities are those of rigs A to C and what the roller rig's joints feel at 2 Hz: at the secondary stage 2 mm, 0.02 m/s and
0.6 kN, at a yaw damper 1 mm, 0.013 m/s and 4 kN, in an axle's guidance 0.2 mrad and 7 kN m, twice that in the surge.
Left out of plant.LAWS is added_mass, for which rig.c has no force. A drawn rig that diverges or goes on moving after the
excitation has stopped is drawn again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from generate import AMPLITUDE, FREQUENCY, SPEEDS, STEP, hidden_effects
from plant import ROOT, Plant, read_model

Rng = np.random.Generator
CONICITY = 0.10  # of the users' model
ROLLER_RADIUS = 0.685  # m
TRIES = 50
SETTLE = 10.0  # s at rest before a record begins
MARGIN = 1.05  # of the highest speed, up to which a rig must be stable
KICK = 1.1  # times the surge, which a rig must get over
HUNTING = 0.02  # mm peak to peak that may be left 8 to 10 s after the excitation
UNSURE = (
    *("f11", "f22", "f23", "coil_ky", "bush_kx", "bush_ky", "air_spring_kx", "air_spring_ky", "lateral_damper_c1"),
    *("yaw_damper_series", "car_mass", "frame_mass", "frame_Izz", "wheelset_mass", "wheelset_Izz"),
)  # base parameters, 2 to 5 % of which nobody knows


@dataclass(frozen=True)
class Drawn:
    """rig: what generate.write takes. story: a line for each thing that is hidden. rejected: why earlier draws were."""

    seed: int
    rig: dict
    story: tuple[str, ...]
    rejected: tuple[str, ...]


class Settled:
    """A plant that has stood at rest for SETTLE s before the record begins, so that a preload shows no start."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant

    def run(self, parameters, effects, command, columns, step=STEP, substeps=10) -> np.ndarray:
        """As Plant.run."""
        before = np.zeros(round(SETTLE / step))
        wave = np.concatenate([before, command])
        return self._plant.run(parameters, effects, wave, columns, step, substeps)[len(before) :]


def draw(seed: int, plant: Plant) -> Drawn:
    """The rig of a seed: the first of its draws that is stable. Raises ArithmeticError where TRIES draws are not."""
    rejected: list[str] = []
    for attempt in range(TRIES):
        rig, story = propose(seed, attempt)
        trouble = instability(rig, plant)
        if trouble is None:
            return Drawn(seed, rig, tuple(story), tuple(rejected))
        rejected.append(f"draw {attempt}: {trouble}")
    raise ArithmeticError(f"seed {seed}: no stable rig in {TRIES} draws")


def propose(seed: int, attempt: int) -> tuple[dict, list[str]]:
    """One draw: the rig, and its story. Whether it is stable is not known yet."""
    rng = np.random.default_rng([seed, attempt])
    nominal = {item.name: item.start for item in read_model(ROOT / "fmus" / "roller_rig" / "variables.toml").variables}
    nominal["equivalent_conicity"] = CONICITY
    physical: dict[str, float] = {}
    names = ["equivalent_conicity", *rng.choice(UNSURE, int(rng.integers(5, 10)), replace=False).tolist()]
    for name in names:
        physical[name] = rounded(nominal[name] * (1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.02, 0.05)))
    story: list[str] = []
    value = lambda name: physical.get(name, nominal[name])  # noqa: E731
    first = rng.integers(MAIN)
    second = rng.choice([i for i in range(len(STORIES)) if i != first])
    for i in [first, second][: rng.integers(1, 3)]:
        text, change = STORIES[i](rng, value)
        physical |= {name: rounded(number) for name, number in change.items()}
        story.append(text + ": " + ", ".join(f"{name} {physical[name]:g}" for name in change))
        names = [name for name in names if name not in change]
    story.append("errors of 2 to 5 %: " + ", ".join(f"{name} {physical[name]:g}" for name in names))
    effects = []
    laws = sorted({kind.law for kind in KINDS})
    for law in rng.choice(laws, int(rng.integers(1, 4)), replace=False):
        kinds = [kind for kind in KINDS if kind.law == law]
        kind = kinds[rng.integers(len(kinds))]
        effects.append(kind.draw(rng, value))
        numbers = ", ".join(f"{key} {v:g}" for key, v in effects[-1].items() if key not in ("law", "joint"))
        story.append(f"{kind.words}: {law} at {effects[-1]['joint']}, {numbers}")
    recorded = str(rng.choice(["command", "actual"]))
    band = (40.0, 80.0) if recorded == "command" else (20.0, 40.0)  # Hz
    physical["platform_bandwidth"] = rounded(rng.uniform(*band))
    rig = {
        "title": f"Roller rig {seed}, 2 Hz yaw excitation",
        "seed": int(rng.integers(2**31)),
        "surge": round(float(rng.uniform(1.0, 2.0)), 2),
        "excitation_kind": recorded,
        "epoch": int(rng.choice([0, 1767225600])),
        "clock_offset": 0.35,
        "model": {"equivalent_conicity": CONICITY},
        "physical": physical,
        "effects": effects,
        "rotation": {"radius": ROLLER_RADIUS},
        "sensors": {
            "gain": rng.uniform(0.994, 1.006, 4).round(4).tolist(),
            "lag": round(float(rng.uniform(0.0004, 0.0014)), 5),
            "noise": 0.020,
            "offset": rng.uniform(-0.025, 0.025, 4).round(4).tolist(),
        },
    }
    return rig, story


def rounded(value: float) -> float:
    """To four digits, as a person would write it."""
    return float(f"{value:.4g}")


def instability(rig: dict, plant: Plant) -> str | None:
    """What is unstable about a rig, None where nothing is: 2 s of KICK times its surge, then 10 s of rest, at every
    speed and MARGIN beyond the highest. Forces that turn with the rollers are left out, since they never stop."""
    t = np.arange(round(12.0 / STEP)) * STEP
    wave = np.where(t < 2.0, KICK * rig["surge"] * AMPLITUDE * np.sin(2.0 * np.pi * FREQUENCY * t), 0.0)
    for speed in (*SPEEDS, MARGIN * max(SPEEDS)):
        effects = [effect for effect in hidden_effects(rig, speed / 3.6) if effect.law != "periodic_force"]
        parameters = {**rig["physical"], "speed": speed / 3.6, "platform_amplitude": 0.0}
        try:
            end = Settled(plant).run(parameters, effects, wave, ["FW", "FB", "RW", "RB"])[-round(2.0 / STEP) :]
        except ArithmeticError:
            return f"diverges at {speed:g} km/h"
        if np.ptp(end, axis=0).max() > HUNTING:
            return f"moves by {np.ptp(end, axis=0).max():.2g} mm at {speed:g} km/h 8 to 10 s after the excitation"
    return None


Value = Callable[[str], float]
"""The physical rig's value of a parameter, so far."""


def either(rng: Rng, *ranges: tuple[float, float]) -> float:
    """Uniform from one of several ranges."""
    return float(rng.uniform(*ranges[rng.integers(len(ranges))]))


def _yaw_dampers(rng: Rng, value: Value) -> tuple[str, dict]:
    if rng.random() < 0.5:
        left, right = rng.uniform(0.32, 0.75) * rng.uniform(0.95, 1.05, 2)
        return "worn yaw dampers", {"yaw_damper_left_scale": left, "yaw_damper_right_scale": right}
    good = rng.uniform(0.6, 1.0)
    left, right = rng.permutation([good, good * rng.uniform(0.5, 0.8)])
    return "unequal yaw dampers", {"yaw_damper_left_scale": left, "yaw_damper_right_scale": right}


def _conicity(rng: Rng, value: Value) -> tuple[str, dict]:
    return "wheels of another conicity", {"equivalent_conicity": either(rng, (0.07, 0.09), (0.11, 0.14))}


def _contaminated(rng: Rng, value: Value) -> tuple[str, dict]:
    factor = rng.uniform(0.6, 0.85)
    creep = {name: factor * value(name) for name in ("f11", "f22", "f23")}
    return "contaminated rollers", {**creep, "friction": rng.uniform(0.2, 0.3)}


def _rod_bush(rng: Rng, value: Value) -> tuple[str, dict]:
    factor = either(rng, (0.6, 0.85), (1.15, 1.4))
    return "aged rod bushes", {"bush_kx": factor * value("bush_kx"), "bush_ky": factor * value("bush_ky")}


def _soft_mounts(rng: Rng, value: Value) -> tuple[str, dict]:
    return "soft yaw damper mounts", {"yaw_damper_series": rng.uniform(0.6, 0.85) * value("yaw_damper_series")}


def _air_springs(rng: Rng, value: Value) -> tuple[str, dict]:
    factor = either(rng, (0.6, 0.8), (1.25, 1.6))
    return "other air springs", {name: factor * value(name) for name in ("air_spring_kx", "air_spring_ky")}


def _lateral_dampers(rng: Rng, value: Value) -> tuple[str, dict]:
    front, rear = rng.uniform(0.4, 0.8, 2)
    return "worn lateral dampers", {"lateral_damper_front_scale": front, "lateral_damper_rear_scale": rear}


STORIES: tuple[Callable[[Rng, Value], tuple[str, dict]], ...] = (
    _yaw_dampers, _conicity, _contaminated, _rod_bush, _soft_mounts, _air_springs, _lateral_dampers,
)  # fmt: skip
MAIN = 4  # the first of these; each rig has one of them


@dataclass(frozen=True)
class Kind:
    """A hidden effect that may be drawn. joints: where, each with the parameter whose physical value multiplies a, "" for
    none. a, b: ranges of rig.c's numbers, SI; slip: m or rad of presliding, from which friction has its b = a / slip."""

    words: str
    law: str
    joints: tuple[tuple[str, str], ...]
    a: tuple[tuple[float, float], ...]
    b: tuple[float, float] | None = None
    slip: tuple[float, float] | None = None

    def draw(self, rng: Rng, value: Value) -> dict:
        """One of this kind, as an entry of a rig's [[effects]]."""
        joint, scale = self.joints[rng.integers(len(self.joints))]
        entry = {"law": self.law, "joint": joint, "a": rounded(either(rng, *self.a) * (value(scale) if scale else 1.0))}
        if self.b is not None:
            entry["b"] = rounded(rng.uniform(*self.b))
        if self.slip is not None:
            entry["b"] = rounded(entry["a"] / rng.uniform(*self.slip))
        if self.law == "periodic_force":
            entry |= {"order": float(rng.integers(1, 3)), "c": rounded(rng.uniform(0.0, 6.28))}
        return entry


def ends(joint: str, scale: str = "", kind: tuple[str, str] = ("front", "rear")) -> tuple[tuple[str, str], ...]:
    """A joint that is there twice, and its parameter."""
    return tuple((joint.format(end), scale.format(end)) for end in kind)


def both(low: float, high: float) -> tuple[tuple[float, float], ...]:
    """A range and its negative."""
    return ((-high, -low), (low, high))


SIDES = ("left", "right")
AT_SECONDARY = (("secondary_lateral", ""),)
AT_GUIDANCE = ends("primary_yaw_{}")
KINDS = (
    Kind("a stiff hose beside the air springs", "linear_stiffness", AT_SECONDARY, ((3e4, 1.5e5),)),
    Kind("one axle guided otherwise", "linear_stiffness", AT_GUIDANCE, both(3e6, 9e6)),
    Kind("damping in the air springs", "viscous_damping", AT_SECONDARY, ((5e3, 25e3),)),
    Kind("damping in one axle's guidance", "viscous_damping", AT_GUIDANCE, ((3e5, 1e6),)),
    Kind("a progressive axle guidance", "cubic_stiffness", AT_GUIDANCE, ((5e13, 2e14),)),
    Kind("progressive air springs", "cubic_stiffness", AT_SECONDARY, ((5e9, 3e10),)),
    Kind("throttling at the air springs", "quadratic_damping", AT_SECONDARY, ((2e5, 8e5),)),
    Kind("a throttling yaw damper", "quadratic_damping", ends("yaw_damper_{}", "", SIDES), ((2e6, 8e6),)),
    Kind("friction in the secondary stage", "coulomb_friction", AT_SECONDARY, ((150.0, 800.0),), slip=(1.5e-4, 4e-4)),
    Kind("friction at the pivot", "coulomb_friction", (("secondary_yaw", ""),), ((200.0, 1200.0),), slip=(1e-4, 2e-4)),
    Kind("friction in one axle's guidance", "coulomb_friction", AT_GUIDANCE, ((500.0, 2500.0),), slip=(2e-5, 5e-5)),
    Kind(
        "play in a yaw damper's mount", "backlash",
        ends("yaw_damper_{}_mount", "yaw_damper_series", SIDES), ((1.0, 1.0),), (0.4e-4, 1.5e-4),
    ),
    Kind(
        "play in a lateral damper's mount", "backlash",
        ends("lateral_damper_{}_mount", "lateral_damper_series"), ((1.0, 1.0),), (0.5e-4, 2e-4),
    ),
    Kind("a lateral stop that is too near", "bump_stop", AT_SECONDARY, ((0.3e6, 1e6),), (1e-3, 2e-3)),
    Kind(
        "a yaw damper that pulls harder than it pushes, or the other way", "damper_asymmetry",
        ends("yaw_damper_{}", "yaw_damper_{}_scale", SIDES), both(1.2e5, 3e5),
    ),
    Kind(
        "a lateral damper that pulls harder than it pushes, or the other way", "damper_asymmetry",
        ends("lateral_damper_{}"), both(8e3, 24e3),
    ),
    Kind("gas pressure in a yaw damper", "preload", ends("yaw_damper_{}", "", SIDES), both(500.0, 2000.0)),
    Kind("an axle that is not square", "preload", AT_GUIDANCE, both(2e3, 6e3)),
    Kind("rollers out of round", "periodic_force", ends("contact_lateral_{}"), ((200.0, 1000.0),)),
    Kind("hysteresis of the air springs", "bouc_wen_hysteresis", AT_SECONDARY, ((5e4, 2e5),), (0.5e-3, 2e-3)),
    Kind("hysteresis of one axle's guidance", "bouc_wen_hysteresis", AT_GUIDANCE, ((5e6, 1.5e7),), (0.5e-4, 1.5e-4)),
)  # fmt: skip
