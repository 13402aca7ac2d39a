"""Bouc-Wen: a simulated benchmark, a mass on a spring and a hysteretic element, as a study on an oscillator without the latter.

Its 750 Hz are no whole number of nanoseconds: samples are taken to be 1 333 328 ns apart, with steps of 166 666 ns. All
frequencies come out 4e-6 too high, which is 8e-6 of the stiffness; nothing is resampled. The noisy training record is five
periods of one multisine, settled from the second on; their mean is cut into stretches, each behind a lead-in in which what the
first row does not say about the hidden state is forgotten.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from real_study import Figure, Made, Series, Stretch, between, smooth_slope
from scipy.io import loadmat

STEP_NS = 166_666
RATIO = 8
SAMPLE = STEP_NS * RATIO / 1e9  # s
PERIOD = 8192  # rows
LEAD = 1024  # rows
PARTS = 4  # stretches of a period

HEAD = """format = 1
name = "Bouc-Wen benchmark: mass on a spring, 1 output"

[simulation]
fmu = "oscillator.fmu"
step_size = {step!r}      # {ratio} steps a sample
parameters = {{ m1 = 2.0, c1 = 10.0, k1 = 5e4 }}

[[channels]]
name = "displacement"
simulation = "mass1.x"
measurement = "y"
quantity = "displacement"
unit = "mm"
noise = {noise:.5f}               # of a mean of four periods

[[joints]]
name = "spring"
force = "joint1.f"
displacement = "joint1.d"
velocity = "joint1.v"
nominal_force = "joint1.F"
acceleration = "mass1.a"

[[adjustable]]
parameter = "m1"
minimum = 1.5
maximum = 2.5
tolerance = 0.02

[[adjustable]]
parameter = "c1"
minimum = 2.0
maximum = 50.0
tolerance = 0.1

[[adjustable]]
parameter = "k1"
minimum = 2e4
maximum = 10e4
tolerance = 0.05
"""


def make(data: Path) -> Made:
    """The study: four stretches of the training multisine, and both test records."""
    folder = data / "bouc_wen"
    with h5py.File(folder / "train.h5") as file:
        u, runs = file["multisine/u"][:PERIOD, 0], file["multisine/y"][:, 0].reshape(-1, PERIOD)
    runs = runs[1:]  # the first still settles: 14e-6 m beside the others in its first 400 rows, then 8e-6 m, the noise
    y = runs.mean(0)
    noise = float(np.sqrt(((runs - y) ** 2).sum() / ((len(runs) - 1) * y.size) / len(runs)))
    hop = PERIOD // PARTS
    stretches = [
        _steady(f"multisine_{i + 1}", "development", u, y, i * hop, hop - PARTS * 12)  # 2000 rows
        for i in range(PARTS)
    ]
    u, y = (loadmat(folder / f"{name}.mat")[name][0] for name in ("uval_multisine", "yval_multisine"))
    stretches.append(_steady("multisine_test", "evaluation", u, y, 0, PERIOD))
    u, y = (loadmat(folder / f"{name}.mat")[name][0] for name in ("uval_sinesweep", "yval_sinesweep"))
    stretches.append(Stretch("sweep_test", "evaluation", {"mass1.f": between(u, RATIO)}, y))
    published = {
        "multisine": {"PNLSS": 1.87e-5, "sparse regression": 1.83e-4, "fitted Bouc-Wen": 9.4e-6},
        "sweep": {"sparse regression": 1.72e-4, "fitted Bouc-Wen": 2.5e-6},
    }
    figures = [
        Figure("multisine", "multisine_test", (LEAD, LEAD + PERIOD), "rms", "m", 1e-3, 9.4e-6, published["multisine"]),
        Figure("sweep", "sweep_test", (0, len(y)), "rms", "m", 1e-3, 2.5e-6, published["sweep"]),
    ]
    head = HEAD.format(step=STEP_NS / 1e9, ratio=RATIO, noise=1e3 * noise)
    return Made(head, STEP_NS, RATIO, "y", "m", stretches, figures)


def _steady(name: str, role: str, u: Series, y: Series, begin: int, rows: int) -> Stretch:
    """Rows of a period (begin, so many) behind a lead-in of LEAD rows, which periodicity gives."""
    three_u, three_y = np.tile(u, 3), np.tile(y, 3)
    first, last = PERIOD + begin - LEAD, PERIOD + begin + rows
    x0, v0 = smooth_slope(three_y, first, SAMPLE)
    lines = [
        f"parameters = {{ x1 = {x0:.6e}, v1 = {v0:.6e} }}      # the record's own first value and slope",
        f"start = {LEAD * SAMPLE + 1.0:.3f}      # what lies more than a second before is not looked at",
    ]
    force = between(three_u, RATIO)[first * RATIO : (last - 1) * RATIO + 1]
    return Stretch(name, role, {"mass1.f": force}, three_y[first:last], lines)
