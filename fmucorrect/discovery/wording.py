"""A discovery's verdict in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fmucorrect.discovery.confirm import Gap
from fmucorrect.discovery.decide import Decision
from fmucorrect.discovery.discrepancy import TOO_MUCH, TOO_UNEVEN
from fmucorrect.discovery.fitted import Setting, stands_out
from fmucorrect.discovery.sets import MOST
from fmucorrect.discovery.terms import OF_FACTOR, OFFSET
from fmucorrect.discovery.worth import OPEN, SMALL, WORTH
from fmucorrect.report.base.words import duration, quantity, short
from fmucorrect.report.discovery.text import at, changes, plain

TELLING = 2.5
"""Standard deviations of a sensor's gain or lag from which on the sentence tells it."""
MUCH = 0.1
"""Share of the disagreement's amplitude that may stay without being told in the sentence."""


def sentence(report: dict[str, Any], checked: Sequence[Gap]) -> str:
    """The verdict for an engineer; of a search that its time limit ended it says so first."""
    said = _verdict(report, checked) + _hangs_on(report)
    if report.get("complete", True):
        return said
    return f"Verdict so far, {duration(report['time_limit'])} into a search that is not complete: {said}"


def _hangs_on(report: dict[str, Any]) -> str:
    """What a name, or that there is none to give, hangs on; of what nothing explains that says nothing."""
    doubts = report.get("cautions", [])
    return f" This hangs on {'; and on '.join(doubts)}." if doubts and report["verdict"] != "unexplained" else ""


def _verdict(report: dict[str, Any], checked: Sequence[Gap]) -> str:
    if report["verdict"] == "none":
        by = report["adjusted_by"]
        most = max(by, key=lambda name: abs(by[name]), default="")
        moved = f" after its parameters moved by at most {abs(by[most]):.2g} of their tolerances ({most})" if by else ""
        far, which = max(_sensed(report), default=(0.0, ""))
        if far >= TELLING:
            moved += f"{' and' if by else ' after'} the {which} by {far:.2g} standard deviations"
        return f"Simulation and measurement agree to the sensors' noise{moved}: nothing is missing that these data can show."
    if report["verdict"] == "unexplained":
        left = _nearest(report["suspects"]) or f"{100 * report['unexplained']:.3g} % of the residual's energy stays"
        known = "nothing in the catalogue" if report.get("complete", True) else "nothing that was looked at"
        return f"Simulation and measurement disagree, and {known} explains it: {left}.{_learned(report)}"
    held = [gap for gap in checked if gap.condition.role == "evaluation"] or list(checked)
    worst = max(held, key=lambda gap: gap.nrmse_before)
    error = (
        f"the error at {worst.condition.name} falls from {worst.nrmse_before:.3g} to {worst.nrmse_after:.3g} %"
        f" (sensor noise {worst.noise_floor:.2g} %)"
    )
    names = [_or_another(row) for row in report["effects"]]
    what = names[0] if len(names) == 1 else f"{len(names)} effects: {'; '.join(names)}"
    after = f"; with it {error}." if len(names) == 1 else f". With them {error}."
    return f"The model lacks {what}{after}{_more(report['unexplained'], worst)}"


def _learned(report: dict[str, Any]) -> str:
    """What a learned law does instead; nothing where there is none, or where it does not help."""
    row = report.get("learned")
    if (
        row is None
        or (share := row["closed"] if row["closed"] is not None else row["closed_in_development"] or 0.0) <= 0.0
    ):
        return ""
    gap = "held-out gap" if row["closed"] is not None else "gap it was learned from (none was held out)"
    return f" A force learned at {row['joint']}, which is no name for it, closes {100 * share:.2g} % of the {gap}."


def _more(unexplained: float, held: Gap) -> str:
    """What is said where names do not explain all. unexplained: share of the residual's energy that is left above the noise."""
    stays = np.sqrt(unexplained)
    if stays < MUCH or held.nrmse_after**2 < OPEN * held.noise_floor**2:
        return ""
    return f" {100 * stays:.2g} % of the disagreement's amplitude stays unexplained."


def _or_another(row: dict[str, Any]) -> str:
    """An effect and, if there are any, those that stand in its place as well."""
    others = " or ".join(sorted(at(other) for other in row["indistinguishable_from"]))
    return f"{sized(row)}, or {others}, which these data cannot tell apart" if others else sized(row)


def _sensed(report: dict[str, Any]) -> list[tuple[float, str]]:
    """By how many of the standard deviations that are expected of it each sensor's gain and lag are off, and what that is."""
    return [(abs(row[f"{of}_by"]), f"{of} of {row['channel']}") for row in report["sensors"] for of in ("gain", "lag")]


def _nearest(suspects: Sequence[dict[str, Any]]) -> str:
    """What came near and is not it: its force would have to be another one each time, or it moves most of the model's own
    parameters; nothing where none is so."""
    by_place = max(suspects, key=_uneven, default=None)
    if by_place is not None and _uneven(by_place) >= TOO_UNEVEN:
        differs = (
            f"force would have to differ by {100 * _uneven(by_place):.0f} % with the {by_place['uneven']['over']} there"
        )
        return f"nearest comes {at(by_place)}, whose {differs}"
    by_condition = max(suspects, key=_varies, default=None)
    if by_condition is not None and _varies(by_condition) >= TOO_MUCH:
        number, share = plain(by_condition["varies"]["parameter"]), 100 * _varies(by_condition)
        return (
            f"nearest comes {at(by_condition)}, whose {number} would have to differ by {share:.0f} % between conditions"
        )
    moved = sum(row["effect"] == OFFSET for row in suspects)
    if moved > MOST:
        return f"nearest come {len(suspects)} effects at once, {moved} of them parameters that are off"
    return ""


def _varies(row: dict[str, Any]) -> float:
    """By which the effect's number would have to differ between conditions."""
    return row["varies"]["share"] if row["varies"] else 0.0


def _uneven(row: dict[str, Any]) -> float:
    """By which its force would have to differ along the joint's own motion."""
    return row["uneven"]["share"] if row["uneven"] else 0.0


def sized(row: dict[str, Any]) -> str:
    """Effect and place, and how large it is; a rectified signal has no size."""
    if not row["parameters"]:
        return at(row)
    name, main = next(iter(row["parameters"].items()))  # the first is the main one
    if main["meaning"] == OF_FACTOR:
        size = f"{short(100.0 * main['value'])} %"
    else:
        size = next(iter(changes(row).values()), quantity(main["value"], unit=main["unit"]))
    size = size if len(row["parameters"]) == 1 else f"{plain(name)} {size}"
    acts = row.get("acting")  # a size that is said is the force that acted
    size += f", at most {quantity(acts['peak'], unit=acts['unit'])} acted" if acts else ""
    return f"{at(row)} ({size})"


def rest(setting: Setting, decision: Decision) -> list[str]:
    """What is said where more is left than the sensors' noise, and no effect of it is named."""
    if decision.verdict == "unexplained" or not stands_out(setting, decision.best):
        return []
    amplitude, worth, small = 100.0 * np.sqrt(decision.unexplained), 100.0 * WORTH, 100.0 * SMALL
    return [
        f"Something is left: the error has {decision.best.s2 / setting.floor:.3g} times the variance of the noise,"
        f" {amplitude:.2g} % of the amplitude of what was to be explained. Further effects are named from {worth:g} % on,"
        f" or from {small:g} % where one is nearly all that is left."
    ]
