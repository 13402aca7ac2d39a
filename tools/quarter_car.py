"""A quarter car over random roads, simulated and measured: python tools/quarter_car.py KIND --out DIR

DIR gets study.toml, of records, and study_fmu.toml, of the same measurements and the oscillator FMU, for `fmucorrect discover`.

KIND is what the model lacks: friction (70 N, rubbed at the damper), stop (a rubber stop, 60 kN/m beyond 12 mm either way) or
nothing. 16 s a drive at 500 Hz; roads of ISO 8608, class B, between 10 and 20 m/s to develop on, at 17 and 25 m/s to evaluate.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fmucorrect.records import writer
from fmucorrect.signals import Channel, Record

KINDS = ("friction", "stop", "nothing")
STEP, ROWS, PARTS = 2e-3, 8000, 10
SPRUNG, UNSPRUNG, SPRING, DAMPER, TYRE = 300.0, 40.0, 20e3, 1200.0, 180e3  # kg, N/m, N s/m
FRICTION, SLIDING = 70.0, 5e-3  # N, and m/s at which three quarters of it act
GAP, STOP = 12e-3, 60e3  # m, N/m
NOISE = 0.02  # mm rms
ROUGHNESS = 64e-6  # m3, at 0.1 cycles/m: class B
WAVE = 0.01  # cycles/m; longer waves are no rougher than that
TYRE_PATCH = 20.0  # Hz; shorter waves vanish under the tyre
DRIVES = (
    (10.0, "development"),
    (15.0, "development"),
    (20.0, "development"),
    (17.0, "evaluation"),
    (25.0, "evaluation"),
)
CHANNELS = ("body", "wheel", "travel")
FMU = Path(__file__).resolve().parent.parent / "fmus" / "oscillator" / "oscillator.fmu"
OUTPUTS = ("mass2.x", "mass1.x", "joint2.d")
"""The channels in the FMU: a chain of wheel and body on a base that is the road."""
PARAMETERS = f"{{ m1 = {UNSPRUNG}, k1 = {TYRE}, c1 = 0.0, masses = 2.0, m2 = {SPRUNG}, k2 = {SPRING}, c2 = {DAMPER} }}"
JOINTS = "".join(
    f'[[joints]]\nname = "{name}"\nforce = "joint{i}.f"\ndisplacement = "joint{i}.d"\nvelocity = "joint{i}.v"\n'
    f'nominal_force = "joint{i}.F"\nacceleration = "mass{i}.a"\n\n'
    for i, name in ((1, "tyre"), (2, "suspension"))
)


def road(speed: float, rng: np.random.Generator) -> Float64[np.ndarray, " T"]:
    """Height, m: white noise through a first-order lag, as the standard's spectrum asks."""
    from scipy.signal import butter, lfilter, sosfilt

    noise = rng.standard_normal(ROWS) / np.sqrt(STEP)
    gain = 2.0 * np.pi * 0.1 * np.sqrt(ROUGHNESS * speed)
    height = lfilter([STEP * gain], [1.0, STEP * 2.0 * np.pi * WAVE * speed - 1.0], noise)
    return np.asarray(sosfilt(butter(2, TYRE_PATCH, fs=1.0 / STEP, output="sos"), height))


def motion(height: Float64[np.ndarray, " T"], kind: str) -> Float64[np.ndarray, "T 3"]:
    """mm, of CHANNELS, from rest; semi-implicit Euler in PARTS of a step."""
    said, h = np.zeros((len(height), 3)), STEP / PARTS
    body, wheel, body_speed, wheel_speed = 0.0, 0.0, 0.0, 0.0
    for k, now in enumerate(height):
        said[k] = body, wheel, body - wheel
        after = height[min(k + 1, len(height) - 1)]
        for part in range(PARTS):
            under = now + (after - now) * (part + 0.5) / PARTS
            travel, speed = body - wheel, body_speed - wheel_speed
            force = SPRING * travel + DAMPER * speed
            if kind == "friction":
                force += FRICTION * np.tanh(speed / SLIDING)
            elif kind == "stop":
                force += STOP * (max(travel - GAP, 0.0) - max(-travel - GAP, 0.0))
            body_speed -= h * force / SPRUNG
            wheel_speed += h * (force - TYRE * (wheel - under)) / UNSPRUNG
            body, wheel = body + h * body_speed, wheel + h * wheel_speed
    return 1e3 * said


def write(folder: Path, kind: str, seed: int = 0) -> Path:
    """The studies and their records; the path of the study of records."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    lines = ["[records]", 'clock = "common"', ""]
    t_ns = np.arange(ROWS, dtype=np.int64) * round(STEP * 1e9)
    for speed, role in DRIVES:
        height = road(speed, rng)
        simulated, real = motion(height, "nothing"), motion(height, kind)
        measured = real + NOISE * rng.standard_normal(real.shape)
        for label, topic, prefix, values in (
            ("simulated", "/simulation", "", simulated),
            ("measured", "/measured", "lvdt_", measured),
        ):
            with writer(folder / f"{label}_{speed:g}.mcap") as out:
                out.write(topic, Record(t_ns, values, tuple(Channel(prefix + name, unit="mm") for name in CHANNELS)))
        held = (height + np.append(height[1:], height[-1])) / 2.0  # over a step, as the FMU holds its input
        with writer(folder / f"road_{speed:g}.mcap") as out:
            out.write("/road", Record(t_ns, held[:, None], (Channel("base.d", unit="m"),)))
        lines += ["[[conditions]]", f'name = "{speed:g} m/s"', f'role = "{role}"', f"speed = {3.6 * speed}"]
        lines += [f'measurement = "measured_{speed:g}.mcap"', f'simulated = "simulated_{speed:g}.mcap"', ""]
    text = "\n".join(lines)
    (folder / "study.toml").write_text(_head(kind, CHANNELS) + text, encoding="utf-8")
    head = _head(kind, OUTPUTS, f"fmu = {json.dumps(str(FMU))}\nparameters = {PARAMETERS}\n")
    driven = text.replace("simulated = ", "inputs = ").replace('"simulated_', '"road_')
    (folder / "study_fmu.toml").write_text(head + JOINTS + driven, encoding="utf-8")
    return folder / "study.toml"


def _head(kind: str, simulated: Sequence[str], model: str = "") -> str:
    """A study's, up to its channels. simulated: their names in the simulation."""
    lines = [
        "format = 1",
        f'name = "Quarter car, missing: {kind}"',
        "",
        "[simulation]",
        f"{model}step_size = {STEP}",
        "",
    ]
    for name, variable in zip(CHANNELS, simulated, strict=True):
        lines += ["[[channels]]", f'name = "{name}"', f'simulation = "{variable}"', f'measurement = "lvdt_{name}"']
        lines += ['quantity = "displacement"', 'unit = "mm"', ""]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make a study of a quarter car over random roads.")
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--out", type=Path, required=True, help="folder that gets the study")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(write(arguments.out, arguments.kind, arguments.seed))
