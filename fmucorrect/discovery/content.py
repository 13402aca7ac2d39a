"""Values of a discovery by their content: a digest that is the same in every run, and bytes that any process can read."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect import packing
from fmucorrect.catalogue import CATALOGUE, Law
from fmucorrect.catalogue.signal import SIGNALS, SignalLaw


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


def packed(value: object, put: packing.Put = lambda _: None) -> bytes:
    """A value as bytes; laws go by their names. put: what stands for an object that is kept elsewhere, None for one that is
    not."""

    def stands(item: Any) -> tuple[str, Any] | None:
        return ("law", [type(item).__name__, item.label]) if isinstance(item, Law | SignalLaw) else put(item)

    return packing.pack(value, stands)


def unpacked(data: bytes, get: packing.Get | None = None) -> Any:
    """What `packed` made bytes of. get: the object that something stands for. Raises ValueError for other bytes."""

    def stood_for(name: str, content: Any) -> Any:
        if name == "law":
            kind, label = content
            known = CATALOGUE if kind == "Law" else SIGNALS
            return {law.label: law for forms in known.values() for law in forms}[label]
        if get is None:
            raise ValueError(f"nothing is known by the name {name!r}")
        return get(name, content)

    return packing.unpack(data, stood_for)
