"""Parquet: a column `time` in s (or of a timestamp or duration type), units in the columns' metadata key `unit`.

Files written here hold `time` as doubles. Where those could not hold every nanosecond (beyond 24 days) the whole
seconds of the first stamp are subtracted and stand in the file's metadata as `time_origin_ns`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records import seconds
from fmucorrect.records.assemble import RESERVED
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.source import NO_TIME, RAM_ROWS, Block, extent_of
from fmucorrect.signals import Record

_ORIGIN = "time_origin_ns"
_PER_SECOND = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtra("pyarrow", "formats") from error
    return pyarrow, pyarrow.parquet


class ParquetSource:
    """A Parquet file opened for reading. Raises RecordError when it has no column `time`."""

    format = "Parquet"
    truncated = False
    damage = ""
    left_out: tuple[str, ...] = ()

    def __init__(self, path: str) -> None:
        self.path = path
        self._arrow, parquet = _pyarrow()
        try:
            self._file: Any = parquet.ParquetFile(path)
        except (self._arrow.ArrowInvalid, OSError) as error:
            raise RecordError(
                f"this cannot be read as Parquet: {error}", where=path, remedy="A file never closed has no index."
            ) from error
        self._schema: Any = self._file.schema_arrow
        times = [name for name in self._schema.names if name.lower() == "time"]
        if not times:
            self.close()
            raise RecordError(
                "there is no column 'time'", where=path, expected="'time' in s", got=", ".join(self._schema.names)
            )
        self._time = times[0]
        noted = {**(self._schema.metadata or {}), **(self._file.metadata.metadata or {})}
        metadata = {k.decode(): v.decode() for k, v in noted.items()}
        self._origin = int(metadata.pop(_ORIGIN, 0))
        self._metadata = {k: v for k, v in metadata.items() if k not in ("pandas", "ARROW:schema")}

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def topics(self) -> tuple[Topic, ...]:
        """One topic, of the columns of numbers and truth values."""
        types = self._arrow.types
        columns = [
            Column(f.name, (f.metadata or {}).get(b"unit", b"1").decode())
            for f in self._schema
            if f.name != self._time
            and (
                types.is_integer(f.type)
                or types.is_floating(f.type)
                or types.is_boolean(f.type)
                or types.is_decimal(f.type)
            )
        ]
        return (Topic("", tuple(columns), "columns", self._metadata),)

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """Batches of rows; null is NaN."""
        names = list(dict.fromkeys([self._time, *columns]))
        for batch in self._file.iter_batches(batch_size=RAM_ROWS, columns=names):
            if batch.num_rows:
                values = np.empty((batch.num_rows, len(columns)))
                for c, name in enumerate(columns):
                    values[:, c] = self._floats(batch.column(name))
                yield Block(self._stamps(batch.column(self._time)), values)

    def extent(self, topic: str) -> Extent:
        """By reading the times."""
        return extent_of(self.blocks(topic, []))

    def _floats(self, array: Any) -> np.ndarray:
        return np.asarray(array.cast(self._arrow.float64()).to_numpy(zero_copy_only=False), np.float64)

    def _stamps(self, array: Any) -> np.ndarray:
        types = self._arrow.types
        if types.is_timestamp(array.type) or types.is_duration(array.type):
            whole = array.cast(self._arrow.int64())
            t_ns = (
                np.asarray(whole.fill_null(0).to_numpy(zero_copy_only=False), np.int64) * _PER_SECOND[array.type.unit]
            )
            return np.where(np.asarray(array.is_null().to_numpy(zero_copy_only=False)), NO_TIME, t_ns)
        t_ns = seconds.to_ns(self._floats(array))
        return t_ns if not self._origin else np.where(t_ns == NO_TIME, NO_TIME, t_ns + self._origin)


class ParquetSink:
    """A Parquet file being written: a row group an append; it can be read once it is closed."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._arrow, self._parquet = _pyarrow()
        self._writer: Any = None
        self._origin = 0

    def append(self, topic: str, record: Record) -> None:
        """Write a row group."""
        if self._writer is None:
            self._origin = seconds.origin_for(record.t_ns)
            metadata = {k: v for k, v in record.metadata.items() if k not in RESERVED}
            if self._origin:
                metadata[_ORIGIN] = str(self._origin)
            double = self._arrow.float64()
            fields = [self._arrow.field("time", double, metadata={"unit": "s"})]
            fields += [self._arrow.field(c.name, double, metadata={"unit": c.unit}) for c in record.channels]
            self._schema = self._arrow.schema(fields, metadata=metadata)
            self._writer = self._parquet.ParquetWriter(self._path, self._schema, compression="zstd")
        if len(record):
            arrays = [seconds.from_ns(record.t_ns, self._origin), *record.values.T]
            self._writer.write_table(self._arrow.table([self._arrow.array(a) for a in arrays], schema=self._schema))

    def close(self, notes: Mapping[str, str]) -> None:
        """Write the index, with notes in the file's metadata, and close."""
        if self._writer is not None and self._writer.is_open:
            if notes:
                self._writer.add_key_value_metadata(notes)
            self._writer.close()
