"""What a discovery has found already: kept in a folder, so that a run that was broken off goes on where it stopped.

A discovery takes the same steps in every run. Each costly one (`remembered`) is looked up by what it depends on, and done only
where that is not known: the content of its arguments, of the study, of the FMU and of the records of the development
conditions, and the package's own source. Nothing that was found from other data or by other code is ever read.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache, wraps
from pathlib import Path
from shutil import rmtree
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar, runtime_checkable
from zipfile import BadZipFile

import numpy as np

import fmucorrect
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


_DIGEST = re.compile(r"[0-9a-f]{40}")
LARGE = 50_000
"""Bytes of an array beyond which it is a file of its own, however many results hold it."""
FINEST = 32_767.0
"""The largest number of a column of a large matrix, as it is kept. Such columns are sensitivities and signatures: differences
of simulations whose own error is larger than a 16-bit number's. Kept whole they would be nearly all of the folder."""


class Kept:
    """Results by key, in files of `folder`. Several processes may write there, and each may clear it."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder

    def read(self, key: str, given: list[object]) -> tuple[Any] | None:
        """The result of this key, in a tuple; None where there is none that can be read. given: objects that it may hold."""

        def get(kind: str, name: Any) -> object:
            if kind == "given":
                return given[name]
            if not _DIGEST.fullmatch(name):
                raise ValueError(f"no array is called {name!r}")
            return self._loaded(self._folder / f"{name}.npz")

        try:
            return (unpacked((self._folder / f"{key}.result").read_bytes(), get),)
        except (OSError, EOFError, ValueError):
            return None

    def write(self, key: str, result: object, given: list[object]) -> None:
        """Keep a result; whole or not at all."""
        numbers = {id(item): i for i, item in enumerate(given)}

        def put(value: object) -> tuple[str, Any] | None:
            if id(value) in numbers:
                return "given", numbers[id(value)]
            return ("array", self._array(value)) if isinstance(value, np.ndarray) and value.nbytes > LARGE else None

        self._replace(f"{key}.result", packed(result, put))

    def clear(self) -> None:
        """Nothing is kept any longer."""
        rmtree(self._folder, ignore_errors=True)

    def _loaded(self, path: Path) -> np.ndarray:
        try:
            with np.load(path, allow_pickle=False) as parts:
                values, scale = parts["values"], parts.get("scale")
            return values if scale is None else values.astype(scale.dtype) * scale
        except (ValueError, EOFError, KeyError, BadZipFile, zlib.error) as error:  # damaged: to be written anew
            path.unlink()
            raise ValueError(f"{path.name} is damaged") from error

    def _array(self, values: np.ndarray) -> str:
        parts = _columns(values) if values.ndim == 2 and values.dtype.kind == "f" else {"values": values}
        name = digest(parts)
        if not (self._folder / f"{name}.npz").exists():
            buffer = io.BytesIO()
            whole: dict[str, Any] = {key: np.ascontiguousarray(part) for key, part in parts.items()}
            np.savez_compressed(buffer, **whole)
            self._replace(f"{name}.npz", buffer.getvalue())
        return name

    def _replace(self, name: str, content: bytes) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)  # where another process has cleared it
        partial = self._folder / f"{name}.{os.getpid()}.partial"
        partial.write_bytes(content)
        partial.replace(self._folder / name)


@runtime_checkable
class Keyed(Protocol):
    """What is looked at. key: of all that results depend on beside the arguments. kept: where they are kept, if at all."""

    @property
    def key(self) -> str: ...
    @property
    def kept(self) -> Kept | None: ...


P = ParamSpec("P")
K = TypeVar("K", bound=Keyed)
R = TypeVar("R")


def remembered(work: Callable[Concatenate[K, P], R]) -> Callable[Concatenate[K, P], R]:
    """A function that first looks whether its result is kept. Functions among its arguments, which are told how far it is,
    do not count. The result is the one that was written, whether it was read or has just been found: equal to the bit, laid
    out alike in memory."""

    @wraps(work)
    def run(first: K, /, *args: P.args, **kwargs: P.kwargs) -> R:
        if first.kept is None:
            return work(first, *args, **kwargs)
        names = [name for name, value in kwargs.items() if not callable(value)]
        values = [value for value in args if not callable(value)]
        key = digest([work.__qualname__, first.key, values, [(name, kwargs[name]) for name in sorted(names)]])
        given = _given([*values, *kwargs.values()])
        known = first.kept.read(key, given)
        if known is None:
            first.kept.write(key, work(first, *args, **kwargs), given)
            known = first.kept.read(key, given)
            assert known is not None
        return known[0]

    return run


def _columns(values: np.ndarray) -> dict[str, np.ndarray]:
    """A matrix in 16 bits a number: values = values * scale, scale a power of two for each column. The same again of what comes
    of that. What is not finite stays as it is."""
    if not np.isfinite(values).all():
        return {"values": values}
    most = np.abs(values).max(axis=0, initial=0.0)
    most = np.where(most > 2.0 * FINEST * np.finfo(values.dtype).tiny, most, FINEST)
    scale = np.exp2(np.ceil(np.log2(most / FINEST))).astype(values.dtype)
    return {"values": np.rint(values / scale).astype(np.int16), "scale": scale}


def _given(values: list[Any]) -> list[object]:
    """What holds functions, which cannot be written: it is among the arguments whenever the result is read."""
    return [item for value in values if isinstance(value, list | tuple) for item in value if hasattr(item, "identity")]


@cache
def code() -> str:
    """Of the package's source and of numpy: another code, another result."""
    root = Path(fmucorrect.__file__).parent
    files = sorted(path for ending in ("py", "c", "h") for path in root.rglob(f"*.{ending}"))
    return digest([np.__version__, *((path.relative_to(root).as_posix(), path.read_bytes()) for path in files)])
