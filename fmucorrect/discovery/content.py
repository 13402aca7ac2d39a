"""Values of a discovery by their content: a digest that is the same in every run, and bytes that any process can read."""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fmucorrect.catalogue import CATALOGUE, Law
from fmucorrect.catalogue.signal import SIGNALS, SignalLaw

Put = Callable[[object], object | None]


def digest(value: object) -> str:
    """Of a value's content: numbers, texts, arrays, laws of the catalogue, and whatever is made of these. What holds functions
    says by its `identity` what it is. Raises TypeError for a function."""
    found = hashlib.blake2b(digest_size=20)
    _feed(found.update, value)
    return found.hexdigest()


def _feed(update: Callable[[bytes | memoryview], object], value: Any) -> None:
    if value is None or isinstance(value, bool | int | float | str | Path | np.generic):
        update(f"{type(value).__name__}{value!r};".encode())
    elif isinstance(value, bytes):
        update(f"bytes{len(value)};".encode())
        update(value)
    elif isinstance(value, np.ndarray):
        update(f"{value.dtype.str}{value.shape};".encode())
        update(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data)
    elif isinstance(value, Law | SignalLaw):
        update(f"{type(value).__name__} {value.label};".encode())
    elif isinstance(value, Mapping):
        rows = sorted((str(key), entry) for key, entry in value.items())
        _feed(update, [part for row in rows for part in row])
    elif isinstance(value, frozenset | set):
        _feed(update, sorted(value))
    elif isinstance(value, list | tuple):
        update(f"({len(value)};".encode())
        for part in value:
            _feed(update, part)
    elif isinstance(value, slice):
        _feed(update, (value.start, value.stop, value.step))
    elif hasattr(value, "identity"):
        _feed(update, (type(value).__name__, value.identity))
    elif is_dataclass(value) and not isinstance(value, type):
        _feed(update, [type(value).__name__, *(getattr(value, item.name) for item in fields(value))])
    elif callable(value) or not hasattr(value, "__dict__"):
        raise TypeError(f"{value!r} has no content that tells it from others")
    else:
        _feed(update, (type(value).__name__, vars(value)))


class _Pickler(pickle.Pickler):
    """Laws go by their names."""

    def __init__(self, file: io.BytesIO, put: Put) -> None:
        super().__init__(file, protocol=5)
        self._put = put

    def persistent_id(self, obj: object) -> object | None:
        return self._put(obj)

    def reducer_override(self, obj: object) -> Any:
        if isinstance(obj, Law | SignalLaw):
            return law_called, (type(obj).__name__, obj.label)
        if isinstance(obj, MappingProxyType):
            return fixed, (dict(obj),)
        return NotImplemented


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, get: Callable[[Any], object]) -> None:
        super().__init__(file)
        self._get = get

    def persistent_load(self, pid: Any) -> object:
        return self._get(pid)


def packed(value: object, put: Put = lambda _: None) -> bytes:
    """A value as bytes. put: what stands for an object that is kept elsewhere, None for one that is not."""
    buffer = io.BytesIO()
    _Pickler(buffer, put).dump(value)
    return buffer.getvalue()


def unpacked(data: bytes, get: Callable[[Any], object] = lambda _: None) -> Any:
    """What `packed` made bytes of. get: the object that something stands for."""
    return _Unpickler(io.BytesIO(data), get).load()


def fixed(table: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    """A table that nobody changes."""
    return MappingProxyType(table)


def law_called(kind: str, label: str) -> Law | SignalLaw:
    """A law of the catalogue."""
    known = CATALOGUE if kind == "Law" else SIGNALS
    return {law.label: law for forms in known.values() for law in forms}[label]
