"""Damage at the level of bytes: what a cut cable, a full disk, a bad sector or an enemy does to a file of any format."""

# ruff: noqa: E501 (tables of hostile values read best in rows)
from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import dataclass

BOUNDARIES = (0, 1, 0x20, 0x7F, 0x80, 0xFF)
NUMBERS = (0, 1, 2**7 - 1, 2**8 - 1, 2**15 - 1, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
WORDS = (
    b"", b"0", b"-1", b"1e308", b"1e400", b"-1e-400", b"nan", b"inf", b"-inf", b"9" * 400, b"0x10", b"1_000", b"1,5", b"1.5.2", b"\xff\xfe",
    "\N{FULLWIDTH DIGIT ONE}".encode(), b"\x00", b'"', b"'", b"[", b"{", b"true", b"null", b"2024-01-01T00:00:00Z", b"\x1b[31m", b"..", b"%s", b"1e300",
)  # fmt: skip
"""What stands in the place of a number in a text."""


@dataclass(frozen=True)
class Damaged:
    """data: the file now. what: in words. touched: first and last changed place (half open) in the file as it was, and
    whether every other byte is where it was."""

    data: bytes
    what: str
    touched: tuple[tuple[int, int], ...] = ()
    in_place: bool = False


def _place(rng: random.Random, data: bytes, size: int = 1) -> int:
    """Anywhere, the beginning and the end more often: there stand the headers."""
    last = max(len(data) - size, 0)
    kind = rng.random()
    if kind < 0.25:
        return rng.randint(0, min(last, 256))
    if kind < 0.4:
        return rng.randint(max(last - 256, 0), last)
    return rng.randint(0, last)


def _put(data: bytes, at: int, new: bytes, what: str) -> Damaged:
    new = new[: len(data) - at]
    return Damaged(data[:at] + new + data[at + len(new) :], f"{what} at {at}", ((at, at + len(new)),), True)


def flip(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    at, bit = _place(rng, data), rng.randrange(8)
    return _put(data, at, bytes([data[at] ^ 1 << bit]), f"bit {bit} flipped")


def flips(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    new, touched = bytearray(data), []
    for _ in range(rng.randint(2, 8)):
        at = _place(rng, data)
        new[at] ^= 1 << rng.randrange(8)
        touched.append((at, at + 1))
    return Damaged(bytes(new), f"bits flipped at {sorted(at for at, _ in touched)}", tuple(touched), True)


def boundary(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    value = rng.choice(BOUNDARIES)
    return _put(data, _place(rng, data), bytes([value]), f"byte {value:#x}")


def number(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    size, order = rng.choice((2, 4, 8)), rng.choice(("little", "big"))
    value = rng.choice(NUMBERS) & (1 << 8 * size) - 1
    return _put(data, _place(rng, data, size), value.to_bytes(size, order), f"{8 * size} bit {order} {value:#x}")


def length(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    """A field that may be a length, a count or an offset, set to 0, 1, the greatest, or one off."""
    size = rng.choice((4, 8))
    order = rng.choice(("little", "little", "big"))
    for _ in range(200):
        at = _place(rng, data, size)
        old = int.from_bytes(data[at : at + size], order)
        if 0 < old <= 2 * len(data) and at + size <= len(data):
            greatest = (1 << 8 * size) - 1
            value = rng.choice((0, 1, greatest, greatest >> 1, old + 1, old - 1, 2 * old, 2**31 - 1, len(data)))
            return _put(data, at, (value & greatest).to_bytes(size, order), f"{8 * size} bit {old} set to {value}")
    return number(rng, data, other)


def sector(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    """A bad sector, or pages that never reached the disk."""
    size = rng.choice((16, 64, 512))
    return _put(data, _place(rng, data), bytes([rng.choice((0, 0xFF))]) * size, f"{size} bytes lost")


def insertion(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    at, size = _place(rng, data), rng.choice((1, 2, 8, 100))
    return Damaged(data[:at] + rng.randbytes(size) + data[at:], f"{size} bytes inserted at {at}", ((at, at),))


def deletion(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    at, size = _place(rng, data), rng.choice((1, 2, 8, 100, 512))
    return Damaged(data[:at] + data[at + size :], f"{size} bytes deleted at {at}", ((at, at + size),))


def duplication(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    at, size = _place(rng, data), rng.choice((1, 8, 100, 1000))
    return Damaged(data[: at + size] + data[at:], f"{size} bytes twice at {at}", ((at, at + size),))


def exchange(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    size = rng.choice((4, 32, 256))
    a, b = sorted((_place(rng, data, size), _place(rng, data, size)))
    b = min(max(b, a + size), len(data))
    new = data[:a] + data[b : b + size] + data[a + size : b] + data[a : a + size] + data[b + size :]
    touched = ((a, a + size), (b, b + size))
    return Damaged(
        new, f"{size} bytes exchanged, {a} and {b}", touched, len(new) == len(data) and b + size <= len(data)
    )


def cut(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    at = rng.randrange(len(data))
    return Damaged(data[:at], f"cut off at {at} of {len(data)}", ((at, len(data)),))


def appended(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    more = rng.choice((b"\0" * 512, rng.randbytes(64), data, data[: len(data) // 2], other[:2000]))
    return Damaged(data + more, f"{len(more)} bytes appended", ((len(data), len(data)),))


def splice(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    """The head of one file, the tail of another."""
    a, b = rng.randrange(len(data)), rng.randrange(max(len(other), 1))
    return Damaged(data[:a] + other[b:], f"spliced: {a} bytes, then another file from {b}", ((a, len(data)),))


def text(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    """A number of a text replaced by what is none, or a hostile one."""
    found = [match.span() for match in re.finditer(rb"-?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?", data)]
    if not found:
        return flip(rng, data, other)
    a, b = rng.choice(found)
    word = rng.choice(WORDS)
    return Damaged(
        data[:a] + word + data[b:], f"{data[a:b][:20]!r} at {a} made {word[:20]!r}", ((a, b),), len(word) == b - a
    )


def lines(rng: random.Random, data: bytes, other: bytes) -> Damaged:
    """A line of a text lost, doubled, or moved."""
    rows = data.splitlines(keepends=True)
    i, j = rng.randrange(len(rows)), rng.randrange(len(rows))
    kind = rng.randrange(4)
    if kind == 0:
        new, what = rows[:i] + rows[i + 1 :], "lost"
    elif kind == 1:
        new, what = [*rows[:i], rows[i], *rows[i:]], "doubled"
    elif kind == 2:
        new, what = [*rows], f"and {j} exchanged"
        new[i], new[j] = new[j], new[i]
    else:
        new, what = (
            [
                *rows[:i],
                rows[i].rstrip(b"\r\n") + rng.choice((b",", b";", b"#", b" ", b"\t", b"\r", b",1")) + b"\n",
                *rows[i + 1 :],
            ],
            "longer",
        )
    return Damaged(b"".join(new), f"line {i} {what}")


ANY: tuple[Callable[[random.Random, bytes, bytes], Damaged], ...] = (
    flip, flip, flips, boundary, number, length, length, sector, insertion, deletion, duplication, exchange, cut, cut, appended, splice, text,
)  # fmt: skip
TEXT = (*ANY, text, text, text, lines, lines)


def damaged(rng: random.Random, data: bytes, other: bytes = b"", is_text: bool = False) -> Damaged:
    """One damage, now and then several."""
    kinds = TEXT if is_text else ANY
    for _ in range(20):
        found = rng.choice(kinds)(rng, data, other)
        if rng.random() < 0.08 and found.data:
            more = rng.choice(kinds)(rng, found.data, other)
            found = Damaged(
                more.data, f"{found.what}; {more.what}", found.touched + more.touched, found.in_place and more.in_place
            )
        if found.data != data:
            return _as_bytes_differ(data, found)
    return cut(rng, data, other)


def _as_bytes_differ(data: bytes, found: Damaged) -> Damaged:
    """Where no byte has moved, what was touched is what differs."""
    if len(found.data) != len(data):
        return found
    places = [i for i, (a, b) in enumerate(zip(data, found.data, strict=True)) if a != b]
    return Damaged(found.data, found.what, tuple((i, i + 1) for i in places), True)
