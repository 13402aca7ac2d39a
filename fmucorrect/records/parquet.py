"""Parquet: a column `time` in s or its unit, or of a type of time, units in the columns' metadata key `unit` or, as a table
of pandas has them, in the names: `x [mm]`. The index of such a table is its time where nothing else is.

Columns that are no numbers are named in `left_out`; equal names are numbered. Pages are written with checksums. Reading
is done in a process of its own: damaged metadata can end the interpreter, and a small file can unfold to gigabytes.
Files written here hold `time` as doubles. Where those could not hold every nanosecond (beyond 24 days) the whole
seconds of the first stamp are subtracted and stand in the file's metadata as `time_origin_ns`.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.errors import MissingExtra, RecordError
from fmucorrect.records import naming, seconds
from fmucorrect.records.assemble import RESERVED
from fmucorrect.records.child import ChildSource
from fmucorrect.records.contents import Column, Extent, Topic
from fmucorrect.records.source import MOST_COLUMNS, NO_TIME, RAM_ROWS, UNTIMED, Block, at_rate, counted, extent_of
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Reading, Record

_ORIGIN = "time_origin_ns"
_FEW_ROWS, _ROWS_PER_BYTE = 2**20, 1000
"""Rows that a file may have: even a regular time takes bits, so many more are a damaged or hostile file."""
_CHUNK, _EXPANSION = 2**28, 100
"""Bytes that one column of a row group may unfold to, as it is unfolded in memory."""
_LOOKED_AT = 100
"""Times that are looked at for what they count."""
_INDEX = re.compile(r"__index_level_\d+__")
"""What pandas calls an index without a name."""
_PER_SECOND = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtra("pyarrow", "formats") from error
    return pyarrow, pyarrow.parquet


def opened(path: str, reading: Reading) -> ChildSource:
    """A Parquet file, read in a process of its own. Raises MissingExtra, and RecordError as `ParquetSource`."""
    if importlib.util.find_spec("pyarrow") is None:
        raise MissingExtra("pyarrow", "formats")
    return ChildSource(path, "fmucorrect.records.parquet:ParquetSource", reading)


class ParquetSource:
    """A Parquet file opened for reading. Raises RecordError when it has no time."""

    format = "Parquet"
    truncated = False
    damage = ""

    @staticmethod
    def load() -> None:
        """Import the library. Raises MissingExtra."""
        _pyarrow()

    def __init__(self, path: str, reading: Reading = AS_IT_IS) -> None:
        self.path = path
        self._arrow, parquet = _pyarrow()
        try:
            self._file: Any = parquet.ParquetFile(path, page_checksum_verification=True)
        except (self._arrow.ArrowInvalid, OSError) as error:
            raise RecordError(
                f"this cannot be read as Parquet: {error}", where=path, remedy="A file never closed has no index."
            ) from error
        self._require_bounded()
        self._fields: list[Any] = list(self._file.schema_arrow)
        self._assumed: list[str] = []
        self._metadata = self._texts(
            {**(self._file.schema_arrow.metadata or {}), **(self._file.metadata.metadata or {})}
        )
        self._origin = seconds.origin_from(self._metadata.pop(_ORIGIN, None))
        for own in ("pandas", "ARROW:schema"):
            self._metadata.pop(own, None)
        self._told = reading.time
        self._told_unit, self._counts = reading.time_unit, False
        self._rate = reading.rate
        self._time = self._time_place()
        self._per = NANOSECONDS if self._time is None else self._time_unit(self._time)
        self._left_out: list[str] = []
        self._places = self._columns()
        self.left_out = tuple(self._left_out)

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def topics(self) -> tuple[Topic, ...]:
        """One topic, of the columns of numbers and truth values."""
        columns = tuple(Column(name, self._column(self._fields[place]).unit) for name, place in self._places.items())
        assumed = "; ".join(dict.fromkeys(self._assumed))
        note = "" if columns else "; ".join(self.left_out)
        named = None if self._time is None else naming.time_column(str(self._fields[self._time].name), known=True)
        time = "" if named is None else named.name
        metadata = self._metadata | ({"assumed": assumed} if assumed else {})
        return (Topic("", columns, "columns", metadata, note, time, self._counts),)

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """Batches of rows; null is NaN."""
        places = [self._places[name] for name in columns]
        read = places if self._time is None else [self._time, *places]
        names = list(dict.fromkeys(self._fields[place].name for place in read or range(1)))
        row = 0
        for batch in self._file.iter_batches(batch_size=RAM_ROWS, columns=names):
            if batch.num_rows:
                values = np.empty((batch.num_rows, len(columns)))
                for c, place in enumerate(places):
                    values[:, c] = self._floats(self._array(batch, place))
                if self._time is None:
                    yield Block(at_rate(self._rate, row, batch.num_rows), values)
                else:
                    yield Block(self._stamps(self._array(batch, self._time), row), values)
                row += batch.num_rows
        if row != self._file.metadata.num_rows:  # past a wrong page header the library may end without a word
            raise RecordError(
                "pages of rows are missing, or damaged",
                where=self.path,
                expected=f"{self._file.metadata.num_rows} rows, as the file says of itself",
                got=row,
            )

    def extent(self, topic: str) -> Extent:
        """By reading the times."""
        return extent_of(self.blocks(topic, []))

    def _require_bounded(self) -> None:
        """Raise RecordError when a small file says that it unfolds to more than memory should be spent on."""
        told, size = self._file.metadata, Path(self.path).stat().st_size
        if told.num_columns > MOST_COLUMNS:
            raise RecordError(
                "the file has too many columns",
                where=self.path,
                expected=f"at most {MOST_COLUMNS}",
                got=told.num_columns,
            )
        chunks = [told.row_group(g).column(c) for g in range(told.num_row_groups) for c in range(told.num_columns)]
        largest = max((chunk.total_uncompressed_size for chunk in chunks), default=0)
        if told.num_rows > _FEW_ROWS + _ROWS_PER_BYTE * size or largest > _CHUNK + _EXPANSION * size:
            raise RecordError(
                f"the file unfolds to more than is read: {told.num_rows} rows, {largest} bytes in one column",
                where=self.path,
                expected="at most some hundred times its size",
                got=f"a file of {size} bytes",
            )

    def _array(self, batch: Any, place: int) -> Any:
        """The column of a batch that is this field, by its name and its place among equal names."""
        name = self._fields[place].name
        before = sum(field.name == name for field in self._fields[:place])
        array = batch.column([c for c, field in enumerate(batch.schema) if field.name == name][before])
        return array.dictionary_decode() if self._arrow.types.is_dictionary(array.type) else array

    def _time_place(self) -> int | None:
        """The column `time`, or else the only one whose name says time, that holds time stamps, or that pandas made of an
        index; None where there is none and a rate is known."""
        types, names = self._arrow.types, [str(field.name) for field in self._fields]
        named = [i for i, name in enumerate(names) if naming.time_column(name)]
        stamps = [
            i for i, field in enumerate(self._fields) if types.is_timestamp(field.type) or types.is_duration(field.type)
        ]
        exact = [i for i in named if naming.bare(names[i]).lower() == "time"]
        told = [i for i, name in enumerate(names) if self._told and self._told in (name, naming.bare(name))]
        # whole numbers would be those of the rows that were kept of a longer table
        index = [i for i, f in enumerate(self._fields) if _INDEX.fullmatch(names[i]) and types.is_floating(f.type)]
        for candidates in (told, exact, [i for i in named if i in stamps], named, stamps, index):
            if len(candidates) == 1:
                if candidates not in (told, exact):
                    what = "the index of the table" if candidates == index else f"column {names[candidates[0]]!r}"
                    self._assumed.append(f"the time is {what}")
                return candidates[0]
        if self._rate and not (told or named or stamps):
            self._assumed.append(counted(self._rate))
            return None
        raise RecordError(
            "there are several columns 'time'" if exact else "there is no column 'time'",
            where=self.path,
            expected="'time' in s",
            got=", ".join(names[:20]),
            remedy=UNTIMED,
        )

    def _time_unit(self, place: int) -> int:
        """ns in a unit of the time at this place. Raises RecordError when it is not known."""
        field, types = self._fields[place], self._arrow.types
        if types.is_timestamp(field.type):
            if field.type.tz is None:
                self._assumed.append("the time stamps name no zone: taken as UTC")
            return _PER_SECOND[field.type.unit]
        if types.is_duration(field.type):
            return _PER_SECOND[field.type.unit]
        if types.is_time(field.type):
            self._assumed.append("the clock times count from midnight")
            return _PER_SECOND[field.type.unit]
        if not (types.is_integer(field.type) or types.is_floating(field.type) or types.is_decimal(field.type)):
            raise RecordError(
                "the column of the time is no time", where=self.path, expected="numbers or stamps", got=str(field.type)
            )
        said = naming.time_column(str(field.name), known=True)
        unit = said.unit if said is not None and (field.metadata or {}).get(b"unit") is None else self._unit(field)
        self._counts, unit = True, self._told_unit or unit
        per = seconds.unit_ns("s" if unit == "1" else unit)
        if per is None:
            raise RecordError(
                "the unit of the time is not known", where=self.path, expected="s, ms ...", got=repr(unit)
            )
        if unit == "1":
            first = next(self._file.iter_batches(batch_size=_LOOKED_AT, columns=[field.name]), None)
            values = np.zeros(1) if first is None or not first.num_rows else self._floats(self._array(first, place))
            seconds.refuse_days(values.tolist(), self.path)
            value = float(values[0])
            if epoch := seconds.epoch_unit(value):
                self._assumed.append(f"the time has no unit: {value:.0f} is taken as {epoch[1]} since 1970")
                return epoch[0]
            if types.is_integer(field.type):
                self._assumed.append("the time has no unit: taken as s")
        return per

    def _columns(self) -> dict[str, int]:
        """The places of the columns of numbers by name; what is none goes into `left_out`."""
        types, found = self._arrow.types, list[int]()
        for place, field in enumerate(self._fields):
            kind = field.type.value_type if types.is_dictionary(field.type) else field.type
            if place == self._time:
                continue
            if types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind):
                found.append(place)
            else:
                self._left_out.append(f"column {field.name!r}: {str(kind)[:60]}, no numbers")
        names, told = naming.numbered([self._column(self._fields[place]).name for place in found])
        if told:
            self._assumed.append(told)
        return dict(zip(names, found, strict=True))

    def _texts(self, metadata: Mapping[bytes, bytes]) -> dict[str, str]:
        try:
            return {key.decode(): self._text(value) for key, value in metadata.items()}
        except UnicodeDecodeError as error:
            raise RecordError(
                "the file is damaged: a key of its metadata is no UTF-8", where=self.path, got=repr(error.object[:60])
            ) from error

    def _text(self, raw: bytes) -> str:
        try:
            return raw.decode()
        except UnicodeDecodeError:
            self._assumed.append("some metadata is no UTF-8: read as Windows-1252 (Western European)")
            return raw.decode("cp1252", "replace")

    def _column(self, field: Any) -> Column:
        """Its name and unit: as its metadata say, or its name."""
        if (field.metadata or {}).get(b"unit") is not None:
            return Column(str(field.name), self._unit(field))
        return naming.column(str(field.name), naming.arrays([str(other.name) for other in self._fields]))

    def _unit(self, field: Any) -> str:
        return self._text((field.metadata or {}).get(b"unit", b"1")) or "1"

    def _floats(self, array: Any) -> np.ndarray:
        double = array.cast(self._arrow.float64(), safe=False)  # a whole number beyond 2^53 is rounded
        return np.asarray(double.to_numpy(zero_copy_only=False), np.float64)

    def _stamps(self, array: Any, row: int) -> np.ndarray:
        types = self._arrow.types
        missing = np.asarray(array.is_null().to_numpy(zero_copy_only=False))
        if types.is_floating(array.type) or types.is_decimal(array.type):
            floats = self._floats(array)
            missing = missing | np.isnan(floats)
            t_ns = seconds.to_ns(floats, self._per)
        else:
            if types.is_time32(array.type):
                array = array.cast(self._arrow.int32())
            elif not types.is_integer(array.type):
                array = array.cast(self._arrow.int64())
            t_ns = seconds.whole_to_ns(np.asarray(array.fill_null(0).to_numpy(zero_copy_only=False)), self._per)
        t_ns = seconds.shifted(t_ns, self._origin)
        beyond = (t_ns == NO_TIME) & ~missing
        if beyond.any():
            i = int(np.argmax(beyond))
            raise RecordError(
                f"the time at row {row + i} is beyond what can be counted in ns (years 1678 to 2262)",
                where=self.path,
                got=str(array[i])[:60],
            )
        return np.where(missing, NO_TIME, t_ns)


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
            self._writer = self._parquet.ParquetWriter(
                self._path, self._schema, compression="zstd", write_page_checksum=True
            )
        if len(record):
            arrays = [seconds.from_ns(record.t_ns, self._origin), *record.values.T]
            self._writer.write_table(self._arrow.table([self._arrow.array(a) for a in arrays], schema=self._schema))

    def close(self, notes: Mapping[str, str]) -> None:
        """Write the index, with notes in the file's metadata, and close."""
        if self._writer is not None and self._writer.is_open:
            if notes:
                self._writer.add_key_value_metadata(notes)
            self._writer.close()
