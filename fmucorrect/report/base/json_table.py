"""An object of JSON as a frozen dataclass, whose annotations say what each key may hold.

A field may be str, float, bool, Numbers, a dataclass, a Sequence or Mapping of one of these, or one of them | None. What is
missing or null is the field's default or else None where it may be that, nan, "", False, or empty: of a dataclass, one of such
blanks. A key that is a word of Python has a field with _ behind it; a key without a field is passed over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from math import nan
from types import NoneType
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from jaxtyping import Float64

Numbers = Float64[np.ndarray, " _"]
"""A list of numbers; nan for null."""

T = TypeVar("T")


def read(kind: type[T], value: Any, where: str) -> T:
    """The dataclass `kind` that the object says. where: its place, for errors. ValueError: something is of another type."""
    found = _checked(Mapping, "an object", value, where)
    values: dict[str, Any] = {}
    for item in fields(cast(Any, kind)):
        key = item.name.rstrip("_")
        if found.get(key) is not None or item.default is MISSING:
            values[item.name] = _value(_hints(kind)[item.name], found.get(key), f"{where}.{key}")
    return kind(**values)


def _value(hint: Any, value: Any, where: str) -> Any:
    """What stands at a place, as the type that is hinted."""
    origin, inner = get_origin(hint), get_args(hint)
    if NoneType in inner:
        return None if value is None else _value(inner[0], value, where)
    if is_dataclass(hint):
        return read(cast(type, hint), {} if value is None else value, where)
    if origin is Mapping:
        found = _checked(Mapping, "an object", {} if value is None else value, where)
        return {str(key): _value(inner[1], entry, f"{where}.{key}") for key, entry in found.items()}
    if origin is Sequence or hint is Numbers:
        found = _checked(list | tuple, "a list", () if value is None else value, where)
        if hint is Numbers:
            if all(type(entry) is float for entry in found):  # histories: a hundred thousand of them a report
                return np.array(found, np.float64)
            return np.array([_value(float, entry, where) for entry in found], np.float64)
        return tuple(_value(inner[0], entry, f"{where}[{i}]") for i, entry in enumerate(found))
    types, words, blank = {
        float: (int | float, "a number", nan),
        str: (str, "a text", ""),
        bool: (bool, "true or false", False),
    }[hint]
    return blank if value is None else hint(_checked(types, words, value, where))


def _checked(types: Any, words: str, value: Any, where: str) -> Any:
    if not isinstance(value, types) or (isinstance(value, bool) and types is not bool):
        raise ValueError(f"{where}: expected {words}, got {str(value)[:80]!r}")
    return value


@cache
def _hints(kind: type) -> Mapping[str, Any]:
    return get_type_hints(kind)
