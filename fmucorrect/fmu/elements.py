"""Names of the elements of FMI 3 arrays."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator

_DERIVATIVE = re.compile(r"der\((.*?)((?:,\d+)?)\)$")
_INDEXED = re.compile(r"(.*)\[(\d+(?:,\d+)*)\]$")


def element_names(name: str, shape: tuple[int, ...]) -> Iterator[str]:
    """Of each element, row-major from 1: `a[1,2]`, `der(a[1,2])`, and `a[3,1,2]` of an array `a[3]`."""
    before, after = "", ""
    derivative = _DERIVATIVE.match(name)
    if derivative is not None:
        name, before, after = derivative[1], "der(", f"{derivative[2]})"
    indexed = _INDEXED.match(name)
    first = "" if indexed is None else f"{indexed[2]},"
    name = name if indexed is None else indexed[1]
    for place in itertools.product(*(range(1, extent + 1) for extent in shape)):
        yield f"{before}{name}[{first}{','.join(map(str, place))}]{after}"
