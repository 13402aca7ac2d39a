"""The one reader: columns of a source become Records, whole or in chunks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import zip_longest

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.records import timebase
from fmucorrect.records.columns import Part, Plan, plan, with_units
from fmucorrect.records.guarded import Guarded
from fmucorrect.records.repairs import Repairs
from fmucorrect.records.source import NO_TIME, RAM_ROWS, Block
from fmucorrect.signals import Channel, Reading, Record

_STREAMED = {"drop"}
"""Rules that need only what came before a row; the others need the whole file."""

MADE = ("fmucorrect_version", "study_sha256", "corrector_sha256")
"""Notes of what made a file: true of that file alone, so that none made from it takes them over."""

RESERVED = ("path", "topic", "truncated", "assumed", "preamble", "parts", *MADE)
"""Metadata that reading sets and writing leaves out. What was lost ("damage") and mended ("repaired") is written on."""


def whole(
    source: Guarded,
    columns: Sequence[str] | None,
    topic: str | None,
    repair: str | Sequence[str] | None,
    reading: Reading,
) -> Record:
    """The record of these columns, all rows."""
    names = timebase.rules(repair or reading.repair)
    found = plan(with_units(source.topics(), reading), columns, topic, source.path, reading, source.left_out)
    if set(names) <= _STREAMED:
        repairs = _counting(found)
        blocks = list(_checked(source, found, names, RAM_ROWS if len(found.parts) > 1 else None, repairs))
        return _record(source, found, _concatenate(blocks, len(found.names)), repairs)
    return _repaired(source, found, names)


def chunks(
    source: Guarded,
    columns: Sequence[str] | None,
    topic: str | None,
    repair: str | Sequence[str] | None,
    reading: Reading,
    rows: int,
    step_ns: int | None = None,
) -> Iterator[Record]:
    """The same record in chunks of at most `rows` rows. step_ns: as of records.stream."""
    names = timebase.rules(repair or reading.repair)
    found = plan(with_units(source.topics(), reading), columns, topic, source.path, reading, source.left_out)
    if set(names) <= _STREAMED:
        repairs = _counting(found)
        blocks = _checked(source, found, names, rows, repairs)
        for block in _one_ahead(blocks) if names else blocks:
            yield _record(source, found, block, repairs)
    else:
        record = _repaired(source, found, names, step_ns)
        for start in range(0, len(record), rows):
            yield record.rows(start, min(start + rows, len(record)))


def _one_ahead(blocks: Iterator[Block]) -> Iterator[Block]:
    """The same, each once the next one is read: what a rule left out behind the last row is told with the last one."""
    held: Block | None = None
    try:
        for block in blocks:
            if held is not None:
                yield held
            held = block
    except RecordError:
        if held is not None:
            yield held
        raise
    if held is not None:
        yield held


def _counting(found: Plan) -> list[Repairs]:
    """What repairs of each part are counted in."""
    return [Repairs([found.names[i] for i in part.positions]) for part in found.parts]


def _record(source: Guarded, found: Plan, block: Block, repairs: Sequence[Repairs]) -> Record:
    channels = tuple(Channel(name, unit) for name, unit in zip(found.names, found.units, strict=True))
    metadata = dict(found.parts[0].topic.metadata) if len(found.parts) == 1 else {}
    metadata["path"] = source.path
    if len(found.parts) == 1 and found.parts[0].topic.name:
        metadata["topic"] = found.parts[0].topic.name
    if source.truncated:
        metadata["truncated"] = "true"
    if damage := source.damage:
        metadata["damage"] = "; ".join(filter(None, [damage, metadata.get("damage")]))
    repaired = [
        f"{part.topic.name}: {one.text()}" for part, one in zip(found.parts, repairs, strict=True) if one.text()
    ]
    if repaired:
        told = [text.removeprefix(": ") for text in repaired]
        metadata["repaired"] = "; ".join(filter(None, [*told, metadata.get("repaired")]))
    return Record(block.t_ns, block.values, channels, metadata)


def _checked(
    source: Guarded, found: Plan, names: tuple[str, ...], rows: int | None, repairs: Sequence[Repairs]
) -> Iterator[Block]:
    """Blocks with increasing time and finite values, of `rows` rows (None: as the file gives them)."""
    series = [_sound(source, part, names, one) for part, one in zip(found.parts, repairs, strict=True)]
    if len(series) == 1:
        yield from series[0] if rows is None else _regular(series[0], rows)
        return
    row = 0
    for blocks in zip_longest(*(_regular(one, rows or RAM_ROWS) for one in series)):
        counts = [0 if block is None else len(block.t_ns) for block in blocks]
        agreed = min(counts)
        if agreed:
            yield _joined(source, found, [Block(b.t_ns[:agreed], b.values[:agreed]) for b in blocks], row)
        if len(set(counts)) > 1 and not source.truncated:
            raise _ended(source, found, counts, row)
        if len(set(counts)) > 1:
            return
        row += agreed


def _sound(source: Guarded, part: Part, names: tuple[str, ...], repairs: Repairs) -> Iterator[Block]:
    """One topic's blocks, dropped where asked, checked."""
    row, last = 0, NO_TIME
    labels = [part.topic.full_name(column) for column in part.columns]
    for block in source.blocks(part.topic.name, part.columns):
        if names:
            block = timebase.drop(block, last, repairs)
        timebase.check(block, labels, source.path, row, last)
        timebase.check_clock(block.t_ns, source.path, row, last)
        row += len(block.t_ns)
        if len(block.t_ns):
            last = int(block.t_ns[-1])
            yield block


def _regular(blocks: Iterator[Block], rows: int) -> Iterator[Block]:
    """The same rows in blocks of exactly `rows` rows, the last one shorter."""
    held: list[Block] = []
    count = 0
    for block in blocks:
        start = 0
        while count + len(block.t_ns) - start >= rows:
            stop = start + rows - count
            held.append(Block(block.t_ns[start:stop], block.values[start:stop]))
            yield _concatenate(held, block.values.shape[1])
            held, count, start = [], 0, stop
        if start < len(block.t_ns):
            held.append(Block(block.t_ns[start:].copy(), block.values[start:].copy()))
            count += len(block.t_ns) - start
    if held:
        yield _concatenate(held, held[0].values.shape[1])


def _concatenate(blocks: list[Block], columns: int) -> Block:
    if len(blocks) == 1:
        return blocks[0]
    if not blocks:
        return Block(np.empty(0, np.int64), np.empty((0, columns)))
    return Block(np.concatenate([b.t_ns for b in blocks]), np.concatenate([b.values for b in blocks]))


def _joined(source: Guarded, found: Plan, blocks: Sequence[Block], first_row: int) -> Block:
    """Blocks of several topics side by side. Raises RecordError at the first row where the stamps differ."""
    t_ns = blocks[0].t_ns
    for part, block in zip(found.parts, blocks, strict=True):
        differs = block.t_ns != t_ns
        if differs.any():
            i = int(np.argmax(differs))
            first, there = timebase.seconds_text(int(t_ns[i])), timebase.seconds_text(int(block.t_ns[i]))
            one, other = found.parts[0].topic.name, part.topic.name
            raise RecordError(
                f"topics {one!r} and {other!r} have different stamps at row {first_row + i}",
                where=source.path,
                expected=f"{first} s",
                got=f"{there} s",
                remedy="The repair rule 'interpolate' takes the others at the stamps of the topic with the most rows.",
            )
    return Block(t_ns, _side_by_side(found, [block.values for block in blocks], len(t_ns)))


def _side_by_side(found: Plan, values: Sequence[np.ndarray], rows: int) -> np.ndarray:
    together = np.empty((rows, len(found.names)))
    for part, columns in zip(found.parts, values, strict=True):
        together[:, list(part.positions)] = columns
    return together


def _ended(source: Guarded, found: Plan, counts: Sequence[int], row: int) -> RecordError:
    short = found.parts[int(np.argmin(counts))].topic.name
    return RecordError(
        f"topic {short!r} ends at row {row + min(counts)}, before the others",
        where=source.path,
        remedy="The repair rule 'interpolate' keeps the interval that all topics cover.",
    )


def _repaired(source: Guarded, found: Plan, names: tuple[str, ...], step_ns: int | None = None) -> Record:
    """Every topic in memory, mended rule by rule, then joined."""
    blocks: list[Block] = []
    every = _counting(found)
    for part, repairs in zip(found.parts, every, strict=True):
        block = _concatenate(list(source.blocks(part.topic.name, part.columns)), len(part.columns))
        for name in names:
            if name == "sort":
                block = timebase.sort(block, repairs)
            elif name == "drop":
                block = timebase.drop(block, repairs=repairs)
            elif name == "clock":
                block = timebase.clock(block, repairs)
            elif name == "interpolate":
                block = timebase.interpolate(block, source.path, repairs)
        timebase.check(block, [part.topic.full_name(column) for column in part.columns], source.path)
        timebase.check_clock(block.t_ns, source.path)
        blocks.append(block)
    joined = _one_base(source, found, blocks, names, every)
    if "resample" in names:
        channels = tuple(Channel(name) for name in found.names)
        step = timebase.step_for(joined.t_ns, step_ns) if step_ns else None
        mended = timebase.resample(Record(joined.t_ns, joined.values, channels), step, every[0])
        joined = Block(mended.t_ns, mended.values)
    for repairs in every:
        repairs.require_known(source.path)
    return _record(source, found, joined, every)


def _one_base(
    source: Guarded, found: Plan, blocks: Sequence[Block], names: tuple[str, ...], repairs: Sequence[Repairs]
) -> Block:
    if len(blocks) == 1:
        return blocks[0]
    if "interpolate" not in names:
        counts = [len(block.t_ns) for block in blocks]
        rows = min(counts)
        joined = _joined(source, found, [Block(b.t_ns[:rows], b.values[:rows]) for b in blocks], 0)
        if len(set(counts)) > 1 and not source.truncated:
            raise _ended(source, found, counts, 0)
        return joined
    if any(not len(block.t_ns) for block in blocks):
        raise RecordError("a topic has no rows, so nothing can be joined to it", where=source.path)
    start, stop = max(int(b.t_ns[0]) for b in blocks), min(int(b.t_ns[-1]) for b in blocks)
    base = max(blocks, key=lambda block: len(block.t_ns)).t_ns  # else what is faster would be folded down
    base = base[(base >= start) & (base <= stop)]
    values = [timebase.at_stamps(block, base, one) for block, one in zip(blocks, repairs, strict=True)]
    return Block(base, _side_by_side(found, values, len(base)))
