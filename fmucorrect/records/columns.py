"""Which column a name means: the full name, or a suffix of it that only one column has."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmucorrect.errors import RecordError, few
from fmucorrect.records.contents import Column, Topic
from fmucorrect.signals import AS_IT_IS, Reading


@dataclass(frozen=True)
class Part:
    """What is taken from one topic. columns: names in the file; positions: where each goes in the record."""

    topic: Topic
    columns: tuple[str, ...]
    positions: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """What a record is put together from. names and units: of its columns, in order. parts: one a topic."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    parts: tuple[Part, ...]


def plan(
    topics: Sequence[Topic],
    names: Sequence[str] | None,
    topic: str | None,
    path: str,
    reading: Reading = AS_IT_IS,
    left_out: Sequence[str] = (),
) -> Plan:
    """Find each named column (None: all columns of the only topic). left_out: what the file holds that is none, and why. Raises
    RecordError with near names."""
    if isinstance(names, str):
        raise RecordError("columns are given as a list of names", where=path, got=repr(names))
    if topic is not None:
        topics = [_topic(topics, topic, path)]
    if names is None:
        return _everything(topics, path)
    found = [find(topics, name, path, reading, left_out) for name in names]
    parts: list[Part] = []
    for t in dict.fromkeys(t for t, _ in found):
        mine = [(i, column.name) for i, (other, column) in enumerate(found) if other == t]
        parts.append(Part(topics[t], tuple(name for _, name in mine), tuple(i for i, _ in mine)))
    return Plan(tuple(names), tuple(column.unit for _, column in found), tuple(parts))


def find(
    topics: Sequence[Topic], name: str, path: str, reading: Reading = AS_IT_IS, left_out: Sequence[str] = ()
) -> tuple[int, Column]:
    """The column that a name means: the number of its topic, and itself. left_out: as of `plan`. Raises RecordError with near
    names."""
    matches, wanted = _meant(topics, name, reading), reading.columns.get(name, name)
    if len(matches) == 1:
        return matches[0]
    if matches:
        there = ", ".join(topics[t].full_name(column.name) for t, column in matches)
        raise RecordError(f"column {wanted!r} may mean {there}", where=path, remedy="Write the full name.")
    ends = (f"'{wanted}': ", f".{wanted}': ")
    none = not any(topic.columns for topic in topics)
    unread = [f"{t.name}: {t.note}" for t in topics if t.note and (none or _plain(wanted).startswith(_plain(t.name)))]
    raise RecordError(
        f"there is no column {wanted!r}",
        where=path,
        expected=_near(topics, _plain(wanted)),
        got=next((text for text in left_out if any(end in text for end in ends)), few(unread) or None),
    )


def has(topics: Sequence[Topic], name: str, reading: Reading = AS_IT_IS) -> bool:
    """Whether there is a column that a name may mean."""
    return bool(_meant(topics, name, reading))


def with_units(topics: Sequence[Topic], reading: Reading) -> tuple[Topic, ...]:
    """The topics with the units that `reading` knows."""
    told = {
        (t, column.name): unit for name, unit in reading.units.items() for t, column in _meant(topics, name, reading)
    }
    if not told:
        return tuple(topics)
    return tuple(
        replace(topic, columns=tuple(replace(c, unit=told.get((t, c.name), c.unit)) for c in topic.columns))
        for t, topic in enumerate(topics)
    )


def _topic(topics: Sequence[Topic], name: str, path: str) -> Topic:
    for topic in topics:
        if topic.name.lstrip("/") == name.lstrip("/"):
            return topic
    there = ", ".join(repr(topic.name) for topic in topics) or "none"
    expected = "no name of a topic: it is one table" if there == "''" else f"one of {there}"
    raise RecordError(f"there is no topic {name!r}", where=path, expected=expected)


def _everything(topics: Sequence[Topic], path: str) -> Plan:
    readable = [topic for topic in topics if topic.columns]
    if not readable:
        notes = "; ".join(f"{topic.name}: {topic.note}" for topic in topics if topic.note)
        raise RecordError("there is no numeric column", where=path, got=notes or None)
    if len(readable) > 1:
        there = ", ".join(repr(topic.name) for topic in readable)
        raise RecordError(
            f"there are several topics: {there}", where=path, remedy="Say which: topic=..., or name columns."
        )
    columns = readable[0].columns
    names = tuple(column.name for column in columns)
    part = Part(readable[0], names, tuple(range(len(names))))
    return Plan(names, tuple(column.unit for column in columns), (part,))


def _meant(topics: Sequence[Topic], name: str, reading: Reading) -> list[tuple[int, Column]]:
    """The columns that a name may mean: by the name that `reading` has for it, else by itself."""
    known = reading.columns.get(name)
    return (_matches(topics, known) if known is not None else []) or _matches(topics, name)


def _matches(topics: Sequence[Topic], name: str) -> list[tuple[int, Column]]:
    """The columns that a name may mean: in full, as the column alone, as the end of the full name, or with its unit as a
    header writes it."""
    wanted = _plain(name)
    every = [
        (t, column, _plain(topic.full_name(column.name))) for t, topic in enumerate(topics) for column in topic.columns
    ]
    for matches in (
        [(t, column) for t, column, full in every if full == wanted],
        [(t, column) for t, column, _ in every if _plain(column.name) == wanted],
        [(t, column) for t, column, full in every if full.endswith("." + wanted)],
        [(t, column) for t, column, full in every if wanted in (f"{full} [{column.unit}]", f"{full} ({column.unit})")],
    ):
        if matches:
            return matches
    return []


def _near(topics: Sequence[Topic], wanted: str) -> str:
    names = [topic.full_name(column.name) for topic in topics for column in topic.columns]
    last = wanted.rsplit(".", 1)[-1].lower()
    score = {n: difflib.SequenceMatcher(None, last, _plain(n).rsplit(".", 1)[-1].lower()).ratio() for n in names}
    best = sorted(names, key=lambda n: -score[n])[:8]
    more = f" and {len(names) - len(best)} more" if len(names) > len(best) else ""
    return f"one of {', '.join(best)}{more}" if best else "a column, but there are none"


def _plain(name: str) -> str:
    return name.replace("/", ".").lstrip(".")
