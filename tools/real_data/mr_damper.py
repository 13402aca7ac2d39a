"""Magneto-rheological damper on a shaking table at constant current: motion given, force measured, on the bench of rotary.py.

The displacement comes at 100 Hz; a cubic between the samples stands for what is between them. The last rows, in which the table
stops, are left out. The model is a spring and a damper by least squares.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from real_study import Figure, Made, Series, Stretch, bench, noise_above, sloped
from scipy.io import loadmat

STEP_NS = 1_000_000
RATIO = 10
ROWS = 1490
DEVELOPMENT = ("ensaio1", "ensaio4", "ensaio9")
EVALUATION = ("ensaio6", "ensaio3")
PUBLISHED = {
    "ensaio6": {"fitted Coulomb": 18.0, "fitted Dahl": 13.6, "laws without a name": 11.6},
    "ensaio3": {"fitted Coulomb": 15.7, "fitted Dahl": 12.5, "laws without a name": 9.5},
}


def make(data: Path) -> Made:
    """The study."""
    runs = {name: _read(data / "mr_damper" / f"{name}.2.2.mat") for name in DEVELOPMENT + EVALUATION}
    step = STEP_NS / 1e9
    shaken = [runs[name][0] for name in DEVELOPMENT]
    motion = np.concatenate([np.stack([x, np.gradient(x, RATIO * step)], axis=1) for x in shaken])
    force = np.concatenate([runs[name][1] for name in DEVELOPMENT])
    k, c = np.linalg.lstsq(motion, force, rcond=None)[0]
    noise = noise_above(runs["ensaio1"][1], RATIO * step, 30.0)
    title = "Magneto-rheological damper: motion given, force measured"
    head = bench(title, STEP_NS, RATIO, (k, c), "N", f"{noise:.3f}     # rms of the force above 30 Hz, taken as white")
    stretches: list[Stretch] = []
    for name, (x, f) in runs.items():
        d, v = sloped(x, RATIO, step)
        role = "development" if name in DEVELOPMENT else "evaluation"
        stretches.append(Stretch(name, role, {"base.d": d, "base.v": v}, f))
    figures = [
        Figure(name, name, (0, ROWS), "share", "%", 100.0, min(PUBLISHED[name].values()), PUBLISHED[name])
        for name in EVALUATION
    ]
    return Made(head, STEP_NS, RATIO, "force", "N", stretches, figures)


def _read(path: Path) -> tuple[Series, Series]:
    """Displacement m, force N."""
    rows = loadmat(path)["x_F"][:ROWS]
    return 1e-3 * rows[:, 0], rows[:, 2]
