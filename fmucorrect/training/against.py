"""What a corrector is judged against at conditions that were held out: the simulation as it is, and the simplest ways.

The measurements interpolated over the condition need no simulation, and are asked only where every excitation has a frequency:
over a random road a record that is replayed says nothing of another one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from fmucorrect.comparison import Comparison
from fmucorrect.metrics import score
from fmucorrect.study_training import Training
from fmucorrect.training.baselines import fit_quadratic, fit_straight
from fmucorrect.training.data import Samples
from fmucorrect.training.families import NETWORKS, fit_filter
from fmucorrect.training.loop import Run
from fmucorrect.training.model import Model
from fmucorrect.training.selection import Selection, folds
from fmucorrect.training.verdict import WORDS

Group = Literal["nothing", "simple", "network"]
REPLAYED: dict[str, Callable[..., Model]] = {
    "measurements interpolated, linear in the condition": fit_straight,
    "measurements interpolated, quadratic in the condition": fit_quadratic,
}


@dataclass(frozen=True)
class Way:
    """One row. taken: what is deployed. left_out: NRMSE, %, of each development condition when it was left out. unseen: of each
    condition that was held out of everything, as deployed where it was taken; None where it was not fitted to all."""

    label: str
    group: Group
    taken: bool
    left_out: tuple[float, ...]
    unseen: tuple[float | None, ...]


@dataclass(frozen=True)
class Against:
    """left_out, unseen: names of the conditions, the columns. ways: the simplest first."""

    left_out: tuple[str, ...]
    unseen: tuple[str, ...]
    ways: tuple[Way, ...]


def against(
    selection: Selection,
    training: Training,
    development: Sequence[Samples],
    unseen: Sequence[tuple[Samples, Comparison]],
) -> Against:
    """The table. unseen: conditions that were held out of everything, and what the deployed corrector made of them."""
    names = tuple(selection.tried["nothing"])
    ways: list[Way] = []
    for family, errors in selection.tried.items():
        taken = family == selection.family
        there: tuple[float | None, ...] = tuple(None for _ in unseen)
        if family == "nothing":
            there = tuple(said.before.mean_nrmse for _, said in unseen)
        elif taken:
            there = tuple(said.after.mean_nrmse for _, said in unseen)
        elif family not in NETWORKS:
            there = _unseen(fit_filter(family, development, training), unseen)
        group: Group = "nothing" if family == "nothing" else "network" if family in NETWORKS else "simple"
        ways.append(Way(WORDS[family], group, taken, tuple(errors[name] for name in names), there))
    if all(item.condition[2] > 0.0 for item in (*development, *(item for item, _ in unseen))):
        ways[1:1] = [_replayed(label, fit, names, training, development, unseen) for label, fit in REPLAYED.items()]
    return Against(names, tuple(item.name for item, _ in unseen), tuple(ways))


def _replayed(
    label: str,
    fit: Callable[..., Model],
    names: Sequence[str],
    training: Training,
    development: Sequence[Samples],
    unseen: Sequence[tuple[Samples, Comparison]],
) -> Way:
    found: dict[str, float] = {}
    for rest, held in folds(development):
        model = fit(rest, training, Run())
        found |= {item.name: score(model.predict(item), item.measured).mean_nrmse for item in held}
    there = _unseen(fit(development, training, Run()), unseen)
    return Way(label, "simple", False, tuple(found[name] for name in names), there)


def _unseen(model: Model, unseen: Sequence[tuple[Samples, Comparison]]) -> tuple[float, ...]:
    """NRMSE, %, over the rows that the deployed corrector is scored on; complete windows begin no earlier."""
    errors: list[float] = []
    for item, said in unseen:
        values = model.predict(item)
        missing = len(said.measured) - len(values)
        rows = slice(max(said.scored.start, missing), said.scored.stop)
        errors.append(score(values[rows.start - missing : rows.stop - missing], said.measured[rows]).mean_nrmse)
    return tuple(errors)
