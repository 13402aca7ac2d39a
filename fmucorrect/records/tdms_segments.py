"""What the segments of a TDMS file say one after another: the library keeps the last value of each property alone.

A file that was appended to may begin anew in a later segment: at another time, in another unit, or with a channel missing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fmucorrect.errors import RecordError

START = "wf_start_time"
AXIS = ("wf_increment", "wf_start_offset", "wf_xunit_string")
"""What says with the start at which times the values of a waveform are."""
UNITS = ("unit_string", "NI_UnitDescription")
_SCALING = ("NI_Scale", "NI_Number_Of_Scales", "NI_Scaling_Status")
"""How properties begin that say what stored numbers stand for."""
_GROUP = re.compile(r"/'(?:[^']|'')*'")
"""The group at the beginning of an object's path."""


@dataclass
class History:
    """One channel over the segments.

    starts: rows from which a wf_start_time holds, and it. changed: by property that changed between values, how. behind: rows
    that it had less than others of its group and increment, when a segment went on with all of them.
    """

    group: str
    properties: dict[str, Any] = field(default_factory=dict[str, Any])
    starts: list[tuple[int, Any]] = field(default_factory=list[tuple[int, Any]])
    changed: dict[str, str] = field(default_factory=dict[str, str])
    behind: int = 0
    rows: int = 0
    _pending: dict[str, tuple[int, str]] = field(default_factory=dict[str, tuple[int, str]])

    def told(self, key: str, value: Any) -> None:
        """A property, before the values of its segment."""
        matters = key == START or key in (*AXIS, *UNITS) or key.startswith(_SCALING)
        # by their text: the library's time stamps are comparable with each other alone
        if not matters or (key in self.properties and repr(self.properties[key]) == repr(value)):
            return
        if key == START:
            if self.starts and self.starts[-1][0] == self.rows:
                self.starts.pop()
            # told for the first time, it holds for all
            self.starts.append((self.rows if self.starts else 0, value))
        elif self.rows and key in self.properties:
            self._pending.setdefault(key, (self.rows, f"{self.properties[key]!s} becomes {value!s} at row {self.rows}"))
        self.properties[key] = value

    def grew(self, rows: int) -> None:
        """Values that a segment adds."""
        if rows:
            self.rows += rows
            self.changed |= {key: how for key, (_, how) in self._pending.items()}
            self._pending.clear()

    def finish(self) -> None:
        """A start behind the last value is a correction of the only one before, or says nothing."""
        if len(self.starts) > 1 and self.starts[-1][0] == self.rows:
            _, value = self.starts.pop()
            self.starts = [(0, value)] if len(self.starts) == 1 else self.starts

    @property
    def since_start(self) -> int:
        """Values since its last start."""
        return self.rows - (self.starts[-1][0] if self.starts else 0)

    @property
    def at_once(self) -> tuple[object, ...]:
        """What channels have in common whose values in one segment are of the same times."""
        return (
            self.group,
            *(self.properties.get(key) for key in AXIS),
            repr(self.starts[-1][1]) if self.starts else "",
        )


class _Noted:
    """The histories of all objects, as the library reads segment after segment. known: its metadata by path."""

    def __init__(self) -> None:
        self.histories: dict[str, History] = {}
        self.seen = 0
        self._objects: list[Any] = []
        self._before: dict[str, int] = {}
        self._even: list[Any] | None = None

    def begins(self, segment: Any, known: Mapping[str, Any]) -> None:
        """A segment, before its values are counted."""
        self._objects = segment.ordered_objects
        self._before = {one.path: _rows(known, one.path) for one in self._objects if one.has_data}

    def ends(self, told: Mapping[str, Any], known: Mapping[str, Any]) -> None:
        """The same, with them. told: properties by path that stand in it."""
        self.seen += 1
        for path, properties in told.items():
            for key, value in properties:
                self._history(path).told(key, value)
        grown = {path: _rows(known, path) - before for path, before in self._before.items()}
        # segments that repeat the objects of the one before change nothing where each adds as much to all
        if told or self._objects is not self._even:
            self._even = self._objects if self._compare(grown) else None
        for path, rows in grown.items():
            self._history(path).grew(rows)

    def _compare(self, grown: Mapping[str, int]) -> bool:
        """Note what is behind among the channels that go on together; whether these grow evenly."""
        together: dict[tuple[object, ...], list[str]] = {}
        for path, rows in grown.items():
            if rows and "wf_increment" in self._history(path).properties:
                together.setdefault(self.histories[path].at_once, []).append(path)
        for paths in together.values():
            most = max(self.histories[path].since_start for path in paths)
            for path in paths:
                history = self.histories[path]
                history.behind = max(history.behind, most - history.since_start)
        return all(len({grown[path] for path in paths}) == 1 for paths in together.values())

    def _history(self, path: str) -> History:
        if path not in self.histories:
            found = _GROUP.match(path)
            self.histories[path] = History(found[0] if found else "")
        return self.histories[path]


def _rows(known: Mapping[str, Any], path: str) -> int:
    return known[path].num_values if path in known else 0


def histories(path: str) -> dict[str, History]:
    """What each object of a file, by its path in the file, was over the segments."""
    from nptdms.reader import TdmsReader

    noted = _Noted()

    class Reader(TdmsReader):
        def _update_object_metadata(self, segment: Any) -> None:
            noted.begins(segment, self.object_metadata)
            super()._update_object_metadata(segment)

        def _update_object_properties(self, segment_object_properties: Any) -> None:
            super()._update_object_properties(segment_object_properties)
            noted.ends(segment_object_properties or {}, self.object_metadata)

    with Path(path).open("rb") as stream:
        reader = Reader(stream)
        reader.read_metadata()
    if reader.object_metadata and not noted.seen:
        raise RecordError("this version of nptdms does not show the segments of a file", where=path)
    for history in noted.histories.values():
        history.finish()
    return noted.histories
