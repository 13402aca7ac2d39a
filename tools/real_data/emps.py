"""Electro-mechanical positioning system: one slide on a ball screw, its motion given, the motor's force measured.

On the bench of rotary.py; the force that the slide's inertia takes is given with the motion (joint1.f). The position comes in
counts of the encoder, so that it is smoothed first, to and fro; force and motion are compared at every tenth sample, behind
the low-pass that this asks, as published. Development: the estimation record in four parts; evaluation: the record with
pulses, which are not told. Mass and damper are by least squares. What they lack is friction, more of it one way than
the other, and an offset.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from real_study import Figure, Made, Series, Stretch, bench, noise_above, sloped
from scipy.io import loadmat
from scipy.signal import butter, decimate, sosfiltfilt

STEP_NS = 1_000_000
RATIO = 10
SMOOTH = 40.0  # Hz
PARTS = 4  # of the estimation record, 6 s each
PUBLISHED = {"mass, friction, offset": 5.982}


def make(data: Path) -> Made:
    """The study."""
    step = STEP_NS / 1e9
    x, f = _read(data / "emps" / "DATA_EMPS.mat")
    v = np.gradient(x, step)
    motion = np.stack([v, np.gradient(v, step)], axis=1)[::RATIO]
    c, m = np.linalg.lstsq(motion, f, rcond=None)[0]
    rows = len(f) // PARTS
    parts = [(f"part_{i + 1}", "development", x, f, i * rows, (i + 1) * rows) for i in range(PARTS)]
    other = _read(data / "emps" / "DATA_EMPS_PULSES.mat")
    parts.append(("pulses", "evaluation", *other, 0, len(other[1])))
    stretches: list[Stretch] = []
    for name, role, position, force, begin, end in parts:
        d, slope = sloped(position, 1, step)
        slope[-1] = slope[-2]  # the filter that smoothed has no record beyond its end to lean on
        given = {"base.d": d, "base.v": slope, "joint1.f": -m * np.gradient(slope, step)}
        steps = slice(begin * RATIO, (end - 1) * RATIO + 1)
        inputs = {key: series[steps] for key, series in given.items()}
        stretches.append(Stretch(name, role, inputs, force[begin:end]))
    noise = f"{noise_above(f, RATIO * step, 30.0):.3f}     # rms of the force above 30 Hz, taken as white"
    title = "Electro-mechanical positioning system: motion given, force measured"
    head = bench(title, STEP_NS, RATIO, (0.0, c), "N", noise)
    figures = [Figure("pulses", "pulses", (0, len(other[1])), "share", "%", 100.0, 5.982, PUBLISHED)]
    return Made(head, STEP_NS, RATIO, "force", "N", stretches, figures)


def _read(path: Path) -> tuple[Series, Series]:
    """Position m at STEP_NS, smoothed, and force N at every RATIO-th of its samples."""
    record = loadmat(path)
    position = sosfiltfilt(butter(4, SMOOTH, fs=1e9 / STEP_NS, output="sos"), record["qm"][:, 0])
    force = record["vir"][:, 0] * float(record["gtau"][0, 0])
    return position, decimate(force, RATIO, zero_phase=True)
