"""Protobuf messages in MCAP: the schema of records written here, and the numbers of any message read here."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Collection, Iterator, Sequence
from itertools import islice
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import DecodeError

from fmucorrect.records.bulk import REST, WHOLE, Layout, Place
from fmucorrect.records.decode import DEEPEST, LONGEST
from fmucorrect.records.named import Entries, holds_names
from fmucorrect.records.source import MOST_COLUMNS
from fmucorrect.stepper import Status

_PACKAGE = "fmucorrect"
_FIXED = {
    FieldDescriptor.TYPE_DOUBLE: "<f8",
    FieldDescriptor.TYPE_FLOAT: "<f4",
    FieldDescriptor.TYPE_FIXED64: "<u8",
    FieldDescriptor.TYPE_SFIXED64: "<i8",
    FieldDescriptor.TYPE_FIXED32: "<u4",
    FieldDescriptor.TYPE_SFIXED32: "<i4",
}
_TEXT = {FieldDescriptor.TYPE_STRING, FieldDescriptor.TYPE_BYTES}
_TIMES = {"google.protobuf.Timestamp", "google.protobuf.Duration"}
DOUBLE, STATUS, STAMP = "<f8", "u1", "<i4"
"""What a field may be: a double, a `stepper.Status` as an enum, whose values take one byte, or half of a sample time."""

_UNIT = re.compile(r"\[([^\[\]]+)\]")


def schema(
    topic: str,
    names: Sequence[str],
    fields: Sequence[str],
    units: Sequence[str],
    kinds: Sequence[str],
    stamp: str = "",
) -> tuple[str, bytes]:
    """Name and FileDescriptorSet of a message of numbers, each with its name and unit as a comment. kinds: DOUBLE or STATUS.
    stamp: name of a field behind them that holds the sample time as whole seconds and nanoseconds, "" for none.

    proto2 optional fields: a value of 0.0 is written like any other, so every message has the same size.
    """
    title = "".join(word[:1].upper() + word[1:] for word in re.split(r"[^A-Za-z0-9]+", topic)) or "Record"
    title = title if title[0].isalpha() else f"Record{title}"
    file = descriptor_pb2.FileDescriptorProto(name=f"{_PACKAGE}/{title}.proto", package=_PACKAGE, syntax="proto2")
    message = file.message_type.add(name=title)
    if STATUS in kinds:
        enum = message.enum_type.add(name="Status")
        for status in Status:
            enum.value.add(name=status.name, number=status.value)
    for i, (name, field, unit, kind) in enumerate(zip(names, fields, units, kinds, strict=True)):
        described = message.field.add(
            name=field, number=_number(i), label=descriptor_pb2.FieldDescriptorProto.LABEL_OPTIONAL
        )
        if kind == STATUS:
            described.type = descriptor_pb2.FieldDescriptorProto.TYPE_ENUM
            described.type_name = f".{_PACKAGE}.{title}.Status"
        else:
            described.type = descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE
        place = file.source_code_info.location.add(trailing_comments=f" {name} [{unit}]\n")
        place.path.extend([4, 0, 2, i])
        place.span.extend([i + 3, 2, 60])
    if stamp:
        kept = descriptor_pb2.FieldDescriptorProto
        time = message.nested_type.add(name="Stamp")
        for number, part in enumerate(("sec", "nsec"), 1):
            time.field.add(name=part, number=number, label=kept.LABEL_OPTIONAL, type=kept.TYPE_SFIXED32)
        message.field.add(
            name=stamp,
            number=_number(len(fields)),
            label=kept.LABEL_OPTIONAL,
            type=kept.TYPE_MESSAGE,
            type_name=f".{_PACKAGE}.{title}.Stamp",
        )
    return f"{_PACKAGE}.{title}", descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()


def tags(kinds: Sequence[str]) -> list[bytes]:
    """What stands before each number of a message of `schema`: field number and wire type, 1 for doubles, 0 for enums."""
    return [_varint(_number(i) << 3 | (kind == DOUBLE)) for i, kind in enumerate(kinds)]


def stamp_tags(i: int) -> list[bytes]:
    """What stands before the seconds and before the nanoseconds of a stamp behind `i` numbers, each of kind STAMP."""
    return [_varint(_number(i) << 3 | 2) + b"\x0a\x0d", b"\x15"]  # ten bytes, two fields of wire type 5


def _number(i: int) -> int:
    return i + 1 if i + 1 < 19000 else i + 1001  # 19000 to 19999 are protobuf's own


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


class ProtobufDecoder:
    """Messages of one schema. Raises ValueError when the schema cannot be used."""

    def __init__(self, name: str, descriptors: bytes) -> None:
        try:
            files = descriptor_pb2.FileDescriptorSet.FromString(descriptors)
            pool = descriptor_pool.DescriptorPool()
            waiting = {file.name: file for file in files.file}
            while waiting:
                self._add(pool, waiting, next(iter(waiting)))
            self._descriptor: Any = pool.FindMessageTypeByName(name)
        except (DecodeError, KeyError, TypeError, RecursionError) as error:
            raise ValueError(f"the protobuf schema {name!r} cannot be used: {error}") from error
        self._class: Any = message_factory.GetMessageClass(self._descriptor)
        self._units = _units(files)
        self._declares: list[tuple[str, str]] | None = None
        self.left: dict[str, str] = {}
        self.entries = Entries()

    def _add(self, pool: Any, waiting: dict[str, Any], name: str) -> None:
        file = waiting.pop(name)
        for needed in file.dependency:
            if needed in waiting:
                self._add(pool, waiting, needed)
        pool.Add(file)

    def declared(self) -> list[tuple[str, str]]:
        """The single numbers of the schema at any depth, with the units that comments give in brackets.

        Raises ValueError for more than MOST_COLUMNS: types that hold one another twice multiply with every level.
        """
        if self._declares is None:
            most = MOST_COLUMNS
            self._declares = list(islice(self._declared(self._descriptor, "", ()), most + 1))
            if len(self._declares) > most:
                self._declares = None
                raise ValueError(f"the protobuf schema declares more than {most} numbers")
        return self._declares

    def complete(self, names: Collection[str]) -> bool:
        """Whether the schema declares no more than these, and no lists."""
        return all(name in names for name, _ in self.declared())

    def _declared(self, descriptor: Any, prefix: str, above: tuple[str, ...]) -> Iterator[tuple[str, str]]:
        if len(above) > DEEPEST:
            raise ValueError(f"the protobuf schema is nested more than {DEEPEST} deep")
        for field in descriptor.fields:
            name = f"{prefix}{field.name}"
            unit = self._units.get(field.full_name, "1")
            if _repeated(field) or field.type in _TEXT or field.type == FieldDescriptor.TYPE_GROUP:
                if _repeated(field):
                    yield f"{name}[", unit  # a prefix: gives its unit to the entries
            elif field.message_type is None:
                yield name, unit
            elif field.message_type.full_name in _TIMES:
                yield name, "s"
            elif field.message_type.full_name not in above:
                yield from self._declared(field.message_type, f"{name}.", (*above, field.message_type.full_name))

    def leaves(self, payload: bytes) -> dict[str, float]:
        """Every number by its path; fields that can be absent and are, are left out."""
        message = self._class()
        try:
            message.ParseFromString(payload)
        except DecodeError as error:
            raise ValueError(str(error)) from error
        found: dict[str, float] = {}
        self._collect(message, "", found, None)
        return found

    def _collect(self, message: Any, prefix: str, found: dict[str, float], order: Sequence[int] | None) -> None:
        """order: places of the entries of lists as long as it, by the names beside them or further up."""
        named = next((field for field in message.DESCRIPTOR.fields if _names(field)), None)
        if named is not None:
            order = self.entries.order(f"{prefix}{named.name}", getattr(message, named.name)[: LONGEST + 1])
        for field in message.DESCRIPTOR.fields:
            name = f"{prefix}{field.name}"
            if field.type in _TEXT:
                self.left[re.sub(r"\[\d+\]", "[]", name)] = (
                    "text" if field.type == FieldDescriptor.TYPE_STRING else "bytes"
                )
                continue
            if _repeated(field):
                entries = getattr(message, field.name)
                if len(entries) > LONGEST or (
                    field.message_type is not None and field.message_type.GetOptions().map_entry
                ):
                    continue
                ordered = named is not None or field.message_type is None
                placed = order if ordered and order is not None and len(order) == len(entries) else range(len(entries))
                for i, entry in zip(placed, entries, strict=True):
                    self._leaf(entry, field, f"{name}[{i}]", found, order)
            elif not field.has_presence or message.HasField(field.name):
                self._leaf(getattr(message, field.name), field, name, found, order)

    def _leaf(self, value: Any, field: Any, name: str, found: dict[str, float], order: Sequence[int] | None) -> None:
        if field.message_type is None:
            found[name] = float(value)
        elif field.message_type.full_name in _TIMES:
            found[name] = value.seconds + value.nanos / 1e9
            found[name + WHOLE], found[name + REST] = float(value.seconds), float(value.nanos)
        else:
            self._collect(value, f"{name}.", found, order)

    def layout(self, payload: bytes) -> Layout | None:
        """The layout where all numbers are of fixed size; None for varints and what else has none."""
        fixed: list[int] = []
        limits: list[tuple[int, int]] = []
        places: dict[str, tuple[Place, ...]] = {}
        try:
            if not _trace(payload, 0, len(payload), self._descriptor, "", fixed, places, limits):
                return None
            layout = Layout(payload, tuple(fixed), places, tuple(limits))
            same = _equal(layout.leaves(), self.leaves(payload))
        except (ValueError, IndexError, struct.error, RecursionError):
            return None
        return layout if same else None


def _names(field: Any) -> bool:
    return field.type == FieldDescriptor.TYPE_STRING and _repeated(field) and holds_names(field.name)


def _repeated(field: Any) -> bool:
    known: bool | None = getattr(field, "is_repeated", None)  # newer protobuf; older ones have the label
    return field.label == field.LABEL_REPEATED if known is None else known


def _trace(
    data: bytes,
    at: int,
    end: int,
    descriptor: Any,
    prefix: str,
    fixed: list[int],
    places: dict[str, tuple[Place, ...]],
    limits: list[tuple[int, int]],
) -> bool:
    while at < end:
        start = at
        tag, at = _read_varint(data, at)
        field, wire = descriptor.fields_by_number.get(tag >> 3), tag & 7
        size = {1: 8, 5: 4}.get(wire)
        if wire == 0 and field is not None and (largest := _largest(field)) >= 0:
            size = 1
            limits.append((at, largest))
        if wire == 2:
            size, at = _read_varint(data, at)
        if size is None or at + size > end:
            return False
        fixed.extend(range(start, at))
        if field is not None:
            name = f"{prefix}{field.name}"
            kind = "u1" if wire == 0 else _FIXED.get(field.type)
            if _repeated(field) or (name in places):
                return False
            if kind is not None and wire != 2:
                places[name] = (Place(at, kind),)
            elif field.message_type is not None and wire == 2:
                if field.message_type.full_name in _TIMES:
                    return False
                if not _trace(data, at, at + size, field.message_type, f"{name}.", fixed, places, limits):
                    return False
            elif field.type not in _TEXT:
                return False
        at += size
    return True


def _largest(field: Any) -> int:
    """The largest number up to which an enum knows all, and which takes one byte; -1 where there is none."""
    known = field.enum_type.values_by_number if field.enum_type is not None else {}
    return next((n for n in range(128) if n not in known), 128) - 1


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value, shift = 0, 0
    while data[at] > 127 and shift < 64:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
    return value | data[at] << shift, at + 1


def _equal(a: dict[str, float], b: dict[str, float]) -> bool:
    return a.keys() == b.keys() and all(
        x == b[name] or (math.isnan(x) and math.isnan(b[name])) for name, x in a.items()
    )


def _units(files: Any) -> dict[str, str]:
    """Units by full field name, from comments like `[mm]` in the source information."""
    units: dict[str, str] = {}
    for file in files.file:
        for place in file.source_code_info.location:
            found = _UNIT.findall(f"{place.leading_comments}\n{place.trailing_comments}")
            path = list(place.path)
            if not found or len(path) < 4 or path[0] != 4 or path[-2] != 2 or set(path[2:-2:2]) - {3}:
                continue
            message, name = file.message_type[path[1]], file.package
            name = f"{name}.{message.name}" if name else message.name
            for i in path[3:-2:2]:
                message = message.nested_type[i]
                name = f"{name}.{message.name}"
            units[f"{name}.{message.field[path[-1]].name}"] = found[-1]
    return units
