"""The MCAP project's conformance files, built from their published description, through our reader and theirs.

    python tools/conformance.py               # the table, and what went wrong; exit 1 where anything did
    python tools/conformance.py --keep FOLDER # leaves the files there
    python tools/conformance.py --commit-table # writes conformance.md beside this script

A case is a content (nothing, a message, ten messages, an attachment, a metadata record) and a set of features: whether
there are chunks, indexes, statistics, repeated schemas, and bytes behind every record that a reader must pass over. The
MCAP project keeps each as a JSON list of records and as a file; the same features always give the same bytes. SEALS are
checksums that stand in their lists, and that the files built here must bear. Their messages are three bytes of no known
encoding: right is to name the topic and its rows, and to refuse its columns. `TenNumbers` is ours: the same features
around ten JSON messages, so that there are numbers to compare.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import traceback
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.signals import join

FEATURES = ("ax", "ch", "chx", "mdx", "mx", "pad", "rch", "rsh", "st", "sum")
"""Index of attachments, chunks, index of chunks, index of metadata, index of messages, bytes behind each record,
channels and schemas repeated in the summary, statistics, offsets of the summary's groups."""

SEALS = {
    "NoData-st-sum": (3959079795, 430344505),
    "OneMetadata-mdx-st-sum": (864453130, 1977374533),
    "OneSchemalessMessage-ch-chx-mx-rch-st-sum": (3511088359, 2291561592),
    "TenMessages-ch-chx-mx-pad-rch-rsh-st-sum": (3282868494, 829723996),
    "TenMessages-pad-rch-rsh-st-sum": (1473564290, 1987992992),
    "OneAttachment-ax-pad-st-sum": (1702036232, 2541810275),
}
"""Checksums of the data and of the summary, as published."""

MAGIC = b"\x89MCAP0\r\n"
EXTRA = b"\x01\xff\xff"  # what `pad` puts behind each record
LOG_TIMES = (0, 2, 1, 3, 3, 5, 4, 7, 8, 9)
TABLE = Path(__file__).with_suffix(".md")

SCHEMA = Schema(id=1, name="Example", encoding="c", data=b"\x04\x05\x06")
CHANNEL = Channel(id=1, topic="example", message_encoding="a", metadata={"foo": "bar"}, schema_id=1)
BYTES = b"\x01\x02\x03"


def message(log_time: int, publish_time: int, sequence: int, data: bytes = BYTES) -> Message:
    """A message of channel 1."""
    return Message(channel_id=1, log_time=log_time, publish_time=publish_time, sequence=sequence, data=data)


CONTENTS: dict[str, list[McapRecord]] = {
    "NoData": [],
    "OneSchemalessMessage": [
        Channel(id=1, topic="example", message_encoding="text", metadata={}, schema_id=0),
        message(2, 1, 10),
    ],
    "OneMessage": [SCHEMA, CHANNEL, message(2, 1, 10)],
    "OneAttachment": [
        Attachment(create_time=1, log_time=2, name="myFile", media_type="application/octet-stream", data=BYTES)
    ],
    "OneMetadata": [Metadata(name="myMetadata", metadata={"foo": "bar"})],
    "TenMessages": [SCHEMA, CHANNEL, *(message(t, t, i) for i, t in enumerate(LOG_TIMES))],
    "TenNumbers": [
        Schema(id=1, name="Example", encoding="jsonschema", data=b"{}"),
        Channel(id=1, topic="example", message_encoding="json", metadata={"foo": "bar"}, schema_id=1),
        *(message(10 * i, 10 * i, i, json.dumps({"x": i / 7, "in": {"y": i}}).encode()) for i in range(10)),
    ],
}


def cases() -> Iterator[tuple[str, str, frozenset[str]]]:
    """Name, content and features of every case that makes sense."""
    for content, its_records in CONTENTS.items():
        kinds = {type(record) for record in its_records}
        for count in range(len(FEATURES) + 1):
            for chosen in combinations(FEATURES, count):
                features = frozenset(chosen)
                needed = {"ax": Attachment, "mdx": Metadata, "rsh": Schema, "rch": Channel, "ch": Message}
                if any(feature in features and kind not in kinds for feature, kind in needed.items()):
                    continue
                if features & {"chx", "mx"} and "ch" not in features:
                    continue
                if "sum" in features and not features & {"chx", "rsh", "rch", "mdx", "ax", "st"}:
                    continue
                yield "-".join([content, *chosen]), content, features


def packed(record: McapRecord, extra: bool) -> bytes:
    """A record's bytes. extra: with bytes behind what its kind needs; in a message and a chunk they would be its data."""
    builder = RecordBuilder()
    record.write(builder)
    data = builder.end()
    if not extra or isinstance(record, Message | Chunk):
        return data
    return data[:1] + (len(data) - 9 + len(EXTRA)).to_bytes(8, "little") + data[9:] + EXTRA


def built(its_records: Sequence[McapRecord], features: frozenset[str]) -> bytes:
    """The file of a case."""
    pad = "pad" in features
    data = MAGIC + packed(Header(profile="", library=""), pad)
    inside, stamps = b"", list[tuple[int, int]]()
    indexes: dict[Opcode, list[McapRecord]] = {}
    for record in its_records:
        start, length = len(data), len(packed(record, pad))
        if "ch" in features and isinstance(record, Message | Schema | Channel):
            if isinstance(record, Message):
                stamps.append((record.log_time, len(inside)))
            inside += packed(record, False)
            continue
        data += packed(record, pad)
        if isinstance(record, Attachment) and "ax" in features:
            index = AttachmentIndex(
                start, length, record.log_time, record.create_time, len(record.data), record.name, record.media_type
            )
            indexes[Opcode.ATTACHMENT_INDEX] = [index]
        if isinstance(record, Metadata) and "mdx" in features:
            indexes[Opcode.METADATA_INDEX] = [MetadataIndex(offset=start, length=length, name=record.name)]
    if "ch" in features:
        start, times = len(data), [t for t, _ in stamps]
        chunk = Chunk("", inside, max(times), min(times), zlib.crc32(inside), len(inside))
        data += packed(chunk, pad)
        end, offsets = len(data), dict[int, int]()
        if "mx" in features:
            offsets[1] = end
            data += packed(MessageIndex(1, stamps), pad)
        if "chx" in features:
            index = ChunkIndex(
                end - start, start, "", len(inside), max(times), len(data) - end, offsets, min(times), len(inside)
            )
            indexes[Opcode.CHUNK_INDEX] = [index]
    data += packed(DataEnd(zlib.crc32(data)), pad)
    if "rsh" in features:
        indexes[Opcode.SCHEMA] = [record for record in its_records if isinstance(record, Schema)]
    if "rch" in features:
        indexes[Opcode.CHANNEL] = [record for record in its_records if isinstance(record, Channel)]
    if "st" in features:
        indexes[Opcode.STATISTICS] = [statistics(its_records, "ch" in features)]
    return data + summary(indexes, len(data), features)


def statistics(its_records: Sequence[McapRecord], chunked: bool) -> Statistics:
    """What is in the file, counted."""
    kinds = Counter(type(record) for record in its_records)
    times = [record.log_time for record in its_records if isinstance(record, Message)]
    return Statistics(
        attachment_count=kinds[Attachment],
        channel_count=kinds[Channel],
        channel_message_counts={1: len(times)} if times else {},
        chunk_count=int(chunked),
        message_count=len(times),
        message_start_time=min(times, default=0),
        message_end_time=max(times, default=0),
        metadata_count=kinds[Metadata],
        schema_count=kinds[Schema],
    )


def summary(indexes: dict[Opcode, list[McapRecord]], start: int, features: frozenset[str]) -> bytes:
    """Everything behind the data section."""
    pad = "pad" in features
    groups, offsets = b"", b""
    for opcode in (
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.STATISTICS,
        Opcode.METADATA_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.CHUNK_INDEX,
    ):
        group = b"".join(packed(record, pad) for record in indexes.get(opcode, []))
        if group and "sum" in features:
            offsets += packed(SummaryOffset(opcode, start + len(groups), len(group)), pad)
        groups += group
    begin, offset_start = start if groups else 0, start + len(groups) if "sum" in features else 0
    head = packed(Footer(begin, offset_start, 0), False)[:-4]
    checksum = zlib.crc32(groups + offsets + head)
    return groups + offsets + packed(Footer(begin, offset_start, checksum), False) + MAGIC


@dataclass(frozen=True)
class Theirs:
    """What the mcap library reads. rows: by topic, log time and payload, in file order."""

    rows: dict[str, list[tuple[int, bytes]]]
    fails: bool


def theirs(path: Path) -> Theirs:
    """By its reader from front to back. fails: its other reader, which goes by the summary, does not give the same."""
    both: list[dict[str, list[tuple[int, bytes]]]] = []
    for kind in (NonSeekingReader, make_reader):
        rows: dict[str, list[tuple[int, bytes]]] = {}
        with path.open("rb") as stream, suppress(KeyError if kind is make_reader else ()):
            for _, channel, one in kind(stream).iter_messages(log_time_order=False):
                rows.setdefault(channel.topic, []).append((one.log_time, one.data))
        both.append(rows)
    return Theirs(both[0], both[0] != both[1])


def ours(path: Path, expected: Theirs) -> tuple[str, str]:
    """The outcome in one word or three, and what is wrong ("" when nothing is)."""
    outcome = _numbers(path, expected) if expected.rows else _refused(path)
    if expected.rows:
        described = records.describe(path)
        found = {one.topic.name: (one.extent.rows, one.extent.start_ns, one.extent.stop_ns) for one in described.topics}
        wanted = {
            topic: (len(rows), min(t for t, _ in rows), max(t for t, _ in rows))
            for topic, rows in expected.rows.items()
        }
        if found != wanted:
            return outcome[0], f"describe says {found}, expected {wanted}"
        if described.damage or described.truncated:
            return outcome[0], f"a whole file is called damaged: {described.damage}"
    return outcome


def _refused(path: Path, expected: str = "there is no topic") -> tuple[str, str]:
    for call in (records.describe, records.read, lambda place: list(records.stream(place))):
        try:
            call(path)
        except RecordError as error:
            if expected not in str(error):
                return "refused", f"{error}, expected {expected!r}"
        else:
            return "accepted", "a file without a number was read"
    return "refused", ""


def _numbers(path: Path, expected: Theirs) -> tuple[str, str]:
    [rows] = expected.rows.values()
    if rows[0][1] == BYTES:
        for call in (records.read, lambda place: list(records.stream(place))):
            try:
                call(path)
            except RecordError as error:
                if "there is no numeric column" not in str(error) or "example" not in str(error):
                    return "topic named, columns refused", str(error)
            else:
                return "accepted", "bytes of no known encoding were read"
        return "topic named, columns refused", ""
    read = [records.read(path, ["x", "in.y"]), join(list(records.stream(path, ["x", "in.y"], rows=3)))]
    wanted = np.array([[json.loads(data)["x"], json.loads(data)["in"]["y"]] for _, data in rows])
    for record in read:
        if record.t_ns.tolist() != [t for t, _ in rows] or not np.array_equal(record.values, wanted):
            return "numbers", "the numbers differ from those of the mcap library"
    return "numbers equal", ""


def run(folder: Path) -> tuple[dict[str, Counter[str]], list[str]]:
    """Outcomes by content, and everything that is wrong."""
    counts: dict[str, Counter[str]] = {}
    wrong: list[str] = []
    for name, content, features in cases():
        path = folder / f"{name}.mcap"
        data = built(CONTENTS[content], features)
        path.write_bytes(data)
        counted = counts.setdefault(content, Counter())
        counted["files"] += 1
        wrong += _unsealed(name, data)
        try:
            expected = theirs(path)
            counted[LIBRARY_FAILS] += expected.fails
            outcome, problem = ours(path, expected)
        except Exception:  # any exception is what is looked for here
            outcome, problem = "traceback", traceback.format_exc(limit=-2)
        counted[outcome] += 1
        if problem:
            counted["wrong"] += 1
            wrong.append(f"{name}: {problem}")
    return counts, wrong


def _unsealed(name: str, data: bytes) -> list[str]:
    if name not in SEALS:
        return []
    footer = len(data) - len(MAGIC) - 29
    summary_start = int.from_bytes(data[footer + 9 : footer + 17], "little")
    end = summary_start - 13 - (len(EXTRA) if "-pad" in name else 0)
    found = (data[end + 9 : end + 13], data[footer + 25 : footer + 29])
    return [
        f"{name}: the file built here has checksum {int.from_bytes(got, 'little')}, published is {seal}"
        for got, seal in zip(found, SEALS[name], strict=True)
        if int.from_bytes(got, "little") != seal
    ]


LIBRARY_FAILS = "mcap's own summary reader fails"
COLUMNS = (
    "files",
    "numbers equal",
    "topic named, columns refused",
    "refused",
    "traceback",
    "wrong",
    LIBRARY_FAILS,
)


def table(counts: dict[str, Counter[str]]) -> str:
    """Markdown, a row a content."""
    lines = [f"| content | {' | '.join(COLUMNS)} |", "|---" * (len(COLUMNS) + 1) + "|"]
    total = sum(counts.values(), Counter[str]())
    for content, counted in [*counts.items(), ("all", total)]:
        lines.append(f"| {content} | {' | '.join(str(counted[column]) for column in COLUMNS)} |")
    return "\n".join(lines)


def main() -> int:
    """The exit code: 1 where anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, help="leave the files in this folder")
    parser.add_argument("--commit-table", action="store_true", help=f"write {TABLE.name}")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        counts, wrong = run(folder)
    print(table(counts))
    for line in wrong:
        print(line, file=sys.stderr)
    if chosen.commit_table:
        commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True)
        TABLE.write_text(
            f"# MCAP conformance\n\n`python tools/conformance.py --commit-table` at {commit.stdout.strip()}: the MCAP "
            "project's cases and our own `TenNumbers`, read by fmucorrect and by both readers of the mcap library.\n\n"
            "*numbers equal*: stamps and values are those of the library, in one piece and streamed. *topic named,\n"
            "columns refused*: rows and stamps are the library's, and the error names the topic and its encoding, which\n"
            "is of no known kind. *refused*: there is no message; one error says so. *wrong* and *traceback* must be 0.\n"
            "The last column counts files that the library's reader by the summary cannot read, since their channels\n"
            "are not repeated there; its reader from front to back reads them, and is compared with.\n\n"
            f"{table(counts)}\n",
            encoding="utf-8",
        )
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
