"""What a variable of the solver is to the C core (wrap/c/wrapper.h), and what both directions of conversion share."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field

TIME = 255
"""Kind of a row that no variable of the solver stands behind: the communication time."""

KINDS: Mapping[int, Mapping[str, int]] = {
    2: {"Real": 0, "Integer": 1, "Enumeration": 1, "Boolean": 2, "String": 3},
    3: {
        "Float64": 0,
        "Float32": 1,
        "Int8": 2,
        "UInt8": 3,
        "Int16": 4,
        "UInt16": 5,
        "Int32": 6,
        "UInt32": 7,
        "Int64": 8,
        "Enumeration": 8,
        "UInt64": 9,
        "Boolean": 10,
        "String": 11,
    },
}
"""The C core's number of each type, by FMI version of the solver."""


@dataclass(frozen=True)
class Wired:
    """A row of the cross-version table; the row's number is the outer value reference.

    kind: a number of KINDS for the solver's FMI version, or TIME. reference: the solver's value reference. size: elements
    of the solver's variable. index: which of them, row-major from 0.
    """

    kind: int
    reference: int
    size: int = 1
    index: int = 0


@dataclass(frozen=True)
class Converted:
    """A model description in the other version. left_out: what could not be carried over, in words."""

    root: ET.Element
    wired: tuple[Wired, ...]
    left_out: tuple[str, ...]


@dataclass
class Rows:
    """Wired rows as they are found; the same variable (or element of one) has one row."""

    rows: list[Wired] = field(default_factory=list)
    _places: dict[Wired, int] = field(default_factory=dict)

    def place(self, row: Wired) -> int:
        """The outer value reference of `row`."""
        if row not in self._places:
            self._places[row] = len(self.rows)
            self.rows.append(row)
        return self._places[row]
