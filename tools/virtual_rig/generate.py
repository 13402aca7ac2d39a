"""Makes the measured-like records of the virtual rigs: python tools/virtual_rig/generate.py [A B C]

Each rig of this folder (<rig>.toml says what is hidden in it) becomes fmus/roller_rig/<rig>/: the platform's command, one
measured MCAP a condition, as an acquisition system would have written it, and study.toml, which says nothing of what is
hidden. Same seeds, same files.
"""

from __future__ import annotations

import argparse
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from plant import ROOT, HiddenEffect, Plant
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, lfilter

from fmucorrect.records import writer
from fmucorrect.signals import NANOSECONDS, Channel, Record

STEP = 1e-3
CHANNELS = ("FW", "FB", "RW", "RB")
SPEEDS = (300.0, 320.0, 340.0, 360.0, 385.0)
AMPLITUDE, FREQUENCY, START, STOP, END = 0.03, 2.0, 10.0, 20.0, 30.0
# the frame's front accelerometer is a good one; the others suffer from range, mounting and axis (paper, appendix B)
ACCELERATION_NOISE = (0.9, 0.02, 0.9, 0.35)  # m/s2 rms
ACCELERATION_AXIS = (0.15, 1.0, 0.12, 0.2)  # share of the lateral acceleration that the sensor's axis catches
LVDT_RESOLUTION = 2.0**-8  # mm
ACCELERATION_RESOLUTION = 2.0**-5  # m/s2
YAW_RESOLUTION = 2.0**-16  # deg


@dataclass(frozen=True)
class Run:
    """One condition: name, speed km/h, the platform's command (T,) deg at STEP, and what the study says of it."""

    name: str
    speed: float
    command: np.ndarray
    inputs: str
    role: str
    extra: str


def tone(amplitude: float, surge: float, frequency: float = FREQUENCY) -> np.ndarray:
    """The paper's excitation: 10 s of rest, 10 s of a sine, 10 s of rest; its first cycle is the platform's surge."""
    t = np.arange(round(END / STEP) + 1) * STEP
    wave = amplitude * np.sin(2.0 * np.pi * frequency * (t - START))
    wave[(t < START) | (t >= STOP)] = 0.0
    wave[(t >= START) & (t < START + 1.0 / frequency)] *= surge
    return wave


def sweep(amplitude: float) -> np.ndarray:
    """0.5 to 8 Hz in 40 s, exponentially, the amplitude falling as 1/sqrt(f); 10 s of rest before, 10 s after."""
    t = np.arange(round(60.0 / STEP) + 1) * STEP
    s = np.clip((t - 10.0) / 40.0, 0.0, 1.0)
    rate = np.log(16.0)
    phase = 2.0 * np.pi * 0.5 * 40.0 * (np.exp(rate * s) - 1.0) / rate
    wave = amplitude * np.exp(-0.5 * rate * s) * np.sin(phase) * np.minimum(1.0, (1.0 - s) * 40.0)
    wave[(t < 10.0) | (t >= 50.0)] = 0.0
    return wave


def runs(rig: dict) -> list[Run]:
    """The conditions of one rig."""
    single = tone(AMPLITUDE, rig["surge"])
    extra = f"amplitude = {AMPLITUDE}\nfrequency = {FREQUENCY}\nstart = {START}\nquiet = [0.0, 9.5]"
    result = [
        Run(f"{v:.0f}", v, single, "platform_yaw.csv", "development" if v < 385.0 else "evaluation", extra)
        for v in SPEEDS
    ]
    for amplitude in rig.get("sweeps", []):
        wave = sweep(amplitude)
        name = f"sweep_{1000 * amplitude:.0f}mdeg"
        rest = f"amplitude = {amplitude}\nstart = 10.0\nquiet = [0.0, 9.5]"
        result += [Run(f"{v:.0f}_{name}", v, wave, f"{name}.csv", "development", rest) for v in (300.0, 360.0)]
    return result


def hidden_effects(rig: dict, speed: float) -> list[HiddenEffect]:
    """The rig's hidden effects at a speed in m/s; what turns with the rollers gets its frequency here."""
    effects = []
    for entry in rig["effects"]:
        entry = dict(entry)
        if "order" in entry:
            entry["b"] = entry.pop("order") * speed / (2.0 * np.pi * rig["rotation"]["radius"])
        effects.append(HiddenEffect(**entry))
    return effects


def measure(rig: dict, plant: Plant, run: Run, rng: np.random.Generator) -> Record:
    """What the acquisition recorded of one run."""
    speed = run.speed / 3.6
    effects = hidden_effects(rig, speed)
    columns = [*CHANNELS, *(f"acc_{name}" for name in CHANNELS), "platform_yaw"]
    parameters = {**rig["physical"], "speed": speed, "platform_amplitude": 0.0}
    truth = plant.run(parameters, effects, run.command, columns, STEP, substeps=10)
    sensors = rig["sensors"]
    offset = rng.uniform(-rig["clock_offset"], rig["clock_offset"])  # s, of the first sample
    t = np.arange(len(truth)) * STEP
    command_or_actual = run.command if rig["excitation_kind"] == "command" else truth[:, 8]
    response = make_interp_spline(t, np.column_stack([truth[:, :8], command_or_actual]), k=3)
    held = lambda at: response(np.clip(at, 0.0, t[-1]))  # noqa: E731
    at = t + offset
    displacement = held(at - sensors["lag"])[:, :4] * sensors["gain"] + sensors["offset"]
    displacement += sensors["noise"] * rng.standard_normal(displacement.shape)
    # accelerometers have a 200 Hz low-pass of second order; the wheels' own vibration is noise to them
    acceleration = held(at)[:, 4:8] * ACCELERATION_AXIS + ACCELERATION_NOISE * rng.standard_normal((len(t), 4))
    acceleration = lfilter(*butter(2, 200.0, fs=1.0 / STEP), acceleration, axis=0)
    yaw = held(at)[:, 8:] + 2e-5 * rng.standard_normal((len(t), 1))
    rounded = [
        np.round(values / step) * step
        for values, step in (
            (displacement, LVDT_RESOLUTION),
            (acceleration, ACCELERATION_RESOLUTION),
            (yaw, YAW_RESOLUTION),
        )
    ]
    channels = (
        *(Channel(f"lvdt_{name}", "mm", "displacement") for name in CHANNELS),
        *(Channel(f"acc_{name}", "m/s2", "acceleration") for name in CHANNELS),
        Channel("platform_yaw", "deg", "angle"),
    )
    t_ns = rig["epoch"] * NANOSECONDS + np.arange(len(t), dtype=np.int64) * round(STEP * NANOSECONDS)
    return Record(t_ns, np.concatenate(rounded, axis=1), channels)


def study(rig: dict, items: list[Run]) -> str:
    """The study file of one rig."""
    head = Path(__file__).with_name("study_head.toml").read_text(encoding="utf-8")
    head = head.replace("@TITLE@", rig["title"]).replace("@KIND@", rig["excitation_kind"])
    excitation = "platform_yaw_input" if rig["excitation_kind"] == "command" else "platform_yaw"
    head = head.replace("@EXCITATION@", excitation)
    parameters = {"platform_amplitude": 0.0, **rig["model"]}
    head = head.replace("@PARAMETERS@", ", ".join(f"{key} = {value}" for key, value in parameters.items()))
    conditions = [
        f'\n[[conditions]]\nname = "{run.name}"\nrole = "{run.role}"\nspeed = {run.speed}\n{run.extra}\n'
        f'parameters = {{ speed = {run.speed / 3.6:.9f} }}\ninputs = "{run.inputs}"\nmeasurement = "measured_{run.name}.mcap"\n'
        for run in items
    ]
    training = "".join(_toml(name, rig[name]) for name in ("training", "training.corrector") if name in rig)
    return head + training + "".join(conditions)


def _toml(name: str, table: dict) -> str:
    """A table of plain numbers."""
    return f"\n[{name}]\n" + "".join(f"{key} = {value}\n" for key, value in table.items())


def make(name: str) -> None:
    """Write everything of one of this folder's rigs."""
    rig = tomllib.loads(Path(__file__).with_name(f"{name}.toml").read_text(encoding="utf-8"))
    write(rig, ROOT / "fmus" / "roller_rig" / name, Plant("roller_rig"))


def write(rig: dict, place: Path, plant: Plant) -> None:
    """Write the platform's commands, the measurements and study.toml of a rig into the folder `place`."""
    place.mkdir(parents=True, exist_ok=True)
    for old in place.glob("measured_*.mcap"):
        old.unlink()
    rng = np.random.default_rng(rig["seed"])
    items = runs(rig)
    for inputs, command in {run.inputs: run.command for run in items}.items():
        write_command(place / inputs, command)
    for run in items:
        with writer(place / f"measured_{run.name}.mcap") as out:
            out.write("/measured", measure(rig, plant, run, rng))
    (place / "study.toml").write_text(study(rig, items), encoding="utf-8", newline="\n")


def write_command(path: Path, command: np.ndarray) -> None:
    """Write the platform's command (T,), deg at STEP, as the FMU's input: from just before its motion to just behind."""
    moving = np.flatnonzero(command)
    rows = range(moving[0] - 1, moving[-1] + 2)
    lines = ["time,platform_yaw_input [deg]", *(f"{row * STEP:.3f},{command[row]:.9g}" for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make the measurements of the virtual rigs.")
    parser.add_argument("rigs", nargs="*", default=["A", "B", "C"])
    for rig_name in parser.parse_args().rigs:
        make(rig_name)
        print(f"rig {rig_name} made")
