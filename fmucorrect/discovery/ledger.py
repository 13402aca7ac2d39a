"""The ledger of a search: what it has fitted and what lies ahead of it, for a verdict before its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fmucorrect.discovery.fitted import Fitted, Setting
    from fmucorrect.discovery.trials import Trial

AHEAD = {
    "parameters": "adjustable parameters that are off by more than their tolerances",
    "singles": "each effect of the catalogue by itself, at every place",
    "sets": "further effects beside the likeliest sets, and what may stand in the place of their members",
    "conditions": "the development conditions that the search leaves for its end",
    "ending": "equivalents of what was found, and its numbers to their end",
}
"""What a search goes through, in its order, by the names that `Ledger.through` takes."""
LISTED = 12
"""Sets that are kept: enough for a verdict, and not the memory of all fits."""


@dataclass(frozen=True)
class Entry:
    """A fit, the setting that it was judged with, and how many couplings a step it has."""

    fitted: Fitted
    setting: Setting
    substeps: int


class Ledger:
    """Of one discovery. ahead: what has not been looked at, by names of AHEAD."""

    def __init__(self) -> None:
        self.ahead = list(AHEAD)
        self._entries: dict[object, dict[frozenset[tuple[str, str]], Entry]] = {}

    def add(self, trials: Sequence[Trial], entry: Entry) -> None:
        """A fit to these conditions. Of every set of effects the likeliest stays, and of the sets the likeliest, beside the one
        without effects. What a finer coupling simulated goes before the rest."""
        own = self._entries.setdefault(_extent(trials), {})
        key = frozenset(term.key for term in entry.fitted.model.terms)
        known = own.get(key)
        if known is None or _rank(entry) < _rank(known):
            own[key] = entry
        for gone in sorted((k for k in own if k), key=lambda k: _rank(own[k]))[LISTED:]:
            del own[gone]

    def of(self, trials: Sequence[Trial]) -> list[Entry]:
        """What was fitted to these conditions, the likeliest first."""
        return sorted(self._entries.get(_extent(trials), {}).values(), key=_rank)

    def through(self, stage: str) -> None:
        """A stage of AHEAD lies behind."""
        self.ahead.remove(stage)


def _rank(entry: Entry) -> tuple[int, float]:
    return -entry.substeps, entry.fitted.surprise


def _extent(trials: Sequence[Trial]) -> tuple[tuple[str, int], ...]:
    return tuple((trial.condition.name, trial.rows.stop) for trial in trials)
