"""The verdict of a training, in words and as a table: what was tried, what was taken, and what it is worth."""

from __future__ import annotations

from collections.abc import Sequence

from fmucorrect.comparison import Comparison
from fmucorrect.study_training import Family
from fmucorrect.training.selection import Selection

WORDS: dict[Family, str] = {
    "nothing": "simulation as it is",
    "amplitude": "one amplitude factor",
    "linear": "linear filter",
    "window": "network on a window",
    "recurrent": "recurrent network",
}


def verdict(selection: Selection, evaluations: Sequence[Comparison] = ()) -> str:
    """One to three sentences. evaluations: of all conditions, those of development are left aside."""
    bare, left = selection.means["nothing"], selection.means[selection.family]
    others = [WORDS[family] for family in selection.tried if family != "nothing"]
    if selection.family == "nothing":
        text = (
            f"No better than the simulation: at conditions that were left out in turn none of what was tried "
            f"({', '.join(others) or 'nothing else'}) beats it by more than its standard error. corrector.onnx gives the "
            "simulation as it is, with a band; `fmucorrect discover` may find what it lacks."
        )
    else:
        text = (
            f"Taken: {WORDS[selection.family]}. At conditions that were left out in turn it learned "
            f"{100 * selection.learned:.0f} % of what the simulation lacks (NRMSE {bare:.2f} -> {left:.2f} %)."
        )
    unseen = [item for item in evaluations if item.condition.role == "evaluation"]
    worse = [item for item in unseen if item.after.mean_nrmse > item.before.mean_nrmse * (1.0 + _WORSE)]
    if worse:
        named = ", ".join(
            f"{item.condition.name} ({item.before.mean_nrmse:.2f} -> {item.after.mean_nrmse:.2f} %)" for item in worse
        )
        text += f" WORSE than the simulation at {named}, which nothing was fitted to: do not use it there."
    return text


_WORSE = 0.02
"""Share by which an error may grow before it is told: less is in the noise of a record."""


def table(selection: Selection) -> list[tuple[str, list[float], float]]:
    """What was tried, the simplest first: its name (the one that was taken is marked), NRMSE (%) of each condition when it was
    left out, and their mean."""
    return [
        (
            WORDS[family] + (" (taken)" if family == selection.family else ""),
            list(scores.values()),
            selection.means[family],
        )
        for family, scores in selection.tried.items()
    ]


def conditions(selection: Selection) -> list[str]:
    """The columns of that table."""
    return list(selection.tried["nothing"])
