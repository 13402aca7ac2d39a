"""Places where a force may act: an input that pushes, and the displacement that gives way to it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from fmucorrect import units
from fmucorrect.drafting.guess import DERIVATIVE, quantity, si, words
from fmucorrect.errors import FmuError, SignalError
from fmucorrect.fmu import FmuDescription, Variable
from fmucorrect.fmu.feedthrough import feedthrough
from fmucorrect.study import joint_ports
from fmucorrect.study_places import like

PUSH_NS = 20_000_000
"""For how long an input is pushed: long enough to be seen in a displacement, short against any period."""
BRIEF_NS = 2_500_000
"""And to see how an output begins to move: a displacement that swings with 70 Hz still goes with the square of the time."""
ALIKE = 0.01
"""Share by which two forces may move a displacement otherwise and still act at one place."""
SI = {"displacement": "m", "velocity": "m/s", "force": "N", "acceleration": "m/s2"}
TURNING = {"displacement": "rad", "velocity": "rad/s", "force": "N.m", "acceleration": "rad/s2"}
"""Units of what has none, by its kind: of what moves along, and of what turns."""
_WORDS = {
    "force": frozenset(["f", "fx", "fy", "fz", "force", "torque", "trq", "moment", "mx", "my", "mz", "tau"]),
    "velocity": frozenset(["v", "vel", "velocity", "rate", "omega", "w", "qd", "dq", "speed", "vrel", "wrel"]),
    "acceleration": frozenset(["a", "acc", "accel", "acceleration", "arel"]),
    "displacement": frozenset(
        [
            *("d", "x", "y", "z", "disp", "displacement", "pos", "position", "travel", "stroke", "defl", "deflection"),
            *(
                "compression",
                "extension",
                "elongation",
                "srel",
                "angle",
                "phi",
                "theta",
                "twist",
                "phirel",
                "stretch",
                "s",
                "q",
            ),
        ]
    ),
}
"""Words of a name that tell what a variable without a unit is; `s`, `s_rel` and their kin as Modelica's library has them."""
_TURNS = frozenset("torque trq moment mx my mz tau omega w wrel angle phi theta twist phirel".split())  # noqa: SIM905
"""Of these words, those of what turns."""
RATE_OF = {"displacement": "velocity", "velocity": "acceleration"}
"""What the derivative of each is."""
_ALL = frozenset().union(*_WORDS.values())


@dataclass(frozen=True)
class JointGuess:
    """Names of variables, "" for none; sign as in a study. untold: whether nobody says that its force is one. by_push: whether
    nobody says that its displacement is one, but the force moves it as one. by_rate: which of `velocity` and `acceleration`
    are told by a run of the model, as derivatives."""

    name: str
    force: str
    displacement: str
    velocity: str
    nominal_force: str
    acceleration: str
    sign: int
    untold: bool = False
    by_push: bool = False
    by_rate: frozenset[str] = frozenset()


def find_joints(fmu: FmuDescription, driven: Sequence[str], *, untold: bool = False) -> tuple[JointGuess, ...]:
    """Every force input that is not `driven` and has a displacement of the same name's stem, or else the one that it moves
    most, of its own component (`rack.f_ext`, `rack.flange_a.s`) where that has any. Where it moves no displacement that is
    known, outputs that neither a unit nor a name tells anything of count if it moves them as one. untold: of the inputs that
    neither a unit nor a name tells anything of, in their place. None whose displacement is another force's by its name, and
    which moves it otherwise: it acts elsewhere. Raises FmuError of the pushes."""
    wanted = "" if untold else "force"
    forces = [v for v in fmu.of("input") if v.number and kind(v) == wanted and v.name not in driven]
    forces = [v for v in forces if v.unit in units.UNSAID and not v.discrete] if untold else forces
    outputs = [v for v in fmu.of("output") if v.number and not v.discrete]
    known = [v for v in outputs if kind(v) == "displacement"]
    moved = [*known, *(v for v in outputs if v.unit in units.UNSAID and not kind(v))]
    if not forces or not moved:
        return ()
    pushed = [v.name for v in forces], [v.name for v in moved]
    answers = feedthrough(fmu.path, *pushed, PUSH_NS) / [_in_si(force, fmu.defined) for force in forces]
    if all(v.unit not in units.UNSAID for v in moved):  # without units numbers are rather in one unit than in SI
        answers = answers * [[_in_si(v, fmu.defined)] for v in moved]
    moves = answers != 0.0
    moves[len(known) :] = False
    if len(moved) > len(known) and not moves.any(axis=0).all():
        moves |= ~moves.any(axis=0) & _as_displacements(fmu, *pushed)
    # with how far it is pushed, and whether a name says that the displacement is its own
    guessed = list[tuple[JointGuess, float, bool]]()
    for i, force in enumerate(forces):
        belonging = [j for j, v in enumerate(moved) if _belong(force, v)]
        mine = [j for j in belonging if stem(moved[j].name) == stem(force.name) != ""]
        beside = [j for j in belonging if _component(moved[j].name, force.name)]
        candidates = mine or beside or belonging
        gives = [j for j in candidates if moves[j, i]]
        if not gives:
            continue
        own_words = set(words(force.name))
        shared = [j for j in gives if own_words & set(words(moved[j].name))]  # F_rope and rope_stretch
        j = max(shared or gives, key=lambda j: abs(answers[j, i]))
        alike = [force.name] if mine else [moved[j].name, force.name]
        shown = [v for v in outputs if kind(v) != "force" or _turn_alike(force, v)]
        own = {what: next(filter(None, (_of(shown, what, name) for name in alike)), "") for what in _WORDS}
        joint = JointGuess(
            " ".join(words(stem(force.name))) or force.name,
            force.name,
            moved[j].name,
            own["velocity"],
            own["force"],
            own["acceleration"],
            -1 if answers[j, i] > 0.0 else 1,
            untold,
            j >= len(known),
        )
        guessed.append((joint, abs(float(answers[j, i])), bool(mine or beside or shared)))
    owners = {joint.displacement: push for joint, push, by_name in guessed if by_name}
    found = [
        joint
        for joint, push, by_name in guessed
        if by_name or abs(push - owners.get(joint.displacement, push)) <= ALIKE * push
    ]
    names = [joint.name for joint in found]
    return tuple(joint if names.count(joint.name) == 1 else replace(joint, name=joint.force) for joint in found)


def _in_si(variable: Variable, defined: Mapping[str, units.Unit]) -> float:
    """How large 1 of a variable is in SI; 1 of one without a unit, or with one that nobody knows."""
    try:
        return units.explained(variable.unit, "", defined).factor
    except SignalError:
        return 1.0


def _as_displacements(fmu: FmuDescription, forces: Sequence[str], outputs: Sequence[str]) -> Bool[np.ndarray, "O I"]:
    """Which outputs move with the square of the time while a force pushes, as displacements do; velocities go with the time
    itself, and accelerations are there at once. None of an FMU that does not bear such short steps."""
    try:
        brief, twice = (np.abs(feedthrough(fmu.path, forces, outputs, ns)) for ns in (BRIEF_NS, 2 * BRIEF_NS))
    except FmuError:
        return np.zeros((len(outputs), len(forces)), dtype=bool)
    moving = (brief > 0.0) & (twice > 0.0)
    power = np.log2(np.where(moving, twice, 1.0) / np.where(moving, brief, 1.0))
    return moving & (np.abs(power - 2.0) < 0.5)


def joint_units(fmu: FmuDescription, joints: Sequence[JointGuess]) -> dict[str, str]:
    """The units of their variables that the FMU leaves without one: SI, of what turns where one of a joint's variables does."""
    found: dict[str, str] = {}
    for joint in joints:
        names = (joint.force, joint.displacement, joint.velocity, joint.nominal_force, joint.acceleration)
        own = [fmu.variables[name] for name in names if name]
        known = TURNING if any(map(turns, own)) else SI
        untold = {joint.displacement: "displacement"}
        found |= {v.name: known[kind(v) or untold.get(v.name, "force")] for v in own if not v.unit}
    return found


def loadable(
    joints: Sequence[JointGuess], variables: Mapping[str, str], defined: Mapping[str, units.Unit]
) -> tuple[JointGuess, ...]:
    """The joints as a study of these units takes them: without a velocity, a force or an acceleration in a unit that does not
    belong to the others, and without those whose port itself has such a one. variables: unit by name."""
    found: list[JointGuess] = []
    for joint in joints:
        taken = joint_ports(joint, variables, defined)
        odd = [key for key, (name, known) in taken.items() if not any(like(variables[name], u, defined) for u in known)]
        if not {"force", "displacement"} & set(odd):
            found.append(replace(joint, **dict.fromkeys(odd, "")))
    return tuple(found)


def kind(variable: Variable) -> str:
    """What a variable is: by its unit, else by the last word of its name or the first; "" for neither."""
    if variable.unit not in units.UNSAID:
        found = quantity(variable.unit) or ""
        return "displacement" if found == "angle" else found
    told = _telling(variable)
    return _rated(variable.name, next((what for what, known in _WORDS.items() if told in known), ""))


def kind_by_name(name: str) -> str:
    """What a column is, where one kind alone is written out in its name; single letters mean too much."""
    whole = {bare for word in words(name) if len(bare := word.rstrip("0123456789")) > 2}
    written = {what for what, known in _WORDS.items() if whole & known}
    return _rated(name, written.pop()) if len(written) == 1 else ""


def _rated(name: str, what: str) -> str:
    """What this is, of its derivative where the name is that of one."""
    return RATE_OF.get(what, "") if DERIVATIVE.match(name) else what


def turning(parts: Sequence[str]) -> bool:
    """Whether one of these words is of what turns."""
    return not _TURNS.isdisjoint(parts)


def turns(variable: Variable) -> bool | None:
    """Whether it is a torque or of an angle: by its unit, else by that word of its name. None where neither tells."""
    if variable.unit in units.UNSAID:
        return True if _telling(variable) in _TURNS else None
    return None if quantity(variable.unit) is None else si(variable.unit) in TURNING.values()


def unit_of(variable: Variable) -> str:
    """The SI unit that the name of a variable without one tells; "" where it tells none."""
    return (TURNING if turns(variable) else SI).get(kind(variable), "")


def written_out(variable: Variable) -> str:
    """What a variable is by a word of its name alone; "" where only a letter tells it, which may be an axis or a place, but
    not in a derivative."""
    if DERIVATIVE.match(variable.name):
        return kind(variable)
    told = _telling(variable)
    return next((what for what, known in _WORDS.items() if told in known and len(told) > 1), "")


def _telling(variable: Variable) -> str:
    """The word of its name that tells what it is: one of several letters, that of a rate before others (`strokeVel`), else the
    last or the first letter, the first where nothing but case parts the words (`vF`); "" where none does."""
    name = re.split(r"[./]", DERIVATIVE.sub(r"\1", variable.name))[-1]
    parts = [word.rstrip("0123456789") for word in words(name)]
    if parts[-1:] == ["rel"] and len(parts) > 1:
        parts[-2:] = [f"{parts[-2]}rel"]
    ends = [*parts[-1:], *parts[:1]] if re.search(r"[^A-Za-z0-9]", name) else [*parts[:1], *parts[-1:]]
    told = [word for word in (*ends, *parts) if len(word) > 1 and word in _ALL]
    rates = [word for word in told if word in _WORDS["velocity"] | _WORDS["acceleration"]]  # of what the others name
    return next((word for word in (*rates, *told, *ends) if word in _ALL), "")


def stem(name: str) -> str:
    """A name without what tells its kind: `joint1.f` and `joint1.d` have one stem, so have `F_front` and `d_front`."""
    name = DERIVATIVE.sub(r"\1", name)
    head = re.match(r"(.*)[./][^./]+$", name)
    if head:
        return head.group(1)
    return " ".join(word for word in words(name) if word.rstrip("0123456789") not in _ALL)


def _component(one: str, other: str) -> bool:
    """Whether two names stand below the same first part: `rack.flange_a.s` and `rack.f_ext`."""
    head = re.match(r".+?[./]", one)
    return head is not None and other.startswith(head.group())


def _belong(force: Variable, moved: Variable) -> bool:
    """A force moves metres, a moment radians; where neither a unit nor a name says it, either may be."""
    both = turns(force), turns(moved)
    return None in both or both[0] == both[1]


def _turn_alike(force: Variable, other: Variable) -> bool:
    """Whether both push along an axis, or both turn. Of two names without units a torque's is no force's."""
    both = turns(force), turns(other)
    return both[0] == both[1] or (None in both and bool(force.unit or other.unit))


def _of(outputs: Sequence[Variable], what: str, name: str) -> str:
    """The one output of this kind with the same stem."""
    found = [v.name for v in outputs if kind(v) == what and stem(v.name) == stem(name)]
    return found[0] if len(found) == 1 else ""
