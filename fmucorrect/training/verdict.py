"""The verdict of a training, in words and as a table: what was tried, what was taken, and what it is worth."""

from __future__ import annotations

from collections.abc import Sequence

from fmucorrect.comparison import BAND_90, Comparison
from fmucorrect.noise import known_floor, removed
from fmucorrect.stepper import Status
from fmucorrect.study_training import Family
from fmucorrect.training.fallback import Fallback
from fmucorrect.training.novelty import FALSE_ALARMS, Guard
from fmucorrect.training.selection import HARDLY, Selection

WORDS: dict[Family, str] = {
    "nothing": "simulation as it is",
    "amplitude": "one amplitude factor",
    "linear": "linear filter",
    "window": "network on a window",
    "recurrent": "recurrent network",
    "feedback": "recurrent network with feedback",
}


def headline(selection: Selection) -> str:
    """For a page's title."""
    if selection.family == "nothing":
        return "no better than the simulation"
    if _is_noise(selection.noise, selection.means[selection.family]):
        return "learned what the simulation lacked, down to the sensors' noise"
    return f"learned {100 * selection.learned:.0f}\u00a0% of what the simulation lacked"


def verdict(selection: Selection, evaluations: Sequence[Comparison] = (), guard: Guard | None = None) -> str:
    """One to four sentences. evaluations: of all conditions, those of development say what was left out at a time. guard: None
    where nothing is corrected, or it is not to be spoken of."""
    unseen = [item for item in evaluations if item.unseen]
    text = _when_left_out(selection, evaluations)
    if unseen and selection.family != "nothing":
        text += _held_out(unseen)
    harmed = [
        f"{name} ({grown})"
        for name, left in selection.held_out.items()
        if (grown := _grown(selection.tried["nothing"][name], left))
    ]
    if harmed:
        text += f" Left out, {', '.join(harmed)} was met WORSE than by the simulation: where it moves like that, do not use it."
    if selection.family != "nothing":
        for item in evaluations:
            if item.withheld:
                text += f" At {item.condition.name} nothing is corrected: {item.withheld}."
    if worse := [found for item in unseen if (found := _worse(item))]:
        text += f" WORSE than the simulation at {', '.join(worse)}, which nothing was fitted to: do not use it there."
    narrow = [
        f"{name} ({100 * held:.0f} %) when it was left out"
        for name, held in selection.covered.items()
        if held < _NARROW
    ]
    in_motion = [(item.condition.name, item.within(BAND_90, item.excited).mean()) for item in unseen]
    narrow += [f"{name} ({100 * held:.0f} % in motion)" for name, held in in_motion if held < _NARROW]
    if narrow:
        text += f" Its 90 % band is too narrow at {', '.join(narrow)}."
    if guard is not None and guard.misses > _UNNOTICED:
        text += (
            f" Under another excitation it may not notice that it is elsewhere: {100 * guard.misses:.0f} % of the rows of "
            f"motions made of these ({'; '.join(guard.strange)}) pass as known. Its error and its band were measured under "
            "these excitations alone."
        )
    return text


def _when_left_out(selection: Selection, evaluations: Sequence[Comparison]) -> str:
    """What leaving conditions out said."""
    bare, left, noise = selection.means["nothing"], selection.means[selection.family], ""
    if selection.noise > _TELLING * left:
        noise = f"the sensors' noise alone makes {selection.noise:.2f} %"
    if selection.family == "nothing":
        others = [WORDS[family] for family in selection.tried if family != "nothing"]
        return (
            f"No better than the simulation: at conditions that were left out in turn none of what was tried "
            f"({', '.join(others) or 'nothing else'}) beats it by more than its standard error and {100 * HARDLY:.0f} %. "
            + f"Of its error (NRMSE {bare:.2f} %) {noise}. " * bool(noise)
            + "corrector.onnx gives the simulation as it is, with a band"
            + ("." if _is_noise(selection.noise, bare) else "; `fmucorrect discover` may find what it lacks.")
        )
    found = f"{100 * selection.learned:.0f} % of what the simulation lacked"
    if _is_noise(selection.noise, left):
        found = "what the simulation lacked, down to the sensors' noise,"
    few = " Two conditions can hardly tell which corrector is the best: more records would." * (
        len(selection.held_out) == 2
    )
    return (
        f"Learned {found} at {_places(evaluations)} it had not seen (each left out of the fit in turn; error, NRMSE, "
        f"{bare:.2f} -> {left:.2f} %"
        + f", of which {noise}" * bool(noise)
        + f"). Taken: {WORDS[selection.family]}.{few}"
    )


def _held_out(unseen: Sequence[Comparison]) -> str:
    """What was learned of what nothing was fitted to; nothing where it has not become better."""
    bare, left = [item.before.nrmse for item in unseen], [item.after.nrmse for item in unseen]
    floors = [known_floor(item.noise, [item.before.nrmse, item.after.nrmse]) for item in unseen]
    share = removed(bare, left, floors)
    if share <= 0.0:
        return ""
    noise, named = sum(float(floor.mean()) for floor in floors), ", ".join(item.condition.name for item in unseen)
    found = f"{100 * share:.0f} %"
    if _is_noise(noise, sum(item.after.mean_nrmse for item in unseen)):
        found = "down to the sensors' noise"
    return f" At {named}, held out of everything: {found}."


def _is_noise(noise: float, left: float) -> bool:
    """Whether the error that is left is the sensors' noise, as far as that is known; both NRMSE in %."""
    return noise > _NOISE * left


def _worse(item: Comparison) -> str:
    """Where the mean error has grown, or that of channels, with their names; nothing where none has."""
    name = item.condition.name
    if mean := _grown(item.before.mean_nrmse, item.after.mean_nrmse):
        return f"{name} ({mean})"
    each = [
        f"{channel.name} {found}"
        for channel, *errors in zip(item.channels, item.before.nrmse, item.after.nrmse, strict=True)
        if (found := _grown(*errors))
    ]
    return f"{name} in {', '.join(each)}" if each else ""


def _grown(before: float, after: float) -> str:
    """From where to where an error has grown, NRMSE in %; nothing where it has not."""
    return f"{before:.2f} -> {after:.2f} %" if after > before * (1.0 + _WORSE) else ""


def _places(evaluations: Sequence[Comparison]) -> str:
    """What was left out at a time: a speed, where the development conditions have several."""
    speeds = {item.condition.speed for item in evaluations if item.condition.role == "development"}
    return "speeds" if len(speeds) > 1 else "conditions"


_TELLING = 0.3
"""Share of what is left that noise makes, from which it is told: below, the error without it is the same within 5 %."""
_NOISE = 0.95
"""Share of what is left that noise makes, from which nothing is said of the rest: noise itself is known no better."""
_NARROW = 0.8
"""Share of the measured samples in motion below which a band that is stated as 90 % is told to be too narrow."""
_UNNOTICED = 0.1
"""Share of the rows of made motions that pass as known from which it is told, so that who moves so knows it beforehand."""
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


Motion = tuple[str, float, float | None]
"""What was done, share flagged of the rows in motion, share of the measured samples that the 90 % band holds (None: nothing was
measured)."""


def guarded(guard: Guard, selection: Selection, evaluations: Sequence[Comparison]) -> list[Motion]:
    """The guard's table: conditions that were left out, those that were held out of everything, and motions made of those of
    development."""
    left = [(f"{name}, left out", share, selection.covered[name]) for name, share in guard.flagged.items()]
    unseen = [
        (
            f"{item.condition.name}, held out of everything",
            flagged_in_motion(guard, item),
            float(item.within(BAND_90).mean()),
        )
        for item in evaluations
        if item.unseen
    ]
    return [*left, *unseen, *((f"development, {name}", share, None) for name, share in guard.strange.items())]


def flagged_in_motion(guard: Guard, item: Comparison) -> float:
    """Share of the rows in motion that are flagged: of a development condition when it was left out of the fit."""
    left = guard.flagged.get(item.condition.name)
    return float((item.status[item.excited] == Status.OUTSIDE).mean()) if left is None else left


def guard_words(guard: Guard, fallback: Fallback | None) -> list[str]:
    """What the guard does, and how often it errs, point by point."""
    looks, limits, each = "", f"threshold {guard.known.threshold:.3g}", ""
    if guard.lately is not None:
        looks = " and at how strong each part of it has been lately"
        limits, each = f"thresholds {guard.known.threshold:.3g} and {guard.lately.threshold:.3g}", " for either"
    then = "There the correction fades to the bare simulation."
    if fallback is not None:
        bare, left = fallback.figures.values()
        then = (
            "There the correction fades to a linear filter of what it sees, one that adds little to what stands still "
            "and was better than the simulation at every condition that was left out (NRMSE "
            f"{bare:.3g} -> {left:.3g} %). The band is then that of the bare simulation. Under another declared condition "
            "nothing is corrected."
        )
    return [
        f"The corrector looks at the motion{looks}, too. Outside is what lies farther from all that development holds than "
        f"conditions did that had been left out ({limits}: at most {100 * FALSE_ALARMS:.1f} % of any one's rows in motion are "
        f"flagged{each}).",
        then,
        f"False alarms: {100 * guard.false_alarms:.1f} % of the rows in motion of conditions that were left out.",
        f"Not noticed: {100 * guard.misses:.0f} % of the rows in motion of motions made of those of development "
        f"({'; '.join(guard.strange)}). Where it flags few of these, they were no news to it: random motion holds small and "
        "slow ones, too. What is not flagged is corrected as if it were known.",
    ]
