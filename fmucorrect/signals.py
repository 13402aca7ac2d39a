"""Channel, Record and Condition: names, units, shapes and time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.errors import RecordError

Times = Int64[np.ndarray, " T"]
"""Sample times in nanoseconds, strictly increasing."""

Values = Float64[np.ndarray, "T C"]
"""One row a sample time, one column a channel, each in its channel's unit."""

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class Channel:
    """One row of the sensor dictionary.

    name: what the channel is called everywhere. unit: of the values that carry this channel.
    quantity: displacement, velocity, acceleration, force or angle. axis, positive, frame: where it points, in words.
    simulation: FMU variable or column of a simulated record; measurement: column of a measured record;
    acceleration: column of the paired accelerometer. noise: known sensor noise (rms, in the unit).
    measurement_sign: -1 where the sensor's positive direction is the other way.
    """

    name: str
    unit: str = "1"
    quantity: str = ""
    axis: str = ""
    positive: str = ""
    frame: str = ""
    simulation: str = ""
    measurement: str = ""
    acceleration: str = ""
    noise: float | None = None
    measurement_sign: int = 1


@dataclass(frozen=True)
class Record:
    """A stretch of signals on one time base.

    t_ns: (T,) int64, strictly increasing, in nanoseconds. values: (T, C) float64, in the channels' units.
    metadata: text by key, carried into files. Raises RecordError when the shapes or the times are not so.
    """

    t_ns: Times
    values: Values
    channels: tuple[Channel, ...]
    metadata: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        expected = (len(self.t_ns), len(self.channels))
        if self.values.shape != expected:
            raise RecordError("values have the wrong shape", expected=f"(T, C) = {expected}", got=self.values.shape)
        backwards = np.flatnonzero(np.diff(self.t_ns) <= 0)
        if len(backwards):
            i = int(backwards[0]) + 1
            raise RecordError(
                f"time does not increase at row {i}",
                expected=f"more than {self.t_ns[i - 1]} ns",
                got=f"{self.t_ns[i]} ns",
                remedy="Choose a repair rule when reading.",
            )
        names = [channel.name for channel in self.channels]
        if len(set(names)) < len(names):
            double = sorted({name for name in names if names.count(name) > 1})
            raise RecordError(f"channel names occur twice: {', '.join(double)}")

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def names(self) -> tuple[str, ...]:
        """The channels' names, in order."""
        return tuple(channel.name for channel in self.channels)

    def seconds(self, origin_ns: int = 0) -> Float64[np.ndarray, " T"]:
        """Sample times in seconds since `origin_ns`; the difference is taken in integers, so nothing is lost far out."""
        return (self.t_ns - origin_ns) / NANOSECONDS

    def index(self, name: str) -> int:
        """The column of a channel. Raises RecordError with the names that there are."""
        try:
            return self.names.index(name)
        except ValueError:
            raise RecordError(
                f"there is no channel {name!r}",
                where=self.metadata.get("path"),
                expected=f"one of {', '.join(self.names)}",
            ) from None

    def __getitem__(self, name: str) -> Float64[np.ndarray, " T"]:
        """The values of one channel (a view)."""
        return self.values[:, self.index(name)]

    def select(self, names: Sequence[str]) -> Record:
        """The same record with only these channels, in this order."""
        columns = [self.index(name) for name in names]
        return replace(self, values=self.values[:, columns], channels=tuple(self.channels[c] for c in columns))

    def rows(self, start: int, stop: int) -> Record:
        """Rows start to stop (not included), as views."""
        return replace(self, t_ns=self.t_ns[start:stop], values=self.values[start:stop])

    @property
    def step_ns(self) -> int:
        """The median sample interval in nanoseconds."""
        if len(self) < 2:
            raise RecordError("a record of fewer than two rows has no sample interval", where=self.metadata.get("path"))
        return int(np.median(np.diff(self.t_ns)))


def join(parts: Sequence[Record]) -> Record:
    """Records of the same channels one after another. Raises RecordError when channels differ or time goes back."""
    first = parts[0]
    if any(part.channels != first.channels for part in parts):
        raise RecordError("records with different channels cannot be joined", expected=first.names)
    return replace(
        first,
        t_ns=np.concatenate([part.t_ns for part in parts]),
        values=np.concatenate([part.values for part in parts]),
    )


@dataclass(frozen=True)
class Reading:
    """What is known of record files beside what they say themselves.

    columns: a column of the file by the name that it goes by here; a file without that column is read as it is. units: of
    columns, by either name, in place of what the file says. repair: repair rules of `records.timebase`, as "sort,drop".
    """

    columns: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    units: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    repair: str = ""


AS_IT_IS = Reading()
"""A file that says all of itself."""


@dataclass(frozen=True)
class Condition:
    """One operating condition of a study.

    role: "development" or "evaluation". speed: km/h; amplitude: deg; frequency: Hz; start: s, when the excitation
    begins (phase zero); 0 where it has no meaning. parameters: FMU start values in the FMU's own units. inputs: time
    series for FMU inputs. measurement, simulated: record files. quiet: s, an interval without excitation. clock: "common",
    "excitation", s from the simulation's first sample to the measurement's, or None: as `clocks` finds it. reading: of its
    record files.
    """

    name: str
    role: str = "development"
    speed: float = 0.0
    amplitude: float = 0.0
    frequency: float = 0.0
    start: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    inputs: Path | None = None
    measurement: Path | None = None
    simulated: Path | None = None
    quiet: tuple[float, float] | None = None
    clock: str | float | None = None
    reading: Reading = AS_IT_IS

    @property
    def start_ns(self) -> int:
        """When the excitation begins, in nanoseconds."""
        return round(self.start * NANOSECONDS)

    @property
    def features(self) -> tuple[float, float, float]:
        """What a corrector is conditioned on: speed km/h, amplitude deg, frequency Hz (x_c of the paper)."""
        return (self.speed, self.amplitude, self.frequency)
