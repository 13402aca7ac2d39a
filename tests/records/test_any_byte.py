"""A file that is cut or changed at any byte, and a library that dies of it: a result, or one error that names the file."""

from __future__ import annotations

import os
import random
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fmucorrect import places, records
from fmucorrect.errors import RecordError
from fmucorrect.records import child
from fmucorrect.records.child import ChildSource
from fmucorrect.records.csv import CsvSource
from fmucorrect.records.guarded import Guarded
from fmucorrect.records.mat import MatSource
from fmucorrect.records.tdms import TdmsSource
from fmucorrect.signals import Channel, Record

ROWS = 11


def seeds(folder: Path) -> dict[str, Path]:
    """A small file of each format that can be read in this process."""
    found: dict[str, Path] = {}
    values = np.random.default_rng(0).normal(size=(ROWS, 2)).round(3)
    for suffix in (".csv", ".tdms", ".mat"):
        record = Record(10**6 * np.arange(ROWS, dtype=np.int64), values, (Channel("a", "mm"), Channel("b", "N")))
        found[suffix] = folder / f"seed{suffix}"
        with records.writer(found[suffix]) as file:
            file.write("/a", record.rows(0, 5))
            file.write("/a", record.rows(5, ROWS))
    found["foreign.csv"] = folder / "foreign.csv"
    rows = "".join(f"2024-05-06 07:08:{i:02d};{i * i / 8};{i % 3}1\n".replace(".", ",") for i in range(ROWS))
    found["foreign.csv"].write_text("Zeit;a (mm);b\n" + rows)
    return found


def opened(path: Path) -> Any:
    """The source in this process: starting another one takes too long for every byte."""
    kinds: dict[str, Any] = {".csv": CsvSource, ".tdms": TdmsSource, ".mat": MatSource}
    return Guarded(str(path), kinds[path.suffix])


def content(path: Path) -> tuple[list[tuple[str, str]], np.ndarray, np.ndarray, str]:
    source = opened(path)
    try:
        topic = next((topic for topic in source.topics() if topic.columns), None)
        if topic is None:
            return [], np.empty(0, np.int64), np.empty((0, 0)), source.damage
        blocks = list(source.blocks(topic.name, [c.name for c in topic.columns]))
        t_ns = np.concatenate([block.t_ns for block in blocks] or [np.empty(0, np.int64)])
        values = np.concatenate([block.values for block in blocks] or [np.empty((0, len(topic.columns)))])
        return [(c.name, c.unit) for c in topic.columns], t_ns, values, source.damage
    finally:
        source.close()


@pytest.mark.parametrize("kind", [".csv", "foreign.csv", ".tdms", ".mat"])
def test_cut_at_every_byte(kind: str, tmp_path: Path) -> None:
    seed = seeds(tmp_path)[kind]
    data = seed.read_bytes()
    names, t_ns, values, damage = content(seed)
    assert (len(t_ns), damage) == (ROWS, "")
    path = tmp_path / f"cut{seed.suffix}"
    for size in range(0, len(data), 1 if seed.suffix in (".csv", ".tdms") else 5):
        path.write_bytes(data[:size])
        try:
            there, cut_ns, cut_values, damage = content(path)
        except RecordError:
            continue
        n = len(cut_ns)
        assert (cut_ns == t_ns[:n]).all()
        assert there == names or damage or not n
        assert [(name, cut_values[:, c].tolist()) for c, (name, _) in enumerate(there)] == [
            (name, values[:n, c].tolist()) for c, (name, _) in enumerate(names) if (name, names[c][1]) in there
        ]


@pytest.mark.parametrize("kind", [".csv", "foreign.csv", ".tdms", ".mat"])
def test_damaged_anywhere_is_a_result_or_one_error(kind: str, tmp_path: Path) -> None:
    seed = seeds(tmp_path)[kind]
    data = seed.read_bytes()
    path = tmp_path / f"damaged{seed.suffix}"
    rng = random.Random(1)
    for _ in range(120):
        damaged = bytearray(data)
        start, length = rng.randrange(len(data)), rng.choice([1, 1, 1, 2, 8, 60])
        if rng.random() < 0.3:
            del damaged[start : start + length]
        else:
            for i in range(start, min(start + length, len(data))):
                damaged[i] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            _, t_ns, values, _ = content(path)
        except RecordError as error:
            assert path.name in str(error)  # noqa: PT017 (a result is as right)
        else:
            assert len(t_ns) == len(values)
            assert t_ns.dtype == np.int64


@pytest.mark.parametrize("suffix", [".parquet", ".mf4"])
def test_the_child_outlives_nothing_and_harms_nothing(suffix: str, tmp_path: Path) -> None:
    """Damaged files whose libraries may die, read in a process of its own: a result or one error, as for the others."""
    path = tmp_path / f"run{suffix}"
    values = np.random.default_rng(0).normal(size=(20, 2))
    with records.writer(path) as file:
        file.write("/a", Record(10**6 * np.arange(20, dtype=np.int64), values, (Channel("a", "mm"), Channel("b", "N"))))
    data = path.read_bytes()
    rng = random.Random(2)
    for _ in range(3):
        damaged = bytearray(data)
        for _ in range(3):
            damaged[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged[: rng.randrange(len(data))] if rng.random() < 0.3 else damaged)
        try:
            records.read(path)
        except RecordError as error:
            assert path.name in str(error)  # noqa: PT017 (a result is as right)


class Stuck(CsvSource):
    """A source whose library does not come back, fills the memory, prints, or ends the interpreter."""

    @staticmethod
    def load() -> None:
        """Nothing to import."""

    def topics(self) -> Any:
        what = Path(self.path).read_text().split(",")[1].strip().split("\n")[0]
        print("a library prints")
        if what == "exits":
            os._exit(0)
        if what == "dies":
            os.kill(os.getpid(), signal.SIGSEGV)
        if what == "grows":
            return [bytearray(2**28) for _ in range(64)]
        while what == "loops":
            pass
        return super().topics()


@pytest.mark.skipif(sys.platform == "win32", reason="signals and limits of memory")
@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("exits", "ended by itself .exit code 0."),
        ("dies", "ended by itself .signal 11."),
        ("grows", "MemoryError"),
        ("loops", "took more than 2 s|signal"),
        ("works", ""),
    ],
)
def test_the_child_ends_and_says_why(what: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "ANSWER_S", 2.0 if what == "loops" else 20.0)
    monkeypatch.setattr(places, "PLACES", (*places.PLACES, str(Path(__file__).parent)))
    path = tmp_path / "run.csv"
    path.write_text(f"time,{what}\n0,1\n1,2\n", encoding="utf-8")
    if what == "works":
        source = ChildSource(str(path), "test_any_byte:Stuck")
        first, second = source.blocks("", [what]), source.blocks("", [])
        assert next(first).values.tolist() == [[1], [2]]
        assert next(second).t_ns.tolist() == [0, 10**9]
        assert next(first, None) is None
        source.close()
        return
    with pytest.raises(RecordError, match=message) as caught:
        ChildSource(str(path), "test_any_byte:Stuck")
    assert str(path) in str(caught.value)


def test_parquet_without_some_bytes_says_every_row_or_is_refused(tmp_path: Path) -> None:
    """Past a page header that is none the library may end the rows without a word."""
    stamps, values = np.arange(96) / 1e3, np.random.default_rng(3).normal(size=96)
    whole, path = tmp_path / "whole.parquet", tmp_path / "run.parquet"
    pq.write_table(pa.table({"time": stamps, "x": values}), whole, row_group_size=32, use_dictionary=False)
    data, refused = whole.read_bytes(), 0
    for at in range(4, len(data) - 8, 61):
        path.write_bytes(data[:at] + data[at + 2 :])
        try:
            assert records.describe(path).topics[0].extent.rows == 96
        except RecordError:
            refused += 1
    assert refused
