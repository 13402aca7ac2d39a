"""Record files: MCAP, CSV, Parquet, MDF, TDMS and MATLAB, chosen by the file's suffix.

    record = read("measured_385.mcap", ["lvdt_FW", "lvdt_FB"])
    for chunk in stream("simulated_385.mcap", topic="/simulation"): ...
    with writer("corrected.mcap") as file:
        file.write("/corrected", chunk)

A column is named `topic.field.subfield`. The topic's leading slash goes, its inner slashes stay or may be written as
dots; entries of lists are `field[i]`. A name matches in full, or as the end (after a dot) of the full name of one
column only. Stamps that repeat or go back, and NaN, are errors that say where, unless a repair rule of
`fmucorrect.records.timebase` was chosen. What a file's metadata gives is in `Record.metadata`, with `path`, `topic`
and, for a file that was cut off, `truncated` = "true". What a damaged file lost stands in words in `damage`, what a
repair rule changed in `repaired`; both are written on into files made from the record. What was taken to be so without
the file saying it (a zone, a unit, an encoding) stands in `assumed`. Formats whose library can die, hang or fill the
memory on a damaged file (Parquet, MDF, MATLAB) are read in a process of their own, `fmucorrect.records.child`.
A path may be a folder (a bag of ROS 2, or MCAP files) or a pattern as `runs/*.mcap`: its files are one record.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import _lru_cache_wrapper, lru_cache  # pyright: ignore[reportPrivateUsage]
from os import PathLike, fspath
from pathlib import Path
from typing import TypeVar

from fmucorrect.errors import RecordError
from fmucorrect.records import assemble, naming
from fmucorrect.records.columns import find, has, with_units
from fmucorrect.records.contents import Contents, Topic, TopicContents
from fmucorrect.records.guarded import Guarded, damaged
from fmucorrect.records.naming import field_names
from fmucorrect.records.parts import PartsSource, is_recording, parts_of, refuse
from fmucorrect.records.source import Sink, counted
from fmucorrect.records.writing import Writer
from fmucorrect.signals import AS_IT_IS, TOLD, Reading, Record
from fmucorrect.unchanged import state

SUFFIXES = (".mcap", ".csv", ".parquet", ".mf4", ".mdf", ".tdms", ".mat")
"""The suffixes of files that can be read and written."""

GROWING = (".mcap", ".csv", ".tdms")
"""Those of files whose finished rows can be read while they are written; the others are files only at their end."""

TEXT = (".txt", ".tsv", ".asc", ".tab", ".prn", ".csv.gz", ".txt.gz", ".tsv.gz", ".asc.gz", ".tab.gz")
"""Those of files that are read as CSV is; none is written."""

READ = (*SUFFIXES, *TEXT, ".lvm", ".h5", ".hdf5", ".hdf", ".nc", ".uff", ".unv", ".58", ".tdm")
"""The suffixes of files that can be read."""

__all__ = [
    "GROWING",
    "READ",
    "SUFFIXES",
    "damaged",
    "describe",
    "field_names",
    "find",
    "has",
    "is_recording",
    "read",
    "rewrite",
    "stream",
    "suffix_of",
    "topics",
    "unused",
    "writer",
]


def read(
    path: str | PathLike[str],
    columns: Sequence[str] | None = None,
    *,
    topic: str | None = None,
    repair: str | Sequence[str] | None = None,
    reading: Reading = AS_IT_IS,
    allow_damaged: bool = True,
) -> Record:
    """The whole file, or these columns of it, as one record whose channels have the requested names.

    columns: names in the order wanted; None: all numeric columns of the only topic (or of `topic`). Columns from
    several topics are joined when their stamps agree, or by the repair rule `interpolate`. repair: rules by name, as
    "sort,drop" or ("sort", "drop"), applied in that order, by default those of `reading`. reading: what is known of the
    file beside what it says. allow_damaged: whether a file that lost something is read
    (and says so in its metadata) or refused. Raises RecordError, with place and remedy.
    """
    source = _source(path, reading)
    try:
        record = assemble.whole(source, columns, topic, repair, reading)
        if not allow_damaged:
            source.require_whole()
        return record
    finally:
        source.close()


def stream(
    path: str | PathLike[str],
    columns: Sequence[str] | None = None,
    *,
    topic: str | None = None,
    repair: str | Sequence[str] | None = None,
    reading: Reading = AS_IT_IS,
    rows: int = 4096,
    allow_damaged: bool = True,
    step_ns: int | None = None,
) -> Iterator[Record]:
    """The same in chunks of at most `rows` rows, which joined equal `read`. Errors come when their row is reached. step_ns:
    the sample time for which the repair rule `resample` makes its grid, where the record's own nearly is that, or a part.

    A chunk's metadata holds the damage that is known when it is read, the last one's all of it. With `allow_damaged` off
    no chunk comes from behind a damage.

    Memory does not grow with the file for MCAP (chunk by chunk), CSV (block of lines), Parquet (batch) and TDMS
    (slices). MDF4 and .mat files are read whole, and so is any file with a repair rule other than `drop`.
    """
    if rows < 1:
        raise RecordError("a chunk has at least one row", where=fspath(path), got=rows)
    source = _source(path, reading)
    try:
        for chunk in assemble.chunks(source, columns, topic, repair, reading, rows, step_ns):
            if not allow_damaged:
                source.require_whole()
            yield chunk
        if not allow_damaged:
            source.require_whole()
    finally:
        source.close()


def writer(path: str | PathLike[str], *, becomes: str | PathLike[str] | None = None) -> Writer:
    """A file to write records to, over what may be there. To be used as a context manager.

    becomes: the name that the file will have, or that of the file that `rewrite` will make of it, for messages.

    MCAP takes several topics, the others one. A killed process leaves every finished `write` readable in MCAP, CSV and
    TDMS (GROWING); Parquet, MDF4 and .mat files are complete only once closed (the last two are held in memory until
    then): what must not be lost goes into CSV first, and through `rewrite`. A format other than MCAP makes no file when
    nothing is written.
    """
    name = fspath(path if becomes is None else becomes)
    suffix = _suffix(path, SUFFIXES)
    if _suffix(name, SUFFIXES) != suffix:
        _sink(_suffix(name, SUFFIXES), name)  # says now, and not at the end, that a library is missing
    try:
        return Writer(_sink(suffix, fspath(path)), name, topics=suffix == ".mcap")
    except OSError as error:
        raise RecordError(f"the file cannot be written: {error.strerror}", where=name) from error


def rewrite(
    rows: str | PathLike[str],
    path: str | PathLike[str],
    topic: str,
    like: Record,
    notes: Mapping[str, str],
    *,
    becomes: str | PathLike[str],
) -> None:
    """Write `path` with the rows of a CSV file that `writer` wrote, and the channels and metadata of `like`.

    notes: as in `Writer.close`. becomes: as in `writer`. Raises RecordError.
    """
    from fmucorrect.records.csv import written

    with writer(path, becomes=becomes) as file:
        for block in written(fspath(rows)):
            file.write(topic, replace(like, t_ns=block.t_ns, values=block.values))
        file.close(notes)


def topics(path: str | PathLike[str], reading: Reading = AS_IT_IS) -> tuple[Topic, ...]:
    """The topics of a file with their columns; unlike `describe` it does not look for their rows."""
    return with_units(_known(_topics, path, reading), reading)


def describe(path: str | PathLike[str], reading: Reading = AS_IT_IS) -> Contents:
    """What is in the file: topics, columns with units, rows, time range, encoding, and whether it was cut off."""
    seen = _known(_contents, path, reading)
    known = with_units([item.topic for item in seen.topics], reading)
    topics = tuple(replace(item, topic=topic) for item, topic in zip(seen.topics, known, strict=True))
    return replace(seen, topics=topics, left_out=(*seen.left_out, *_unused(seen, reading)))


def unused(path: str | PathLike[str], reading: Reading) -> tuple[str, ...]:
    """What of `reading` the file has no use for, in words."""
    return tuple(_unused(_known(_contents, path, reading), reading))


def _unused(seen: Contents, reading: Reading) -> Iterator[str]:
    topics = [item.topic for item in seen.topics]
    if reading.rate and not any(counted(reading.rate) in topic.metadata.get("assumed", "") for topic in topics):
        yield f"rate = {reading.rate:.10g}: the file has a time of its own"
    if reading.time and not any(is_time(topic, reading.time) for topic in topics):
        theirs = ", ".join(dict.fromkeys(repr(topic.time) for topic in topics if topic.time))
        yield f"time = {reading.time!r}: there is no such column; the time is {theirs or 'that of the log'}"
    if reading.time_unit and not any(topic.counts for topic in topics):
        yield f"time_unit = {reading.time_unit!r}: it has stamps, or a time of the log's own"
    for key, kinds in (("delimiter", ("CSV",)), ("decimal", ("CSV",)), ("encoding", ("CSV", "LabVIEW"))):
        if (value := getattr(reading, key)) and not any(kind in seen.format for kind in kinds):
            yield f"{key} = {value!r}: that is of text files, and this one is {seen.format}"


Seen = TypeVar("Seen")
_Told = tuple[str | float, ...]
"""The values of signals.TOLD."""


@lru_cache(maxsize=256)
def _topics(name: str, now: tuple[int, ...], told: _Told) -> tuple[Topic, ...]:
    source = _source(name, replace(AS_IT_IS, **dict(zip(TOLD, told, strict=True))))
    try:
        return source.topics()
    finally:
        source.close()


@lru_cache(maxsize=256)
def _contents(name: str, now: tuple[int, ...], told: _Told) -> Contents:
    source = _source(name, replace(AS_IT_IS, **dict(zip(TOLD, told, strict=True))))
    try:
        topics = tuple(TopicContents(topic, source.extent(topic.name)) for topic in source.topics())
        return Contents(source.path, source.format, topics, source.truncated, source.damage, source.left_out)
    finally:
        source.close()


def _known(look: _lru_cache_wrapper[Seen], path: str | PathLike[str], reading: Reading) -> Seen:
    """What a look at a file tells. It may take a process, or all rows: a file that has not changed since the last one is not
    looked at again."""
    name = fspath(path)
    told = tuple(getattr(reading, key) for key in TOLD)
    now = None if Path(name).suffix.lower() in (".tdm", ".tdms") else state(Path(name))  # those are several files
    return look.__wrapped__(name, (), told) if now is None else look(name, now, told)


def is_time(topic: Topic, name: str) -> bool:
    """Whether the time of a topic is the column of this name, which may have its unit behind it."""
    own = naming.time_column(name, known=True)
    return own is not None and topic.time in (name, own.name)


def suffix_of(path: str | PathLike[str]) -> str:
    """The suffix that tells the format, as `.csv` or `.csv.gz`, in small letters."""
    suffixes = Path(path).suffixes[-2:]
    return "".join(suffixes if suffixes[-1:] == [".gz"] else suffixes[-1:]).lower()


def _suffix(path: str | PathLike[str], known: Sequence[str]) -> str:
    suffix = suffix_of(path)
    if suffix not in known:
        raise RecordError(
            "the file's format is not known",
            where=fspath(path),
            expected=f"one of {', '.join(known)}",
            got=repr(suffix),
        )
    return suffix


def _source(path: str | PathLike[str], reading: Reading) -> Guarded:
    name = fspath(path)
    if is_recording(Path(path)):
        files, missing = parts_of(Path(path))
        return Guarded(name, lambda path: PartsSource(path, files, missing, lambda part: _source(part, reading)))
    refuse(Path(path).parent, [Path(path).name])
    suffix = _suffix(path, READ)
    if not Path(path).is_file():
        raise RecordError("there is no such file", where=name)
    if suffix == ".mcap":
        from fmucorrect.records.mcap import McapSource
        from fmucorrect.records.stamped import StampedMcap

        return Guarded(
            name, lambda path: StampedMcap(path, reading.time, reading.time_unit) if reading.time else McapSource(path)
        )
    if suffix == ".csv" or suffix in TEXT:
        from fmucorrect.records.csv import CsvSource as Opened
    elif suffix == ".parquet":
        from fmucorrect.records.parquet import opened as Opened
    elif suffix in (".mf4", ".mdf"):
        from fmucorrect.records.mdf4 import opened as Opened
    elif suffix == ".tdms":
        from fmucorrect.records.tdms import TdmsSource as Opened
    elif suffix == ".lvm":
        from fmucorrect.records.lvm import LvmSource as Opened
    elif suffix in (".h5", ".hdf5", ".hdf", ".nc"):
        from fmucorrect.records.hdf5 import opened as Opened
    elif suffix in (".uff", ".unv", ".58"):
        from fmucorrect.records.uff import opened as Opened
    elif suffix == ".tdm":
        from fmucorrect.records.tdm import opened as Opened
    else:
        from fmucorrect.records.mat import opened as Opened
    return Guarded(name, lambda path: Opened(path, reading))


def _sink(suffix: str, name: str) -> Sink:
    if suffix == ".mcap":
        from fmucorrect.records.mcap_writer import McapSink as Opened
    elif suffix == ".csv":
        from fmucorrect.records.csv import CsvSink as Opened
    elif suffix == ".parquet":
        from fmucorrect.records.parquet import ParquetSink as Opened
    elif suffix in (".mf4", ".mdf"):
        from fmucorrect.records.mdf4 import Mdf4Sink as Opened
    elif suffix == ".tdms":
        from fmucorrect.records.tdms import TdmsSink as Opened
    else:
        from fmucorrect.records.mat import MatSink as Opened
    return Opened(name)
