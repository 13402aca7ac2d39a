"""A short repr of what holds arrays, or much else: a notebook shows what it is, not thousands of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

LONGEST = 80
"""Characters of one value; what is longer is named by its type."""

ENTRIES = 8
"""Of a sequence or a mapping; the rest is counted."""


def brief(self: Any) -> str:
    """`Pair(condition='385', measured=float64 (3000, 2), ...)`, for a class's __repr__: arrays by type and shape, what has a
    name by that, files without their folder, what has its default not at all."""
    shown: list[str] = []
    for field in fields(self):
        value = getattr(self, field.name)
        default = field.default if field.default_factory is MISSING else field.default_factory()
        if field.repr and not (value is default or _same(value, default)):
            shown.append(f"{field.name}={_value(value)}")
    return f"{type(self).__name__}({', '.join(shown)})"


def brief_of(self: Any, *names: str) -> str:
    """The same of a class without fields, with these of its attributes; without those that are ()."""
    values = {name: getattr(self, name) for name in names}
    shown = [f"{name.lstrip('_')}={_value(value)}" for name, value in values.items() if not _same(value, ())]
    return f"{type(self).__name__}({', '.join(shown)})"


def _same(value: Any, default: Any) -> bool:
    if type(value) is not type(default):
        return False
    if is_dataclass(value):
        return all(_same(getattr(value, field.name), getattr(default, field.name)) for field in fields(value))
    return bool(np.array_equal(value, default) if isinstance(value, np.ndarray) else value == default)


def _value(value: Any) -> str:
    if isinstance(value, np.ndarray):
        array = cast(np.ndarray[Any, Any], value)
        return f"{array.dtype} {array.shape}"
    if isinstance(value, np.generic):
        return repr(value.item())
    if isinstance(value, Path):
        return repr(value.name)
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if is_dataclass(value) and isinstance(name := getattr(value, "name", None), str):
        return repr(name)
    if isinstance(value, Mapping):
        keys = [str(key) for key in cast(Mapping[Any, Any], value)]
        return f"{{{_few(keys)}}}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{_few([_value(entry) for entry in cast(Sequence[Any], value)])}]"
    text = repr(value)
    return text if len(text) <= LONGEST else f"{type(value).__name__}(...)"


def _few(texts: list[str]) -> str:
    if len(texts) > 1 and len({*texts}) == 1:
        return f"{len(texts)} x {texts[0]}"
    return ", ".join(texts[:ENTRIES]) + (f", ... {len(texts)} in all" if len(texts) > ENTRIES else "")
