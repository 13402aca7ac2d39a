"""MCAP messages by the thousand, in numpy: assembled without a loop, found in a chunk and decoded without one.

A message record is `opcode 5, length u64, channel u16, sequence u32, log time u64, publish time u64, payload`, little
endian, packed. Where payloads have one size, a chunk is an array of such records, and a field is a strided view.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Bool, Float64, Int64, UInt8

WHOLE, REST = "\0whole", "\0rest"
"""Behind the name of a time: its whole seconds, and the nanoseconds above them. They are no columns of their own: a column's
double holds a time since 1970 to 0.24 us."""

MESSAGE = 5
MESSAGE_INDEX = 7
_Run = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
_RECORD = struct.Struct("<BQ")
_HEAD = struct.Struct("<BQHIQQ")


def assemble(
    channel: int,
    sequence: int,
    t_ns: Int64[np.ndarray, " T"],
    values: Float64[np.ndarray, "T C"],
    tags: Sequence[bytes],
    kinds: Sequence[str],
) -> bytes:
    """T message records, one after another. tags: what stands before each of the C numbers in the payload, which are of
    numpy's types `kinds`."""
    fields: list[tuple[str, str]] = [("head", "V15"), ("log", "<i8"), ("publish", "<i8")]
    for c, (tag, kind) in enumerate(zip(tags, kinds, strict=True)):
        fields += [(f"tag{c}", f"V{len(tag)}"), (f"value{c}", kind)]
    layout = np.dtype(fields)
    records = np.empty(len(t_ns), layout)
    raw = records.view(np.uint8).reshape(len(t_ns), layout.itemsize)
    constant = np.zeros(1, layout)
    constant["head"] = np.void(_HEAD.pack(MESSAGE, layout.itemsize - 9, channel, 0, 0, 0)[:15])
    for c, tag in enumerate(tags):
        constant[f"tag{c}"] = np.void(tag)
    raw[:] = constant.view(np.uint8)
    raw[:, 11:15] = ((sequence + np.arange(len(t_ns))) % 2**32).astype("<u4").view(np.uint8).reshape(-1, 4)
    records["log"] = t_ns
    records["publish"] = t_ns
    for c in range(len(tags)):
        records[f"value{c}"] = values[:, c]
    return records.tobytes()


def assemble_index(channel: int, t_ns: Int64[np.ndarray, " T"], record_size: int) -> bytes:
    """The message index record of a chunk that holds T message records of one size and nothing else."""
    entries = np.empty((len(t_ns), 2), "<i8")
    entries[:, 0] = t_ns
    entries[:, 1] = record_size * np.arange(len(t_ns))
    data = entries.tobytes()
    return struct.pack("<BQHI", MESSAGE_INDEX, 6 + len(data), channel, len(data)) + data


@dataclass(frozen=True)
class Messages:
    """The message records in some bytes, in their order: start and size are of the payload."""

    data: bytes
    channel: Int64[np.ndarray, " N"]
    log_ns: Int64[np.ndarray, " N"]
    start: Int64[np.ndarray, " N"]
    size: Int64[np.ndarray, " N"]

    def payload(self, row: int) -> bytes:
        """The payload of one message."""
        start = int(self.start[row])
        return self.data[start : start + int(self.size[row])]

    def payloads(self, rows: Int64[np.ndarray, " n"]) -> UInt8[np.ndarray, "n S"]:
        """The payloads of messages of one size: a view where they lie at equal distances, else a copy."""
        raw = np.frombuffer(self.data, np.uint8)
        start, size = self.start[rows], int(self.size[rows[0]])
        distances = np.diff(start)
        if len(rows) == 1 or (distances == distances[0]).all():
            distance = int(distances[0]) if len(distances) else size
            return np.ndarray((len(rows), size), np.uint8, buffer=raw, offset=int(start[0]), strides=(distance, 1))
        return raw[start[:, None] + np.arange(size)]


def walk(data: bytes) -> tuple[Messages, list[tuple[int, bytes]]]:
    """The messages in the bytes of a chunk, and its other records as (opcode, body).

    Raises ValueError where the bytes are no records.
    """
    others: list[tuple[int, bytes]] = []
    runs: list[_Run] = []
    loose = array("Q")  # four numbers a message; tuples would take ten times the memory of a chunk of tiny messages
    position, end = 0, len(data)
    while position < end:
        if position + 9 > end:
            raise ValueError(f"a record header is cut off at byte {position} of a chunk")
        opcode, length = _RECORD.unpack_from(data, position)
        after = position + 9 + length
        if after > end or (opcode == MESSAGE and length < 22):
            raise ValueError(f"a record at byte {position} of a chunk has the impossible length {length}")
        if opcode != MESSAGE:
            others.append((opcode, data[position + 9 : after]))
        elif not runs:
            runs.append(_run(data, position, length))
            after = position + (9 + length) * len(runs[0][0])
        else:
            _, _, channel, _, log, _ = _HEAD.unpack_from(data, position)
            loose.extend((channel, log, position + 31, length - 22))
        position = after
    if loose:
        columns = np.ascontiguousarray(np.frombuffer(loose, np.int64).reshape(-1, 4).T)
        runs.append((columns[0], columns[1], columns[2], columns[3]))
    if not runs:
        none = np.empty(0, np.int64)
        runs.append((none, none, none, none))
    channel, log, start, size = (
        runs[0][k] if len(runs) == 1 else np.concatenate([run[k] for run in runs]) for k in range(4)
    )
    return Messages(data, channel, log, start, size), others


def _run(data: bytes, position: int, length: int) -> _Run:
    """channel, log, start, size of the messages of this length that follow one another from here."""
    step = 9 + length
    count = (len(data) - position) // step
    field = partial(_strided, data, count, step, position)
    good = (field(0, "u1") == MESSAGE) & (field(1, "<u8") == length)
    n = count if good.all() else int(np.argmin(good))
    start = position + 31 + step * np.arange(n, dtype=np.int64)
    channel, log = field(9, "<u2")[:n].astype(np.int64), field(15, "<i8")[:n].copy()
    return channel, log, start, np.full(n, length - 22, np.int64)


def _strided(data: bytes, count: int, step: int, position: int, offset: int, kind: str) -> np.ndarray:
    return np.ndarray((count,), kind, buffer=data, offset=position + offset, strides=(step,))


@dataclass(frozen=True)
class Place:
    """A number in a payload: `number of type kind at offset / divisor`."""

    offset: int
    kind: str
    divisor: float = 1.0


@dataclass(frozen=True)
class Layout:
    """Where numbers lie in payloads that equal `template` at the bytes `fixed`; a column is the sum of its places.

    limits: bytes that must not be larger than this, by their place: a larger one would be the first of several.
    """

    template: bytes
    fixed: tuple[int, ...]
    places: Mapping[str, tuple[Place, ...]]
    limits: tuple[tuple[int, int], ...] = ()

    def decode(
        self, payloads: UInt8[np.ndarray, "n S"], columns: Sequence[str]
    ) -> tuple[Float64[np.ndarray, "n C"], Bool[np.ndarray, " n"]]:
        """The columns (NaN for one that is not here), and which rows have this layout; the others are worthless."""
        fits = np.ones(len(payloads), bool)
        for position in self.fixed:
            fits &= payloads[:, position] == self.template[position]
        for position, largest in self.limits:
            fits &= payloads[:, position] <= largest
        values = np.empty((len(payloads), len(columns)))
        for c, column in enumerate(columns):
            places = self.places.get(column)
            if places is None:
                values[:, c] = np.nan
                continue
            values[:, c] = _numbers(payloads, places[0])
            for place in places[1:]:
                values[:, c] += _numbers(payloads, place)
        return values, fits

    def leaves(self) -> dict[str, float]:
        """The columns of the template itself."""
        values, _ = self.decode(np.frombuffer(self.template, np.uint8)[None, :], list(self.places))
        return {name: float(value) for name, value in zip(self.places, values[0], strict=True)}


def _numbers(payloads: UInt8[np.ndarray, "n S"], place: Place) -> np.ndarray:
    kind = np.dtype(place.kind)
    numbers = payloads[:, place.offset : place.offset + kind.itemsize].view(kind)[:, 0]
    return numbers if place.divisor == 1.0 else numbers / place.divisor
