"""The gate before a study is used: what in its records and simulations cannot be right, before hours are spent on it.

    checked = screen(study)      # raises StudyError with every finding that leaves nothing sensible to do
    checked.warnings             # what stands in the page, checked.pairs: the development conditions, simulated

finding.py says what a finding is, recorded.py looks at files alone, lifeless.py at whether a channel lives, same.py finds
one record inside another, floor.py the noise that a changed copy keeps, simulated.py holds simulation and measurement
against each other, repeatable.py a run against the same run once more, coarse.py against one at another step,
load_cells.py pushes where a load cell should feel it. Of evaluation conditions only what no training could use is looked at,
and nothing but a finding comes of it: whether they are held out at all, whether their channels live, their inputs cover the
run, and their sensors, signs and units are those of the others.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from fmucorrect.errors import FmucorrectError, StudyError
from fmucorrect.pairs import Pair, pair
from fmucorrect.screening.coarse import coarse
from fmucorrect.screening.finding import Finding, together
from fmucorrect.screening.load_cells import unfelt
from fmucorrect.screening.recorded import of_records
from fmucorrect.screening.repeatable import unrepeated
from fmucorrect.screening.simulated import NOTHING_IN_COMMON, of_pairs
from fmucorrect.signals import Condition
from fmucorrect.study import Study

__all__ = ["NOTHING_IN_COMMON", "Finding", "Screened", "coarse", "of_pairs", "of_records", "screen", "together"]

_log = logging.getLogger("fmucorrect")


@dataclass(frozen=True)
class Screened:
    """A study that passed. pairs: its development conditions, in order. warnings: what should be looked at."""

    pairs: tuple[Pair, ...]
    warnings: tuple[Finding, ...]

    def told(self) -> list[dict[str, str]]:
        """The warnings, for JSON."""
        return [finding.to_json() for finding in self.warnings]


def screen(
    study: Study,
    advance: Callable[[int], object] = lambda _: None,
    also: Callable[[Study, Sequence[Pair]], Iterable[Finding]] = lambda study, pairs: (),
) -> Screened:
    """Look at all records, simulate every condition once and the shortest one once more, and log each warning; advance(1) after
    each of development. also: what else is looked at in these, as `coarse` where forces are to be told. Raises StudyError that
    lists every error, and what reading, simulation and registration raise in development; in evaluation, which may never be
    asked for, that is a warning."""
    found = of_records(study)
    _refuse(study, found)
    pairs: list[Pair] = []
    for condition in study.development:
        pairs.append(pair(study, condition))
        advance(1)
    held: list[Pair] = []
    for condition in study.conditions:
        if condition.role == "evaluation":
            try:
                held.append(pair(study, condition))
            except FmucorrectError as error:
                found = (*found, _unpaired(condition, error))
    found = together(
        (
            *found,
            *of_pairs(study, [*pairs, *held]),
            *unrepeated(study, pairs),
            *also(study, pairs),
            *unfelt(study),
        )
    )
    _refuse(study, found)
    for finding in found:
        _log.warning("%s", finding.text)
    return Screened(tuple(pairs), found)


def _unpaired(condition: Condition, error: FmucorrectError) -> Finding:
    return Finding(
        "evaluation condition that cannot be used",
        "warning",
        f"condition {condition.name!r}",
        f"simulation and measurement could not be laid side by side: {str(error).rstrip('.')}",
        "Nothing will be scored there",
        "Mend that before comparing; training goes without it.",
    )


def _refuse(study: Study, found: Sequence[Finding]) -> None:
    errors = [finding.text for finding in found if finding.level == "error"]
    if errors:
        raise StudyError(str(study.path), errors)
