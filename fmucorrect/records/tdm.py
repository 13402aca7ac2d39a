"""TDM (.tdm with its .tdx beside it, as DIAdem and LabVIEW write them): groups are topics.

The time is a channel that is named so or holds dates, else the waveform attributes of the channels. Channels of other
lengths, of text and without a time are named in `left_out`. Read whole, in a process of its own.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records import naming, seconds
from fmucorrect.records.child import ChildSource
from fmucorrect.records.structures import Table, Tables
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Reading

_TEXT = "DT_STRING"


def opened(path: str, reading: Reading) -> ChildSource:
    """A TDM file, read in a process of its own. Raises MissingExtra, and RecordError as `TdmSource`."""
    if importlib.util.find_spec("tdm_loader") is None:
        raise MissingExtra("tdm-loader", "formats")
    return ChildSource(path, "fmucorrect.records.tdm:TdmSource", reading)


class TdmSource(Tables):
    """A TDM file, read. Raises RecordError when it is none, its .tdx is not there, or it has no time."""

    format = "TDM"
    encoding = "channel group"

    @staticmethod
    def load() -> None:
        """Import the library."""
        import tdm_loader  # noqa: F401 # pyright: ignore[reportUnusedImport, reportMissingImports]

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        super().__init__(path, reading)
        import tdm_loader

        try:
            file: Any = tdm_loader.OpenFile(path)
            beside = str(file._root.find(".//file").get("url"))
        except Exception as error:  # the XML and zip libraries raise many kinds on damaged files
            raise RecordError(f"this cannot be read as TDM: {error}", where=path) from error
        if Path(beside).name != beside or not Path(path).with_name(beside).is_file():
            raise RecordError(
                "the numbers of this file are not there", where=path, expected=f"{Path(beside).name!r} beside it"
            )
        for group in range(len(file)):
            self._group(file, group)
        if not self._tables:
            raise RecordError(
                "there is no time", where=path, got="; ".join(self._left_out[:20]) or "no channels",
                remedy="Say which channel it is: time in [records] of a study, --time on the command line.",
            )  # fmt: skip
        self.left_out = tuple(self._left_out)

    def _group(self, file: Any, group: int) -> None:
        title = str(file.channel_group_name(group) or f"group{group + 1}")
        names = [str(file.channel_name(group, c) or f"channel{c + 1}") for c in range(file.no_channels(group))]
        names, told = naming.numbered(names)
        channels: list[tuple[str, np.ndarray, str, dict[str, str]]] = []
        for c, name in enumerate(names):
            xml = file._channel_xml(group, c)
            if xml.findtext("datatype") == _TEXT or not xml.findtext("local_columns"):
                self._left_out.append(
                    f"channel '{title}.{name}': {'text' if xml.findtext('datatype') == _TEXT else 'empty'}"
                )
                continue
            attributes = {str(a.get("name")): str(a.text) for a in xml.iterfind("instance_attributes/*")}
            channels.append(
                (
                    name,
                    np.asarray(file.channel(group, c)),
                    str(file.channel_unit(group, c) or "").strip('" ') or "1",
                    attributes,
                )
            )
        named = [c for c in channels if c[0] == self._told] or [c for c in channels if naming.time_column(c[0])]
        named = named or [c for c in channels if c[1].dtype.kind == "M"]
        tables = [self._timed(title, named[0])] if named else []
        for channel in channels:
            if not named or channel is not named[0]:
                self._channel(title, channel, tables, bool(named))
        for number, table in enumerate(tables):
            table.name = title if not number else f"{title}/{number + 1}"
            table.assumed += [told] if told else []
            if table.name in {other.name for other in self._tables}:
                table.name = f"{table.name}_{len(self._tables) + 1}"
            self._tables.append(table)

    def _timed(self, title: str, channel: tuple[str, np.ndarray, str, dict[str, str]]) -> Table:
        name, values, unit, _ = channel
        if values.dtype.kind == "M":
            return Table(title, values.astype("datetime64[ns]").astype(np.int64), time=name)
        per = seconds.unit_ns(self._told_unit or naming.time_unit(name, unit))
        if per is None:
            raise RecordError(f"the unit of the time '{title}.{name}' is not known", where=self.path, got=repr(unit))
        return Table(title, seconds.to_ns(values.astype(np.float64), per), time=name, counts=True)

    def _channel(
        self, title: str, channel: tuple[str, np.ndarray, str, dict[str, str]], tables: list[Table], timed: bool
    ) -> None:
        name, values, unit, attributes = channel
        if values.dtype.kind not in "fiub":
            self._left_out.append(f"channel '{title}.{name}': no numbers ({values.dtype})")
            return
        if not timed:
            grid = next(_grid(attributes, len(values)), None)
            if grid is None:
                self._left_out.append(f"channel '{title}.{name}': it has no time")
                return
            if not any(np.array_equal(table.t_ns, grid) for table in tables):
                tables.append(Table(title, grid))
            table = next(table for table in tables if np.array_equal(table.t_ns, grid))
        else:
            table = tables[0]
            if len(values) != len(table.t_ns):
                self._left_out.append(f"channel '{title}.{name}': {len(values)} values, but {len(table.t_ns)} times")
                return
        table.series[name] = values.astype(np.float64)
        table.units[name] = unit


def _grid(attributes: dict[str, str], rows: int) -> Iterator[np.ndarray]:
    """The times of a waveform; nothing without them."""
    try:
        step = float(attributes.get("wf_increment", "0"))
        offset = float(attributes.get("wf_start_offset", "0"))
    except ValueError:
        return
    start = seconds.parse_stamp(attributes.get("wf_start_time", "")) or (0, "")
    if step > 0:
        yield start[0] + np.rint((offset + step * np.arange(rows)) * NANOSECONDS).astype(np.int64)
