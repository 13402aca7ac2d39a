"""TDMS: groups are topics; the unit is the property `unit_string` (or `NI_UnitDescription`).

Time is a channel `time` in s of the group, or the waveform properties wf_start_offset and wf_increment. Groups whose
channels have different lengths keep the channels as long as the time, or without one as the first.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records import seconds
from fmucorrect.records.assemble import RESERVED
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.source import NO_TIME, RAM_ROWS, Block, extent_of
from fmucorrect.signals import Record

_ORIGIN = "time_origin_ns"
_UNITS = ("unit_string", "NI_UnitDescription")


def _nptdms() -> Any:
    try:
        import nptdms
    except ImportError as error:
        raise MissingExtra("nptdms", "formats") from error
    return nptdms


class TdmsSource:
    """A TDMS file opened for reading. Raises RecordError when it is none."""

    format = "TDMS"
    truncated = False
    damage = ""
    left_out: tuple[str, ...] = ()

    def __init__(self, path: str) -> None:
        self.path = path
        try:
            self._file: Any = _nptdms().TdmsFile.open(path)
        except (ValueError, KeyError, EOFError, OSError) as error:
            raise RecordError(f"this cannot be read as TDMS: {error}", where=path) from error
        self.truncated = bool(getattr(self._file.file_status, "incomplete_final_segment", False))

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def topics(self) -> tuple[Topic, ...]:
        """One topic a group, of its numeric channels."""
        found: list[Topic] = []
        for group in self._file.groups():
            time, columns = self._channels(group)
            note = "" if columns else "no time channel, no wf_increment, or no numbers"
            kept = {k: str(v) for k, v in group.properties.items() if k != _ORIGIN}
            named = tuple(Column(channel.name, _unit(channel)) for channel in columns)
            found.append(Topic(group.name, named, "time channel" if time is not None else "waveform", kept, note))
        return tuple(found)

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """Slices of the channels."""
        group = self._file[topic]
        time, channels = self._channels(group)
        rows = len(time) if time is not None else len(channels[0]) if channels else 0
        origin = int(group.properties.get(_ORIGIN, 0))
        for start in range(0, rows, RAM_ROWS):
            stop = min(start + RAM_ROWS, rows)
            values = np.empty((stop - start, len(columns)))
            for c, name in enumerate(columns):
                values[:, c] = group[name][start:stop]
            yield Block(self._stamps(time, channels, start, stop, origin), values)

    def extent(self, topic: str) -> Extent:
        """By reading the times."""
        return extent_of(self.blocks(topic, []))

    def _stamps(self, time: Any, channels: list[Any], start: int, stop: int, origin: int) -> np.ndarray:
        if time is None:
            properties = channels[0].properties
            offset = round(float(properties.get("wf_start_offset", 0.0)) * 1e9)
            step = float(properties["wf_increment"]) * 1e9
            return offset + np.rint(step * np.arange(start, stop)).astype(np.int64)
        t_ns = seconds.to_ns(np.asarray(time[start:stop], np.float64))
        return t_ns if not origin else np.where(t_ns == NO_TIME, NO_TIME, t_ns + origin)

    def _channels(self, group: Any) -> tuple[Any, list[Any]]:
        """The time channel (None for waveforms) and the numeric channels that go with it."""
        every = [c for c in group.channels() if c.dtype is not None and c.dtype.kind in "fiub"]
        time = next((c for c in every if c.name.lower() == "time"), None)
        others = [c for c in every if c is not time]
        if time is None:
            others = [c for c in others if "wf_increment" in c.properties]
            steps = {c.properties["wf_increment"] for c in others[:1]}
            others = [c for c in others if c.properties["wf_increment"] in steps]
        rows = len(time) if time is not None else len(others[0]) if others else 0
        return time, [c for c in others if len(c) == rows]


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
    return next((str(channel.properties[key]) for key in _UNITS if channel.properties.get(key)), "1")
