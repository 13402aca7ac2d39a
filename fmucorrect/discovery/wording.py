"""A discovery's verdict in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fmucorrect.discovery.confirm import Gap, judged
from fmucorrect.discovery.decide import BESIDE_REST, Decision, leaves
from fmucorrect.discovery.discrepancy import TOO_MUCH, TOO_UNEVEN
from fmucorrect.discovery.fitted import Setting, stands_out
from fmucorrect.discovery.sets import MOST
from fmucorrect.discovery.terms import OFFSET
from fmucorrect.discovery.worth import AGREES, OPEN, SMALL, WORTH
from fmucorrect.report.base.words import duration, known, quantity, short
from fmucorrect.report.discovery.content import Discovery, Effect
from fmucorrect.report.discovery.text import OF_FACTOR, WITH_THEM, hangs_on, plain

TELLING = 2.5
"""Standard deviations of a sensor's gain or lag from which on the sentence tells it."""
MUCH = 0.1
"""Share of the disagreement's amplitude that may stay without being told in the sentence."""
BY_NAME = 2
"""Of the parameters that moved, so many are told by name in the sentence; the page has them all."""


def sentence(report: Discovery, checked: Sequence[Gap]) -> str:
    """The verdict for an engineer; of a search that its time limit ended it says so first."""
    said = _verdict(report, checked) + hangs_on(report.verdict, report.cautions)
    if report.complete:
        return said
    return f"Verdict so far, {duration(report.time_limit)} into a search that is not complete: {said}"


def _verdict(report: Discovery, checked: Sequence[Gap]) -> str:
    if report.verdict == "none":
        by = report.adjusted_by
        most = max(by, key=lambda name: abs(by[name]), default="")
        moved = f" after its parameters moved by at most {abs(by[most]):.2g} of their tolerances ({most})" if by else ""
        far, which = max(_sensed(report), default=(0.0, ""))
        if far >= TELLING:
            moved += f"{' and' if by else ' after'} the {which} by {far:.2g} standard deviations"
        if any(gap.nrmse_after > np.sqrt(AGREES) * gap.noise_floor for gap in checked):  # not where it is unknown, NaN
            after, before = (
                sum(max(error**2 - gap.least**2, 0.0) for gap in checked for error in [getattr(gap, side)])
                for side in ("nrmse_after", "nrmse_before")
            )
            rest = f"{100.0 * np.sqrt(after / before):.2g} % of the disagreement's amplitude"
            return (
                f"Simulation and measurement agree{moved}, but for {rest}, which noise of the recorded inputs can do, or which "
                "is too little for a name: nothing is missing that these data can show."
            )
        return f"Simulation and measurement agree to the sensors' noise{moved}: nothing is missing that these data can show."
    if report.verdict == "unexplained":
        stays = f"{100 * report.unexplained:.3g} % of the residual's energy"
        near = "; ".join(map(sized, report.suspects))
        but = f", but {report.not_named}" if report.not_named else ""
        left = _nearest(report.suspects) or (
            f"nearest: {near}, beside which {stays} stays{but}" if near else f"{stays} stays"
        )
        nothing = "nothing in the catalogue" if report.complete else "nothing that was looked at"
        return f"Simulation and measurement disagree, and {nothing} explains it: {left}.{_learned(report)}"
    worst = max(judged(checked), key=lambda gap: gap.nrmse_before)
    error = f"the error at {worst.condition.name} falls from {worst.nrmse_before:.3g} to {worst.nrmse_after:.3g} %"
    beside = [f"sensor noise {worst.noise_floor:.2g} %"] if known(worst.noise_floor) else []
    beside += [
        f"{row.nrmse_alone:.3g} % with augmented.fmu alone, without gains and lags of sensors"
        for row in report.gap
        if row.condition == worst.condition.name and row.far
    ]
    error += f" ({'; '.join(beside)})" if beside else ""
    names = [_or_another(row) for row in report.effects]
    what = names[0] if len(names) == 1 else f"{len(names)} effects: {'; '.join(names)}"
    moved = _moved(report)
    after = f"; with it {moved}{error}." if len(names) == 1 else f".{WITH_THEM}{moved}{error}."
    return f"The model lacks {what}{after}{_more(report.unexplained, worst)}"


def _learned(report: Discovery) -> str:
    """What a learned law does instead; nothing where there is none, or where it does not help."""
    row = report.learned
    if row is None or not (share := row.closed if known(row.closed) else row.closed_in_development) > 0.0:
        return ""
    held = [gap.condition for gap in row.gap if gap.role == "evaluation"]
    gap = "held-out gap" if known(row.closed) else "gap it was learned from (none was held out)"
    one = f" That is of {held[0]} alone: of another run it may not be so." if len(held) == 1 else ""
    return (
        f" A force learned at {row.joint}, which is no name for it, closes {short(100 * share, 2)} % of the {gap}.{one}"
    )


def moved_far(adjusted_by: Mapping[str, float]) -> list[str]:
    """Parameters that moved by a tolerance or more, the farthest first. adjusted_by: in tolerances."""
    moved = sorted(adjusted_by, key=lambda name: -abs(adjusted_by[name]))
    return [name for name in moved if abs(adjusted_by[name]) >= 1.0]


def _moved(report: Discovery) -> str:
    """Parameters of the model that moved by as much as is expected of one, or more: a part of what became better is theirs."""
    moved = moved_far(report.adjusted_by)
    told = [f"{name} at {short(report.adjusted[name])} (from {short(report.adjusted_from[name])})" for name in moved]
    if len(moved) > BY_NAME:
        told = [f"{len(moved)} parameters that moved, {told[0]} the farthest,"]
    return "".join(f"and {one} " for one in told)


def _more(unexplained: float, held: Gap) -> str:
    """What is said where names do not explain all. unexplained: share of the residual's energy that is left above the noise."""
    stays = np.sqrt(unexplained)
    if stays < MUCH or held.nrmse_after**2 < OPEN * held.least**2:
        return ""
    return f" {100 * stays:.2g} % of the disagreement's amplitude stays unexplained."


def _or_another(row: Effect) -> str:
    """An effect and, if there are any, those that stand in its place as well."""
    others = " or ".join(sorted(other.at for other in row.indistinguishable_from))
    return f"{sized(row)}, or {others}, which these data cannot tell apart" if others else sized(row)


def _sensed(report: Discovery) -> list[tuple[float, str]]:
    """By how many of the standard deviations that are expected of it each sensor's gain and lag are off, and what that is."""
    gains = [(abs(row.gain_by), f"gain of {row.channel}") for row in report.sensors]
    return [*gains, *((abs(row.lag_by), f"lag of {row.channel}") for row in report.sensors)]


def _nearest(suspects: Sequence[Effect]) -> str:
    """What came near and is not it: its force would have to be another one each time, or it moves most of the model's own
    parameters; nothing where none is so."""
    by_place = max(((row.uneven, row) for row in suspects if row.uneven), key=lambda pair: pair[0].share, default=None)
    if by_place is not None and (uneven := by_place[0]).share >= TOO_UNEVEN:
        differs = f"force would have to differ by {100 * uneven.share:.0f} % with the {uneven.over} there"
        return f"{_one_of(suspects, by_place[1])} {differs}"
    by_size = max(((row.varies, row) for row in suspects if row.varies), key=lambda pair: pair[0].share, default=None)
    if by_size is not None and (varies := by_size[0]).share >= TOO_MUCH:
        differs = f"{plain(varies.parameter)} would have to differ by {100 * varies.share:.0f} % between conditions"
        return f"{_one_of(suspects, by_size[1])} {differs}"
    moved = sum(row.effect == OFFSET for row in suspects)
    if moved > MOST:
        return f"nearest come {len(suspects)} effects at once, {moved} of them parameters that are off"
    return ""


def _one_of(suspects: Sequence[Effect], row: Effect) -> str:
    """What came nearest, up to what is said of one of them."""
    if len(suspects) == 1:
        return f"nearest comes {row.at}, whose"
    return f"nearest come {len(suspects)} effects together; of {row.at} the"


def sized(row: Effect) -> str:
    """Effect and place, and how large it is; a rectified signal has no size, nor has a force whose main number is lost in its
    own error (friction that fades with the speed): there what acted says it."""
    if not row.parameters:
        return row.at
    name, main = next(iter(row.parameters.items()))  # the first is the main one
    acts = row.acting  # a size that is said is the force that acted
    acted = f"peak {quantity(acts.peak, unit=acts.unit)}" if acts else ""
    if acted and abs(main.value) < main.std:
        return f"{row.at} ({acted})"
    own = main.told(std=False)
    size = own if main.meaning == OF_FACTOR else next(iter(row.moved.values()), own)
    size = size if len(row.parameters) == 1 else f"{plain(name)} {size}"
    return f"{row.at} ({size}, {acted})" if acted else f"{row.at} ({size})"


def rest(setting: Setting, decision: Decision, told: bool) -> list[str]:
    """What is said where more is left than the sensors' noise, and no effect of it is named. told: whether the noise is
    known."""
    if decision.verdict == "unexplained" or not stands_out(setting, decision.best):
        return []
    amplitude, worth, small = 100.0 * np.sqrt(decision.unexplained), 100.0 * WORTH, 100.0 * SMALL
    above = (
        f"the error has {decision.best.s2 / setting.floor:.3g} times the variance of the noise,"
        if told
        else "noise with it,"
    )
    shaky = leaves(setting, decision.best, decision.unexplained)
    most = f" Beside it no name is more than {100 * BESIDE_REST:g} % probable." if shaky else ""
    return [
        f"Something is left: {above} {amplitude:.2g} % of the amplitude of what was to be explained. Further effects are named"
        f" from {worth:g} % on, or from {small:g} % where one is nearly all that is left.{most}"
    ]
