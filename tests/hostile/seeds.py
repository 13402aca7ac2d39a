"""Small whole files to begin from: of every record format, made with this project's writers and with other libraries."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import bundles
import numpy as np

from fmucorrect import records
from fmucorrect.signals import Channel, Record

ROWS, STEP_NS, WINDOW = 96, 1_000_000, 8
NAMES = ("FW", "FB", "RW", "RB", "yaw")
UNITS = ("mm", "mm", "mm", "mm", "deg")
T_NS = STEP_NS * np.arange(ROWS, dtype=np.int64)
VALUES = np.sin(2e-9 * np.pi * 20.0 * T_NS)[:, None] * np.array(
    [1.0, 2.0, 3.0, 4.0, 0.03]
) + 0.01 * np.random.default_rng(7).normal(size=(ROWS, len(NAMES)))
"""Doubles that all differ, so that each is found again in a file by its eight bytes."""

_LIBRARY = "mcap library"


CHECKED = (
    *("own.mcap", "json zstd.mcap", "json lz4.mcap", "json plain chunks.mcap"),
    *("protobuf.mcap", "ros2.mcap", "zstd checksums.parquet", "asammdf 4.11 deflate.mf4", "own.mat"),
    *("scipy 5 deflate.mat", "hdf5 deflate.mat"),
)
"""Seeds whose values lie under a checksum: there no changed byte of them may change a result in silence."""


@dataclass(frozen=True)
class Seed:
    """A whole file. name: format and maker."""

    name: str
    path: Path

    @property
    def suffix(self) -> str:
        return self.path.suffix

    @cached_property
    def data(self) -> bytes:
        return self.path.read_bytes()

    @cached_property
    def cells(self) -> list[tuple[int, int, int, int]]:
        """First place, end, row and column (-1: time) of every number that the file holds as it is, as double or as text.

        Values that lie under a checksum are left out.
        """
        if self.name in CHECKED:
            return []
        patterns: dict[bytes, tuple[int, int]] = {}
        for row in range(ROWS):
            for column, value in enumerate(VALUES[row].tolist()):
                patterns |= dict.fromkeys((struct.pack("<d", value), repr(value).encode()), (row, column))
            if row:  # a stamp of zero is no pattern
                stamp = int(T_NS[row])
                patterns |= dict.fromkeys((struct.pack("<d", stamp / 1e9), struct.pack("<q", stamp)), (row, -1))
        found = []
        for pattern, cell in patterns.items():
            at = self.data.find(pattern)
            while at >= 0:
                found.append((at, at + len(pattern), *cell))
                at = self.data.find(pattern, at + 1)
        return found + self._pages()

    def _pages(self) -> list[tuple[int, int, int, int]]:
        """A Parquet page is compressed as one: a changed byte may change all of it."""
        if self.suffix != ".parquet":
            return []
        import pyarrow.parquet

        found, first, metadata = [], 0, pyarrow.parquet.read_metadata(self.path)
        for number in range(metadata.num_row_groups):
            group = metadata.row_group(number)
            for i in range(group.num_columns):
                part = group.column(i)
                column = NAMES.index(part.path_in_schema) if part.path_in_schema in NAMES else -1
                start = part.dictionary_page_offset or part.data_page_offset
                found += [
                    (start, start + part.total_compressed_size, first + row, column) for row in range(group.num_rows)
                ]
            first += group.num_rows
        return found

    def touched(self, places: tuple[tuple[int, int], ...]) -> set[tuple[int, int]]:
        """Rows and columns of the stored numbers that these bytes belong to."""
        return {(row, column) for a, b, row, column in self.cells for start, stop in places if a < stop and start < b}

    @property
    def ends(self) -> set[int]:
        """Places where a file of this format may end without anyone knowing that more was meant: TDMS segments."""
        marks = re.finditer(b"TDSm", self.data) if self.suffix == ".tdms" else ()
        return {match.start() for match in marks} - {0}


def corrector(folder: Path) -> Path:
    return bundles.make(folder / "corrector.onnx", rows=WINDOW)


def record_seeds(folder: Path) -> list[Seed]:
    """All of them, written into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    found: list[Seed] = []
    for suffix in records.SUFFIXES:
        found.append(_own(folder, suffix))
    for name, write in FOREIGN.items():
        suffix = name.rpartition(".")[2]
        path = folder / f"{name.replace(' ', '_').replace('.', '_')}.{suffix}"
        write(path)
        found.append(Seed(name, path))
    return found


def _own(folder: Path, suffix: str) -> Seed:
    channels = tuple(Channel(name, unit=unit) for name, unit in zip(NAMES, UNITS, strict=True))
    path = folder / f"own{suffix}"
    with records.writer(path) as file:
        for start in range(0, ROWS, 32):
            file.write("/simulation", Record(T_NS[start : start + 32], VALUES[start : start + 32], channels))
    return Seed(f"own{suffix}", path)


def _json_mcap(path: Path, **options: object) -> None:
    from mcap.writer import Writer

    with path.open("wb") as stream:
        file = Writer(stream, chunk_size=1500, **options)  # type: ignore[arg-type]
        file.start(profile="", library=_LIBRARY)
        schema = file.register_schema("Rig", "jsonschema", b'{"type": "object"}')
        channel = file.register_channel(
            "/simulation", "json", schema, {f"unit.{n}": u for n, u in zip(NAMES, UNITS, strict=True)}
        )
        for i in range(ROWS):
            data = json.dumps(dict(zip(NAMES, VALUES[i].tolist(), strict=True))).encode()
            file.add_message(channel, int(T_NS[i]), data, int(T_NS[i]), i)
        file.finish()


def _compression(name: str):
    from mcap.writer import CompressionType

    return getattr(CompressionType, name)


def _protobuf_mcap(path: Path) -> None:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap_protobuf.writer import Writer

    file = descriptor_pb2.FileDescriptorProto(name="rig.proto", package="rig", syntax="proto3")
    message = file.message_type.add(name="Sample")
    for i, name in enumerate(NAMES):
        message.field.add(name=name, number=i + 1, label=1, type=1)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    sample = message_factory.GetMessageClass(pool.FindMessageTypeByName("rig.Sample"))
    with path.open("wb") as stream, Writer(stream, chunk_size=1500) as out:
        for i in range(ROWS):
            out.write_message(
                "/simulation",
                sample(**dict(zip(NAMES, VALUES[i].tolist(), strict=True))),
                log_time=int(T_NS[i]),
                publish_time=0,
            )


def _ros2_mcap(path: Path) -> None:
    from mcap.writer import Writer

    with path.open("wb") as stream:
        file = Writer(stream, chunk_size=1500)
        file.start(profile="ros2", library=_LIBRARY)
        schema = file.register_schema(
            "rig_msgs/msg/Sample", "ros2msg", "".join(f"float64 {name}\n" for name in NAMES).encode()
        )
        channel = file.register_channel(
            "/simulation", "cdr", schema, {f"unit.{n}": u for n, u in zip(NAMES, UNITS, strict=True)}
        )
        for i in range(ROWS):
            file.add_message(channel, int(T_NS[i]), b"\0\1\0\0" + VALUES[i].astype("<f8").tobytes(), int(T_NS[i]), i)
        file.finish()


def _header(delimiter: str = ",") -> str:
    return delimiter.join(["time [s]", *(f"{name} [{unit}]" for name, unit in zip(NAMES, UNITS, strict=True))])


def _csv(path: Path, delimiter: str, decimal: str, end: str) -> None:
    lines = [_header(delimiter)]
    for i in range(ROWS):
        cells = [repr(float(T_NS[i] / 1e9)), *map(repr, VALUES[i].tolist())]
        lines.append(delimiter.join(cells).replace(".", decimal))
    path.write_bytes(end.join([*lines, ""]).encode("latin1"))


def _arrow(path: Path, **options: object) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    fields = [pa.field("time", pa.timestamp("ns"))]
    fields += [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in zip(NAMES, UNITS, strict=True)]
    columns = [pa.array(T_NS, pa.timestamp("ns")), *(pa.array(VALUES[:, i]) for i in range(len(NAMES)))]
    pa.parquet.write_table(pa.table(columns, pa.schema(fields)), path, row_group_size=40, **options)


def _mdf(path: Path, version: str, compression: int = 0) -> None:
    import asammdf

    with asammdf.MDF(version=version) as file:
        time = T_NS / 1e9
        file.append(
            [asammdf.Signal(VALUES[:, i].copy(), time, unit=UNITS[i], name=NAMES[i]) for i in range(len(NAMES))],
            acq_name="simulation",
            common_timebase=True,
        )
        file.save(path, overwrite=True, compression=compression)


def _tdms(path: Path, waveform: bool) -> None:
    import nptdms

    with nptdms.TdmsWriter(str(path)) as file:
        for start in range(0, ROWS, 32):
            part = slice(start, start + 32)
            objects = []
            if not waveform:
                objects.append(nptdms.ChannelObject("simulation", "time", T_NS[part] / 1e9))
            for i, name in enumerate(NAMES):
                properties: dict[str, object] = {"unit_string": UNITS[i]}
                if waveform:
                    properties |= {"wf_increment": 1e-3, "wf_start_offset": 0.0, "wf_samples": 1}
                objects.append(nptdms.ChannelObject("simulation", name, VALUES[part, i], properties))
            file.write_segment(objects)


def _mat(path: Path, **options: object) -> None:
    import scipy.io

    arrays = {"time": (T_NS / 1e9)[:, None]} | {name: VALUES[:, i : i + 1] for i, name in enumerate(NAMES)}
    scipy.io.savemat(path, arrays, **options)  # type: ignore[arg-type]


def _mat73(path: Path, **options: object) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for i, (name, values) in enumerate([("time", T_NS / 1e9), *zip(NAMES, VALUES.T, strict=True)]):
            data = file.create_dataset(name, data=np.ascontiguousarray(values)[None, :], **options)
            data.attrs["MATLAB_class"] = np.bytes_("double")
            del i
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan 01 00:00:00 2024 HDF5 schema 1.00 ."
    with path.open("r+b") as stream:
        stream.write(head.ljust(116) + bytes(8) + b"\x00\x02IM")


FOREIGN: dict[str, Callable[[Path], None]] = {
    "json zstd.mcap": lambda path: _json_mcap(path),
    "json lz4.mcap": lambda path: _json_mcap(path, compression=_compression("LZ4")),
    "json plain chunks.mcap": lambda path: _json_mcap(path, compression=_compression("NONE")),
    "json no chunks.mcap": lambda path: _json_mcap(path, use_chunking=False),
    "json no crc.mcap": lambda path: _json_mcap(path, compression=_compression("NONE"), enable_crcs=False),
    "protobuf.mcap": _protobuf_mcap,
    "ros2.mcap": _ros2_mcap,
    "comma.csv": lambda path: _csv(path, ",", ".", "\n"),
    "semicolon.csv": lambda path: _csv(path, ";", ",", "\r\n"),
    "tab.csv": lambda path: _csv(path, "\t", ".", "\n"),
    "snappy.parquet": lambda path: _arrow(path),
    "plain.parquet": lambda path: _arrow(path, compression="none", use_dictionary=False),
    "zstd checksums.parquet": lambda path: _arrow(path, compression="zstd", write_page_checksum=True),
    "asammdf 4.10.mf4": lambda path: _mdf(path, "4.10"),
    "asammdf 4.11 deflate.mf4": lambda path: _mdf(path, "4.11", 2),
    "asammdf 3.30.mdf": lambda path: _mdf(path, "3.30"),
    "waveform.tdms": lambda path: _tdms(path, True),
    "timed.tdms": lambda path: _tdms(path, False),
    "scipy 5.mat": lambda path: _mat(path),
    "scipy 5 deflate.mat": lambda path: _mat(path, do_compression=True),
    "scipy 4.mat": lambda path: _mat(path, format="4"),
    "hdf5.mat": lambda path: _mat73(path),
    "hdf5 deflate.mat": lambda path: _mat73(path, chunks=(1, 48), compression="gzip", fletcher32=True),
}
"""By name; the suffix is the last word's."""
