"""How the rows of a topic become protobuf messages: one a row, all of one size, in files and on the wire alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmucorrect.records import _protobuf
from fmucorrect.records.assemble import RESERVED
from fmucorrect.records.bulk import assemble
from fmucorrect.records.naming import field_names
from fmucorrect.signals import NANOSECONDS, Record

HEAD = 31
"""Bytes of an MCAP message record before its payload."""


@dataclass(frozen=True)
class MessageType:
    """The messages of one topic.

    schema, descriptors: name and FileDescriptorSet. metadata: of the channel, with each field's unit and full name.
    tags, kinds: what stands before each number, and its numpy type. stamp: the field with the sample time, "" for none.
    """

    schema: str
    descriptors: bytes
    metadata: Mapping[str, str]
    tags: Sequence[bytes]
    kinds: Sequence[str]
    stamp: str

    @property
    def size(self) -> int:
        """Bytes of one MCAP message record."""
        return HEAD + sum(len(tag) + np.dtype(kind).itemsize for tag, kind in zip(self.tags, self.kinds, strict=True))

    def records(self, number: int, sequence: int, rows: Record) -> bytes:
        """MCAP message records of channel `number`, the first one's count being `sequence`."""
        values = rows.values
        if self.stamp:
            values = np.column_stack([values, *np.divmod(rows.t_ns, NANOSECONDS)])
        return assemble(number, sequence, rows.t_ns, values, self.tags, self.kinds)

    def payloads(self, rows: Record) -> list[bytes]:
        """One message a row."""
        data, size = self.records(0, 0, rows), self.size
        return [data[end - size + HEAD : end] for end in range(size, len(data) + 1, size)]


def message_type(topic: str, record: Record, stamp: str = "") -> MessageType:
    """The messages of a topic that holds what `record` does. stamp: the field in which each carries its sample time (within
    2**31 s), for who knows no other."""
    fields = field_names(record.names)
    units = [channel.unit for channel in record.channels]
    kinds = [_protobuf.STATUS if c.quantity == "status" else _protobuf.DOUBLE for c in record.channels]
    title, descriptors = _protobuf.schema(topic, record.names, fields, units, kinds, stamp)
    metadata = {key: value for key, value in record.metadata.items() if key not in RESERVED}
    for name, field, unit in zip(record.names, fields, units, strict=True):
        metadata[f"unit.{field}"] = unit
        if name != field:
            metadata[f"name.{field}"] = name
    tags = _protobuf.tags(kinds)
    if stamp:
        tags, kinds = [*tags, *_protobuf.stamp_tags(len(kinds))], [*kinds, _protobuf.STAMP, _protobuf.STAMP]
    return MessageType(title, descriptors, metadata, tags, kinds, stamp)
