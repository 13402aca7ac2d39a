"""Where the values of a study file stand, in words, and what is wrong with a name that should be there."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import SequenceMatcher, get_close_matches
from typing import Any

from fmucorrect import units
from fmucorrect.errors import SignalError

Location = tuple[str | int, ...]
"""The path of a value: table, row of an array of tables, keys; as ("channels", 1, "unit")."""

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
    """The text of a TOML file, its content, and, where it is none, what is wrong with its line."""
    try:
        text = data.decode("utf-8-sig").replace("\r\n", "\n")
        return text, tomllib.loads(text), []
    except UnicodeDecodeError as error:
        return "", {}, [f"line {len(data[: error.start].splitlines()) or 1}: is not UTF-8 text"]
    except tomllib.TOMLDecodeError as error:
        what, _, at = str(error).partition(" (at ")
        line = at.split(",")[0] if at.startswith("line") else f"line {len(data.splitlines())}"
        return "", {}, [f"{line}: is not TOML: {what}"]


def scan(text: str, document: Mapping[str, Any]) -> Places:
    """The places of a valid TOML text, which `document` is the content of.

    A table stands at its header, a key at the line where it begins; what is inside an inline value, at that line too.
    """
    places: dict[Location, str] = {(): "line 1"}
    counts: dict[str, int] = {}
    prefix: Location = ()
    statement, first = "", 0
    for number, line in enumerate(text.split("\n"), start=1):
        statement, first = (f"{statement}\n{line}", first) if statement else (line, number)
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


def misfit(kind: str, name: str, there: Mapping[str, str], known: Sequence[str]) -> tuple[str, str] | None:
    """What is wrong with a name that should be `there`, in two parts with the place between them; None when nothing."""
    if name not in there:
        hint = nearest(name, there) or (f"; there are {', '.join(map(repr, there))}" if len(there) <= 20 else "")
        return f"there is no {kind} {name!r}", hint
    if known and not any(like(there[name], unit) for unit in known):
        text = f"has unit {there[name]!r}" if there[name] not in ("", "1") else "has no unit"
        return f"{kind} {name!r} {text}", f", expected one like {' or '.join(map(repr, known))}"
    return None


def like(unit: str, other: str) -> bool:
    """Whether values in one unit can be converted to the other; False when a unit is not known."""
    try:
        units.conversion(unit, other, "")
    except SignalError:
        return False
    return True
