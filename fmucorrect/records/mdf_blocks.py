"""How many bytes of records an MDF file holds, against how many its channel groups state.

asammdf reads as many records as a group states and leaves what stands behind them without a word (MDF 4), or reads on into the
next block (MDF 3, whose data have no length of their own). Both are seen here by walking from block to block of the file.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

_HEADER = 64
"""Where the header block stands, behind the identification, in all versions."""
_COUNTS_UNKNOWN = 0b101
"""Flags of an MDF 4 file that was not finalized: its cycle counts, or the length of its last data block, are not true."""
_VLSD, _COLUMN = 0b1, 0b1000
"""Flags of a channel group of MDF 4: records of variable length; a column, whose invalidation bytes stand apart."""
_LISTS = (b"##DL", b"##LD")
"""Lists of data blocks; behind the links of both come flags and, 4 bytes on, the number of blocks."""
_LINKS_3 = {b"HD": (4, 8, 12), b"DG": (4, 8, 12, 16), b"CG": (4, 8, 12), b"CN": (4, 8, 12, 16, 20)}
"""Where the links of a block of MDF 3 stand in it."""
_NAMES_3 = (b"TX", b"PR", b"TR", b"SR", b"HD", b"DG", b"CG", b"CN", b"CC", b"CD", b"CE")
"""How a block of MDF 3 begins."""


class _Broken(Exception):
    """A link that leads nowhere, or in a circle."""


@dataclass(frozen=True)
class _Stated:
    """One data group. group: the number of its first channel group. rows: of all its channel groups, as stated. size: bytes of
    their records with all that goes with them. record: bytes of the smallest record."""

    group: int
    rows: int
    size: int
    record: int

    def told(self, found: int) -> str:
        """What does not agree, for `found` bytes of records; "" where they do, but for what fills up a block."""
        if not self.record or abs(found - self.size) < self.record:
            return ""
        return (
            f"group {self.group} states {self.rows} rows ({self.size} bytes), and {found} bytes of records stand in the file: "
            + ("what is more is not read" if found > self.size else "what is missing cannot be read")
        )


def disagreement(path: str) -> str:
    """Where stated and found records do not agree, in words; "" where they do, where a file says itself that its counts are not
    true yet, and where its links lead nowhere, which its reader tells."""
    if Path(path).stat().st_size <= _HEADER:
        return ""
    with Path(path).open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        four = data[8:9] == b"4"
        if four and data[:5] == b"UnFin" and struct.unpack_from("<H", data, 60)[0] & _COUNTS_UNKNOWN:
            return ""
        try:
            return "; ".join(filter(None, _of_4(data) if four else _of_3(data)))
        except (struct.error, _Broken):
            return ""


def _chain(first: int, after: Callable[[int], int]) -> Iterator[int]:
    """Places of blocks, each of which links to the next."""
    seen: set[int] = set()
    while first:
        if first in seen:
            raise _Broken
        seen.add(first)
        yield first
        first = after(first)


def _of_4(data: mmap.mmap) -> Iterator[str]:
    def link(at: int, number: int) -> int:
        return struct.unpack_from("<Q", data, at + 24 + 8 * number)[0]

    number = 0
    for group in _chain(link(_HEADER, 0), lambda at: link(at, 0)):
        ids: int = struct.unpack_from("<B", data, group + 24 + 8 * 4)[0]
        rows, size, smallest, first, vlsd = 0, 0, 0, number, False
        for place in _chain(link(group, 1), lambda at: link(at, 0)):
            links = struct.unpack_from("<Q", data, place + 16)[0]
            _, cycles, flags, values, invalid = struct.unpack_from("<QQH6xII", data, place + 24 + 8 * links)
            record = ids + values + (0 if flags & _COLUMN else invalid)
            rows, size, number = rows + cycles, size + cycles * record, number + 1
            smallest, vlsd = min(smallest or record, record), vlsd or bool(flags & _VLSD)
        if not vlsd:  # lengths of its own, which asammdf counts one by one
            yield _Stated(first, rows, size, smallest).told(_held(data, link(group, 2)))


def _held(data: mmap.mmap, place: int) -> int:
    """Bytes of records, unpacked, in a data block or in all that a list leads to."""

    def link(at: int, number: int) -> int:
        return struct.unpack_from("<Q", data, at + 24 + 8 * number)[0]

    if not place:
        return 0
    name, length, links = struct.unpack_from("<4s4xQQ", data, place)
    if name == b"##HL":
        return _held(data, link(place, 0))
    if name == b"##DZ":
        return struct.unpack_from("<Q", data, place + 32)[0]
    if name not in _LISTS:
        return length - 24
    total = 0
    for part in _chain(place, lambda at: link(at, 0)):
        links = struct.unpack_from("<Q", data, part + 16)[0]
        count = struct.unpack_from("<I", data, part + 24 + 8 * links + 4)[0]
        total += sum(_held(data, link(part, 1 + i)) for i in range(min(count, links - 1)))
    return total


def _of_3(data: mmap.mmap) -> Iterator[str]:
    order = "<" if data[24:26] == b"\0\0" else ">"

    def link(at: int, place: int) -> int:
        return struct.unpack_from(f"{order}I", data, at + place)[0]

    starts, groups = {len(data)}, list(_chain(link(_HEADER, 4), lambda at: link(at, 4)))
    members = [list(_chain(link(group, 8), lambda at: link(at, 4))) for group in groups]
    channels = [at for group in members for place in group for at in _chain(link(place, 8), lambda at: link(at, 4))]
    for at in (_HEADER, *groups, *(place for group in members for place in group), *channels):
        starts.update(link(at, place) for place in _LINKS_3.get(data[at : at + 2], ()))
    number = 0
    for group, places in zip(groups, members, strict=True):
        ids, begin = struct.unpack_from(f"{order}H", data, group + 22)[0], link(group, 16)
        rows, size, smallest, first = 0, 0, 0, number
        for place in places:
            record, cycles = struct.unpack_from(f"{order}HI", data, place + 20)
            rows, size, smallest = rows + cycles, size + cycles * (record + ids), min(smallest or record, record)
            number += 1
        if not begin:
            yield _Stated(first, rows, size, smallest).told(0)
            continue
        end = begin + size
        behind = min(start for start in starts if start > begin)
        if end <= behind and (data[end : end + 2] in _NAMES_3 or not data[end:behind].strip(b"\0")):
            continue  # a block that is not linked, or nothing: no records
        yield _Stated(first, rows, size, smallest).told(behind - begin)
