"""Results of Modelica tools in .mat files (Dymola, OpenModelica): trajectories by name, description and sign.

`dataInfo` says of each variable in which table it stands, in which column, and with a sign that belongs to the column.
The first table holds what does not change: parameters and constants, which are no series. At events a time stands
twice, with the values before and after it: the repair rule `drop` keeps the first.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from fmucorrect.errors import RecordError

_UNIT = re.compile(r"\[([^\[\]|]*)(?:\|[^\[\]]*)?\]\s*$")
"""The unit at the end of a description, and perhaps the one to show it in: `[rad|deg]`."""
_SHOWN = 8
"""Constants that are named where they are left out."""


def is_trajectory(content: Mapping[str, Any]) -> bool:
    """Whether these variables of a .mat file are a result of a Modelica tool."""
    return {"Aclass", "name", "dataInfo", "data_2"} <= set(content)


def series(content: Mapping[str, Any], path: str) -> tuple[dict[str, np.ndarray], dict[str, str], list[str]]:
    """The series by name, `time` among them, their units, and what is left out."""
    transposed = _rows(content["Aclass"])[3:4] == ["binTrans"]
    names, descriptions = (_texts(content.get(key, ()), transposed) for key in ("name", "description"))
    info = np.atleast_2d(np.asarray(content["dataInfo"]))
    info = info.T if transposed else info
    if len(info) != len(names) or info.shape[1] < 2:
        raise RecordError(
            "the result is damaged", where=path, expected=f"{len(names)} entries of dataInfo", got=len(info)
        )
    tables = {n: _table(content, n, transposed) for n in {int(n) for n in info[:, 0]} if n}
    found: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    constants: list[str] = []
    rows = max(len(table) for table in tables.values())
    for i, (name, (table, column)) in enumerate(zip(names, info[:, :2].astype(int).tolist(), strict=True)):
        values = tables[table or 2]
        place = abs(column) - 1
        if not 0 <= place < values.shape[1]:
            raise RecordError(f"the result is damaged: {name!r} is said to be in column {column}", where=path)
        if len(values) != rows or (table == 1 and rows > 2):
            constants.append(name)
            continue
        key = "time" if name.lower() == "time" else name
        found[key] = values[:, place] * (1.0 if column > 0 else -1.0)
        described = _UNIT.search(descriptions[i]) if i < len(descriptions) else None
        units[key] = described.group(1).strip() if described else ""
    if not constants:
        return found, units, []
    more = ", ..." if len(constants) > _SHOWN else ""
    return found, units, [f"{len(constants)} parameters and constants: {', '.join(constants[:_SHOWN])}{more}"]


def _table(content: Mapping[str, Any], number: int, transposed: bool) -> np.ndarray:
    values = np.atleast_2d(np.asarray(content[f"data_{number}"], np.float64))
    return values.T if transposed else values


def _rows(value: Any) -> list[str]:
    return [str(row).strip() for row in np.atleast_1d(np.asarray(value)).tolist()]


def _texts(value: Any, transposed: bool) -> list[str]:
    """The texts of a matrix of characters, whose rows are texts or, transposed, places."""
    lines = [str(row) for row in np.atleast_1d(np.asarray(value)).tolist()]
    if transposed:
        width = max(map(len, lines), default=0)
        lines = ["".join(letters) for letters in zip(*(line.ljust(width) for line in lines), strict=True)]
    return [line.strip(" \0") for line in lines]
