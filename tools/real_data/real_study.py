"""What the sets have in common: where they lie, signals between samples, and a study with its records as files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import make_interp_spline
from scipy.signal import resample_poly

from fmucorrect.records import writer
from fmucorrect.signals import Channel, Record

ROOT = Path(__file__).resolve().parent.parent.parent
FMU = ROOT / "fmus" / "oscillator" / "oscillator.fmu"
DATA = ROOT.parent / "shared" / "data"
SCORE = "score.json"
"""The file beside a study that says what its figures are (`Figure`)."""

_UNITS = {"f": "N", "d": "m", "v": "m/s"}
"""Of the oscillator's inputs, by the last letter of their names."""

Series = Float64[np.ndarray, " T"]

_BENCH = """format = 1
name = "{title}"

[simulation]
fmu = "oscillator.fmu"
step_size = {step!r}      # {ratio} steps a sample
parameters = {{ m1 = 1e15, k1 = {k:.6e}, c1 = {c:.6e} }}

[[channels]]
name = "force"
simulation = "base.F"
measurement = "force"
measurement_sign = -1      # joint1.d = -base.d: what pulls the base back in the model is positive in the record
quantity = "force"
unit = "{unit}"
noise = {noise}

[[joints]]
name = "device"
force = "joint1.f"
displacement = "joint1.d"
velocity = "joint1.v"
nominal_force = "joint1.F"

{adjustable}"""


@dataclass(frozen=True)
class Figure:
    """One published figure: the error over some rows of the measured record of one condition.

    rows: first and last plus one, of the record. kind: "rms", or "share": the rms error in % of the measurement's rms.
    factor: from the channel's unit to `unit`. target: what the project asks for, in `unit`. published: others' figures.
    """

    name: str
    condition: str
    rows: tuple[int, int]
    kind: str
    unit: str
    factor: float
    target: float
    published: Mapping[str, float]


@dataclass(frozen=True)
class Stretch:
    """One condition. u: inputs by FMU name, a value a step of the study (held over it). y: measured, a value a sample.

    ratio: steps a sample. lines: further lines of its table in the study file.
    """

    name: str
    role: str
    u: Mapping[str, Series]
    y: Series
    lines: Sequence[str] = ()


@dataclass(frozen=True)
class Made:
    """A study to be written. head: its text before the conditions. step_ns: of the study. ratio: steps a sample of the
    measurement. column, unit: of the measured channel in its records. figures: what it is scored by."""

    head: str
    step_ns: int
    ratio: int
    column: str
    unit: str
    stretches: Sequence[Stretch]
    figures: Sequence[Figure] = field(default_factory=tuple)


def between(samples: Series, ratio: int) -> Series:
    """The band-limited signal through `samples`, a value each 1 / ratio of their interval, the mean over it.

    An FMU's input is held over a step: the value in its middle, which is the mean but for the second derivative, gives a
    hold without the lag of half a step. The last sample's value stands once: (len(samples) - 1) ratio + 1 values.
    """
    pad = np.concatenate([np.full(64, samples[0]), samples, np.full(64, samples[-1])])
    fine = resample_poly(pad, 2 * ratio, 1, window=("kaiser", 8.0))
    return fine[128 * ratio + 1 :: 2][: (len(samples) - 1) * ratio + 1]


def smooth_slope(samples: Series, row: int, step: float, reach: int = 8) -> tuple[float, float]:
    """Value and slope at `row` of the quintic spline through the samples within `reach` of it."""
    rows = np.arange(max(row - reach, 0), min(row + reach + 1, len(samples)))
    spline = make_interp_spline(rows * step, samples[rows], k=5)
    return float(spline(row * step)), float(spline(row * step, 1))


def sloped(samples: Series, ratio: int, step: float) -> tuple[Series, Series]:
    """`samples` at each 1 / ratio of their interval (cubic between them), and the mean slope over the step that follows. Behind
    the last sample the cubic goes on: a halt there would be a blow that the record does not have."""
    times = np.arange((len(samples) - 1) * ratio + 2) / ratio
    fine = make_interp_spline(np.arange(len(samples)), samples, k=3)(times)
    return fine[:-1], np.diff(fine) / step


def bench(title: str, step_ns: int, ratio: int, line: tuple[float, float], unit: str, noise: str) -> str:
    """Head of the study of a device on a test bench, motion given, force measured: joint 1 between a base that moves and a mass
    that does not. line: its stiffness, N/m, and damping, N s/m, by least squares. unit: of the force. noise: and a comment."""
    # a line through loops of friction: neither number is known
    adjustable = "\n".join(
        f'[[adjustable]]\nparameter = "{name}"\nminimum = 0.0\nmaximum = {5.0 * value:.3e}\ntolerance = 1.0\n'
        for name, value in zip(("k1", "c1"), line, strict=True)
        if value > 0.0
    )
    k, c = line
    return _BENCH.format(
        title=title, step=step_ns / 1e9, ratio=ratio, k=k, c=c, adjustable=adjustable, unit=unit, noise=noise
    )


def noise_above(y: Series, step: float, frequency: float) -> float:
    """Rms of white noise that has the power of y above a frequency, Hz, where the response itself has none."""
    window = np.hanning(len(y))
    power = np.abs(np.fft.rfft((y - y.mean()) * window)) ** 2 / (window**2).sum()
    return float(np.sqrt(np.median(power[np.fft.rfftfreq(len(y), step) > frequency]) / np.log(2.0)))


def write(made: Made, out: Path) -> Path:
    """The study, its FMU, records and inputs in folder `out`. Returns the study's path."""
    out.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(FMU, out / FMU.name)
    text = [made.head.rstrip() + "\n"]
    for stretch in made.stretches:
        names = tuple(stretch.u)
        values = np.stack([stretch.u[name] for name in names], axis=1)
        _write(
            out / f"inputs_{stretch.name}.parquet",
            values,
            made.step_ns,
            [Channel(name, unit=_UNITS[name[-1]]) for name in names],
        )
        channel = Channel(made.column, unit=made.unit)
        _write(out / f"measured_{stretch.name}.parquet", stretch.y[:, None], made.step_ns * made.ratio, [channel])
        rows = [
            f'name = "{stretch.name}"',
            f'role = "{stretch.role}"',
            *stretch.lines,
            f'inputs = "inputs_{stretch.name}.parquet"',
            f'measurement = "measured_{stretch.name}.parquet"',
        ]
        text.append("[[conditions]]\n" + "\n".join(rows) + "\n")
    (out / "study.toml").write_text("\n".join(text), encoding="utf-8")
    figures = {"ratio": made.ratio, "figures": [asdict(figure) for figure in made.figures]}
    (out / SCORE).write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return out / "study.toml"


def _write(path: Path, values: np.ndarray, step_ns: int, channels: Sequence[Channel]) -> None:
    t_ns = np.arange(len(values), dtype=np.int64) * step_ns
    path.unlink(missing_ok=True)
    with writer(path) as out:
        out.write("/measured", Record(t_ns, np.ascontiguousarray(values), tuple(channels)))
