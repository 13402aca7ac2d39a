"""Where the values of a study file stand, in words, and what is wrong with a name that should be there."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import SequenceMatcher, get_close_matches
from glob import has_magic
from itertools import islice
from pathlib import Path
from typing import Any

from fmucorrect import units
from fmucorrect.errors import SignalError

Location = tuple[str | int, ...]
"""The path of a value: table, row of an array of tables, keys; as ("channels", 1, "unit")."""

MOST_BYTES = 4 * 2**20
"""Bytes of a TOML file; the largest that were seen, mapping files of whole vehicles, have 30 000."""

DEEPEST = 16
"""Tables and arrays inside each other; a study has five."""

LONGEST_TEXT = 4096
"""Characters of one text: a path has no more."""

MOST_NAMES = 1000
"""Files beside a missing one among which a similar name is looked for."""

MOST_SCANNED = 16 * 2**20
"""Characters that are parsed to find lines: a value over several lines is parsed again at each of them."""

Places = Mapping[Location, str]
"""Where each value stands, in words: `line 16, [[channels]] 2 "FB", key unit`."""


def nearest(name: str, known: Iterable[str]) -> str:
    """`; did you mean ...?` with the nearest name, and up to two that are as near, or nothing."""
    spelled = {k: k for k in known}
    if not (close := get_close_matches(name, spelled)):
        name, spelled = name.casefold(), {k.casefold(): k for k in spelled}
        close = get_close_matches(name, spelled)
    ratios = {candidate: SequenceMatcher(None, candidate, name).ratio() for candidate in close}
    close = [repr(spelled[candidate]) for candidate in close if ratios[candidate] > max(ratios.values()) - 0.05]
    return f"; did you mean {' or '.join(close)}?" if close else ""


def by_line(problems: Iterable[str]) -> list[str]:
    """Problems that begin with `line N`, in the order of the file."""
    return sorted(problems, key=lambda problem: int(problem[5:].split(",")[0].split(":")[0]))


def place(places: Places, loc: Location) -> str:
    """The place of a value, or the place of the table that it is missing from and the key."""
    known = next(loc[:n] for n in range(len(loc), -1, -1) if loc[:n] in places)
    rest = ".".join(str(key) for key in loc[len(known) :])
    return f"{places[known]}, key {rest}" if rest else places[known]


def parse_toml(data: bytes) -> tuple[str, dict[str, Any], list[str]]:
    """The text of a TOML file, its content, and what is wrong, with its line, where it is none or holds impossible values."""
    if len(data) > MOST_BYTES:
        return "", {}, [f"line 1: the file has {len(data)} bytes, expected {MOST_BYTES} at most"]
    try:
        text = data.decode("utf-8-sig").replace("\r\n", "\n")
        document = tomllib.loads(text)
        found = list(_impossible(document))
        places = scan(text, document) if found else {}
        return text, document, [f"{place(places, loc)}: {what}" for loc, what in found]
    except RecursionError:
        return "", {}, ["line 1: the file is nested too deeply to be read"]
    except UnicodeDecodeError as error:
        return "", {}, [f"line {len(data[: error.start].splitlines()) or 1}: is not UTF-8 text"]
    except tomllib.TOMLDecodeError as error:
        what, _, at = str(error).partition(" (at ")
        line = at.split(",")[0] if at.startswith("line") else f"line {len(data.splitlines())}"
        return "", {}, [f"{line}: is not TOML: {what}"]
    except ValueError as error:  # a number of thousands of digits
        return "", {}, [f"line 1: is not TOML: {error}"]


def _impossible(document: Mapping[str, Any]) -> Iterator[tuple[Location, str]]:
    """Values that nothing here can take, whatever the key: so the checks that follow need not expect them."""
    waiting: list[tuple[Location, Any]] = [((), document)]
    while waiting:
        loc, value = waiting.pop()
        if len(loc) > DEEPEST:
            yield loc[:1], f"is nested more than {DEEPEST} deep"
            return
        if isinstance(value, dict | list):
            inner = value.items() if isinstance(value, dict) else enumerate(value)
            waiting += [((*loc, key), below) for key, below in inner]
        names = [value, loc[-1]] if loc else [value]
        if any(isinstance(name, str) and "\0" in name for name in names):
            yield loc[:-1], "holds a character of code 0, which no name has"
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            yield loc, "is a whole number of more than 64 bits"
        if isinstance(value, str) and len(value) > LONGEST_TEXT:
            yield loc, f"is a text of {len(value)} characters, expected {LONGEST_TEXT} at most"


def missing_file(folder: Path, name: str, beside: str, record: bool = False) -> str | None:
    """What is wrong where `folder`, in which `beside` lies, has no such file, with the nearest name; None where it has.

    record: it may also be a folder with a recording, or a pattern of file names.
    """
    target = folder / name
    try:
        if target.is_file() or (record and _is_recording(target)):
            return None
        there = [file.name for file in islice(target.parent.iterdir(), MOST_NAMES)] if target.parent.is_dir() else []
    except OSError as error:  # a name too long, a folder that may not be read
        return f"{name!r} cannot be looked for: {error.strerror}"
    what = "is a folder, expected a file" if target.is_dir() else "is not there as a file"
    if target.exists():
        return f"{name!r} {what}"
    return f"there is no file {name!r} beside {beside}{nearest(target.name, there)}"


def _is_recording(path: Path) -> bool:
    return path.is_dir() or (has_magic(path.name) and any(path.parent.glob(path.name)))


def scan(text: str, document: Mapping[str, Any]) -> Places:
    """The places of a valid TOML text, which `document` is the content of.

    A table stands at its header, a key at the line where it begins; what is inside an inline value, at that line too. What
    stands behind values of thousands of lines, which take too long to be scanned, is left out.
    """
    places: dict[Location, str] = {(): "line 1"}
    budget = MOST_SCANNED
    counts: dict[str, int] = {}
    prefix: Location = ()
    statement, first = "", 0
    for number, line in enumerate(text.split("\n"), start=1):
        statement, first = (f"{statement}\n{line}", first) if statement else (line, number)
        budget -= len(statement)
        if budget < 0:
            break
        try:
            parsed = tomllib.loads(statement)
        except tomllib.TOMLDecodeError:
            continue  # goes on in the next line
        start, statement = statement.lstrip(), ""
        if start.startswith("["):
            keys = list(_header(parsed))
            if start.startswith("[[") and len(keys) == 1:
                counts[keys[0]] = counts.get(keys[0], -1) + 1
                places.setdefault((keys[0],), f"line {number}, [[{keys[0]}]]")
            row = (counts[keys[0]],) if keys[0] in counts else ()
            prefix = (keys[0], *row, *keys[1:])
            places.setdefault(prefix, f"line {number}, {_title(document, prefix)}")
        for path in _paths(parsed, ()) if not start.startswith("[") else ():
            places.setdefault((*prefix, *path), f"line {first}, {_title(document, (*prefix, *path))}")
    return places


def _header(parsed: Any) -> Iterator[str]:
    """The keys of `[a.b]` or `[[a.b]]`, parsed alone."""
    while parsed:
        if isinstance(parsed, list):
            parsed = parsed[0]
            continue
        key, parsed = next(iter(parsed.items()))
        yield key


def _paths(value: Any, prefix: Location) -> Iterator[Location]:
    rows = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in rows:
        yield (*prefix, key)
        yield from _paths(inner, (*prefix, key))


def _title(document: Mapping[str, Any], path: Location) -> str:
    """`[[channels]] 2 "FB", key unit` of a path."""
    table, keys = str(path[0]), path[1:]
    value = document[table]
    title = f"[{table}]" if isinstance(value, dict) else f"key {table}"
    if isinstance(value, list) and keys:
        number, *keys = keys
        row = value[int(number)]
        name = row.get("name") if isinstance(row, dict) else None
        title = f"[[{table}]] {int(number) + 1}" + (f' "{name}"' if isinstance(name, str) else "")
    return f"{title}, key {'.'.join(map(str, keys))}" if keys else title


def misfit(
    kind: str,
    name: str,
    there: Mapping[str, str],
    known: Sequence[str],
    defined: Mapping[str, units.Unit] = units.NONE,
) -> tuple[str, str] | None:
    """What is wrong with a name that should be `there`, in two parts with the place between them; None when nothing.

    defined: units of the FMU's own.
    """
    if name not in there:
        hint = nearest(name, there) or (f"; there are {', '.join(map(repr, there))}" if len(there) <= 20 else "")
        return f"there is no {kind} {name!r}", hint
    if known and not any(like(there[name], unit, defined) for unit in known):
        expected = f", expected one like {' or '.join(map(repr, known))}"
        if there[name] in ("", "1"):
            return f"{kind} {name!r} has no unit", expected
        try:
            units.explained(there[name], f"{kind} {name!r}", defined)
        except SignalError as error:
            return str(error), expected
        return f"{kind} {name!r} has unit {there[name]!r}", expected
    return None


def like(unit: str, other: str, defined: Mapping[str, units.Unit] = units.NONE) -> bool:
    """Whether values in one unit can be converted to the other; False when a unit is not known."""
    try:
        units.convert(unit, other, "", defined)
    except SignalError:
        return False
    return True
