"""Channel, Record and Condition: names, units, shapes and time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect import sketch
from fmucorrect.brief import brief
from fmucorrect.errors import MissingExtra, RecordError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Times = Int64[np.ndarray, " T"]
"""Sample times in nanoseconds, strictly increasing."""

Values = Float64[np.ndarray, "T C"]
"""One row a sample time, one column a channel, each in its channel's unit."""

NANOSECONDS = 1_000_000_000

Quantity = Literal["displacement", "velocity", "acceleration", "force", "angle", "pressure", "strain", "current"]
QUANTITIES: Mapping[Quantity, tuple[str, ...]] = MappingProxyType(
    {
        "displacement": ("m",),
        "velocity": ("m/s", "rad/s"),
        "acceleration": ("m/s2", "rad/s2"),
        "force": ("N", "N.m"),
        "angle": ("rad",),
        "pressure": ("Pa",),
        "strain": ("1",),
        "current": ("A",),
    }
)
"""What a channel may be, and the SI units of it."""


@dataclass(frozen=True)
class Channel:
    """One row of the sensor dictionary.

    name: what the channel is called everywhere. unit: of the values that carry this channel.
    quantity: one of QUANTITIES. axis, positive, frame: where it points, in words.
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

    __repr__ = brief


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

    __repr__ = brief

    def __post_init__(self) -> None:
        kinds = [getattr(values, "dtype", type(values)) for values in (self.t_ns, self.values)]
        if [getattr(kind, "kind", "") for kind in kinds] != ["i", "f"]:
            raise RecordError(
                "these are no arrays of a record",
                expected="t_ns int64, in nanoseconds, and values float64",
                got=" and ".join(getattr(kind, "name", getattr(kind, "__name__", "")) for kind in kinds),
                remedy="Record.from_pandas takes times in s.",
            )
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
                remedy="Choose a repair rule when reading: repair='sort' or 'drop'.",
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

    def to_pandas(self) -> pd.DataFrame:
        """A DataFrame: a column a channel, in the channel's unit, over a TimedeltaIndex of the stamps (ns, exact).

        `attrs` holds units (by channel) and metadata. Raises MissingExtra without pandas.
        """
        pandas = _optional("pandas")
        index = pandas.TimedeltaIndex(self.t_ns.astype("timedelta64[ns]"), name="time")
        frame = pandas.DataFrame(self.values, index=index, columns=list(self.names))
        frame.attrs = {"units": {channel.name: channel.unit for channel in self.channels}, **dict(self.metadata)}
        return frame

    @staticmethod
    def from_pandas(
        frame: pd.DataFrame, units: Mapping[str, str] = MappingProxyType({}), metadata: Mapping[str, str] | None = None
    ) -> Record:
        """The record of a DataFrame of numbers over its index: durations, time stamps (UTC where no zone is given), or s.

        units: by column; else those that `to_pandas` put into `attrs`, else "1". Raises RecordError for another index, columns
        that are no numbers, NaN, and times that do not increase; MissingExtra without pandas.
        """
        pandas = _optional("pandas")
        known = {**frame.attrs.get("units", {}), **units}
        index: Any = frame.index
        if isinstance(index, pandas.DatetimeIndex) and index.tz is not None:
            index = index.tz_convert("UTC").tz_localize(None)
        names = [str(name) for name in frame.columns]
        text = metadata or {k: v for k, v in frame.attrs.items() if isinstance(k, str) and isinstance(v, str)}
        return _from_table(
            index.to_numpy(), [frame.iloc[:, i].to_numpy() for i in range(len(names))], names, known, text
        )

    @staticmethod
    def from_xarray(dataset: xr.Dataset, time: str = "time", units: Mapping[str, str] = MappingProxyType({})) -> Record:
        """The record of the variables of a Dataset that lie over `time` alone: durations, time stamps (UTC), or s.

        units: by variable; else each variable's attribute `units`, else "1". Raises RecordError where a variable has other
        dimensions, as `from_pandas` does, and MissingExtra without xarray.
        """
        _optional("xarray")
        if time not in dataset.coords:
            raise RecordError(
                f"the dataset has no coordinate {time!r}", expected=f"one of {', '.join(map(str, dataset.coords))}"
            )
        for name, variable in dataset.data_vars.items():
            if variable.dims != dataset[time].dims or len(variable.dims) != 1:
                raise RecordError(
                    f"variable {name!r} does not lie over {time!r} alone", got=f"dimensions {variable.dims}"
                )
        known = {str(name): str(v.attrs["units"]) for name, v in dataset.data_vars.items() if "units" in v.attrs}
        columns = [variable.to_numpy() for variable in dataset.data_vars.values()]
        text = {str(key): value for key, value in dataset.attrs.items() if isinstance(value, str)}
        return _from_table(
            dataset[time].to_numpy(), columns, [str(n) for n in dataset.data_vars], {**known, **units}, text
        )

    def plot(self, names: Sequence[str] | None = None) -> sketch.Sketch:
        """The curves of all channels, or of these, over time in s: an SVG that a notebook shows."""
        shown = self if names is None else self.select(names)
        return sketch.curves(shown.seconds(), shown.values, shown.names, [channel.unit for channel in shown.channels])

    def _repr_html_(self) -> str:
        """What a notebook shows: shape, range and a row a channel."""
        rows: list[list[object]] = []
        for channel, values in zip(self.channels, self.values.T, strict=True):
            span = (f"{values.min():.6g}", f"{values.max():.6g}") if len(values) else ("", "")
            rows.append([channel.name, channel.unit, channel.quantity, *span])
        stretch = f", {self.t_ns[0] / NANOSECONDS:.9g} s to {self.t_ns[-1] / NANOSECONDS:.9g} s" if len(self) else ""
        told = f"Record of {len(self)} rows{stretch}"
        if lost := self.metadata.get("damage"):
            told += f"; damaged: {lost}"
        return sketch.table(["channel", "unit", "quantity", "min", "max"], rows, told)

    @property
    def step_ns(self) -> int:
        """The median sample interval in nanoseconds."""
        if len(self) < 2:
            raise RecordError("a record of fewer than two rows has no sample interval", where=self.metadata.get("path"))
        return int(np.median(np.diff(self.t_ns)))


def _optional(package: str) -> Any:
    """A package that Record's conversions need. Raises MissingExtra."""
    try:
        return import_module(package)
    except ImportError as error:
        raise MissingExtra(package, package) from error


def _from_table(
    times: np.ndarray,
    columns: Sequence[np.ndarray],
    names: Sequence[str],
    units: Mapping[str, str],
    text: Mapping[str, str],
) -> Record:
    """times: durations or time stamps of numpy, or s. columns: (T,) each, numbers."""
    if times.dtype.kind in "mM":
        if np.isnat(times).any():
            raise RecordError("a time is missing (NaT)", got=f"row {int(np.argmax(np.isnat(times)))}")
        kind = "timedelta64[ns]" if times.dtype.kind == "m" else "datetime64[ns]"
        t_ns = times.astype(kind).astype(np.int64)
        if (t_ns.astype(kind).astype(times.dtype) != times).any():
            raise RecordError("a time lies beyond what 64 bits of nanoseconds hold", expected="years 1678 to 2262")
    elif times.dtype.kind in "iuf" and np.isfinite(times).all() and (np.abs(times.astype(np.float64)) < 9e9).all():
        whole = np.floor(times)
        t_ns = whole.astype(np.int64) * NANOSECONDS + np.rint((times - whole) * NANOSECONDS).astype(np.int64)
    else:
        raise RecordError("the index is no time", expected="durations, time stamps, or seconds", got=str(times.dtype))
    for name, column in zip(names, columns, strict=True):
        if column.dtype.kind not in "biuf":
            raise RecordError(f"column {name!r} holds no numbers", got=str(column.dtype))
        if not np.isfinite(column.astype(np.float64)).all():
            row = int(np.argmin(np.isfinite(column.astype(np.float64))))
            raise RecordError(f"column {name!r} is {column[row]} at row {row}", remedy="Fill or drop such rows first.")
    values = np.stack([c.astype(np.float64) for c in columns], axis=1) if len(columns) else np.empty((len(t_ns), 0))
    return Record(t_ns, values, tuple(Channel(name, units.get(name, "1")) for name in names), dict(text))


def join(parts: Sequence[Record]) -> Record:
    """Records of the same channels one after another. Raises RecordError when there are none, channels differ or time goes
    back."""
    if not parts:
        raise RecordError("there are no records to join")
    first = parts[0]
    if any(part.channels != first.channels for part in parts):
        raise RecordError("records with different channels cannot be joined", expected=first.names)
    return replace(
        first,
        t_ns=np.concatenate([part.t_ns for part in parts]),
        values=np.concatenate([part.values for part in parts]),
    )


RULES = frozenset({"sort", "drop", "interpolate", "clock", "resample"})
"""The names of the repair rules; `records.timebase` says what they do."""

DELIMITERS = {"tab": "\t", "space": " ", "blank": " "}
"""Words for delimiters of text files that are hard to write."""


@dataclass(frozen=True)
class Reading:
    """What is known of record files beside what they say themselves.

    columns: a column of the file by the name that it goes by here; a file without that column is read as it is. units: of
    columns, by either name, in place of what the file says. repair: repair rules of `records.timebase`, as "sort,drop".
    time: the column that is the time; a file without that column is read as it is. time_unit: as "ms", of numbers that are
    times, in place of what the file says; "": as it says, else s. rate: Hz, of the samples of files that have no time at all;
    one that has a time keeps it; 0: not known. Of text files: delimiter (one character, "tab" or "space"), decimal ("." or
    ","), encoding (as Python names it). "" of any: found out.
    """

    columns: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    units: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    repair: str = ""
    time: str = ""
    time_unit: str = ""
    rate: float = 0.0
    delimiter: str = ""
    decimal: str = ""
    encoding: str = ""

    __repr__ = brief


AS_IT_IS = Reading()
"""A file that says all of itself."""

TOLD = ("time", "time_unit", "rate", "delimiter", "decimal", "encoding")
"""What of a Reading the source of a file itself needs: the rest is done to what it gives."""


@dataclass(frozen=True)
class Condition:
    """One operating condition of a study.

    role: "development" or "evaluation". speed: km/h; amplitude: deg; frequency: Hz; start: s, when the excitation
    begins (phase zero); 0 where it has no meaning. parameters: FMU start values in the FMU's own units. inputs: time
    series for FMU inputs. measurement, simulated: record files. quiet: s, an interval without excitation. clock: "common",
    "excitation", s from the simulation's first sample to the measurement's, or None: as `clocks` finds it. begins_ns:
    stamp of the inputs at which a run begins, where that is known without the measurement. reading: of its record files.
    free: FMU start values that are not known; those in `parameters` are the first guess. score: "all" rows after the warm-up,
    or those of the "steady" forced segment (`registration.steady_segment`).
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
    score: str = "all"
    clock: str | float | None = None
    begins_ns: int | None = None
    reading: Reading = AS_IT_IS
    free: tuple[str, ...] = ()

    __repr__ = brief

    @property
    def start_ns(self) -> int:
        """When the excitation begins, in nanoseconds."""
        return round(self.start * NANOSECONDS)

    @property
    def files(self) -> tuple[Path, ...]:
        """Measurement, simulated record and inputs, those that there are; a log that is two of them once."""
        return tuple(
            dict.fromkeys(path for path in (self.measurement, self.simulated, self.inputs) if path is not None)
        )

    @property
    def features(self) -> tuple[float, float, float]:
        """What a corrector is conditioned on: speed km/h, amplitude deg, frequency Hz (x_c of the paper)."""
        return (self.speed, self.amplitude, self.frequency)
