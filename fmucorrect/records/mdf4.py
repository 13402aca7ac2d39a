"""MDF 3 and 4 (.mf4, .mdf): channel groups are topics, the master channel is the time, units are the channels' own.

Read and written whole. Samples that the file marks invalid are NaN. A group whose master is an angle, a distance or an
index has no time and is left out. Reading is done in a process of its own (`fmucorrect.records.child`): asammdf can
take the interpreter down with it on a damaged file. Whether the stated numbers of records agree with the data, which it does
not ask, `mdf_blocks` tells as damage.
"""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records import mdf_blocks, naming, seconds
from fmucorrect.records.child import ChildSource
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.source import Block, extent_of
from fmucorrect.signals import AS_IT_IS, Reading, Record

_ORIGIN = "time_origin_ns="
_NOTES = "fmucorrect_notes="
_TIME_V3 = 1
_MASTERS = (2, 3)
"""Kinds of channel in MDF 4 that are a master, stored and counted."""
_CHANNEL = b"##CN"
"""How the block of a channel begins, at a multiple of 8 bytes."""
_FORMULA = 80
"""Characters of a formula that an error quotes."""
_OWN_TOOL = "<tool_id>asammdf</tool_id>"
_LATEST_NS = 2**62
"""ns since 1970, in 2116: a header that says more is damaged."""
_SYNCS = {0: "nothing", 2: "an angle", 3: "a distance", 4: "an index"}
"""What a master of MDF 4 counts, other than 1, the time."""


def _asammdf() -> Any:
    """The library, made safe: a formula that numexpr refuses it would hand to sympy, whose parser runs it as Python."""
    try:
        import asammdf
        from asammdf.blocks import v2_v3_blocks, v4_blocks
    except ImportError as error:
        raise MissingExtra("asammdf", "formats") from error
    for blocks in (v2_v3_blocks, v4_blocks):
        vars(blocks).update(lambdify=_refused, symbols=str)
    return asammdf


def _refused(_: object, formula: str, **__: object) -> None:
    raise RecordError(
        f"the conversion formula {formula[:_FORMULA]!r} cannot be computed",
        expected="arithmetic of X1 and numbers, as numexpr knows it",
    )


def opened(path: str, reading: Reading) -> ChildSource:
    """An MDF file, read in a process of its own. Raises MissingExtra, and RecordError as `Mdf4Source`."""
    if importlib.util.find_spec("asammdf") is None:
        raise MissingExtra("asammdf", "formats")
    return ChildSource(path, "fmucorrect.records.mdf4:Mdf4Source", reading)


class Mdf4Source:
    """An MDF file opened for reading. Raises RecordError when it is none."""

    format = "MDF"
    truncated = False

    @staticmethod
    def load() -> None:
        """Import the library, in the child and without sympy: a third of the time, and what none may use there. Raises
        MissingExtra."""
        sys.modules["sympy"] = None  # pyright: ignore[reportArgumentType] (a name that cannot be imported)
        _asammdf()

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        self.path = path
        self._told = reading.time
        module = _asammdf()
        try:
            self._file: Any = module.MDF(path)
        except Exception as error:  # asammdf raises its own and struct's errors on damaged files
            raise RecordError(f"this cannot be read as MDF: {error}", where=path) from error
        self.format = f"MDF {self._file.version}"
        self.damage = mdf_blocks.disagreement(path)
        self._notes = _noted(str(self._file.header.comment or "")) if self._is_v4() else {}
        self._groups: dict[str, dict[str, tuple[int, int]]] = {}
        self._times: dict[str, tuple[int, int, int]] = {}
        self._left_out: list[str] = []
        self._topics = tuple(self._group(number, group) for number, group in enumerate(self._file.groups))
        self._left_out += self._unlinked()
        self.left_out = tuple(self._left_out)

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def topics(self) -> tuple[Topic, ...]:
        """One topic a channel group."""
        return self._topics

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """All rows at once."""
        places = self._groups[topic]
        if not places:
            return
        t_ns = self._stamps(topic)
        values = np.empty((len(t_ns), len(columns)))
        for c, name in enumerate(columns):
            values[:, c] = self._samples(places[name], len(t_ns))
        yield Block(t_ns, values)

    def extent(self, topic: str) -> Extent:
        """By reading the times."""
        return extent_of(self.blocks(topic, []))

    def _samples(self, place: tuple[int, int], rows: int) -> np.ndarray:
        group, index = place
        signal = self._file.get(group=group, index=index, ignore_invalidation_bits=True)
        values = np.asarray(signal.samples, np.float64)
        if len(values) != rows:
            raise RecordError(
                f"channel {signal.name!r} has {len(values)} samples, its time has {rows}", where=self.path
            )
        if signal.invalidation_bits is not None:
            values = np.where(np.asarray(signal.invalidation_bits, bool), np.nan, values)
        return values

    def _stamps(self, topic: str) -> np.ndarray:
        number = self._times[topic][0]
        group = self._file.groups[number]
        times = self._counted(topic)
        stated = int(group.channel_group.cycles_nr)
        if len(times) != stated:
            raise RecordError(
                f"the file is damaged: group {topic!r} holds {len(times)} of the {stated} rows that it states",
                where=self.path,
            )
        return seconds.shifted(times, _origin(group))

    def _counted(self, topic: str, first: int = 0, rows: int | None = None) -> np.ndarray:
        """(T,) the numbers of a group's time in ns, of `rows` rows from `first` on; None: of all that are there."""
        number, index, per = self._times[topic]
        if self._file.masters_db.get(number) == index:
            times = np.asarray(self._file.get_master(number, record_offset=first, record_count=rows))
        else:
            signal = self._file.get(group=number, index=index, record_offset=first, record_count=rows)
            times = np.asarray(signal.samples)
        return seconds.whole_to_ns(times, per) if times.dtype.kind in "iu" else seconds.to_ns(times.astype(float), per)

    def _unlinked(self) -> Iterator[str]:
        """What stands in the file and no link leads to, as after damage to a link."""
        if not self._is_v4():
            groups = [(len(g.channels), int(g.channel_group.ch_nr), "channels") for g in self._file.groups]
            for found, stated, what in [*groups, (len(self._file.groups), int(self._file.header.dg_nr), "data groups")]:
                if found < stated:
                    yield f"{stated - found} of {stated} {what} that the file states: no link leads to them, it may be damaged"
            return
        # there is no count of channels in MDF 4
        blocks = np.memmap(self.path, "<u4", mode="r", shape=(Path(self.path).stat().st_size // 8, 2))[:, 0]
        found = int(np.count_nonzero(blocks == int.from_bytes(_CHANNEL, "little")))
        read = sum(len(group.channels) for group in self._file.groups)
        if found > read:
            yield f"{found - read} of {found} channels: no link in the file leads to them, it may be damaged"

    def _group(self, number: int, group: Any) -> Topic:
        name = getattr(group.channel_group, "acq_name", "") or f"group{number}"
        name = f"{name}_{number}" if name in self._groups else name
        self._groups[name] = {}
        master, why = self._master(number, group)
        if master is None:
            rows = int(group.channel_group.cycles_nr)
            self._left_out.append(f"group {name!r} ({len(group.channels)} channels, {rows} rows): {why}")
            return Topic(name, (), "channel group", self._notes, why)
        self._times[name] = (number, *master)
        found: list[tuple[int, Column]] = []
        for index, channel in enumerate(group.channels):
            kind = getattr(channel, "channel_type", 0)
            if index == master[0]:
                continue
            signal = self._file.get(group=number, index=index, record_count=1, ignore_invalidation_bits=True)
            samples = np.asarray(signal.samples)
            if self._is_v4() and kind in _MASTERS:
                counts = _SYNCS.get(channel.sync_type, "the time, too")
                self._left_out.append(f"channel '{name}.{channel.name}': a master that counts {counts}")
            elif samples.ndim != 1 or samples.dtype.kind not in "fiub":
                self._left_out.append(f"channel '{name}.{channel.name}': {_kind(samples)}")
            else:
                found.append((index, Column(channel.name, str(signal.unit or "1"))))
        names, told = naming.numbered([column.name for _, column in found])
        self._groups[name] = {label: (number, index) for label, (index, _) in zip(names, found, strict=True)}
        columns = tuple(Column(label, column.unit) for label, (_, column) in zip(names, found, strict=True))
        metadata = {**self._notes, **({"assumed": told} if told else {})}
        time = str(group.channels[master[0]].name)
        note = "" if columns else "no numbers"
        zero = None if _origin(group) else self._zero(name, int(group.channel_group.cycles_nr))
        return Topic(name, columns, "channel group", metadata, note, time, zero_ns=zero)

    def _zero(self, topic: str, rows: int) -> int | None:
        """ns since 1970 at which the measurement was started, as the header says; None where that is not known.

        asammdf writes the time of its own call where nobody told it a start. Such a record would end after its file was
        written, which tells it.
        """
        zero = int(getattr(self._file.header, "abs_time", None) or 0)
        if zero <= 0 or zero > _LATEST_NS:
            return None
        history: list[Any] = list(self._file.file_history) if self._is_v4() else []
        written = [h.abs_time for h in history if _OWN_TOOL in str(h.comment)]
        last = self._counted(topic, rows - 1, 1) if written and rows else None
        return zero if last is None or not len(last) or zero + int(last[0]) <= min(written) else None

    def _master(self, number: int, group: Any) -> tuple[tuple[int, int] | None, str]:
        """The channel that is the time, with ns in its unit; or None, and why there is none."""
        if told := [(i, c) for i, c in enumerate(group.channels) if self._told and c.name == self._told]:
            times = told
        elif self._is_v4():
            masters = [(i, c) for i, c in enumerate(group.channels) if c.channel_type in _MASTERS]
            times = [(i, c) for i, c in masters if c.sync_type == 1]
            if not times and masters:
                index, channel = masters[0]
                return None, f"its master {channel.name!r} is {_SYNCS.get(channel.sync_type, 'unknown')}, not the time"
        else:
            times = [(i, c) for i, c in enumerate(group.channels) if c.channel_type == _TIME_V3]
        if len(times) != 1:
            return None, "it has no time" if not times else "it has several channels that are its time"
        index, channel = times[0]
        unit = str(self._file.get(group=number, index=index, record_count=1).unit or channel.unit or "s")
        per = seconds.unit_ns(unit)
        return (None, f"the unit of its time is not known: {unit!r}") if per is None else ((index, per), "")

    def _is_v4(self) -> bool:
        return str(self._file.version) >= "4"


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
            file.header.abs_time = (
                origin  # else it is the time of this call, which a reader takes for the measurement's
            )
            if notes:
                file.header.comment = _NOTES + json.dumps(dict(notes))
            # the library knows no other suffix for MDF 4, and would write beside
            saved = self._path if self._path.lower().endswith(".mf4") else f"{self._path}.mf4"
            try:
                file.save(saved, overwrite=True)
                Path(saved).replace(self._path)
            except BaseException:
                Path(saved).unlink(missing_ok=True)
                raise


def _noted(comment: str) -> dict[str, str]:
    """The notes that Mdf4Sink left in a comment, which is XML."""
    try:
        found = json.JSONDecoder().raw_decode(unescape(comment).partition(_NOTES)[2])[0]
    except (ValueError, RecursionError):
        return {}
    return {str(key): str(text) for key, text in found.items()} if isinstance(found, dict) else {}


def _kind(samples: np.ndarray) -> str:
    if samples.dtype.kind in "SUO":
        return "text"
    return (
        "complex numbers" if samples.dtype.kind == "c" else f"no series of numbers ({samples.dtype}, {samples.ndim}-D)"
    )


def _origin(group: Any) -> int:
    comment = str(getattr(group.channel_group, "comment", "") or "")
    return seconds.origin_from(comment.split(_ORIGIN)[1].split()[0]) if _ORIGIN in comment else 0
