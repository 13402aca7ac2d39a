"""Rows of an MDF file: as many as its groups state, or what disagrees is told."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import asammdf
import numpy as np
import pytest

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records.mdf_blocks import disagreement

ROWS = 50


def written(
    path: Path, version: str, compression: Literal[0, 1, 2] = 0, invalid: bool = False, pieces: int = 0
) -> Path:
    """Two groups of different rates, with numbers and text. pieces: bytes of a data block, 0 for one that holds all."""
    with asammdf.MDF(version=version) as file:
        if pieces:
            file.configure(write_fragment_size=pieces)
        for rate in (100.0, 30.0):
            time = np.arange(ROWS) / rate
            bits = {"invalidation_bits": np.arange(ROWS) % 3 == 0} if invalid else {}
            text = asammdf.Signal(np.array([b"x" * (i % 5) for i in range(ROWS)]), time, name="t", encoding="utf-8")
            numbers = asammdf.Signal(np.arange(ROWS) + 1.0, time, unit="mm", name="a", **bits)
            file.append([numbers, asammdf.Signal(np.arange(ROWS, dtype="u1"), time, name="b"), text])
        file.save(path, overwrite=True, compression=compression)
    return path


def counts(path: Path) -> list[int]:
    """Where in the file the low byte of each group's number of records stands."""
    data = path.read_bytes()
    with asammdf.MDF(path) as file:
        places = [group.channel_group.address for group in file.groups]
    if path.suffix == ".mdf":
        return [at + 22 for at in places]
    return [at + 32 + 8 * struct.unpack_from("<Q", data, at + 16)[0] for at in places]


@pytest.mark.parametrize("version", ["3.00", "3.30", "4.00", "4.10", "4.11", "4.20"])
def test_a_number_of_records_that_lost_a_bit_disagrees_with_the_data(version: str, tmp_path: Path) -> None:
    four = version >= "4"
    modes: list[tuple[Literal[0, 1, 2], bool, int]] = [(0, False, 0)]
    if four:
        modes.extend([(1, True, 0), (2, False, 200), (0, True, 200)])
    for compression, invalid, pieces in modes:
        path = written(tmp_path / ("run.mf4" if four else "run.mdf"), version, compression, invalid, pieces)
        assert not disagreement(str(path))
        whole = path.read_bytes()
        for group, at in enumerate(counts(path)):
            for bit in range(8):
                data = bytearray(whole)
                data[at] ^= 1 << bit
                path.write_bytes(data)
                assert f"group {group} states {ROWS ^ 1 << bit} rows" in disagreement(str(path))


@pytest.mark.parametrize(("version", "name"), [("3.30", "run.mdf"), ("4.10", "run.mf4")])
def test_records_behind_the_stated_number_are_told(version: str, name: str, tmp_path: Path) -> None:
    path = written(tmp_path / name, version)
    assert not records.describe(path).damage
    data = bytearray(path.read_bytes())
    data[counts(path)[0]] ^= 32
    path.write_bytes(data)
    assert "group 0 states 18 rows" in records.describe(path).damage
    assert len(records.read(path, ["group0.b"])) == 18
    with pytest.raises(RecordError, match=r"states 18 rows .* what is more is not read"):
        records.read(path, ["group0.b"], allow_damaged=False)


def unsorted(path: Path, texts: bool, change: Callable[[list[int]], None] = lambda _: None) -> Path:
    """Records of two groups by turns, each behind its number, and with `texts` values of variable length between them.
    change: alters the stated numbers of records."""
    image = bytearray((b"MDF     4.10    by hand ".ljust(28, b"\0") + struct.pack("<H", 410)).ljust(64, b"\0"))

    def block(name: str, links: list[int], body: bytes) -> int:
        image.extend(bytes(-len(image) % 8))
        at = len(image)
        image.extend(struct.pack("<4s4xQQ", f"##{name}".encode(), 24 + 8 * len(links) + len(body), len(links)))
        image.extend(struct.pack(f"<{len(links)}Q", *links) + body)
        return at

    def link(at: int, number: int, to: int) -> None:
        struct.pack_into("<Q", image, at + 24 + 8 * number, to)

    stated, rows, data = [ROWS, ROWS // 2, ROWS], [0, 0, 0], b""
    for i in range(ROWS):
        for number in (0, 1)[: 2 - i % 2]:
            data += struct.pack("<Bddd", number, rows[number] / 100, i, 2.0 * i) + bytes(8 * number)
            rows[number] += 1
        if texts:
            data += struct.pack("<BI", 2, i % 7) + b"x" * (i % 7)
    change(stated)
    header = block("HD", [0] * 6, bytes(32))
    records_at = block("DT", [], data)
    last = block("CG", [0] * 6, struct.pack("<QQHH4xII", 2, stated[2], 1, 0, sum(i % 7 for i in range(ROWS)), 0))
    groups: list[int] = []
    for number in (1, 0):
        following = groups[-1] if groups else last * texts
        size = 24 + 8 * number
        groups.append(
            block("CG", [following] + [0] * 5, struct.pack("<QQHH4xII", number, stated[number], 0, 0, size, 0))
        )
        channel = 0
        for place, (name, kind) in reversed(list(enumerate((("time", 2), ("a", 0), ("b", 0))))):
            text = block("TX", [], name.encode().ljust(8, b"\0"))
            # a float of 64 bits; the master of time is of type 2, and counts it
            body = struct.pack("<BBBBIIIIBxH6d", kind, kind // 2, 4, 0, 8 * place, 64, 0, 0, 0, 0, *[0.0] * 6)
            channel = block("CN", [channel, 0, text, 0, 0, 0, 0, 0], body)
        link(groups[-1], 1, channel)
    link(header, 0, block("DG", [0, groups[-1], records_at, 0], struct.pack("<B7x", 1)))
    path.write_bytes(image)
    return path


@pytest.mark.parametrize("texts", [False, True])
def test_records_of_several_groups_by_turns(texts: bool, tmp_path: Path) -> None:
    path = unsorted(tmp_path / "run.mf4", texts)
    found = records.describe(path)
    assert not found.damage
    rows = [item.extent.rows for item in found.topics if item.extent and item.topic.columns]
    assert rows == [ROWS, ROWS // 2]


@pytest.mark.parametrize("texts", [False, True])
@pytest.mark.parametrize(("group", "to"), [(0, 18), (0, 51), (1, 9), (1, 57)])
def test_a_wrong_number_of_records_by_turns_is_told(texts: bool, group: int, to: int, tmp_path: Path) -> None:
    def changed(stated: list[int]) -> None:
        stated[group] = to

    path = unsorted(tmp_path / "run.mf4", texts, changed)
    with pytest.raises(RecordError, match=r"states|damaged"):
        records.read(path, [f"group{group}.a"], allow_damaged=False)
