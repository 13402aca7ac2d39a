"""Silverbox: an electronic mass-spring-damper with a cubic spring, as a study on a linear oscillator.

V1 stands for a force in N and V2 for a displacement in m, so 1 mV of the published figures is 1 mm here. The model is what
a linear identification gives: m, c, k and V2's offset by output error on the development rows, close and wrong.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from real_study import Figure, Made, Series, Stretch, between, noise_above, smooth_slope
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter

STEP_NS = 1_638_400  # 2^14 / 10 MHz: the generator's clock
RATIO = 4
# rows of the multisine: gaps of about 100 rows without excitation stand before each of its realisations
GAPS = (40587, 49279, 57973, 66664, 75355, 84046, 92740, 101430)  # first row of excitation
DEVELOPMENT, TEST, END = 40650, 105712, 127400  # rows of the published split: 75 % and the rest
ARROW = (100, 40575, 32100)  # rows: begin, end, end without extrapolation
BEFORE = 60  # rows of a gap that a stretch begins with
LENGTH = 2000  # rows of a development stretch

HEAD = """format = 1
name = "Silverbox: electronic mass-spring-damper, 1 V in = 1 N, 1 V out = 1 m"

[simulation]
fmu = "oscillator.fmu"
step_size = {step!r}      # {ratio} steps a sample of 2^14 / 10 MHz
parameters = {{ m1 = {m:.6e}, c1 = {c:.6e}, k1 = {k:.6f} }}

[[channels]]
name = "displacement"
simulation = "mass1.x"
measurement = "V2"
quantity = "displacement"
unit = "mm"
noise = {noise:.3f}               # rms of V2 above 250 Hz (the generator ends at 200 Hz), taken as white

[[joints]]
name = "spring"
force = "joint1.f"
displacement = "joint1.d"
velocity = "joint1.v"
nominal_force = "joint1.F"
acceleration = "mass1.a"

{adjustable}"""


def read(data: Path) -> tuple[Series, Series]:
    """V1 and V2, V."""
    table = np.genfromtxt(data / "silverbox" / "SNLS80mV.csv", delimiter=",", skip_header=1, usecols=(0, 1))
    return table[:, 0].copy(), table[:, 1].copy()


def response(u: Series, m: float, c: float, k: float, ratio: int = 8) -> Series:
    """m x'' + c x' + k x = u from rest, at the samples of u; the input held over 1 / ratio of their interval."""
    h = STEP_NS / 1e9 / ratio
    b, a, _ = cont2discrete(([1.0], [m, c, k]), h, method="zoh")
    return lfilter(b.ravel(), a, between(u, ratio))[::ratio]


def identify(u: Series, y: Series) -> tuple[float, float, float, float]:
    """m, c, k and the offset of y by output error; the first 200 rows are left out, where it does not begin at rest."""
    scale = np.array([1e-5, 1e-3, 1.0, 1e-3])

    def error(p: np.ndarray) -> np.ndarray:
        m, c, k, offset = p * scale
        return (response(u, m, c, k) + offset - y)[200:]

    m, c, k, offset = least_squares(error, [0.5, 0.2, 1.0, 0.0], x_scale=0.1).x * scale
    return float(m), float(c), float(k), float(offset)


def make(data: Path) -> Made:
    """The study: stretches of the multisine's first 75 % to develop on, its last 25 % and the arrow to evaluate."""
    u, y = read(data)
    quiet = np.concatenate([u[begin - 80 : begin - 10] for begin in GAPS[:-1]])
    u = u - quiet.mean()
    known = slice(GAPS[0] - 80, GAPS[-1] - 10)
    m, c, k, offset = identify(u[known], y[known])
    y = y - offset

    force = between(u, RATIO)

    def stretch(name: str, role: str, begin: int, end: int) -> Stretch:
        x0, v0 = smooth_slope(y, begin, STEP_NS / 1e9)
        line = f"parameters = {{ x1 = {x0:.6e}, v1 = {v0:.6e} }}      # the record's own first value and slope"
        return Stretch(name, role, {"mass1.f": force[begin * RATIO : (end - 1) * RATIO + 1]}, y[begin:end], [line])

    stretches = [
        stretch(f"multisine_{i + 1}", "development", first - BEFORE, first - BEFORE + LENGTH)
        for i, first in enumerate(GAPS[:-1])
    ]
    begin, arrow = GAPS[-1] - BEFORE, ARROW[0] - BEFORE
    stretches += [stretch("multisine_test", "evaluation", begin, END), stretch("arrow", "evaluation", arrow, ARROW[1])]
    rows = {
        "multisine": ("multisine_test", TEST - begin, END - begin),
        "arrow": ("arrow", ARROW[0] - arrow, ARROW[1] - arrow),
        "arrow without extrapolation": ("arrow", ARROW[0] - arrow, ARROW[2] - arrow),
    }
    published = {
        "multisine": {"linear": 6.96, "cubic": 0.350, "best black box": 0.26},
        "arrow": {"linear": 14.29, "cubic": 0.449, "LSTM": 2.7, "GRU": 2.8},
        "arrow without extrapolation": {"linear": 6.59, "cubic": 0.351},
    }
    target = {"multisine": 0.35, "arrow": 0.45, "arrow without extrapolation": 0.351}
    figures = [
        Figure(name, where, (first, last), "rms", "mV", 1.0, target[name], published[name])
        for name, (where, first, last) in rows.items()
    ]
    adjustable = "\n".join(
        f'[[adjustable]]\nparameter = "{name}"\nminimum = {0.5 * value:.3e}\nmaximum = {2.0 * value:.3e}\ntolerance = 0.05\n'
        for name, value in (("m1", m), ("c1", c), ("k1", k))
    )
    head = HEAD.format(
        step=STEP_NS / RATIO / 1e9,
        ratio=RATIO,
        m=m,
        c=c,
        k=k,
        noise=1e3 * noise_above(y[known], STEP_NS / 1e9, 250.0),
        adjustable=adjustable,
    )
    return Made(head, STEP_NS // RATIO, RATIO, "V2", "m", stretches, figures)
