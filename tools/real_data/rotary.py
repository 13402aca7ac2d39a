"""Banded rotary friction device: its motion given, its force measured, as a study on joint 1 between a base and a rest.

Units are converted to SI. The motion drives the base, the mass at the joint's other end does not move (1e15 kg), and what is
measured is base.F; the device's displacement x is -joint1.d, so both the joint's displacement and its force have the
other sign. base.v is the mean velocity over each step, so that what integrates it arrives where the base is.
1024 Hz are no whole number of nanoseconds: samples are taken to be 976 562 ns apart, frequencies come out 5e-7 too high.

Development: the runs at 30 lb of band tension, the only one with two amplitudes and two frequencies. Evaluation: the
earthquakes. The model is a spring and a damper by least squares, as who knows no more would have it.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from real_study import Figure, Made, Series, Stretch, bench, noise_above, sloped

from fmucorrect import units

STEP_NS = 488_281
RATIO = 2
DEVELOPMENT = {
    "1Hz_small": "dataset-2_char_1Hz30lbtension0.5amplitude",
    "1Hz_large": "dataset-2_char_1Hz30lbtension1amplitude",
    "2Hz_small": "dataset-2_char_2Hz30lbtension0.5amplitude",
}
EVALUATION = {
    "ImperialValley": "dataset-2_quake_ImperialValleyMCE",
    "Kocaeli": "dataset-2_quake_KocaeliDBE",
}
METRES = units.conversion("in", "m", "displacement")
NEWTONS = units.conversion("kip", "N", "force")


def make(data: Path) -> Made:
    """The study."""
    folder = data / "friction_damper_backlash"
    runs = {name: _read(folder / f"{file}.json") for name, file in (DEVELOPMENT | EVALUATION).items()}
    motion = np.concatenate([np.stack([runs[name][0], runs[name][1]], axis=1) for name in DEVELOPMENT])
    force = np.concatenate([runs[name][2] for name in DEVELOPMENT])
    k, c = np.linalg.lstsq(motion, force, rcond=None)[0]
    noise = 1e-3 * noise_above(runs["1Hz_large"][2], STEP_NS * RATIO / 1e9, 300.0)
    title = "Banded rotary friction device: motion given, force measured"
    head = bench(
        title, STEP_NS, RATIO, (k, c), "kN", f"{noise:.4f}     # rms of the force above 300 Hz, taken as white"
    )
    stretches: list[Stretch] = []
    for name, (x, _, f) in runs.items():
        d, v = sloped(x, RATIO, STEP_NS / 1e9)
        role = "development" if name in DEVELOPMENT else "evaluation"
        stretches.append(Stretch(name, role, {"base.d": d, "base.v": v}, f))
    # published for the two together: 75 to 140 %
    figures = [
        Figure(name, name, (0, len(runs[name][2])), "share", "%", 100.0, 75.0, {"best published": 75.0, "worst": 140.0})
        for name in EVALUATION
    ]
    return Made(head, STEP_NS, RATIO, "force", "N", stretches, figures)


def _read(path: Path) -> tuple[Series, Series, Series]:
    """Displacement m, velocity m/s, force N."""
    rows = np.array(json.loads(path.read_text(encoding="utf-8"))["data"])
    return rows[:, 1] * METRES, rows[:, 3] * METRES, rows[:, 2] * NEWTONS
