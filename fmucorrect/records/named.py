"""Lists whose entries have names beside them in the message, as `name` and `velocity` of a JointState of ROS.

An entry is a column by its place, `velocity[0]`. Publishers may write the names in another order, or other names, from one
message to the next: then an entry goes to the place that its name had first, so that a column is always of one name.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence

ENTRIES = "entries by "
"""What metadata keys of lists of names begin with."""
_NAMES = re.compile(r"(^|_)names?$")


def holds_names(field: str) -> bool:
    """Whether a list of texts of this name names the entries of those beside it: name, names, joint_names."""
    return _NAMES.search(field) is not None


class Entries:
    """The names that were met in the messages of a topic, and their places."""

    def __init__(self) -> None:
        self._places: dict[str, dict[tuple[str, int], int]] = {}
        self._moved: set[str] = set()

    def order(self, path: str, names: Sequence[str]) -> list[int]:
        """The places of a message's entries: of a name, where it stood when it was first met. path: of the list of names."""
        places = self._places.setdefault(path, {})
        seen: Counter[str] = Counter()
        order: list[int] = []
        for name in names:
            order.append(places.setdefault((name, seen[name]), len(places)))
            seen[name] += 1
        if order != list(range(len(order))):
            self._moved.add(path)
        return order

    def told(self) -> Mapping[str, str]:
        """Metadata: what each list of names names; and in `assumed`, where entries were moved."""
        named = {
            path: ", ".join(f"[{place}] {name}" for (name, _), place in places.items())
            for path, places in self._places.items()
            if places
        }
        moved = [
            f"{path} changes from message to message: entries of the lists beside it stand where their name stood first, "
            f"{named[path]}"
            for path in sorted(self._moved)
        ]
        entries = {f"{ENTRIES}{path}": names for path, names in named.items()}
        return entries | ({"assumed": "; ".join(moved)} if moved else {})
