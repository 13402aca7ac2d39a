"""Where the values of a study file stand, in words, and what is wrong with a name that should be there."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import SequenceMatcher, get_close_matches
from glob import has_magic
from itertools import islice, takewhile
from pathlib import Path
from typing import Any

from fmucorrect import units
from fmucorrect.errors import SignalError

Location = tuple[str | int, ...]
"""The path of a value: table, row of an array of tables, keys; as ("channels", 1, "unit")."""

DEEPEST = 16
"""Tables and arrays inside each other; a study has five."""

MOST_NAMES = 1000
"""Files beside a missing one among which a similar name is looked for."""

MOST_PLACES = 2**17
"""Keys and entries of arrays whose lines are kept: a file of the largest size may have millions."""

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
    """The place of a value, or the place of the table that it is missing from and the key; of what no file says, the keys."""
    known = next((loc[:n] for n in range(len(loc), -1, -1) if loc[:n] in places), None)
    if known is None:
        return ".".join(str(key) for key in loc)
    rest = ".".join(str(key) for key in loc[len(known) :])
    mark = "." if ", key " in places[known] else ", key "
    return f"{places[known]}{mark}{rest}" if rest else places[known]


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

    A table stands at its header, a key where it begins, an entry of an array at its own line. What is nested too deeply, or
    stands behind so many values that nobody wrote them by hand, is left out.
    """
    places: dict[Location, str] = {(): "line 1"}
    for path, line in islice(positions(tokens(text)), MOST_PLACES):
        for n in range(1, len(path) + 1):
            if path[:n] not in places:
                places[path[:n]] = f"line {line}, {_title(document, path[:n])}"
    return places


_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}'
    r"|\'{3}.*?\'{3,5}"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'"
    r"|#[^\n]*|[\[\]{},=\n\"']|[^\s\[\]{},=\"'#]+",
    re.DOTALL,
)
"""Strings, comments, marks and line ends, and what stands bare between them."""

Tokens = Iterator[tuple[str, int]]
"""Each with its line."""


def tokens(text: str) -> Tokens:
    """What a TOML text consists of, without its comments; a quotation mark by itself begins a string that has no end."""
    line = 1
    for match in _TOKEN.finditer(text):
        if not match[0].startswith("#"):
            yield match[0], line
        line += match[0].count("\n")


def positions(tokens: Tokens, path: Location = (), opened: str = "") -> Iterator[tuple[Location, int]]:
    """Headers, keys and entries of arrays, each with the line where it begins, inside of what `opened` begins: an array, a
    table in braces, the file (""), or another value, inside of which there is nothing."""
    rows: dict[Location, int] = {}
    key, first, index, fresh = "", 0, 0, True
    for token, line in tokens if opened in ("", "[", "{") else ():
        if (opened, token) in (("[", "]"), ("{", "}")):
            return
        if token in ("\n", ","):
            key, index, fresh = "", index + (token == ","), fresh or token == ","
        elif opened == "[":
            if fresh:  # a date and a time are two tokens
                fresh = False
                if len(path) < DEEPEST:
                    yield (*path, index), line
                yield from positions(tokens, (*path, index), token)
        elif token == "=":
            inner = (*path, *_keys(key))
            if len(inner) <= DEEPEST:
                yield inner, first
            yield from positions(tokens, inner, next(tokens)[0])
        elif token == "[" and not key:
            path = _header(tokens, rows)
            yield path, line
        else:
            key, first = key + token, first if key else line


def _header(tokens: Tokens, rows: dict[Location, int]) -> Location:
    """The table that a header, of which "[" is read, begins. rows: the last row of each array of tables so far."""
    name = "".join(token for token, _ in takewhile(lambda item: item[0] != "]", tokens))
    *above, last = _keys(name.removeprefix("["))
    path: Location = ()
    for key in above:
        path = (*path, key)
        path = (*path, rows[path]) if path in rows else path
    path = (*path, last)
    if name.startswith("["):
        rows[path] = rows.get(path, -1) + 1
        return (*path, rows[path])
    return path


def _keys(text: str) -> list[str]:
    """The keys of a dotted one."""
    if not {'"', "'"} & {*text}:
        return text.split(".")
    keys: list[str] = []
    inner: Any = tomllib.loads(f"{text} = 0")
    while inner:
        key, inner = next(iter(inner.items()))
        keys.append(key)
    return keys


def _title(document: Any, path: Location) -> str:
    """`[[channels]] 2 "FB", key unit` of a path, or `[preload], supports 2 "left", key upper`."""
    words: list[str] = []
    keys: list[str] = []
    inner = document
    for n, key in enumerate(path):
        value = inner = inner[key]
        if isinstance(key, int) and (n == 1 or isinstance(value, dict)):
            name = value.get("name") if isinstance(value, dict) else None
            row = f"{'.'.join(keys)} {key + 1}" if n > 1 else f"[[{path[0]}]] {key + 1}"
            words = [*(words if n > 1 else []), row + (f' "{name}"' if isinstance(name, str) else "")]
            keys = []
        elif n == 0 and isinstance(value, dict):
            words = [f"[{key}]"]
        elif n == 0 and isinstance(value, list) and value and isinstance(value[0], dict):
            words = [f"[[{key}]]"]
        else:
            keys.append(str(key))
    return ", ".join([*words, *([f"key {'.'.join(keys)}"] if keys else [])])


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
        if there[name] in units.UNSAID:
            return f"{kind} {name!r} has no unit", expected
        try:
            units.explained(there[name], f"{kind} {name!r}", defined)
        except SignalError:
            return f"{kind} {name!r} has unit {there[name]!r}, which is not known,", expected
        return f"{kind} {name!r} has unit {there[name]!r}", expected
    return None


def units_misfits(
    given: Mapping[str, str], there: Mapping[str, str], defined: Mapping[str, units.Unit] = units.NONE
) -> dict[str, str]:
    """What is wrong, by variable, with units that a file gives to variables which the FMU leaves without one.

    there: unit by variable of the FMU. defined: units of the FMU's own.
    """
    found: dict[str, str] = {}
    for name, unit in given.items():
        if name not in there:
            found[name] = f"there is no variable {name!r} in the FMU{nearest(name, there)}"
        elif there[name] not in units.UNSAID | {unit}:
            found[name] = f"{name!r} is in {there[name]!r}, as the FMU says itself, not in {unit!r}"
        elif unit not in defined and (text := unknown_unit(unit)):
            found[name] = f"{text} The FMU declares none of that name."
    return found


def unknown_unit(text: str) -> str:
    """Why nobody but an FMU can know this unit; "" for one that is known."""
    try:
        units.parse(text)
    except SignalError as error:
        return str(error)
    return ""


def like(unit: str, other: str, defined: Mapping[str, units.Unit] = units.NONE) -> bool:
    """Whether values in one unit can be converted to the other; False when a unit is not known."""
    try:
        units.convert(unit, other, "", defined)
    except SignalError:
        return False
    return True
