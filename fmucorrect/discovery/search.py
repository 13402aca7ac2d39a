"""What a search for effects is: whatever fills the ledger with fits of sets of effects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.ledger import Ledger
from fmucorrect.discovery.problem import Problem

Progress = Callable[[str, int, int], object]
"""Told the stage, what is done and how much there is to do."""


@runtime_checkable
class Search(Protocol):
    """Looks for sets of effects that explain the problem's development conditions.

    A search fits (fit.py) what it likes to the problem's conditions or to few of them; every fit enters the ledger by itself.
    budget: counts the runs of the FMU and ends the search (OutOfTime, to be let through) where its time is over. progress: to
    be told how far it is. What it returns is the ledger: the likeliest of its fits are compared, or those that it names
    (`ledger.compare`); their equivalents, the fit to its end and the verdict come after it, the same for every search.
    Raises FmuError when the FMU alone gives up.
    """

    def __call__(self, problem: Problem, ledger: Ledger, budget: Budget, progress: Progress) -> None: ...
