"""The ledger of a search: every fit with the move that made it, what lies ahead, and what is to be compared at last."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from typing import TYPE_CHECKING, Concatenate, ParamSpec, TypeVar

if TYPE_CHECKING:
    from fmucorrect.discovery.budget import Budget
    from fmucorrect.discovery.fitted import Fitted, Setting
    from fmucorrect.discovery.model import Model
    from fmucorrect.discovery.problem import Problem
    from fmucorrect.discovery.trials import Trial

LISTED = 12
"""Sets whose fits are kept whole: enough for a verdict, and not the memory of all fits."""


@dataclass(frozen=True)
class Entry:
    """A fit, the setting that it was judged with, and how many couplings a step it has."""

    fitted: Fitted
    setting: Setting
    substeps: int


@dataclass(frozen=True)
class Row:
    """What stays of every fit. move: what made it, outermost first ("look/extended"). parent: number of the row that it was
    begun from, None for the FMU as it is. model: what it ended at. surprise (-2 log p), s2 (in units of the noise): as it was
    judged then. conditions: that it was fitted to. runs: of the FMU, in the run that made it."""

    number: int
    move: str
    parent: int | None
    model: Model
    surprise: float
    s2: float
    conditions: tuple[str, ...]
    substeps: int
    runs: int


@dataclass(frozen=True)
class Compared:
    """Sets that were fitted to the same conditions, judged alike. problem: of these conditions. base: the FMU without any
    effect. sets: of effects. setting: with which the surprises were formed."""

    problem: Problem
    base: Fitted
    sets: tuple[Fitted, ...]
    setting: Setting


class Ledger:
    """Of one discovery. rows: of all fits, in their order. runs: of the FMU, by move, without those of the moves inside it.
    ahead: what has not been looked at, in words by name. compared: what a search says is to be compared, the last counts;
    once it has ended, behind it what the verdict stands on."""

    def __init__(self) -> None:
        self.rows: list[Row] = []
        self.runs: dict[str, int] = {}
        self.ahead: dict[str, str] = {}
        self.compared: list[Compared] = []
        self._moves: list[str] = []
        self._entries: dict[object, dict[frozenset[tuple[str, str]], Entry]] = {}

    @contextmanager
    def during(self, move: str, budget: Budget) -> Generator[None]:
        """What is fitted and simulated meanwhile is the move's."""
        self._moves.append(move)
        path, before, inside = "/".join(self._moves), budget.runs, sum(self.runs.values())
        try:
            yield
        finally:
            self._moves.pop()
            own = budget.runs - before - (sum(self.runs.values()) - inside)
            self.runs[path] = self.runs.get(path, 0) + own

    def add(self, trials: Sequence[Trial], entry: Entry, parent: int | None = None, runs: int = 0) -> Fitted:
        """A fit to these conditions, with its number. Of every set of effects the likeliest stays whole, and of the sets the
        likeliest, beside the one without effects. What a finer coupling simulated goes before the rest."""
        fitted = replace(entry.fitted, number=len(self.rows))
        self.rows.append(
            Row(
                len(self.rows),
                "/".join(self._moves),
                parent,
                fitted.model,
                fitted.surprise,
                fitted.s2,
                tuple(trial.condition.name for trial in trials),
                entry.substeps,
                runs,
            )
        )
        entry = replace(entry, fitted=fitted)
        own = self._entries.setdefault(_extent(trials), {})
        key = frozenset(term.key for term in fitted.model.terms)
        known = own.get(key)
        if known is None or _rank(entry) < _rank(known):
            own[key] = entry
        for gone in sorted((k for k in own if k), key=lambda k: _rank(own[k]))[LISTED:]:
            del own[gone]
        return fitted

    def of(self, trials: Sequence[Trial]) -> list[Entry]:
        """What was fitted to these conditions, the likeliest first."""
        return sorted(self._entries.get(_extent(trials), {}).values(), key=_rank)

    def ancestors(self, number: int | None) -> list[Row]:
        """The row of this number, that of what it was begun from, and so on."""
        found: list[Row] = []
        while number is not None:
            found.append(self.rows[number])
            number = found[-1].parent
        return found

    def plan(self, stages: Mapping[str, str]) -> None:
        """Stages that lie ahead, in words by name; before those that are known already."""
        self.ahead = {**stages, **self.ahead}

    def through(self, stage: str) -> None:
        """A stage lies behind."""
        del self.ahead[stage]

    def compare(self, compared: Compared) -> None:
        """Sets that the search wants to be compared at last. A search that says nothing has the likeliest of its fits
        compared."""
        self.compared.append(compared)


P = ParamSpec("P")
R = TypeVar("R")


def move(work: Callable[Concatenate[Problem, P], R]) -> Callable[Concatenate[Problem, P], R]:
    """Of an operator of a search: what it fits and simulates stands in the problem's ledger under its name."""

    @wraps(work)
    def run(problem: Problem, /, *args: P.args, **kwargs: P.kwargs) -> R:
        with problem.ledger.during(work.__name__.strip("_"), problem.budget):
            return work(problem, *args, **kwargs)

    return run


def _rank(entry: Entry) -> tuple[int, float]:
    return -entry.substeps, entry.fitted.surprise


def _extent(trials: Sequence[Trial]) -> tuple[tuple[str, int], ...]:
    return tuple((trial.condition.name, trial.rows.stop) for trial in trials)
