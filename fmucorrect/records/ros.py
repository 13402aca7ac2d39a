"""ROS messages, without ROS: schema text (ros2msg, ros1msg) and payloads (CDR, or ROS 1's packed bytes).

A payload is traced once: where each number lies, and which bytes (lengths) must be the same in another message for that
to hold there too. Numbers, strings, nested types, fixed, bounded and free arrays, builtin time and duration (in s).
ROS 1 writes the same fields one behind another: little endian, without alignment, encapsulation or terminators.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from fmucorrect.records.bulk import REST, WHOLE, Layout, Place
from fmucorrect.records.decode import DEEPEST, LONGEST
from fmucorrect.records.named import Entries, holds_names
from fmucorrect.records.source import MOST_COLUMNS

_KINDS = {
    "bool": "u1", "byte": "u1", "octet": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_TIME = re.compile(r"(builtin_interfaces/)?(Time|Duration|time|duration)$")
_FIELD = re.compile(r"([\w/]+)(?:<=\d+)?(?:\[(<=)?(\d*)\])?\s+(\w+)\s*(.*)$")


@dataclass(frozen=True)
class _Field:
    kind: str
    name: str
    array: bool
    count: int | None  # entries of a fixed array


class RosDecoder:
    """Payloads of one schema, whose language is "ros2msg" or "ros1msg". Raises ValueError when the schema cannot be used.

    left: by path, what was met that is no number, with the reason.
    """

    def __init__(self, name: str, schema: str, language: str = "ros2msg") -> None:
        self._language = language
        self._packed = language == "ros1msg"
        self._kinds = _KINDS | {"byte": "i1"} if self._packed else _KINDS
        sections = re.split(r"^=+\s*$", schema, flags=re.MULTILINE)
        self._root = _plain(name)
        self._known_fixed: dict[str, bool] = {}
        self._types: dict[str, list[_Field]] = {self._root: _fields(sections[0], language)}
        for section in sections[1:]:
            head, _, body = section.strip().partition("\n")
            if not head.startswith("MSG:"):
                raise ValueError(f"the {language} schema of {name!r} has a section without 'MSG:'")
            self._types[_plain(head[4:].strip())] = _fields(body, language)
        self._fixed = self._all_fixed(self._root, ())
        self.left: dict[str, str] = {}
        self.entries = Entries()

    def _all_fixed(self, kind: str, above: tuple[str, ...]) -> bool:
        """Whether every message has the same numbers. Raises ValueError for a type that holds itself or lies too deep."""
        if kind in above:
            raise ValueError(f"the {self._language} type {kind!r} holds itself")
        if len(above) > DEEPEST:
            raise ValueError(f"the {self._language} schema is nested more than {DEEPEST} deep")
        if kind in self._known_fixed:
            return self._known_fixed[kind]
        fixed = True
        for field in self._types[kind]:
            free = field.array and field.count is None
            plain = field.kind in _KINDS or field.kind in ("string", "wstring")
            if not plain and not (_TIME.match(field.kind) and _plain(field.kind) not in self._types):
                fixed &= self._all_fixed(self._resolve(kind, field.kind), (*above, kind))
            fixed &= not free and not _names(field)
        self._known_fixed[kind] = fixed
        return fixed

    def declared(self) -> list[tuple[str, str]]:
        """Nothing but what messages hold: the schema has no units and may have free arrays."""
        return []

    def leaves(self, payload: bytes) -> dict[str, float]:
        """Every number by its path."""
        return self.layout(payload).leaves()

    def complete(self, names: Collection[str]) -> bool:
        """Whether the schema has no free lists, and a message was seen."""
        return self._fixed and bool(names)

    def layout(self, payload: bytes) -> Layout:
        """Where the numbers lie. Raises ValueError when the payload does not fit the schema."""
        if self._packed:
            trace = _Trace(payload, "<", 1, 0)
        else:
            if len(payload) < 4 or payload[0] != 0 or payload[1] not in (0, 1, 6, 7):
                raise ValueError(f"the CDR encapsulation {payload[:2].hex()} is not plain CDR")
            trace = _Trace(payload, "<" if payload[1] & 1 else ">", 8 if payload[1] < 2 else 4, 4)
            trace.fixed += (0, 1)
        try:
            self._message(trace, self._root, "", None)
        except (IndexError, struct.error) as error:
            kind = "ROS 1" if self._packed else "CDR"
            raise ValueError(f"the {kind} payload of {len(payload)} bytes ends inside {self._root}") from error
        if self._packed and trace.at != len(payload):
            raise ValueError(f"the ROS 1 payload of {len(payload)} bytes goes on behind {self._root}")
        return Layout(payload, tuple(trace.fixed), trace.places)

    def _message(self, trace: _Trace, kind: str, prefix: str | None, order: Sequence[int] | None) -> None:
        """A structure. prefix: of its paths; None: it makes no columns. order: places of the entries of lists as long as it,
        by names further up."""
        fields = self._types[kind]
        trace.visit()
        if not fields and not self._packed:
            trace.take("u1")  # an empty structure has a dummy member
        named = next((field for field in fields if _names(field)), None) if prefix is not None else None
        if named is not None:
            order = self.entries.order(f"{prefix}{named.name}", self._texts_ahead(trace, kind, named))
        for field in fields:
            self._field(
                trace, kind, field, None if prefix is None else f"{prefix}{field.name}", order, named is not None
            )

    def _field(
        self, trace: _Trace, parent: str, field: _Field, name: str | None, order: Sequence[int] | None, beside: bool
    ) -> None:
        """beside: whether the names that order entries stand in the same structure: then structures, too, are ordered."""
        if not field.array:
            self._value(trace, parent, field.kind, name, order)
            return
        count = field.count if field.count is not None else trace.length()
        if name is not None and count > LONGEST:
            self.left[_unnumbered(name)] = f"a list of more than {LONGEST} entries"
            name = None
        plain = field.kind in self._kinds
        placed = order if order is not None and len(order) == count and (plain or beside) else range(count)
        if plain:
            trace.row(self._kinds[field.kind], count, () if name is None else (f"{name}[{place}]" for place in placed))
        elif _names(field) and name is not None:
            trace.texts(count)
            self.left[_unnumbered(name)] = "text"
        else:
            for place in placed:
                self._value(trace, parent, field.kind, None if name is None else f"{name}[{place}]", order)

    def _texts_ahead(self, trace: _Trace, kind: str, named: _Field) -> list[str]:
        """The names in a structure that begins here."""
        ahead = trace.copy()
        fields = self._types[kind]
        for field in fields[: fields.index(named)]:
            self._field(ahead, kind, field, None, None, False)
        return ahead.texts(named.count if named.count is not None else ahead.length())

    def _value(self, trace: _Trace, parent: str, kind: str, name: str | None, order: Sequence[int] | None) -> None:
        if kind in _KINDS:
            trace.row(self._kinds[kind], 1, () if name is None else (name,))
        elif kind == "string":
            trace.string()
            if name is not None:
                self.left[_unnumbered(name)] = "text"
        elif kind == "wstring":
            raise ValueError("wstring fields are not supported")
        elif _TIME.match(kind) and _plain(kind) not in self._types:
            trace.time(name, *self._time_kinds(kind))
        else:
            found = self._resolve(parent, kind)
            if _TIME.match(found) and "/" in found and found.startswith("builtin_interfaces/"):
                trace.time(name, *self._time_kinds(kind))
            else:
                self._message(trace, found, None if name is None else f"{name}.", order)

    def _time_kinds(self, kind: str) -> tuple[str, str]:
        """Of seconds and nanoseconds."""
        if not self._packed:
            return "i4", "u4"
        return ("i4", "i4") if kind == "duration" else ("u4", "u4")

    def _resolve(self, parent: str, kind: str) -> str:
        plain = _plain(kind)
        package = parent.rpartition("/")[0]
        for candidate in (plain, f"{package}/{plain}"):
            if candidate in self._types:
                return candidate
        ends = [known for known in self._types if known.endswith(f"/{plain}")]
        if len(ends) != 1:
            raise ValueError(f"the {self._language} schema does not define {kind!r}")
        return ends[0]


class _Trace:
    """A position in a payload, and what was found before it."""

    def __init__(self, data: bytes, order: str, largest: int, at: int, visits: int = 0) -> None:
        self.data, self.order, self.largest, self.at, self.visits = data, order, largest, at, visits
        self.fixed: list[int] = []
        self.places: dict[str, tuple[Place, ...]] = {}

    def visit(self) -> None:
        """Count a structure: one of nothing takes no bytes, so that only their number ends a multitude of them."""
        self.visits += 1
        if self.visits > len(self.data) + MOST_COLUMNS:
            raise ValueError(f"the message holds more than {self.visits - 1} structures in {len(self.data)} bytes")

    def take(self, kind: str, count: int = 1) -> int:
        """The offset of `count` numbers from here, which is then behind them. Alignment counts from the fifth byte."""
        size = int(kind[1])
        if len(self.places) > MOST_COLUMNS:
            raise ValueError(f"there are more than {MOST_COLUMNS} numbers in it")
        align = min(size, self.largest)
        self.at += (4 - self.at) % align if count else 0
        start = self.at
        self.at += size * count
        if self.at > len(self.data):
            raise IndexError
        return start

    def row(self, kind: str, count: int, labels: Iterable[str]) -> None:
        """Numbers one behind another; labels: of each, () for none."""
        start = self.take(kind, count)
        for i, label in enumerate(labels):
            self.places[label] = (Place(start + i * int(kind[1]), self.order + kind),)

    def length(self) -> int:
        start = self.take("u4")
        self.fixed += range(start, start + 4)
        return int(struct.unpack_from(f"{self.order}I", self.data, start)[0])

    def string(self) -> int:
        """The offset of a text's bytes, which end here then."""
        length = self.length()
        start = self.at
        self.at += length
        if self.at > len(self.data):
            raise IndexError
        return start

    def texts(self, count: int) -> list[str]:
        """Texts one behind another, which must be the same in another message."""
        found: list[str] = []
        for _ in range(count):
            start = self.string()
            self.fixed += range(start, self.at)
            found.append(self.data[start : self.at].rstrip(b"\0").decode("utf-8", "replace"))
        return found

    def copy(self) -> _Trace:
        """The same position, from which to look ahead."""
        return _Trace(self.data, self.order, self.largest, self.at, self.visits)

    def time(self, name: str | None, seconds_kind: str, nanoseconds_kind: str) -> None:
        seconds, nanoseconds = self.take(seconds_kind), self.take(nanoseconds_kind)
        if name is not None:
            first, kind = Place(seconds, self.order + seconds_kind), self.order + nanoseconds_kind
            self.places[name] = (first, Place(nanoseconds, kind, 1e9))
            self.places[name + WHOLE], self.places[name + REST] = (first,), (Place(nanoseconds, kind),)


def _names(field: _Field) -> bool:
    return field.array and field.kind == "string" and holds_names(field.name)


def _unnumbered(path: str) -> str:
    return re.sub(r"\[\d+\]", "[]", path)


def _plain(name: str) -> str:
    return name.replace("/msg/", "/")


def _fields(body: str, language: str) -> list[_Field]:
    fields: list[_Field] = []
    for line in body.splitlines():
        line = line.split("#", 1)[0].strip()
        if not line:
            continue
        match = _FIELD.match(line)
        if not match:
            raise ValueError(f"the {language} line {line!r} is not understood")
        kind, bounded, count, name, rest = match.groups()
        if rest.startswith("="):
            continue  # a constant
        array = count is not None
        fields.append(_Field(kind, name, array, int(count) if array and count and not bounded else None))
    return fields
