"""A TOML table as a frozen dataclass, whose annotations say what each key may hold.

A field without a default must be there. Its type may be str, int, float, bool, Literal, a dataclass (a table), tuple (an
array), Mapping (a table of any keys), Any, or one of these | None. `Annotated` adds, in any order: limits (Gt, Ge, Le, Interval
and MinLen of annotated_types), a text that says what the value is, for whoever left it out, and functions that say what is
wrong with a value, "" for nothing. A float is finite unless Le(inf) is among its limits.

All that is wrong is found at once. A value that is wrong is blank in the dataclass ("", nan, (), {}), so that what must fit
between values can be checked beside it: such checks pass over blanks, and nothing else uses a dataclass with problems.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Interval, Le, MinLen

from fmucorrect.study_places import Location, Places, by_line, nearest, place, scan
from fmucorrect.toml_text import parse_toml
from fmucorrect.toml_value import toml

Text = Annotated[str, MinLen(1)]
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Sign = Literal[1, -1]

Problem = tuple[Location, str]
"""Where something stands, and what is wrong with it."""

Found = Iterator[Problem]

SHOWN = 200
"""Characters of a wrong value that are shown: an array may have thousands of entries."""

T = TypeVar("T")


def read(
    data: bytes, kind: type[T], misfits: Callable[[T, Places], Found], doubts: Callable[[T], Found] = lambda _: iter(())
) -> tuple[T, Places, list[str]]:
    """The table that a TOML file is, where its values stand, and all that is wrong, a line each, in the order of the file.

    misfits: what does not fit between the values of a table, some of which may be blank; left out where the
    value itself is wrong already. doubts: what may be wrong, which another file settles; told only beside something that
    is wrong, so that both are mended at once.
    """
    text, document, wrong = parse_toml(data)
    if wrong:
        return _blank(kind), {}, wrong
    places = scan(text, document)
    problems: list[Problem] = []
    table = _table(kind, document, (), problems)
    problems = _untold(misfits(table, places), problems) + problems
    if problems:
        problems += _untold(doubts(table), problems)
    return table, places, by_line(f"{place(places, loc)}: {what}" for loc, what in problems)


def _untold(found: Found, problems: list[Problem]) -> list[Problem]:
    """What was found where nothing is wrong already."""
    told = {loc for loc, _ in problems}
    return [(loc, what) for loc, what in found if not any(loc[:n] in told for n in range(1, len(loc) + 1))]


def named(table: str | Location, rows: Iterable[Any]) -> list[tuple[Location, str]]:
    """Place and name of each row of an array of tables."""
    loc = (table,) if isinstance(table, str) else table
    return [((*loc, i), row.name) for i, row in enumerate(rows)]


def repeated(rows: Iterable[tuple[Location, str]], places: Places) -> Found:
    """Names that are given twice."""
    seen: dict[str, Location] = {}
    for loc, name in rows:
        if name and seen.setdefault(name, loc) != loc:
            yield (*loc, "name"), f"{name!r} is taken by {place(places, seen[name])}; names must differ"


def unknown(key: str, known: Iterable[str]) -> str:
    """What is wrong with a key that a table with these does not have."""
    return f"is not known{nearest(key, known) or '; known here: ' + ', '.join(known)}"


def doubted(units: Iterable[Problem]) -> Found:
    """Units that are not known here, as `read` takes them for doubts."""
    yield from ((loc, f"{text} Leave it where the FMU declares it.") for loc, text in units)


def those(name: str, known: Iterable[str], what: str = "there are") -> str:
    """The nearest of the names that are there, or all of them."""
    some = [other for other in dict.fromkeys(known) if other]
    return nearest(name, some) or f"; {what} {', '.join(map(repr, some)) or 'none'}"


def _table(kind: type[T], table: Mapping[str, Any], loc: Location, problems: list[Problem]) -> T:
    """The dataclass that the table at `loc` says; what is wrong with it is added to `problems`."""
    before = len(problems)
    hints = _hints(kind)
    problems += [((*loc, key), unknown(key, hints)) for key in table if key not in hints]
    values: dict[str, Any] = {}
    for name, required in _required(kind).items():
        if name in table:
            values[name] = _value(hints[name], table[name], (*loc, name), problems)
        elif required:
            values[name] = _blank(hints[name])
            words = _words(_parts(hints[name])[1])
            problems.append(((*loc, name), f"is missing{words and ': '}{words}"))
    return kind(**values) if len(problems) == before else _partial(kind, values)


def _partial(kind: type[T], values: Mapping[str, Any]) -> T:
    """A dataclass with blanks, which its __init__ need not take."""
    table = object.__new__(kind)
    for item in fields(cast(Any, kind)):
        default = None if item.default_factory is MISSING else item.default_factory()
        default = default if item.default is MISSING else item.default
        object.__setattr__(table, item.name, values.get(item.name, default))
    return table


def _value(hint: Any, value: Any, loc: Location, problems: list[Problem]) -> Any:
    """The value that a key of this type has; blank, and a problem more, where it is wrong."""
    kind, notes = _parts(hint)
    before = len(problems)
    made, expected = _typed(kind, notes, value, loc, problems)
    texts = [f"must be {expected}, got {shown(value)}"] if expected else []
    if len(problems) == before and not expected:
        for note in notes:
            text = cast(Callable[[Any], str], note)(made) if callable(note) else _beyond(note, made)
            texts += [text if callable(note) else f"{text}, got {shown(value)}"] if text else []
    if not texts:
        return made
    choices = [choice for choice in get_args(kind) if get_origin(kind) is Literal and isinstance(choice, str)]
    near = nearest(value, choices) if isinstance(value, str) else ""
    problems.append((loc, texts[0] + near))
    return _blank(hint)


def _typed(kind: Any, notes: tuple[Any, ...], value: Any, loc: Location, problems: list[Problem]) -> tuple[Any, str]:
    """The value as what its annotation says, before its limits; and what was expected where it is none."""
    origin, inner = get_origin(kind), get_args(kind)
    if is_dataclass(kind) or origin is Mapping:
        if not isinstance(value, dict):
            row = f"a table: write [[{_path(loc[:-1])}]]" if isinstance(loc[-1], int) else "a table"
            return None, row if is_dataclass(kind) else "a table, as { key = value }"
        table = cast(dict[str, Any], value)
        if is_dataclass(kind):
            return _table(cast(type, kind), table, loc, problems), ""
        return {key: _value(inner[1], entry, (*loc, key), problems) for key, entry in table.items()}, ""
    if origin is tuple:
        many = inner[-1] is Ellipsis
        array = cast(list[Any], value) if isinstance(value, list) else None
        if array is None or not (many or len(array) == len(inner)):
            rows = many and is_dataclass(_parts(inner[0])[0])
            some = f"an array of tables: write [[{_path(loc)}]]" if rows else "an array, as [ ... ]"
            return None, some if many else _words(notes) or f"an array of {len(inner)} values"
        kinds = [inner[0]] * len(array) if many else inner
        return tuple(_value(kinds[i], entry, (*loc, i), problems) for i, entry in enumerate(array)), ""
    if origin is Literal:
        if value in inner and not isinstance(value, bool):
            return inner[inner.index(value)], ""
        *some, last = map(repr, inner)
        return None, f"{', '.join(some)}{' or ' if some else ''}{last}"
    if kind is float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None, "a number"
        return float(value), "" if math.isfinite(value) or Le(math.inf) in notes else "a finite number"
    if kind is Any or type(value) is kind:
        return value, ""
    words = "a name in quotes" if MinLen(1) in notes else "a string in quotes"
    return None, {bool: "true or false", int: "a whole number"}.get(kind, words)


def _beyond(limit: Any, value: Any) -> str:
    match limit:
        case Gt(gt=low) if not value > low:
            return f"must be above {low:.10g}"
        case Ge(ge=low) if not value >= low:
            return f"must be at least {low:.10g}"
        case Le(le=high) if not value <= high:
            return f"must be at most {high:.10g}"
        case Interval(ge=low, le=high) if not low <= value <= high:
            return f"must be between {low:.10g} and {high:.10g}"
        case MinLen(min_length=least) if len(value) < least:
            several = "must name at least one" if least == 1 else f"must have at least {least} entries"
            return "must be a name, not empty" if isinstance(value, str) else several
        case _:
            return ""


def _blank(hint: Any) -> Any:
    """What stands in a table in place of a value that is wrong."""
    kind, _ = _parts(hint)
    if is_dataclass(kind):
        hints = _hints(cast(type, kind))
        return _partial(cast(type, kind), {k: _blank(hints[k]) for k, required in _required(kind).items() if required})
    entries = get_args(kind)
    if get_origin(kind) is tuple:
        return () if entries[-1] is Ellipsis else tuple(map(_blank, entries))
    if get_origin(kind) is Mapping:
        return {}
    return {float: math.nan, int: math.nan, bool: False, Any: None}.get(kind, "")


def _parts(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """A type without `| None`, and what is annotated to it."""
    notes: tuple[Any, ...] = ()
    while get_origin(hint) in (Annotated, Union, UnionType):
        if get_origin(hint) is Annotated:
            hint, *more = get_args(hint)
            notes = (*more, *notes)
        else:
            hint = next(kind for kind in get_args(hint) if kind is not NoneType)
    return hint, notes


def _words(notes: tuple[Any, ...]) -> str:
    return next((note for note in reversed(notes) if isinstance(note, str)), "")


@cache
def _hints(kind: type) -> Mapping[str, Any]:
    return get_type_hints(kind, include_extras=True)


@cache
def _required(kind: Any) -> Mapping[str, bool]:
    """Whether each field must be there."""
    return {item.name: item.default is MISSING and item.default_factory is MISSING for item in fields(kind)}


def _path(loc: Location) -> str:
    return ".".join(key for key in loc if isinstance(key, str))


def shown(value: Any) -> str:
    """A wrong value, as much of it as one line takes."""
    text = repr(value) if isinstance(value, str) else toml(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]} ..."
