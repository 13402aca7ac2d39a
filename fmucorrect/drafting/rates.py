"""What a run of the model tells of its outputs, whatever they are called: which is the time derivative of which, and in what
unit one is that the FMU leaves without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from fmucorrect import units
from fmucorrect.drafting.guess import si
from fmucorrect.drafting.joints import RATE_OF, SI, TURNING, JointGuess
from fmucorrect.drafting.pairing import family, may_be
from fmucorrect.drafting.trial import Trial
from fmucorrect.fmu import FmuDescription

CLOSE = 0.05
"""Share by which a derivative may be larger or smaller than the units of both say: a step does that much."""


def by_numbers(
    fmu: FmuDescription,
    joints: Sequence[JointGuess],
    trial: Trial,
    known: Mapping[str, str],
    measured: Mapping[str, str],
) -> tuple[tuple[JointGuess, ...], dict[str, str]]:
    """The joints with the velocities and accelerations that a run of the model shows them to have, and the units of what the
    FMU leaves without, as the numbers of this run ask for. known: these units as they are guessed without. measured: those of
    them that measurements tell; they stay."""
    told = {v.name: v.unit for v in trial.outputs if v.unit not in units.UNSAID} | dict(measured)
    found, shown = list[JointGuess](), {v.name for v in trial.outputs}
    for joint in joints:
        x = joint.displacement
        if not {x, joint.velocity, joint.acceleration} - {""} <= shown:
            found.append(joint)  # one of more outputs than a trial looks at
            continue
        if x not in told:
            told[x] = _as_another(trial, x, told, known[x])
        sizes = TURNING if may_be(told[x], "rad", fmu.defined) else SI
        for of, key in RATE_OF.items():
            joint, told = _with_rate(fmu, joint, key, getattr(joint, of), sizes[key], trial, told)
        found.append(joint)
    return tuple(found), {
        **known,
        **{name: unit for name, unit in told.items() if fmu.variables[name].unit in units.UNSAID},
    }


def _as_another(trial: Trial, name: str, told: Mapping[str, str], guess: str) -> str:
    """The unit of an output that nobody tells: that of another one of its kind which it is the sum or the difference of with a
    third one, or only turned over; numbers add up in one unit alone. The guess where there is none."""
    alike = (other for other, unit in told.items() if may_be(unit, guess))
    return next((told[other] for other in alike if trial.adds_up(name, other)), guess)


def _with_rate(
    fmu: FmuDescription, joint: JointGuess, key: str, of: str, unit: str, trial: Trial, told: Mapping[str, str]
) -> tuple[JointGuess, dict[str, str]]:
    """The joint with what is the time derivative of its variable `of`, and the units with that of it; as they are where no
    output is, or one of another size than its unit says. unit: SI, of such a derivative."""
    own = getattr(joint, key)
    taken = {joint.displacement, joint.velocity, joint.nominal_force, joint.acceleration}
    free = [v.name for v in trial.outputs if v.name not in taken and may_be(told.get(v.name, ""), unit, fmu.defined)]
    name, times = trial.derivative(of, [own] if own else free) if of in told else ("", 0.0)
    if not name:
        return joint, dict(told)
    times *= units.conversion(si(told[of]), told[of], "", fmu.defined)
    fits = {
        u: times * units.conversion(u, unit, "", fmu.defined) for u in ([told[name]] if name in told else family(unit))
    }
    best = min(fits, key=lambda u: abs(fits[u] - 1.0))
    if abs(fits[best] - 1.0) > CLOSE:
        return joint, dict(told)
    joint = joint if own else replace(joint, **{key: name}, by_rate=joint.by_rate | {key})
    return joint, {**told, name: best}
