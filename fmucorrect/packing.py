"""Values of the package as bytes, for files between two runs: a tree in JSON, and arrays behind it.

Reading makes nothing but numbers, texts, containers, arrays of numbers, enumerations of this package and its frozen
dataclasses: nothing that stands in a file can run. What else there is, the caller stands in for (`put` and `get`). Floats
and arrays come back to the bit, arrays in the same order in memory.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

Put = Callable[[Any], "tuple[str, Any] | None"]
"""What stands for an object that is none of those above: a name and a value that can be packed; None: nothing does."""
Get = Callable[[str, Any], Any]
"""The object that a name and a value stand for. Raises ValueError where there is none."""

_MAGIC = b"fmucorrect values 1\n"
_NUMBERS = "?bhilqBHILQefdFD"
"""Array types that are numbers, as numpy's char codes: no objects, nothing with fields."""


def pack(value: object, put: Put = lambda _: None) -> bytes:
    """A value as bytes. Raises TypeError for one that is of no kind known here."""
    writer = _Writer(put)
    tree = json.dumps(writer.tree(value)).encode()
    return _MAGIC + tree + b"\n" + b"".join(writer.blocks)


def unpack(data: bytes, get: Get | None = None) -> Any:
    """What `pack` made bytes of. Raises ValueError for anything else."""
    if not data.startswith(_MAGIC):
        raise ValueError("these are no values of fmucorrect")
    tree, _, blocks = data[len(_MAGIC) :].partition(b"\n")
    try:
        return _Reader(blocks, get or _nothing).value(json.loads(tree))
    except (KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise ValueError(f"the values do not hold together: {error}") from error


def own(module: str, name: str) -> type:
    """A class of this package that is loaded already, by where it is defined. Raises ValueError for any other."""
    found = getattr(sys.modules.get(module), name, None) if module.startswith("fmucorrect.") else None
    if not isinstance(found, type) or (found.__module__, found.__qualname__) != (module, name):
        raise ValueError(f"there is no class {name!r} in {module!r}")
    return found


def _nothing(name: str, _: Any) -> Any:
    raise ValueError(f"nothing is known by the name {name!r}")


class _Writer:
    """A tree of lists, texts, numbers and tables with one key, which says what they are; `blocks` are the arrays in it."""

    def __init__(self, put: Put) -> None:
        self.blocks: list[bytes] = []
        self._put, self._place = put, 0
        self._known: dict[int, tuple[Any, Any]] = {}  # with the array itself, so that no other gets its id

    def tree(self, value: Any) -> Any:
        stands = self._put(value)
        if stands is not None:
            return {"for": [stands[0], self.tree(stands[1])]}
        kind = type(value)
        if value is None or kind in (bool, int, float, str):
            return value
        if kind is list:
            return [self.tree(item) for item in value]
        if kind is dict:
            return {"dict": self._pairs(value)}
        if kind is MappingProxyType:
            return {"fixed": self._pairs(value)}
        if kind in (tuple, set, frozenset):
            return {kind.__name__: [self.tree(item) for item in (value if kind is tuple else sorted(value))]}
        if kind is slice:
            return {"slice": [self.tree(item) for item in (value.start, value.stop, value.step)]}
        if kind is bytes:
            return {"bytes": self._block(value)}
        if isinstance(value, Path):
            return {"path": str(value)}
        if isinstance(value, np.ndarray):
            return self._array(value)
        if isinstance(value, np.generic):
            return {"number": self._array(np.asarray(value))["array"]}
        if isinstance(value, Enum) and kind.__module__.startswith("fmucorrect."):
            return {"enum": [kind.__module__, kind.__qualname__, value.name]}
        if _ours(kind):
            return {"of": [kind.__module__, kind.__qualname__, self._pairs(_content(value))]}
        raise TypeError(f"{kind.__module__}.{kind.__qualname__} cannot be kept: {value!r}")

    def _pairs(self, table: Mapping[Any, Any]) -> list[Any]:
        return [[self.tree(key), self.tree(entry)] for key, entry in table.items()]

    def _array(self, array: np.ndarray) -> dict[str, Any]:
        if id(array) not in self._known:
            if array.dtype.char not in _NUMBERS:
                raise TypeError(f"an array of {array.dtype} cannot be kept")
            order = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
            row = [array.dtype.str, list(array.shape), order, *self._block(array.tobytes(order))]
            self._known[id(array)] = (array, {"array": row})
        return self._known[id(array)][1]

    def _block(self, content: bytes) -> list[int]:
        self.blocks.append(content)
        self._place += len(content)
        return [self._place - len(content), len(content)]


class _Reader:
    def __init__(self, blocks: bytes, get: Get) -> None:
        self._blocks, self._get = memoryview(blocks), get
        self._known: dict[int, np.ndarray] = {}

    def value(self, tree: Any) -> Any:
        if isinstance(tree, list):
            return [self.value(item) for item in tree]
        if not isinstance(tree, dict):
            return tree
        ((kind, content),) = tree.items()
        match kind:
            case "dict" | "fixed":
                table = self._table(content)
                return table if kind == "dict" else MappingProxyType(table)
            case "tuple":
                return tuple(self.value(item) for item in content)
            case "set" | "frozenset":
                return {"set": set, "frozenset": frozenset}[kind](self.value(item) for item in content)
            case "slice":
                return slice(*(self.value(item) for item in content))
            case "bytes":
                return bytes(self._block(*content))
            case "path":
                return Path(content)
            case "array":
                return self._array(*content)
            case "number":
                return self._array(*content)[()]
            case "enum":
                module, name, member = content
                found = own(module, name)
                if not issubclass(found, Enum):
                    raise ValueError(f"{name!r} is no enumeration")
                return found[member]
            case "of":
                return self._made(*content)
            case "for":
                name, inner = content
                return self._get(name, self.value(inner))
            case _:
                raise ValueError(f"no kind of value is called {kind!r}")

    def _table(self, rows: Any) -> dict[Any, Any]:
        return {self.value(key): self.value(entry) for key, entry in rows}

    def _block(self, place: int, size: int) -> memoryview:
        if not 0 <= place <= place + size <= len(self._blocks):
            raise ValueError("an array is missing, in part or in whole")
        return self._blocks[place : place + size]

    def _array(self, kind: str, shape: list[int], order: str, place: int, size: int) -> np.ndarray:
        dtype = np.dtype(kind)
        if dtype.char not in _NUMBERS or min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != size:
            raise ValueError(f"there is no array {kind} {shape} of {size} bytes")
        if place not in self._known or size == 0:
            flat = np.frombuffer(bytearray(self._block(place, size)), dtype)
            array = flat.reshape(shape, order="F" if order == "F" else "C")
            if size == 0:
                return array
            self._known[place] = array
        return self._known[place]

    def _made(self, module: str, name: str, rows: Any) -> Any:
        kind, given = own(module, name), self._table(rows)
        if not _ours(kind):
            raise ValueError(f"{name!r} is no frozen dataclass")
        if hasattr(kind, "_make"):
            return kind(**given)
        wanted = {item.name for item in fields(kind)}
        if set(given) != wanted:
            raise ValueError(f"{name!r} has {', '.join(sorted(wanted))}, got {', '.join(map(str, given))}")
        made = object.__new__(kind)
        for key, entry in given.items():
            object.__setattr__(made, key, entry)
        return made


def _ours(kind: type) -> bool:
    """Whether it is a frozen dataclass or a named tuple of this package."""
    frozen = is_dataclass(kind) and kind.__dataclass_params__.frozen  # type: ignore[attr-defined]
    return kind.__module__.startswith("fmucorrect.") and (
        frozen or (issubclass(kind, tuple) and hasattr(kind, "_make"))
    )


def _content(value: Any) -> dict[str, Any]:
    names = value._fields if isinstance(value, tuple) else [item.name for item in fields(value)]  # type: ignore[attr-defined]
    return {name: getattr(value, name) for name in names}
