"""TDMS: groups are topics; the unit is the property `unit_string` (or `NI_UnitDescription`).

Time is a channel `time` of the group, in its unit or as time stamps, or else the waveform properties wf_start_time,
wf_start_offset and wf_increment. Waveforms of a group that differ in these or in length are topics of their own,
`group/1`, `group/2` and so on. Stamps of waveforms count from the only wf_start_time of the file or, where there are
several, from the earliest, so that they can be joined; by it a condition's files are laid on one clock (`clocks`). A file
that was appended to may have another wf_start_time in a later segment: its rows are stamped by that. Channels that do not
fit, whose unit, scale or increment changes between segments, that
were missing in segments before their last, or whose scale is not known, are named in `left_out`.
"""

from __future__ import annotations

import logging
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records import naming, seconds
from fmucorrect.records.assemble import RESERVED
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.source import RAM_ROWS, Block, counted, extent_of
from fmucorrect.records.tdms_segments import AXIS, START, UNITS, histories
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Reading, Record

_ORIGIN = "time_origin_ns"
_EPOCH_1904 = 2_082_844_800
"""Seconds from the start of 1904, from which TDMS counts, to that of 1970."""
_LEAD_IN = struct.Struct("<4sIIQQ")
_MOST_SEGMENTS = 1_000_000
"""Segments that are looked at: a year of one in half a minute."""
_OTHERS = {"S": "text", "U": "text", "O": "text", "c": "complex numbers", "M": "time stamps", "V": "time stamps"}


def _nptdms() -> Any:
    try:
        import nptdms
        from nptdms.log import log_manager
    except ImportError as error:
        raise MissingExtra("nptdms", "formats") from error
    log_manager.set_level(logging.CRITICAL)  # it warns of what `damage` and `left_out` say
    return nptdms


_SAID = 20
"""Channels whose reason an error repeats."""
_SCALES = 100
"""Most scales between the stored and the physical numbers: the library makes room for as many as the file states."""


@dataclass(frozen=True)
class _Series:
    """Channels that share their stamps. time: their time channel, with ns in its unit (0: time stamps); else a grid.

    pieces: of the grid, the row at which each begins and its stamp. step_ns: of the grid. rows: that all channels have.
    """

    topic: Topic
    group: str
    channels: dict[str, Any]
    rows: int
    time: Any = None
    per: int = 0
    pieces: tuple[tuple[int, int], ...] = ()
    step_ns: float = 0.0


@dataclass(frozen=True)
class _Grid:
    """The times of a waveform. starts: rows at which it begins (anew), and when, in ns since 1970; () without wf_start_time.
    rows: that its channel should have. counted: whether the step is that of `Reading.rate`, as the file has none."""

    starts: tuple[tuple[int, int], ...]
    offset_ns: int
    step_ns: float
    rows: int
    counted: bool = False


class TdmsSource:
    """A TDMS file opened for reading. Raises RecordError when it is none."""

    format = "TDMS"

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        self.path = path
        self._rate, self._told_unit = reading.rate, reading.time_unit
        self.damage = _damage(path)
        self.truncated = bool(self.damage)
        tdms = _nptdms()
        # by its content: of a name, the library would believe an index beside it, which may be that of another file
        self._stream = Path(path).open("rb")  # noqa: SIM115 (close() closes it)
        try:
            self._file: Any = tdms.TdmsFile.open(self._stream, raw_timestamps=True)
            self._histories = histories(path)
        except (ValueError, KeyError, EOFError, OSError) as error:
            self._stream.close()
            raise RecordError(f"this cannot be read as TDMS: {error}", where=path) from error
        for owner in (self._file, *self._file.groups(), *(c for g in self._file.groups() for c in g.channels())):
            if (scales := _scales(owner.properties)) > _SCALES:
                raise RecordError(f"it states {scales} scales", where=path, expected=f"at most {_SCALES}")
        self._left_out: list[str] = []
        groups = [(group, _time_channel(group, reading.time)) for group in self._file.groups()]
        self._from_ns = self._earliest([group for group, time in groups if time is None])
        self._series = {
            series.topic.name: series
            for group, time in groups
            for series in (self._waveforms(group) if time is None else self._timed(group, time))
        }
        self.left_out = tuple(self._left_out)
        if self.damage:
            there = "; ".join(f"{series.rows} rows of {name!r} are there" for name, series in self._series.items())
            self.damage = f"{self.damage}: {there or 'nothing is there'}"

    def close(self) -> None:
        """Release the file."""
        self._file.close()
        self._stream.close()

    def topics(self) -> tuple[Topic, ...]:
        """One topic a group, or several where its channels have times of their own."""
        return tuple(series.topic for series in self._series.values())

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """Slices of the channels."""
        series = self._series[topic]
        origin = seconds.origin_from(self._file[series.group].properties.get(_ORIGIN))
        for start in range(0, series.rows, RAM_ROWS):
            stop = min(start + RAM_ROWS, series.rows)
            values = np.empty((stop - start, len(columns)))
            for c, name in enumerate(columns):
                values[:, c] = series.channels[name][start:stop]
            yield Block(_stamps(series, start, stop, origin), values)

    def extent(self, topic: str) -> Extent:
        """By reading the times."""
        return extent_of(self.blocks(topic, []))

    def _timed(self, group: Any, time: Any) -> list[_Series]:
        """The channels as long as the time channel of their group."""
        metadata = _metadata(group)
        unit = self._told_unit or naming.time_unit(time.name, _unit(time))
        per = 0 if _is_stamps(time) else seconds.unit_ns(unit)
        rows = self._whole_length(time)
        fitting: list[Any] = []
        for channel in group.channels():
            if channel is time:
                continue
            if why := self._unfit(group, channel):
                self._leave_out(channel, why)
            elif self._whole_length(channel) != rows:
                self._leave_out(channel, f"{len(channel)} values, but {len(time)} times")
            else:
                fitting.append(channel)
        changed = self._changed(time)
        if per is None or changed:
            note = f"its time: {changed}" if changed else f"the unit of its time is not known: {unit!r}"
            self._left_out += [f"channel '{group.name}/{channel.name}': {note}" for channel in fitting]
            return [_Series(Topic(group.name, (), "time channel", metadata, note), group.name, {}, 0)]
        there = min([len(time), *(len(channel) for channel in fitting)])
        self._require_room(group.name, [time, *fitting], there)
        note = "" if fitting else "no numbers"
        topic = Topic(group.name, _columns(fitting), "time channel", metadata, note, time.name, bool(per))
        return [_Series(topic, group.name, {c.name: c for c in fitting}, there, time, per)]

    def _waveforms(self, group: Any) -> list[_Series]:
        """The channels of a group without a time channel, by their times."""
        metadata = _metadata(group)
        sets: dict[_Grid, list[Any]] = {}
        for channel in group.channels():
            grid = self._grid(channel)
            why = self._unfit(group, channel) or (grid if isinstance(grid, str) else "")
            if isinstance(grid, str) or why:
                self._leave_out(channel, why)
            else:
                sets.setdefault(grid, []).append(channel)
        if not sets:
            said = [line for line in self._left_out if line.startswith(f"channel '{group.name}/")]
            note = "no time channel, no wf_increment, or no numbers: " + "; ".join(said[:_SAID])
            return [_Series(Topic(group.name, (), "waveform", metadata, note), group.name, {}, 0)]
        found: list[_Series] = []
        for i, (grid, channels) in enumerate(sets.items(), 1):
            name = group.name if len(sets) == 1 else f"{group.name}/{i}"
            there = min(len(channel) for channel in channels)
            self._require_room(name, channels, there)
            told = dict(metadata)
            assumed: list[str] = []
            pieces = tuple((row, grid.offset_ns + start - (self._from_ns or 0)) for row, start in grid.starts)
            if grid.starts:
                told[START] = str(np.datetime64(grid.starts[0][1], "ns"))
            if grid.counted:
                assumed.append(counted(self._rate))
            elif self._from_ns is not None and not grid.starts:
                assumed.append("it has no wf_start_time: times count from 0")
            elif self._from_ns is not None and grid.starts[0][1] != self._from_ns:
                assumed.append("times count from the earliest wf_start_time of the file")
            if len(pieces) > 1:
                assumed.append(f"it was appended to: each of its {len(pieces)} parts has its own wf_start_time")
            if assumed:
                told["assumed"] = "; ".join(assumed)
            pieces = pieces or ((0, grid.offset_ns),)
            if max(abs(offset) for _, offset in pieces) + grid.step_ns * there >= 2**63 - 1:
                raise RecordError(f"the times of {name!r} are beyond what can be counted in ns", where=self.path)
            # 1904, the zero of the format, is what LabVIEW writes for a waveform whose start nobody set
            zero = self._from_ns if grid.starts and self._from_ns and self._from_ns > 0 else None
            topic = Topic(name, _columns(channels), "waveform", told, zero_ns=zero)
            every = {channel.name: channel for channel in channels}
            found.append(_Series(topic, group.name, every, there, pieces=pieces, step_ns=grid.step_ns))
        return found

    def _earliest(self, groups: Sequence[Any]) -> int | None:
        """The earliest start of a waveform; None without any."""
        every = [channel for group in groups for channel in group.channels() if not _no_numbers(channel)]
        return min((start for channel in every for _, start in self._starts(channel)), default=None)

    def _starts(self, channel: Any) -> list[tuple[int, int]]:
        """Rows from which a wf_start_time holds, and it in ns since 1970."""
        history = self._histories.get(channel.path)
        return [(row, _since_1970_of(start)) for row, start in history.starts] if history else []

    def _unfit(self, group: Any, channel: Any) -> str:
        """Why the channel is no series of physical numbers; "" when it is one."""
        return _no_numbers(channel) or _unknown_scale(channel, group, self._file) or self._changed(channel)

    def _changed(self, channel: Any) -> str:
        """What of the meaning of its numbers changes between segments, in words."""
        history = self._histories.get(channel.path)
        changed = history.changed if history else {}
        return "; ".join(f"its {key} changes: {how}" for key, how in changed.items() if key not in AXIS)

    def _grid(self, channel: Any) -> _Grid | str:
        """The times of a waveform, or why it has none."""
        properties = channel.properties
        if "wf_increment" not in properties and self._rate:
            return _Grid((), 0, NANOSECONDS / self._rate, self._whole_length(channel), counted=True)
        if "wf_increment" not in properties:
            return "no time channel in its group, and no wf_increment"
        unit = str(properties.get("wf_xunit_string") or "s")
        per = seconds.unit_ns(unit)
        if per is None:
            return f"its axis is in {unit!r}, not a time"
        step, offset = float(properties["wf_increment"]) * per, float(properties.get("wf_start_offset", 0.0)) * per
        if not (0 < step < 2**63 and abs(offset) < 2**62):
            return f"its wf_increment ({properties['wf_increment']}) or wf_start_offset cannot be"
        history = self._histories.get(channel.path)
        if history and (axis := history.changed.keys() & AXIS):
            return "; ".join(f"its {key} changes: {history.changed[key]}" for key in sorted(axis))
        if history and history.behind:
            return f"it was missing in segments before its last: {history.behind} rows less than others written with it"
        starts: list[tuple[int, int]] = []
        for row, start in self._starts(channel):
            goes_on = starts and abs(start - starts[-1][1] - step * (row - starts[-1][0])) <= step / 2
            if not goes_on:
                starts.append((row, start))
        return _Grid(tuple(starts), round(offset), step, self._whole_length(channel))

    def _whole_length(self, channel: Any) -> int:
        """Values that the channel would have if the file were not cut off."""
        statuses = self._file.file_status.channel_statuses
        status = (statuses or {}).get(channel.path)
        return len(channel) + (status.expected_length - status.read_length if status else 0)

    def _leave_out(self, channel: Any, why: str) -> None:
        self._left_out.append(f"channel '{channel.group_name}/{channel.name}': {why}")

    def _require_room(self, name: str, channels: Sequence[Any], rows: int) -> None:
        """A file cannot hold more values than it has bytes for: a header that says so is damaged."""
        needed = rows * sum(1 if c.dtype is None else c.dtype.itemsize for c in channels if c.dtype.kind != "V")
        size = Path(self.path).stat().st_size
        if needed > 8 * size:  # raw numbers of data acquisition cards are stored in fewer bytes than they are read as
            raise RecordError(
                f"the file is damaged: {name!r} has {rows} rows", where=self.path, got=f"a file of {size} bytes"
            )


class TdmsSink:
    """A TDMS file being written: a segment an append."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._tdms = _nptdms()
        self._stream: Any = None
        self._group, self._origin = "", 0

    def append(self, topic: str, record: Record) -> None:
        """Write a segment."""
        channel, name = self._tdms.ChannelObject, topic.lstrip("/")
        first = self._stream is None
        if first:
            self._stream = Path(self._path).open("wb")  # noqa: SIM115 (close() closes it)
            self._group, self._origin = name, seconds.origin_for(record.t_ns)
        objects: list[Any] = []
        if first:
            properties: dict[str, Any] = {k: v for k, v in record.metadata.items() if k not in RESERVED}
            if self._origin:
                properties[_ORIGIN] = str(self._origin)
            objects.append(self._tdms.GroupObject(name, properties))
        unit = (lambda text: {"unit_string": text}) if first else (lambda text: {})
        objects.append(channel(name, "time", seconds.from_ns(record.t_ns, self._origin), unit("s")))
        for c, series in zip(record.channels, record.values.T, strict=True):
            objects.append(channel(name, c.name, np.ascontiguousarray(series), unit(c.unit)))
        with self._tdms.TdmsWriter(self._stream) as segment:
            segment.write_segment(objects)
        self._stream.flush()

    def close(self, notes: Mapping[str, str]) -> None:
        """Close the file; notes become properties of the group."""
        if self._stream is None or self._stream.closed:
            return
        if notes:
            with self._tdms.TdmsWriter(self._stream) as segment:
                segment.write_segment([self._tdms.GroupObject(self._group, dict(notes))])
        self._stream.close()


def _unit(channel: Any) -> str:
    return next((str(channel.properties[key]) for key in UNITS if channel.properties.get(key)), "1")


def _columns(channels: Sequence[Any]) -> tuple[Column, ...]:
    return tuple(Column(channel.name, _unit(channel)) for channel in channels)


def _metadata(group: Any) -> dict[str, str]:
    return {key: str(value) for key, value in group.properties.items() if key != _ORIGIN}


def _is_stamps(channel: Any) -> bool:
    return channel.data_type is _nptdms().types.TimeStamp


def _no_numbers(channel: Any) -> str:
    """Why the channel is no series of numbers; "" when it is one."""
    if channel.dtype is None:
        return "no values"
    if _is_stamps(channel):
        return "time stamps"
    return "" if channel.dtype.kind in "fiub" else _OTHERS.get(channel.dtype.kind, f"no numbers ({channel.dtype})")


def _time_channel(group: Any, told: str) -> Any:
    """The channel that is the time of its group: told or named so, or the only one of time stamps; None without one."""
    channels = [c for c in group.channels() if c.dtype is not None and (_is_stamps(c) or c.dtype.kind in "fiu")]
    named = [c for c in channels if naming.time_column(c.name)]
    stamps = [c for c in channels if _is_stamps(c)]
    exact = [c for c in named if c.name.lower() == "time"]
    for candidates in ([c for c in channels if told and c.name == told], exact, named, stamps):
        if len(candidates) == 1:
            return candidates[0]
    return None


def _scales(properties: Mapping[str, Any]) -> int:
    """How many scales the properties state, or number."""
    stated = str(properties.get("NI_Number_Of_Scales", ""))
    numbers = [match[1] for key in properties if (match := re.match(r"NI_Scale\[(\d+)\]", key))]
    return max((int(number[:18]) for number in (stated, *numbers) if number.isdecimal()), default=0)


def _unknown_scale(*owners: Any) -> str:
    """Why the scale of a channel (or of its group, or its file: the first that has one) cannot be applied; "" when it can."""
    from nptdms.scaling import get_scaling

    for properties in (owner.properties for owner in owners):
        if not _scales(properties) or properties.get("NI_Scaling_Status", "unscaled") == "scaled":
            continue
        if get_scaling(properties, {}, {}) is not None:
            return ""
        kinds = {str(value) for key, value in properties.items() if re.fullmatch(r"NI_Scale\[\d+\]_Scale_Type", key)}
        return f"its numbers are counts of a scale that is not known ({', '.join(sorted(kinds))})"
    return ""


def _since_1970_of(start: Any) -> int:
    """ns of a property that is a time stamp."""
    if hasattr(start, "second_fractions"):
        return _since_1970(np.array([start.seconds]), np.array([start.second_fractions], np.uint64)).tolist()[0]
    return int(np.datetime64(start, "ns").astype(np.int64))


def _since_1970(whole: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """ns of seconds since 1904 and 2^-64 parts of one."""
    t_ns = seconds.whole_to_ns(whole.astype(np.int64) - _EPOCH_1904)
    # 2^-64 s are far below a ns: the upper 53 bits are enough for the nearest one
    return seconds.shifted_each(t_ns, np.rint(fractions.astype(np.float64) / 2.0**64 * NANOSECONDS).astype(np.int64))


def _stamps(series: _Series, start: int, stop: int, origin: int) -> np.ndarray:
    if series.time is None:
        first, offset = (np.array(every, np.int64) for every in zip(*series.pieces, strict=True))
        rows = np.arange(start, stop)
        piece = np.searchsorted(first, rows, side="right") - 1
        return offset[piece] + np.rint(series.step_ns * (rows - first[piece])).astype(np.int64)
    times = series.time[start:stop]
    if not series.per:
        return _since_1970(np.asarray(times["seconds"]), np.asarray(times["second_fractions"]))
    times = np.asarray(times)
    whole = times.dtype.kind in "iu"
    t_ns = seconds.whole_to_ns(times, series.per) if whole else seconds.to_ns(times.astype(np.float64), series.per)
    return seconds.shifted(t_ns, origin)


def _damage(path: str) -> str:
    """What is wrong with the segments of a file as a whole, in words; their contents are not looked at."""
    size = Path(path).stat().st_size
    position = 0
    with Path(path).open("rb") as stream:
        for number in range(1, _MOST_SEGMENTS):
            if position == size and number > 1:
                return ""
            stream.seek(position)
            head = stream.read(_LEAD_IN.size)
            if len(head) < _LEAD_IN.size:
                return f"cut off in segment {number}"
            tag, _, _, length, raw = _LEAD_IN.unpack(head)
            if tag != b"TDSm":
                return f"damaged: no segment begins at byte {position}" if number > 1 else ""
            position += _LEAD_IN.size + length
            if length == 2**64 - 1 or position > size:
                return f"cut off in segment {number}"
            if raw > length:
                return f"damaged: segment {number} is shorter than what describes it"
    return ""
