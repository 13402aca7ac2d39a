"""A plant of another kind: one mass on a spring over a random road, no speed, no excitation that is recorded; what is measured
has friction that the simulation lacks, or is only filtered, or is the simulation itself."""

from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from fmucorrect.records import writer
from fmucorrect.signals import Channel, Record
from fmucorrect.study_training import Corrector, Recurrent, Training

STEP = 0.01
NOISE = 0.02
QUICK = Training(
    window=20,
    corrector=Corrector(families=("amplitude", "linear", "recurrent")),
    recurrent=Recurrent(steps=(200,), width=16, members=2),
)
HEAD = """format = 1
name = "one mass over a road"

[simulation]
step_size = 0.01

[[channels]]
name = "travel"
simulation = "z"
measurement = "lvdt"
quantity = "displacement"
unit = "mm"

[records]
clock = "common"
"""


def motion(road: np.ndarray, friction: float = 0.0) -> np.ndarray:
    """mm; m z'' + c z' + k z + friction sign(z') = k road, 1 kg, 1.5 Hz, 15 % damping; friction in mm/s2."""
    omega, h, part = 2 * np.pi * 1.5, STEP / 10, 10
    z, v, said = 0.0, 0.0, np.zeros(len(road))
    for i, r in enumerate(road):
        said[i] = z
        for _ in range(part):
            v += h * (omega**2 * (r - z) - 2 * 0.15 * omega * v - friction * np.tanh(v / 1.0))
            z += h * v
    return said


def make(folder: Path, what: str, unit: str = "mm", count: int = 4, noise: float = NOISE) -> Path:
    """what: "friction", "filtered" (a sensor with a low pass and another gain), "creep"
    (what yields over fifty samples) or "nothing". The last record is held out."""
    rng = np.random.default_rng(3)
    text = HEAD.replace('unit = "mm"', f'unit = "{unit}"')
    factor = {"mm": 1.0, "m": 1e-3}[unit]
    for i in range(count):
        rough = np.asarray(lfilter([0.05], [1.0, -0.95], rng.normal(scale=40.0, size=2000)))
        simulated = motion(rough)
        if what == "friction":
            real = motion(rough, 300.0)
        elif what == "filtered":
            real = np.asarray(lfilter([0.3 * 0.9], [1.0, -0.7], simulated))
        elif what == "creep":
            real = simulated + np.asarray(lfilter([0.02], [1.0, -0.98], simulated))
        else:
            real = simulated
        real = real + noise * rng.normal(size=len(real))
        t_ns = np.arange(len(rough), dtype=np.int64) * round(STEP * 1e9)
        for name, topic, column, values in (
            (f"s{i}.mcap", "/simulation", "z", simulated),
            (f"m{i}.mcap", "/measured", "lvdt", real),
        ):
            with writer(folder / name) as out:
                out.write(topic, Record(t_ns, factor * values[:, None], (Channel(column, unit=unit),)))
        role = "evaluation" if i == count - 1 else "development"
        text += f'\n[[conditions]]\nname = "road {i}"\nrole = "{role}"\nmeasurement = "m{i}.mcap"\nsimulated = "s{i}.mcap"\n'
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"
