"""Where values enter and leave an instance: one port for all variables of one type, on memory laid out once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from ctypes import c_void_p
from itertools import accumulate, repeat
from typing import NamedTuple, final

import numpy as np

from fmucorrect.fmu.description import Variable
from fmucorrect.fmu.instance import Instance
from fmucorrect.stepper import Row


class Move(NamedTuple):
    """For each row: point `pointer` to the next of `addresses`, then `call`; its status belongs to `function`."""

    pointer: c_void_p
    addresses: Iterator[int]
    call: Callable[[], int]
    function: str


@final
class Port:
    """All variables of one type among the K that are moved.

    columns: which of the K they are. row: (K,) float64, shared by all ports; the solver accesses it itself where
    all K are float64 to it, else through a buffer of its type. Arrays are moved in full, whichever elements are among the K;
    the others stay what they are.
    """

    def __init__(self, instance: Instance, verb: str, columns: dict[int, Variable], row: Row):
        sizes = {variable.reference: variable.size for variable in columns.values()}
        begins = dict(zip(sizes, accumulate(sizes.values(), initial=0), strict=False))
        kind, count = next(iter(columns.values())).type, sum(sizes.values())
        name, ctype = instance.TYPES[kind]
        dtype = np.dtype(ctype)
        self._instance, self._columns, self._row = instance, list(columns), row
        self._at = [begins[variable.reference] + variable.index for variable in columns.values()]
        self._function = f"{instance.PREFIX}{verb}{name}"
        self._scalars = self._at == list(range(count))
        self._whole = len(columns) == len(row) and self._scalars
        self._direct = self._whole and dtype == row.dtype
        self._buffer = row if self._direct else np.zeros(count, dtype)
        self._address = self._buffer.ctypes.data
        self._pointer = c_void_p(self._address)
        self._call = instance.bind(verb, kind, list(sizes), self._pointer, count)
        self._look = None if self._scalars else instance.bind("Get", kind, list(sizes), c_void_p(self._address), count)
        self._rows: np.ndarray = self._buffer[None]

    def put(self) -> None:
        """Set the variables from the row."""
        if not self._direct:
            self._keep()
            self._buffer[self._at] = self._cast(self._row[self._columns])
        self._pointer.value = self._address
        if status := self._call():
            self._instance.check(status, self._function)

    def get(self) -> None:
        """Write the variables into the row."""
        self._pointer.value = self._address
        if status := self._call():
            self._instance.check(status, self._function)
        if not self._direct:
            self._row[self._columns] = self._buffer[self._at]

    def rows_from(self, values: np.ndarray) -> Move:
        """To set the variables from the rows of `values` (T, K)."""
        chosen = self._cast(values if self._whole else values[:, self._columns])
        if not self._scalars:
            self._keep()
            every = np.tile(self._buffer, (len(values), 1))
            every[:, self._at] = chosen
            chosen = every
        self._rows = np.ascontiguousarray(chosen, self._buffer.dtype)
        return self._move()

    def rows_into(self, values: np.ndarray) -> Move:
        """To get the variables for the rows of `values` (T, K), each written there at once, so that it is not lost with
        what comes after."""
        if self._direct:
            self._rows = values
            return self._move()
        rows, call, columns, buffer = iter(values), self._call, self._columns, self._buffer
        at = slice(None) if self._scalars else self._at

        def into() -> int:
            status = call()
            next(rows)[columns] = buffer[at]
            return status

        return Move(self._pointer, repeat(self._address), into, self._function)

    def _keep(self) -> None:
        """The buffer with what the elements are that are not moved."""
        if self._look is not None and (status := self._look()):
            self._instance.check(status, self._function)

    def _cast(self, values: np.ndarray) -> np.ndarray:
        return values if self._buffer.dtype.kind == "f" else np.rint(values)

    def _move(self) -> Move:
        stride, start = self._rows.strides[0], self._rows.ctypes.data
        addresses = iter(range(start, start + stride * len(self._rows), stride or 1))  # no rows may have no stride
        return Move(self._pointer, addresses, self._call, self._function)


def ports(instance: Instance, verb: str, variables: Sequence[Variable], row: Row) -> list[Port]:
    """One port a type for `variables`, whose values are those of `row`. verb: "Get" or "Set"."""
    kinds = dict.fromkeys(variable.type for variable in variables)
    return [Port(instance, verb, {i: v for i, v in enumerate(variables) if v.type == kind}, row) for kind in kinds]
