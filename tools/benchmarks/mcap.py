"""MCAP of 600 000 samples of 4 doubles: the bulk writer and reader against the mcap library's own, same compression."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect import records
from fmucorrect.signals import Channel, Record

SAMPLES = 600_000
NAMES = ("FW", "FB", "RW", "RB")


def measure(samples: int = SAMPLES, repeats: int = 5) -> dict[str, float]:
    """Seconds and ratios in one run: medians over `repeats` of ours, one run of the library's (it takes seconds).

    The library writes protobuf messages with mcap_protobuf and decodes each one; zstd at its default level both times.
    Raises AssertionError when either reads the other's file differently.
    """
    rng = np.random.default_rng(0)
    t_ns = 1_000_000 * np.arange(samples, dtype=np.int64)
    phase = 2 * np.pi * 2.0 * t_ns[:, None] / 1e9 + np.arange(4)
    values = 3.0 * np.sin(phase) + 0.02 * rng.normal(size=(samples, 4))
    record = Record(t_ns, values, tuple(Channel(name, "mm") for name in NAMES))
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = Path(folder) / "ours.mcap", Path(folder) / "theirs.mcap"
        write = _median(lambda: _write(ours, record), repeats)
        read = _median(lambda: records.read(ours), repeats)
        back = records.read(ours)
        _same(record, back.t_ns, back.values)
        library_write = _seconds(lambda: _library_write(theirs, ours, record))
        result: list[Any] = []
        library_read = _seconds(lambda: result.append(_library_read(theirs)))
        _same(record, *result[0])
        theirs_by_us = _median(lambda: records.read(theirs), repeats)
        _same(record, *_library_read(ours))
        sizes = ours.stat().st_size, theirs.stat().st_size
    return {
        "samples": float(samples),
        "write_s": write,
        "read_s": read,
        "library_write_s": library_write,
        "library_read_s": library_read,
        "write_ratio": library_write / write,
        "read_ratio": library_read / read,
        "library_file_read_by_us_s": theirs_by_us,
        "size_ratio": sizes[0] / sizes[1],
    }


def _same(record: Record, t_ns: np.ndarray, values: np.ndarray) -> None:
    assert np.array_equal(record.t_ns, t_ns)
    assert np.array_equal(record.values, values)


def _write(path: Path, record: Record) -> None:
    with records.writer(path) as file:
        file.write("/simulation", record)


def _library_write(path: Path, ours: Path, record: Record) -> None:
    from mcap_protobuf.writer import Writer

    kind = _message_class(ours)
    with path.open("wb") as stream, Writer(stream) as file:
        for t, row in zip(record.t_ns.tolist(), record.values.tolist(), strict=True):
            message = kind(FW=row[0], FB=row[1], RW=row[2], RB=row[3])
            file.write_message("/simulation", message, log_time=t, publish_time=t)


def _library_read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    times: list[int] = []
    rows: list[tuple[float, ...]] = []
    with path.open("rb") as stream:
        for _, _, message, m in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            times.append(message.log_time)
            rows.append((m.FW, m.FB, m.RW, m.RB))
    return np.array(times), np.array(rows)


def _message_class(path: Path) -> Any:
    """The message class that our file's schema describes."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    schema = next(iter(summary.schemas.values()))
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def _seconds(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def _median(action: Callable[[], object], repeats: int) -> float:
    return statistics.median(_seconds(action) for _ in range(repeats))
