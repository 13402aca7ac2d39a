"""What a bundle says of itself, and the one reader of it: every type, size and number is checked before anything uses it."""

from __future__ import annotations

import base64
import binascii
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar

import numpy as np

from fmucorrect.brief import brief
from fmucorrect.errors import BundleError, unrepeated
from fmucorrect.signals import Channel

FORMATS = (1, 2, 3)
"""3: it sees what inputs held; 2: there is a state, or it sees more than the channels. The lowest that says all is written:
older versions read it."""
OUTPUTS = ("corrected", "baseline", "sigma", "in_envelope")
STATE, NEXT_STATE = "state", "next_state"
"""A further input and output of format 2."""
SEES = "sees"
"""A further table of format 2."""
HELD = "held"
"""A further list of format 3."""

LONGEST = 1000
"""Characters of a name or another short text: names go into C, XML and tables."""
CHANNELS, ROWS, CONDITIONS, ENTRIES = 1000, 100_000, 10_000, 100_000
"""At most, of channels, rows of a window, conditions, and entries of any other table: far beyond any use, and small enough
for whatever loops over them."""
STATES = 4096
"""At most, of numbers in the state: ten times any use, and a wrapped FMU keeps two of them in every copy of its own state."""
LONGEST_STEP = 10**12
"""ns, a thousand seconds between samples."""
LARGEST_TEXT = 64 << 20
"""Bytes of the JSON, golden pair included."""
DEEPEST = 16
"""Levels of lists and tables in the JSON; what is written here has five."""
SAME = 1e-6
"""Relative difference of two start values that are the same, written with other digits."""
T = TypeVar("T")
FEATURES: Mapping[str, str] = {"speed": "km/h", "amplitude": "deg", "frequency": "Hz", "start": "s"}
"""What a corrector may be conditioned on besides the window, and in which unit; `start` is where its time begins."""


@dataclass(frozen=True)
class Trained:
    """A start value in training. low, high: between which another one counts as the same. words: what it was."""

    low: float
    high: float
    words: str


@dataclass(frozen=True)
class Info:
    """What a bundle says of itself.

    rows: W. step_ns: sample time. uncorrected: (J,) rms of measurement minus simulation in development, in the channels'
    units: sigma while there is no correction. envelope: for `speed`, `amplitude`, `frequency` and `response <channel>` the
    four corners outer low, inner low, inner high, outer high: inside the inner ones the correction is whole, beyond the
    outer ones it is nothing. conditions: those trained on, with the FMU start values of each. parameters: FMU start values
    of all of them, in the FMU's own units. units: of variables that the FMU leaves without one, as the study knew them.
    evaluation: figures, for people. state: S, numbers that the network hands on from sample to sample, 0 for none. sees: what
    it sees beside the channels. held: names of those of which a row of the window has what they held while the solver came to
    it: its inputs. solver: the FMU that was simulated in training, by its file's name; "" where logs were, or in bundles that
    do not say it. defaults: what its parameters were by themselves, {} likewise. driven: its inputs that a column
    drove at every condition of training, with their units, {} likewise.
    """

    name: str
    channels: tuple[Channel, ...]
    rows: int
    step_ns: int
    uncorrected: tuple[float, ...]
    envelope: Mapping[str, tuple[float, float, float, float]]
    conditions: tuple[Mapping[str, Any], ...]
    study_hash: str
    versions: Mapping[str, str]
    evaluation: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    state: int = 0
    sees: tuple[Channel, ...] = ()
    held: tuple[str, ...] = ()
    solver: str = ""
    defaults: Mapping[str, float] = field(default_factory=dict)
    driven: Mapping[str, str] = field(default_factory=dict)

    __repr__ = brief

    @property
    def seen(self) -> tuple[Channel, ...]:
        """V, the window's columns: the channels, then what else it sees."""
        return self.channels + self.sees

    @property
    def inputs(self) -> dict[str, tuple[int, ...]]:
        """The network's inputs and the shape of one row of each."""
        found = {"window": (self.rows, len(self.seen)), "condition": (3,), "time": (1,)}
        return found | ({STATE: (self.state,)} if self.state else {})

    @property
    def outputs(self) -> dict[str, tuple[int, ...]]:
        """The outputs likewise."""
        found = {name: (1 if name == "in_envelope" else len(self.channels),) for name in OUTPUTS}
        return found | ({NEXT_STATE: (self.state,)} if self.state else {})

    @property
    def features(self) -> Mapping[str, str]:
        """Those of FEATURES that have a meaning in some condition of training, with their units: 0 stands for none, and a start
        belongs to an excitation, which has a frequency."""
        found = {key for key in FEATURES if any(condition.get(key, 0.0) for condition in self.conditions)}
        found |= {"start"} if "frequency" in found else set()
        return {key: unit for key, unit in FEATURES.items() if key in found}

    def unlike(self, given: Mapping[str, float], defaults: Mapping[str, float] = MappingProxyType({})) -> list[str]:
        """Which start values are others than those trained with, and what they were. given: those of the FMU that are set;
        defaults: those that hold otherwise, as far as they are known: another FMU has others. One that took several values in
        training may lie beyond them by as much as they lie apart, where the correction for another speed ends, too; a constant
        one may not differ. A bundle that knows neither of start values nor of a solver says nothing."""
        known = self.start_values_known
        found: list[str] = []
        own = self.defaults.keys() & defaults.keys()
        for name in sorted(known | own | (set(given) if known or self.solver else set())):
            value, trained = given.get(name, defaults.get(name)), self.trained(name, defaults)
            if value is None or (trained is None and name in known):
                continue
            if trained is None:
                found.append(f"{name} is set to {value:g}, which nothing in training was")
            elif not trained.low <= value <= trained.high:
                found.append(f"{name} is {value:g}, trained with {trained.words}")
        return found

    @property
    def start_values_known(self) -> set[str]:
        """Names of the start values that training set."""
        return set(self.parameters).union(*(condition.get("parameters", {}) for condition in self.conditions))

    def trained(self, name: str, defaults: Mapping[str, float]) -> Trained | None:
        """What `unlike` allows a start value to be; None where it is not known what it was. defaults: as there, for a bundle
        that does not say what its FMU had."""
        rows = [{**self.parameters, **condition.get("parameters", {})} for condition in self.conditions]
        otherwise = self.defaults.get(name, defaults.get(name))
        values = [one for one in (row.get(name, otherwise) for row in rows) if one is not None]
        if not values:
            return None
        low, high = min(values), max(values)
        margin = high - low + SAME * max(abs(low), abs(high))
        least = 0.0 if low > 0.0 and low - margin < 0.0 else low - margin  # a mass, say, is never less than nothing
        most = 0.0 if high < 0.0 and high + margin > 0.0 else high + margin
        if low == high:
            return Trained(least, most, f"{low:g}")
        return Trained(least, most, f"{low:g} to {high:g}, used from {least:.4g} to {most:.4g}")

    def to_json(self) -> dict[str, Any]:
        data = {"format": 3 if self.held else 2 if self.state or self.sees else 1, **asdict(self)}
        for key in (STATE, SEES, HELD, "solver", "defaults", "driven"):
            if not data[key]:
                del data[key]
        return data

    @staticmethod
    def from_json(data: Mapping[str, Any], where: str) -> Info:
        """Raises BundleError where the format is another one, or a key is missing or of another type, size or range."""
        version = data.get("format")
        if not _is_whole(version) or version not in FORMATS:
            raise BundleError("bundle of another format", where=where, expected="1, 2 or 3", got=_shown(version))
        top = _Table(dict(data), where, "")
        channels = tuple(_channel(row) for row in top.rows("channels", CHANNELS))
        sees = tuple(_channel(row) for row in top.rows(SEES, CHANNELS)) if version >= 2 and SEES in data else ()
        names, every = ([channel.name for channel in rows] for rows in (channels, channels + sees))
        if not channels or len(set(every)) < len(every):
            top.wrong("channels", "one row or more, each with a name of its own", every)
        rows, step_ns = top.whole("rows", ROWS), top.whole("step_ns", LONGEST_STEP)
        return Info(
            name=top.text("name"),
            channels=channels,
            rows=rows,
            step_ns=step_ns,
            uncorrected=_uncorrected(top, len(channels)),
            envelope=_envelope(top, names),
            conditions=tuple(_condition(row) for row in top.rows("conditions", CONDITIONS)),
            study_hash=top.text("study_hash"),
            versions=top.table("versions").all(_Table.text),
            evaluation=top.table("evaluation").data,
            parameters=top.table("parameters").all(_Table.number) if "parameters" in data else {},
            units=top.table("units").all(_Table.text) if "units" in data else {},
            state=top.whole(STATE, STATES) if version >= 2 and (STATE in data or not sees) else 0,
            sees=sees,
            held=_held(top, sees) if version >= 3 else (),
            solver=top.text("solver") if "solver" in data else "",
            defaults=top.table("defaults").all(_Table.number) if "defaults" in data else {},
            driven=top.table("driven").all(_Table.text) if "driven" in data else {},
        )


def parse(text: str, where: str) -> dict[str, Any]:
    """The JSON as it stands: a table, no key twice, only numbers that JSON knows, not too deep. Raises BundleError."""

    def constant(name: str) -> NoReturn:
        raise ValueError(f"{name} is no number of JSON")

    if len(text) > LARGEST_TEXT:
        raise BundleError("the metadata is too large", where=where, expected=f"at most {LARGEST_TEXT} characters")
    try:
        data = json.loads(text, object_pairs_hook=unrepeated, parse_constant=constant)
    except (ValueError, RecursionError) as error:
        raise BundleError(f"the metadata is no JSON that can be used: {error}", where=where) from error
    level: list[Any] = [data]
    for _ in range(DEEPEST):
        level = [inner for item in level for inner in _inside(item)]
    if level or not isinstance(data, dict):
        raise BundleError("the metadata is no table", where=where, expected=f"a table of at most {DEEPEST} levels")
    return data


def _inside(item: Any) -> list[Any]:
    return list(item.values()) if isinstance(item, dict) else item if isinstance(item, list) else []


def golden(data: Mapping[str, Any], info: Info, where: str) -> dict[str, np.ndarray]:
    """The golden pair: inputs, and those outputs that it holds: `corrected` at least (bundles made earlier), or all. Sizes are
    held against the channels and rows before anything is unpacked. Raises BundleError."""
    top = _Table(dict(data), where, "").table("golden")
    shape = top.table("time").data.get("shape")
    if not (isinstance(shape, list) and len(shape) == 2 and _is_whole(shape[0]) and 1 <= shape[0] <= ROWS):
        top.wrong("time", "a shape (N, 1)", shape)
    known = info.inputs | info.outputs
    needed = {*info.inputs, *(info.outputs if info.state else ("corrected",))}
    unknown = sorted(set(top.data) - set(known))
    if unknown:
        top.wrong(unknown[0], f"one of {', '.join(known)}", "another name")
    return {
        name: _array(top.table(name), name, (int(shape[0]), *row))
        for name, row in known.items()
        if name in top.data or name in needed
    }


def _array(entry: _Table, name: str, shape: tuple[int, ...]) -> np.ndarray:
    dtype = np.dtype("<f8" if name == "time" else "<f4")
    size = math.prod(shape) * dtype.itemsize
    if entry.data.get("dtype") != dtype.str or entry.data.get("shape") != list(shape):
        entry.wrong("shape", f"{dtype.str} {list(shape)}", f"{entry.data.get('dtype')!a} {entry.data.get('shape')!a}")
    text = entry.data.get("base64")
    if not isinstance(text, str) or len(text) != (size + 2) // 3 * 4:
        entry.wrong("base64", f"the {size} bytes of {list(shape)}", "another number of them")
    try:
        array = np.frombuffer(base64.b64decode(text, validate=True), dtype).reshape(shape)
    except (binascii.Error, ValueError) as error:
        raise BundleError(f"golden.{name} cannot be unpacked: {error}", where=entry.where) from error
    if not np.isfinite(array).all():
        entry.wrong("base64", "finite numbers", "NaN or Inf")
    return array


def _channel(row: _Table) -> Channel:
    """Raises BundleError for keys that a channel does not have, too: they would be lost."""
    texts = [item.name for item in fields(Channel) if item.type == "str"]
    unknown = sorted(set(row.data) - {item.name for item in fields(Channel)})
    if unknown:
        row.wrong(unknown[0], "a key of a channel", "another one")
    given: dict[str, Any] = {
        key: row.text(key, empty=key != "name") for key in texts if key in row.data or key == "name"
    }
    if row.data.get("noise") is not None:
        given["noise"] = row.number("noise", at_least=0.0)
    if "measurement_sign" in row.data:
        sign = row.data["measurement_sign"]
        if not _is_whole(sign) or sign not in (1, -1):
            row.wrong("measurement_sign", "1 or -1", sign)
        given["measurement_sign"] = sign
    return Channel(**given)


def _uncorrected(top: _Table, count: int) -> tuple[float, ...]:
    found = top.numbers("uncorrected", count, at_least=0.0)
    if max(found) > 1e30:  # they become single precision
        top.wrong("uncorrected", "numbers that single precision holds", max(found))
    return tuple(found)


def _held(top: _Table, sees: tuple[Channel, ...]) -> tuple[str, ...]:
    found, known = top.entry(HELD), [channel.name for channel in sees]
    if not isinstance(found, list | tuple) or any(name not in known for name in found) or not found:
        top.wrong(HELD, f"names among {known}", found)
    return tuple(found)


def _envelope(top: _Table, names: list[str]) -> dict[str, tuple[float, float, float, float]]:
    table = top.table("envelope")
    known = {"speed", "amplitude", "frequency", *(f"response {name}" for name in names)}
    found: dict[str, tuple[float, float, float, float]] = {}
    for key in table.data:
        a, b, c, d = table.numbers(key, 4)
        if key not in known or not a <= b <= c <= d:
            table.wrong(key, "speed, amplitude, frequency or a response, with four corners in order", (a, b, c, d))
        found[key] = (a, b, c, d)
    return found


def _condition(row: _Table) -> dict[str, Any]:
    """What is known of one; further keys are for people."""
    if "name" in row.data:
        row.text("name")
    for key in FEATURES:
        if key in row.data:
            row.number(key)
    if "parameters" in row.data:
        row.table("parameters").all(_Table.number)
    return row.data


@dataclass(frozen=True)
class _Table:
    """A table of the metadata and its place in it. Every reader raises BundleError."""

    data: dict[str, Any]
    where: str
    place: str

    def wrong(self, key: str, expected: str, got: object) -> NoReturn:
        place = ".".join(part for part in (self.place, key) if part)
        raise BundleError(
            f"metadata {place[:200]!a} cannot be used", where=self.where, expected=expected, got=_shown(got)
        )

    def entry(self, key: str) -> Any:
        if key not in self.data:
            self.wrong(key, "an entry", "none")
        return self.data[key]

    def text(self, key: str, empty: bool = False) -> str:
        value = self.entry(key)
        if not isinstance(value, str) or len(value) > LONGEST or not (value or empty):
            self.wrong(key, f"a text of at most {LONGEST} characters", value)
        if any("\ud800" <= c <= "\udfff" or c == "\0" for c in value):
            self.wrong(key, "characters of Unicode, none of them NUL", value)
        return value

    def number(self, key: str, at_least: float = -math.inf) -> float:
        return _number(self, key, self.entry(key), at_least)

    def numbers(self, key: str, count: int, at_least: float = -math.inf) -> list[float]:
        value = self.entry(key)
        if not isinstance(value, list | tuple) or len(value) != count:
            self.wrong(key, f"{count} numbers", value)
        return [_number(self, key, item, at_least) for item in value]

    def whole(self, key: str, most: int) -> int:
        value = self.entry(key)
        if not _is_whole(value) or not 1 <= value <= most:
            self.wrong(key, f"a whole number from 1 to {most}", value)
        return value

    def table(self, key: str) -> _Table:
        value = self.entry(key)
        if not isinstance(value, dict) or len(value) > ENTRIES:
            self.wrong(key, f"a table of at most {ENTRIES} entries", value)
        return _Table(value, self.where, f"{self.place}.{key}" if self.place else key)

    def rows(self, key: str, most: int) -> list[_Table]:
        value = self.entry(key)
        if not isinstance(value, list | tuple) or len(value) > most or not all(isinstance(row, dict) for row in value):
            self.wrong(key, f"a list of at most {most} tables", value)
        return [_Table(row, self.where, f"{key}.{i}") for i, row in enumerate(value)]

    def all(self, read: Callable[[_Table, str], T]) -> dict[str, T]:
        """Every entry by the same reader."""
        return {key: read(self, key) for key in self.data}


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _number(table: _Table, key: str, value: Any, at_least: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not at_least <= value or abs(value) >= 1e300:
        table.wrong(key, "a finite number" + ("" if at_least == -math.inf else f", at least {at_least:g}"), value)
    return float(value)


def _shown(value: object) -> str:
    text = ascii(value)
    return text if len(text) <= 120 else f"{text[:120]} ..."
