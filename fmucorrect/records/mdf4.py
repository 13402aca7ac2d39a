"""MDF4 (.mf4): channel groups are topics, the master channel is the time, units are the channels' own.

Read and written whole. Samples that the file marks invalid are NaN.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from html import unescape
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records import seconds
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.source import Block, extent_of
from fmucorrect.signals import Record

_ORIGIN = "time_origin_ns="
_NOTES = "fmucorrect_notes="


def _asammdf() -> Any:
    try:
        import asammdf
    except ImportError as error:
        raise MissingExtra("asammdf", "formats") from error
    return asammdf


class Mdf4Source:
    """An MDF4 file opened for reading. Raises RecordError when it is none."""

    format = "MDF4"
    truncated = False
    damage = ""
    left_out: tuple[str, ...] = ()

    def __init__(self, path: str) -> None:
        self.path = path
        module = _asammdf()
        try:
            self._file: Any = module.MDF(path)
        except Exception as error:  # asammdf raises its own and struct's errors on damaged files
            raise RecordError(f"this cannot be read as MDF4: {error}", where=path) from error
        self._notes = _noted(str(self._file.header.comment or ""))
        self._groups: dict[str, dict[str, tuple[int, int]]] = {}
        self._origins: dict[str, int] = {}
        self._topics = tuple(self._group(number, group) for number, group in enumerate(self._file.groups))

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def topics(self) -> tuple[Topic, ...]:
        """One topic a channel group."""
        return self._topics

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """All rows at once."""
        places = self._groups[topic]
        t_ns = self._stamps(topic)
        values = np.empty((len(t_ns), len(columns)))
        for c, name in enumerate(columns):
            group, index = places[name]
            signal = self._file.get(group=group, index=index, ignore_invalidation_bits=True)
            values[:, c] = np.asarray(signal.samples, np.float64)
            if signal.invalidation_bits is not None:
                values[np.asarray(signal.invalidation_bits, bool), c] = np.nan
        yield Block(t_ns, values)

    def extent(self, topic: str) -> Extent:
        """By reading the times."""
        return extent_of(self.blocks(topic, []))

    def _stamps(self, topic: str) -> np.ndarray:
        number = next(iter(self._groups[topic].values()))[0] if self._groups[topic] else 0
        return seconds.to_ns(np.asarray(self._file.get_master(number), np.float64)) + self._origins[topic]

    def _group(self, number: int, group: Any) -> Topic:
        name = group.channel_group.acq_name or f"group{number}"
        name = f"{name}_{number}" if name in self._groups else name
        master = self._file.masters_db.get(number)
        places: dict[str, tuple[int, int]] = {}
        columns: list[Column] = []
        for index, channel in enumerate(group.channels):
            if index == master or master is None:
                continue
            signal = self._file.get(group=number, index=index, record_count=1)
            label = channel.name if channel.name not in places else f"{channel.name}_{index}"
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "fiub":
                places[label] = (number, index)
                columns.append(Column(label, signal.unit or "1"))
        self._groups[name] = places
        comment = group.channel_group.comment or ""
        self._origins[name] = int(comment.split(_ORIGIN)[1].split()[0]) if _ORIGIN in comment else 0
        return Topic(
            name, tuple(columns), "channel group", self._notes, note="" if columns else "no time or no numbers"
        )


class Mdf4Sink:
    """An MDF4 file being written, held in memory until it is closed."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._module = _asammdf()
        self._parts: list[Record] = []
        self._topic = ""

    def append(self, topic: str, record: Record) -> None:
        """Keep a copy of the rows."""
        self._parts.append(replace(record, t_ns=record.t_ns.copy(), values=record.values.copy()))
        self._topic = topic

    def close(self, notes: Mapping[str, str]) -> None:
        """Write the file; notes stand in the comment of its header."""
        if not self._parts:
            return
        t_ns = np.concatenate([part.t_ns for part in self._parts])
        values = np.concatenate([part.values for part in self._parts])
        origin = seconds.origin_for(t_ns)
        times = seconds.from_ns(t_ns, origin)
        signals = [
            self._module.Signal(np.ascontiguousarray(values[:, c]), times, unit=channel.unit, name=channel.name)
            for c, channel in enumerate(self._parts[0].channels)
        ]
        self._parts = []
        with self._module.MDF(version="4.10") as file:
            file.append(
                signals,
                acq_name=self._topic.lstrip("/"),
                comment=f"{_ORIGIN}{origin}" if origin else "",
                common_timebase=True,
            )
            if notes:
                file.header.comment = _NOTES + json.dumps(dict(notes))
            file.save(self._path, overwrite=True)


def _noted(comment: str) -> dict[str, str]:
    """The notes that Mdf4Sink left in a comment, which is XML."""
    try:
        found = json.JSONDecoder().raw_decode(unescape(comment).partition(_NOTES)[2])[0]
    except (ValueError, RecursionError):
        return {}
    return {str(key): str(text) for key, text in found.items()} if isinstance(found, dict) else {}
