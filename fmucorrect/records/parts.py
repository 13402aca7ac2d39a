"""A recording split over several files: a folder of rosbag2, a folder of MCAP files, or a pattern as `runs/*.mcap`.

The files are read one after another, in the order of their first stamps, so that memory does not grow with their number.
Where two of them overlap, time goes back, and the reader says so as it does within a file. What each holds, gaps between
them, and files that are missing are told.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from glob import has_magic
from itertools import pairwise
from pathlib import Path

from fmucorrect.errors import RecordError
from fmucorrect.records.contents import Extent, Topic
from fmucorrect.records.named import ENTRIES
from fmucorrect.records.source import NO_TIME, Block, Source

MOST_PARTS = 200
"""Files of one recording: each is held open by up to four streams, and a process may have 1024."""

GAP = 10
"""How many times the mean distance of a part's stamps may lie between two parts before it is told as a gap."""

_DIFFER = "its columns differ between the files"
_METADATA = "metadata.yaml"
_NUMBER = re.compile(r"(\d+)")


def _columns(topic: Topic) -> list[str]:
    """Columns with their units, and what names the entries of lists."""
    named = [f"{key} {text}" for key, text in topic.metadata.items() if key.startswith(ENTRIES)]
    return [*(f"{c.name} [{c.unit}]" for c in topic.columns), *named]


def is_recording(path: Path) -> bool:
    """Whether the path stands for several files, by a pattern in its last part, or for a folder of them."""
    return path.is_dir() or (has_magic(path.name) and not path.exists())


def parts_of(path: Path) -> tuple[list[Path], list[str]]:
    """The files of a recording in the order of their names, and what is missing of it, in words.

    Raises RecordError for a recording of a kind that is not read, with the way out.
    """
    if not path.is_dir():
        found = [file for file in path.parent.glob(path.name) if file.is_file()]
        return _some(path, _in_order(found)), _unnumbered(found)
    if (path / _METADATA).is_file():
        return _of_rosbag2(path)
    files = list(path.iterdir())
    refuse(path, [file.name for file in files])
    found = [file for file in files if file.suffix.lower() == ".mcap"]
    return _some(path, _in_order(found)), _unnumbered(found)


def _some(path: Path, files: list[Path]) -> list[Path]:
    if not files:
        what = "a folder of MCAP files or a bag of ROS 2" if path.is_dir() else "a file that the pattern fits"
        raise RecordError("there is no record file in it", where=str(path), expected=what)
    if len(files) > MOST_PARTS:
        raise RecordError(
            f"the recording has {len(files)} files", where=str(path), expected=f"at most {MOST_PARTS}",
            remedy="Name fewer by a pattern, or join them with `mcap merge`.",
        )  # fmt: skip
    return files


def _of_rosbag2(folder: Path) -> tuple[list[Path], list[str]]:
    """By metadata.yaml. It is written by one program in one form, of which three keys matter: no YAML reader is needed."""
    text = (folder / _METADATA).read_text("utf-8", errors="replace")[: 2**24]
    value = {key: words.strip("\"'") for key, words in re.findall(r"^ +(\w+): *(\S+) *$", text, re.MULTILINE)}
    listed = re.search(r"^( *)relative_file_paths: *\n((?:\1 *- .*\n?)+)", text, re.MULTILINE)
    names = [line.split("- ", 1)[1].strip().strip("\"'") for line in listed[2].splitlines()] if listed else []
    refuse(folder, names, value.get("storage_identifier", ""))
    if value.get("compression_mode", "").lower() == "message":
        raise RecordError(
            "each message of this bag is compressed by itself, which is not read",
            where=str(folder),
            remedy="Convert it with `ros2 bag convert` to storage mcap without compression_mode, or with file compression.",
        )
    # the names are those of the folder in which the bag was written; a bag may have been moved
    files = [folder / Path(name).name for name in names]
    missing = [f"{file.name}, which {_METADATA} lists, is missing" for file in files if not file.is_file()]
    there = [file for file in files if file.is_file()]
    return _some(folder, there), missing


def refuse(folder: Path, names: Sequence[str], storage: str = "") -> None:
    """Raise RecordError for bags in SQLite and files that are packed as a whole."""
    if storage == "sqlite3" or (not storage and any(name.endswith(".db3") for name in names)):
        raise RecordError(
            "this bag of ROS 2 is an SQLite database, which is not read",
            where=str(folder),
            remedy="Convert it: write `output_bags: [{uri: converted, storage_id: mcap, all_topics: true}]` into out.yaml, "
            f"then `ros2 bag convert -i {folder} -o out.yaml`.",
        )
    packed = [name for name in names if name.endswith((".mcap.zstd", ".mcap.zst", ".mcap.lz4"))]
    if packed:
        raise RecordError(
            f"{packed[0]} is packed as a whole, so nothing of it can be read before it is unpacked",
            where=str(folder),
            remedy=f"Unpack it (`{'lz4' if packed[0].endswith('lz4') else 'zstd'} -d {packed[0]}`) and name the .mcap file, "
            "or a pattern as *.mcap.",
        )


def _in_order(files: Sequence[Path]) -> list[Path]:
    """By name, numbers by their size: run_2 before run_10."""
    return sorted(files, key=lambda file: [int(w) if w.isdigit() else w for w in _NUMBER.split(file.name)])


def _unnumbered(files: Sequence[Path]) -> list[str]:
    """Numbers that are left out between files whose names differ in one number only."""
    split = [_NUMBER.split(file.name) for file in files]
    if len(split) < 3 or len({len(words) for words in split}) != 1:
        return []
    differing = [i for i in range(len(split[0])) if len({words[i] for words in split}) > 1]
    if len(differing) != 1 or differing[0] % 2 == 0:
        return []
    numbers = sorted(int(words[differing[0]]) for words in split)
    gaps = [f"{a + 1}" if b == a + 2 else f"{a + 1} to {b - 1}" for a, b in pairwise(numbers) if b > a + 1]
    return [f"no file has number {', '.join(gaps)}"] if gaps and len(gaps) < len(numbers) / 2 else []


class PartsSource:
    """The files of a recording as one source. A topic is joined from the files that have it, with equal columns."""

    def __init__(
        self, path: str, files: Sequence[Path], missing: Sequence[str], opened: Callable[[Path], Source]
    ) -> None:
        self.path = path
        self._missing = tuple(missing)
        self._parts: list[tuple[str, Source]] = []
        self._extents: dict[tuple[str, int], Extent] = {}
        try:
            for file in files:
                self._parts.append((file.name, opened(file)))
        except BaseException:
            self.close()
            raise
        kinds = dict.fromkeys(source.format for _, source in self._parts)
        self.format = f"{' and '.join(kinds)}, {len(self._parts)} file{'s' if len(self._parts) > 1 else ''}"
        self._topics: tuple[Topic, ...] | None = None
        self._order: dict[str, list[int]] = {}

    def close(self) -> None:
        """Release the files."""
        for _, source in self._parts:
            source.close()

    @property
    def truncated(self) -> bool:
        """Whether one of the files was cut off."""
        return any(source.truncated for _, source in self._parts)

    @property
    def damage(self) -> str:
        """What is lost in each file, and which files are missing."""
        each = [f"{name}: {lost}" for name, source in self._parts if (lost := source.damage)]
        return "; ".join([*self._missing, *each])

    @property
    def left_out(self) -> tuple[str, ...]:
        """What each file does not offer, said once where all say the same, and topics whose columns differ."""
        files: dict[str, list[str]] = {}
        for name, source in self._parts:
            for told in source.left_out:
                files.setdefault(told, []).append(name)
        every = len(self._parts)
        told = [one if len(names) == every else f"{', '.join(names)}: {one}" for one, names in files.items()]
        differing = [f"topic {topic.name}: {topic.note}" for topic in self.topics() if topic.note.startswith(_DIFFER)]
        return (*told, *differing)

    def topics(self) -> tuple[Topic, ...]:
        """The topics of all files, in the order in which they are met."""
        if self._topics is None:
            holding: dict[str, list[tuple[int, Topic]]] = {}
            for i, (_, source) in enumerate(self._parts):
                for topic in source.topics():
                    holding.setdefault(topic.name, []).append((i, topic))
            self._topics = tuple(self._joined(name, held) for name, held in holding.items())
        return self._topics

    def blocks(self, topic: str, columns: Sequence[str]) -> Iterator[Block]:
        """All rows of a topic, file by file."""
        self.topics()
        for i in self._order[topic]:
            yield from self._parts[i][1].blocks(topic, columns)

    def extent(self, topic: str) -> Extent:
        """Rows and time range of a topic, from those of its files."""
        self.topics()
        return Extent.together([self._extent(topic, i) for i in self._order[topic]])

    def _extent(self, topic: str, part: int) -> Extent:
        key = (topic, part)
        if key not in self._extents:
            self._extents[key] = self._parts[part][1].extent(topic)
        return self._extents[key]

    def _joined(self, name: str, held: Sequence[tuple[int, Topic]]) -> Topic:
        """The topic of these files, whose order is kept by their first stamps."""
        used = [(i, topic) for i, topic in held if topic.columns] or list(held)
        first, columns = used[0][1], {i: _columns(topic) for i, topic in used}
        started = [(self._first(i, name), i) for i in columns] if first.columns else [(0, i) for i in columns]
        self._order[name] = [i for _, i in sorted((start, i) for start, i in started if start is not None)]
        metadata = dict(first.metadata) | {"parts": self._told(name)}
        other = next((i for i, its in columns.items() if its != columns[used[0][0]]), None)
        if other is None:
            return Topic(name, first.columns, first.encoding, metadata, first.note, first.time, first.counts)
        each = [f"{self._parts[i][0]}: {', '.join(columns[i])}" for i in (used[0][0], other)]
        return Topic(name, (), first.encoding, metadata, f"{_DIFFER} ({'; '.join(each)})")

    def _first(self, part: int, topic: str) -> int | None:
        """The first stamp that a file has of a topic; None without rows."""
        for block in self._parts[part][1].blocks(topic, ()):
            good = block.t_ns[block.t_ns != NO_TIME]
            if len(good):
                return int(good[0])
        return None

    def _told(self, topic: str) -> str:
        """The files in their order, and gaps between them."""
        words: list[str] = []
        before: Extent | None = None
        for i in self._order[topic]:
            extent = self._extent(topic, i)
            gap = ""
            if before is not None and before.stop_ns is not None and before.start_ns is not None:
                step = (before.stop_ns - before.start_ns) / max(before.rows - 1, 1)
                distance = (extent.start_ns or 0) - before.stop_ns
                if distance > GAP * step:
                    gap = f" after a gap of {distance / 1e9:.6g} s"
                elif distance <= 0:
                    gap = f", {-distance / 1e9:.6g} s of it together with the one before"
            words.append(f"{self._parts[i][0]}{gap}")
            before = extent
        return "; ".join(words)
