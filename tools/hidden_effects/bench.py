"""A bench: a model, where it is measured, what may be wrong with it and how it is driven. Cases differ in what is
hidden.

Eight chains of the oscillator FMU and the roller rig in two programmes. Nothing here is drawn per case.
"""

from __future__ import annotations

import tomllib
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from excitation import multisine, rate, sweep, tone

ROOT = Path(__file__).resolve().parents[2]
STEP = 1e-3
TONE, SWEEP, OSCILLATOR = "tone", "sweep", "oscillator"


@dataclass(frozen=True)
class Run:
    """One condition. inputs: FMU input -> (T,) in the FMU's unit, what the study commands. parameters: FMU start
    values."""

    name: str
    role: str
    inputs: Mapping[str, np.ndarray]
    quiet: tuple[float, float]
    start: float
    parameters: Mapping[str, float] = field(default_factory=dict)
    extra: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Bench:
    """channels: name -> FMU output. factor: from the FMU's unit to mm. units: of the inputs. joints, groups, rotations,
    adjustable: rows as the study writes them. parameters: what the study says of the model. fine: steps of the truth a
    sample. noise: mm, None where it is a share of the response."""

    name: str
    programme: str
    fmu: str
    channels: Mapping[str, str]
    factor: float
    units: Mapping[str, str]
    excitation: tuple[str, str]
    joints: tuple[dict, ...]
    groups: tuple[dict, ...]
    rotations: tuple[dict, ...]
    adjustable: tuple[dict, ...]
    parameters: Mapping[str, float]
    runs: tuple[Run, ...]
    fine: int
    noise: float | None = None
    nominal: Mapping[str, float] = field(default_factory=dict)

    @property
    def development(self) -> tuple[Run, ...]:
        return tuple(run for run in self.runs if run.role == "development")

    @property
    def loudest(self) -> tuple[Run, ...]:
        """Two development runs that are enough to choose a severity: on the rig's tone all are alike."""
        return self.development[:1] if self.programme == TONE else self.development[:2]

    def joint(self, name: str) -> dict:
        return next(joint for joint in self.joints if joint["name"] == name)

    def members(self, place: str) -> tuple[str, ...]:
        """The joints of a joint or group."""
        return next((tuple(g["joints"]) for g in self.groups if g["name"] == place), (place,))

    def value(self, parameter: str, parameters: Mapping[str, float]) -> float:
        """Of an FMU parameter."""
        return parameters.get(parameter, self.parameters.get(parameter, self.nominal.get(parameter, 0.0)))

    def stiffness(self, joint: str, parameters: Mapping[str, float]) -> float:
        """Of the model's own spring in a joint, N/m or N.m/rad; 0 where it has none."""
        value = lambda name: self.value(name, parameters)  # noqa: E731
        if self.programme == OSCILLATOR:
            return value(f"k{joint.split()[-1]}")
        if "mount" in joint:
            return value("yaw_damper_series" if "yaw" in joint else "lateral_damper_series")
        if joint.startswith("primary, lateral"):
            return 2.0 * (value("coil_ky") + value("bush_ky"))
        if joint.startswith("primary, yaw"):
            return 2.0 * value("primary_half_base") ** 2 * (value("coil_kx") + value("bush_kx"))
        return 2.0 * value("air_spring_ky") if joint == "secondary, lateral" else 0.0


@dataclass(frozen=True)
class Chain:
    """m kg, k N/m, c Ns/m of every mass and the joint before it; wall: k and c behind the last mass. drive: "base", or
    the mass that is pushed. reach: m, the largest displacement in the strongest run. band: Hz."""

    m: tuple[float, ...]
    k: tuple[float, ...]
    c: tuple[float, ...]
    wall: tuple[float, float]
    drive: str
    reach: float
    band: tuple[float, float]


CHAINS = {
    "two_on_base": Chain((1.2, 0.8), (1400.0, 900.0), (14.0, 9.0), (0.0, 0.0), "base", 4e-3, (1.0, 12.0)),
    "three_on_base": Chain(
        (1.5, 1.0, 0.8), (2500.0, 1600.0, 1100.0), (24.0, 15.0, 11.0), (0.0, 0.0), "base", 4e-3, (1.0, 12.0)
    ),
    "three_pushed": Chain(
        (1.0, 1.4, 0.9), (2000.0, 1500.0, 1800.0), (20.0, 14.0, 16.0), (0.0, 0.0), "mass3", 5e-3, (0.8, 13.0)
    ),
    "two_before_wall": Chain((1.0, 1.5), (1200.0, 800.0), (5.0, 4.0), (1500.0, 3.0), "mass1", 3e-3, (1.5, 13.0)),
    "three_heavy": Chain(
        (400.0, 300.0, 250.0), (8e5, 5e5, 4e5), (8000.0, 5000.0, 4000.0), (0.0, 0.0), "mass1", 2e-3, (1.0, 16.0)
    ),
    "two_soft": Chain((5.0, 4.0), (800.0, 500.0), (25.0, 16.0), (0.0, 0.0), "mass2", 2e-2, (0.4, 6.0)),
    "damper_light": Chain((1.0, 1.0), (1500.0, 0.0), (12.0, 30.0), (900.0, 6.0), "mass1", 4e-3, (1.5, 12.0)),
    "damper_heavy": Chain(
        (500.0, 400.0, 300.0), (1e6, 6e5, 0.0), (8000.0, 5000.0, 9000.0), (4e5, 2000.0), "mass1", 2e-3, (1.5, 14.0)
    ),
}
"""The last two have a joint that is a damper alone."""

SECONDS, REST = 12.0, 1.0
TOLERANCE = 0.02


@cache
def oscillator(name: str) -> Bench:
    """A chain as a bench, driven to its reach."""
    chain = CHAINS[name]
    n = len(chain.m)
    parameters = {"masses": float(n)}
    for i in range(n):
        parameters |= {f"m{i + 1}": chain.m[i], f"k{i + 1}": chain.k[i], f"c{i + 1}": chain.c[i]}
    if any(chain.wall):
        parameters |= {"k_end": chain.wall[0], "c_end": chain.wall[1]}
    joints = tuple(
        {
            **{"name": f"joint {i}", "force": f"joint{i}.f", "displacement": f"joint{i}.d"},
            **{"velocity": f"joint{i}.v", "nominal_force": f"joint{i}.F", "acceleration": f"mass{i}.a"},
        }
        for i in range(1, n + 1)
    )
    unsure = [key for key, value in parameters.items() if key != "masses" and value > 0.0]
    adjustable = tuple(
        {"parameter": key, "minimum": 0.2 * parameters[key], "maximum": 4.0 * parameters[key], "tolerance": TOLERANCE}
        for key in unsure
    )
    driven = "base.d" if chain.drive == "base" else f"{chain.drive}.f"
    return Bench(
        name=name,
        programme=OSCILLATOR,
        fmu="oscillator.fmu",
        channels={f"x{i}": f"mass{i}.x" for i in range(1, n + 1)},
        factor=1e3,
        units={"base.d": "m", "base.v": "m/s"} if chain.drive == "base" else {driven: "N"},
        excitation=(driven, "drive"),
        joints=joints,
        groups=({"name": "upper joints", "joints": ["joint 2", "joint 3"]},) if n == 3 and chain.k[2] > 0.0 else (),
        rotations=(),
        adjustable=adjustable,
        parameters=parameters,
        runs=_oscillator_runs(name, chain, parameters),
        fine=20,
    )


def _oscillator_runs(name: str, chain: Chain, parameters: dict[str, float]) -> tuple[Run, ...]:
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    low, high = chain.band
    swept = sweep(SECONDS, REST, low, high, STEP, 0.5)
    waves = [multisine(SECONDS, REST, low, high, STEP, rng) for _ in range(2)]
    linear = _peak_of_chain(chain, swept)
    reach = lambda wave, level: wave * level * chain.reach / _peak_of_chain(chain, wave)  # noqa: E731
    held_out = (
        ("sweep_middle", swept * 0.65 * chain.reach / linear)
        if zlib.crc32(name.encode()) % 2
        else ("random_other", reach(waves[1], 0.7))
    )
    table = (
        ("sweep_high", "development", swept * chain.reach / linear),
        ("sweep_low", "development", swept * 0.35 * chain.reach / linear),
        ("random", "development", reach(waves[0], 0.9)),
        (held_out[0], "evaluation", held_out[1]),
    )
    runs = []
    for key, role, wave in table:
        inputs = {"base.d": wave, "base.v": rate(wave, STEP)} if chain.drive == "base" else {f"{chain.drive}.f": wave}
        runs.append(Run(key, role, inputs, (0.0, REST - 0.05), REST))
    return tuple(runs)


def _peak_of_chain(chain: Chain, wave: np.ndarray) -> float:
    """Largest displacement of any mass for a drive `wave`, by the chain's frequency response."""
    n = len(chain.m)
    size = 1 << (2 * len(wave)).bit_length()
    w = 2.0 * np.pi * np.fft.rfftfreq(size, STEP)
    z = np.zeros((len(w), n, n), complex)
    impedance = [k + 1j * w * c for k, c in zip(chain.k, chain.c, strict=True)]
    for i in range(n):
        z[:, i, i] += impedance[i] - chain.m[i] * w**2
        if i:
            z[:, i - 1, i - 1] += impedance[i]
            z[:, i, i - 1] -= impedance[i]
            z[:, i - 1, i] -= impedance[i]
    z[:, n - 1, n - 1] += chain.wall[0] + 1j * w * chain.wall[1]
    push = np.zeros((len(w), n, 1), complex)
    if chain.drive == "base":
        push[:, 0, 0] = impedance[0]
    else:
        push[:, int(chain.drive[-1]) - 1, 0] = 1.0
    response = np.linalg.solve(z, push)[:, :, 0] * np.fft.rfft(wave, size)[:, None]
    return float(np.abs(np.fft.irfft(response, size, axis=0)[: len(wave)]).max())


@cache
def rig(programme: str) -> Bench:
    """The roller rig driven by the paper's tone at four speeds, or by sweeps at two amplitudes and two speeds."""
    text = (ROOT / "tools" / "virtual_rig" / "study_head.toml").read_text(encoding="utf-8")
    for mark in ("TITLE", "KIND", "EXCITATION"):
        text = text.replace(f"@{mark}@", "command")
    head = tomllib.loads(text.replace("@PARAMETERS@", ""))
    amplitude = 0.03  # deg
    if programme == TONE:
        rest, wave = 3.0, tone(12.0, 3.0, 2.0, STEP, 1.5)
        table = [
            (f"{v}", v, wave * amplitude, {"amplitude": amplitude, "frequency": 2.0}) for v in (300, 320, 340, 360)
        ]
        held_out = ("385", 385, wave * amplitude, {"amplitude": amplitude, "frequency": 2.0})
    else:
        rest, wave = 2.0, sweep(15.0, 2.0, 0.5, 10.0, STEP, 0.4)
        table = [
            (f"{v}_{level}", v, wave * share * amplitude, {"amplitude": share * amplitude})
            for v in (300, 360)
            for level, share in (("high", 1.5), ("low", 0.5))
        ]
        held_out = ("385_middle", 385, wave * amplitude, {"amplitude": amplitude})
    runs = tuple(
        Run(
            name,
            role,
            {"platform_yaw_input": series},
            (0.0, rest - 0.1),
            rest,
            {"speed": speed / 3.6},
            {"speed": float(speed), **extra},
        )
        for role, rows in (("development", table), ("evaluation", [held_out]))
        for name, speed, series, extra in rows
    )
    variables = tomllib.loads((ROOT / "fmus" / "roller_rig" / "variables.toml").read_text(encoding="utf-8"))["variable"]
    return Bench(
        name=f"rig_{programme}",
        programme=programme,
        fmu="roller_rig.fmu",
        channels={row["name"]: row["simulation"] for row in head["channels"]},
        factor=1.0,
        units={"platform_yaw_input": "deg"},
        excitation=("platform_yaw_input", "platform_yaw"),
        joints=tuple(head["joints"]),
        groups=tuple(head["groups"]),
        rotations=tuple(head["rotations"]),
        adjustable=tuple(head["adjustable"]),
        parameters={"platform_amplitude": 0.0, "equivalent_conicity": 0.10},
        runs=runs,
        fine=4,
        noise=0.02,
        nominal={row["name"]: row["start"] for row in variables if "start" in row},
    )


def bench(name: str) -> Bench:
    """A bench by its name."""
    return rig(name.removeprefix("rig_")) if name.startswith("rig_") else oscillator(name)
