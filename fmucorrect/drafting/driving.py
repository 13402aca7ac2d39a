"""Which columns of a log drive which inputs of the FMU: by name and unit, and where no name tells by what they do. The model
then runs with a column as that input, and what comes out is held against what was measured beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

from fmucorrect import units
from fmucorrect.drafting.guess import as_well, likeness, names, quantity, role, si
from fmucorrect.drafting.joints import find_joints, kind, kind_by_name
from fmucorrect.drafting.log import Run
from fmucorrect.drafting.pairing import (
    NAMED,
    RARE,
    SHOWS,
    TIED,
    ChannelGuess,
    away,
    correlations,
    family,
    find_channels,
    may_be,
)
from fmucorrect.drafting.trial import Plant, Trial, counted_in, is_share, try_out
from fmucorrect.drafting.vocabulary import COMMAND, MEASURED
from fmucorrect.errors import FmuError, SignalError
from fmucorrect.fmu import FmuDescription, Variable

TRIED = 40
"""Runs of the model that one input is looked for in, the likeliest names first."""
LESS = 0.5
"""Share of what the responses do not explain that a further input may leave: what a model lacks, a measured force beside it
explains a little of by chance."""
CHANCE = 4.0
"""Standard deviations of the correlation of two noises: few rows show nothing."""
COPY, NEARLY = 0.9999, 0.98
"""Correlation from which a series is another one once more, and no response to it; NEARLY (filtered, another sensor) counts
once something drives the model: before, what a spring shows that is moved slowly is as much alike."""
OPPOSED = 0.1
"""What a driver must explain more, of one response, for which most responses go the other way: a brake for a drive, say."""
SAME_SIZE = 0.5
"""Powers of ten within which a unit makes simulated and measured of one size: half of those between two units."""


@dataclass(frozen=True)
class InputGuess:
    """A column that drives an input. column_unit: of a column that the file leaves without, where the variable's own is not
    it; else "". variable_unit: of an input that the FMU leaves without, where the fit tells it; else ""."""

    variable: str
    column: str
    why: str
    column_unit: str = ""
    variable_unit: str = ""


@dataclass(frozen=True)
class Driving:
    """trial: the run with these inputs. untried: columns and inputs that were not tried out together, as there are too many."""

    inputs: tuple[InputGuess, ...]
    trial: Trial
    untried: int = 0


def named(fmu: FmuDescription, log: Run) -> tuple[InputGuess, ...]:
    """The inputs for which the log has a column by its name."""
    found: dict[str, tuple[float, InputGuess]] = {}
    scored = sorted(_scored(fmu, log), key=lambda item: -item[0])
    for score, guess in scored:
        if guess.variable not in found and guess.column not in {other.column for _, other in found.values()}:
            found[guess.variable] = score, guess
    columns = {guess.column for _, guess in found.values()}
    free = [(by, g) for by, g in scored if g.variable not in found or g.column not in columns]
    return tuple(
        replace(guess, why=guess.why + as_well(_twins(guess, [other for by, other in free if by == score])))
        for score, guess in found.values()
    )


def _scored(fmu: FmuDescription, log: Run) -> list[tuple[float, InputGuess]]:
    """Inputs and columns that are named alike, with their likeness. A column that is named more like an output is a response;
    one that is named as much like it drives no force at a joint, and neither does one that says neither that it is a command
    nor all of that input's name: what was measured of the force there is no input."""
    scored = [
        (score, variable, column)
        for variable in fmu.of("input")
        if variable.number
        for column, unit in log.columns.items()
        if may_be(variable.unit, unit, fmu.defined) and may_drive(log, column, variable)
        if (score := likeness(variable.name, column)) >= NAMED and score >= _like_an_output(fmu, log, column)
    ]
    unclear = {
        (variable.name, column)
        for score, variable, column in scored
        if kind(variable) == "force" and log.role(column) != COMMAND
        if not names(column, variable.name) or score == _like_an_output(fmu, log, column)
    }
    ports = {joint.force for joint in find_joints(fmu, ())} if unclear else ()
    return [
        (score, InputGuess(variable.name, column, f"alike names ({score:.2f})"))
        for score, variable, column in scored
        if variable.name not in ports or (variable.name, column) not in unclear
    ]


def _like_an_output(fmu: FmuDescription, log: Run, column: str) -> float:
    """Likeness of a column's name to the output that it could show by its unit and is named most like; 0 of a command."""
    unit, outputs = log.columns[column], [v for v in fmu.of("output") if v.number]
    alike = (likeness(column, v.name) for v in outputs if may_be(v.unit, unit, fmu.defined))
    return 0.0 if log.role(column) == COMMAND else max(alike, default=0.0)


def may_drive(log: Run, column: str, variable: Variable) -> bool:
    """Whether a column may be this input by what their names say: what was measured is no command."""
    return not (role(variable.name) == COMMAND and log.role(column) == MEASURED)


def find_driving(fmu: FmuDescription, log: Run, step_ns: int) -> Driving:
    """What drives the model. Raises FmuError and SignalError: of the model."""
    inputs = named(fmu, log)
    with closing(Plant(fmu)) as plant:
        driving = Driving(inputs, _run(plant, log, inputs, step_ns))
        while (further := _further(plant, log, driving, step_ns)) is not None:
            driving = further
        if alone := _alone(fmu, log, driving):
            inputs = (*driving.inputs, *alone)
            driving = replace(driving, inputs=inputs, trial=_run(plant, log, inputs, step_ns))
        driving = _sized(plant, log, driving, step_ns)
    spelled = [replace(g, column_unit=log.columns[g.column]) if g.column in log.spelled else g for g in driving.inputs]
    return replace(driving, inputs=tuple(spelled))


def _run(plant: Plant, log: Run, inputs: Sequence[InputGuess], step_ns: int) -> Trial:
    known = {guess.variable: guess.variable_unit for guess in inputs if guess.variable_unit}
    return try_out(plant, log, {guess.variable: guess.column for guess in inputs}, step_ns, known)


def _further(plant: Plant, log: Run, known: Driving, step_ns: int) -> Driving | None:
    """With one more input, which no name tells; None where no column shows that it is one."""
    fmu = plant.fmu
    pairs = sorted(_possible(fmu, log, known), key=lambda pair: -log.alike(pair[1], pair[0].name))
    shown = {guess.column: guess.shown for guess in find_channels(fmu, log, known.trial)}
    tried: list[tuple[float, InputGuess]] = []
    best: tuple[float, Trial] | None = None
    for variable, column in sorted(pairs[:TRIED], key=lambda pair: pair[0].name):  # one process for each input
        inputs = {guess.variable: guess.column for guess in known.inputs} | {variable.name: column}
        try:
            trial = try_out(plant, log, inputs, step_ns)
        except (FmuError, SignalError):  # the model does not bear this column: it is not its input
            continue
        found = _shown(fmu, log, known, trial, column, shown, told=_of_one_kind(fmu, log, variable, column) is True)
        if found is None:
            continue
        gain, response = found
        why = f"no name tells; with it, {response.output} shows {response.column} ({response.why})"
        score = gain + log.alike(column, variable.name)
        tried.append((score, InputGuess(variable.name, column, why)))
        if best is None or score > best[0]:
            best = score, trial
    if best is None:
        return None
    guess = next(guess for score, guess in tried if score == best[0])
    twins = as_well(_twins(guess, [other for score, other in tried if score > best[0] - TIED]))
    return Driving((*known.inputs, replace(guess, why=guess.why + twins)), best[1], max(len(pairs) - TRIED, 0))


def _twins(guess: InputGuess, others: Sequence[InputGuess]) -> list[str]:
    """Columns of these for its input, and inputs for its column."""
    columns = [other.column for other in others if other.variable == guess.variable and other.column != guess.column]
    return columns + [g.variable for g in others if g.column == guess.column and g.variable != guess.variable]


def _alone(fmu: FmuDescription, log: Run, known: Driving) -> tuple[InputGuess, ...]:
    """Inputs that no column drives yet and that are alone of their kind, where one column that is used for nothing is of it
    and no output: it can be nothing else."""
    every = [v for v in (*fmu.of("input"), *fmu.of("output")) if v.number]
    said = {column: unit for column, unit in log.columns.items() if unit not in units.UNSAID}
    found: dict[str, str] = {}
    for variable in fmu.of("input"):
        fits = [column for column, unit in said.items() if may_be(variable.unit, unit, fmu.defined)]
        alike = [v for v in every if may_be(v.unit, variable.unit, fmu.defined)]
        if variable.unit not in units.UNSAID and len(fits) == 1 and alike == [variable]:
            found[variable.name] = fits[0]
    rest = _undriven(fmu, [guess.variable for guess in known.inputs]) if found else ()
    why = "the only input, and the only column, in units of that kind"
    return tuple(InputGuess(v.name, found[v.name], why) for v in rest if v.name in found)


def _undriven(fmu: FmuDescription, driven: Sequence[str]) -> list[Variable]:
    """Inputs that move a model and that nothing drives; a force at a joint waits for what the model lacks."""
    free = [v for v in fmu.of("input") if v.number and not v.discrete and v.name not in driven]
    pushing = {joint.force for joint in find_joints(fmu, driven)} if driven and free else ()
    return [variable for variable in free if variable.name not in pushing]


def _possible(fmu: FmuDescription, log: Run, known: Driving) -> Iterator[tuple[Variable, str]]:
    """Inputs without a column, and columns that move and may be of the same quantity, but for those that are named as an
    output; of an input that is named as a command none but commands, where there are any. Once something drives the model, a
    force at a joint is left to what the model lacks."""
    driven = [guess.variable for guess in known.inputs]
    moving = dict(zip(known.trial.columns, np.ptp(known.trial.measured, axis=0) > 0.0, strict=True))
    outputs = {
        column
        for column, unit in log.columns.items()
        for output in known.trial.outputs
        if may_be(output.unit, unit, fmu.defined) and likeness(column, output.name) >= NAMED
        if log.role(column) != COMMAND
    }
    for variable in _undriven(fmu, driven):
        found: list[str] = []
        for column, unit in log.columns.items():
            fits = _of_one_kind(fmu, log, variable, column) is not False and may_be(variable.unit, unit, fmu.defined)
            if fits and moving.get(column) and column not in outputs and may_drive(log, column, variable):
                found.append(column)
        commands = [column for column in found if log.role(column) == COMMAND == role(variable.name)]
        yield from ((variable, column) for column in commands or found)


def _of_one_kind(fmu: FmuDescription, log: Run, variable: Variable, column: str) -> bool | None:
    """Whether a column and an input are of one kind, by units or else words; None where one of them does not tell."""
    unit = log.columns[column]
    theirs = kind_by_name(column) if unit in units.UNSAID else quantity(unit, fmu.defined)
    theirs = "displacement" if theirs == "angle" else theirs
    return theirs == kind(variable) if theirs and kind(variable) else None


def _shown(
    fmu: FmuDescription, log: Run, known: Driving, trial: Trial, column: str, shown: Mapping[str, float], *, told: bool
) -> tuple[float, ChannelGuess] | None:
    """By how much the responses are explained better with this column as an input, and the response that shows it best; None
    where that is not enough: once something drives the model, a further input explains most of what was left of them, or a
    response that nothing explained before. What the column itself showed of an output before is lost: a response that is
    taken for an input makes others look explained. Where nothing drives the model yet, a column that is `told` to be of the
    input's kind needs no more than a response by its own name that is no chance: what the model lacks may keep both apart.
    shown: what each column showed before."""
    driven = known.trial.measured[: len(trial.simulated), [known.trial.columns.index(column)]]
    copied = np.abs(correlations(known.trial.measured[: len(driven)], driven))[:, 0]
    others = [c for c, r in zip(known.trial.columns, copied, strict=True) if r < (NEARLY if known.inputs else COPY)]
    # an output shows the input of the step before, where the model hands it through
    echoes = [correlations(trial.simulated[late : len(driven)], driven[: len(driven) - late]) for late in (0, 1)]
    echoed = np.abs(np.hstack(echoes)).max(axis=1) >= COPY
    before = {guess.column: guess.shown for guess in find_channels(fmu, log, known.trial.only(others))}
    after = find_channels(fmu, log, replace(trial.only(others), simulated=np.where(echoed, 0.0, trial.simulated)))
    best = max(after, key=lambda guess: abs(guess.shown), default=None)
    enough = 0.0 if told and not known.inputs and best is not None and log.same(best.column, best.output) else SHOWS
    if best is None or abs(best.shown) < max(enough, CHANCE / np.sqrt(len(trial.measured))):
        return None
    left = sum(1.0 - guess.shown**2 for guess in after)
    was = sum(1.0 - before.get(guess.column, 0.0) ** 2 for guess in after)
    gain = was - left - shown.get(column, 0.0) ** 2
    gain -= OPPOSED * (2 * sum(guess.shown < 0.0 for guess in after) > len(after))
    if known.inputs and (gain <= 0.0 or (left > LESS * was and all(guess.column in shown for guess in after))):
        return None
    return gain, best


def _sized(plant: Plant, log: Run, driving: Driving, step_ns: int) -> Driving:
    """With the unit of the one column that drives and says none, where the responses say together that it is not the
    variable's own: what drives a linear model sizes them all."""
    fmu = plant.fmu
    unsaid = [g for g in driving.inputs if log.columns[g.column] in units.UNSAID]
    channels = find_channels(fmu, log, driving.trial)
    if len(driving.inputs) == 1 and channels and (share := _share(plant, log, driving, channels, step_ns)):
        return share
    if len(unsaid) != 1 or not channels:
        return driving
    (guess,), own = unsaid, fmu.variables[unsaid[0].variable].unit
    odd = {
        unit: _odd(fmu, log, driving.trial, channels, units.conversion(unit, own, "", fmu.defined))
        + RARE * (unit != own)
        for unit in family(own, fmu.defined)
    }
    unit = min(odd, key=lambda other: odd[other])
    if odd[own] - odd[unit] > SAME_SIZE and odd[unit] <= SAME_SIZE * len(channels):
        inputs = _with(driving.inputs, replace(guess, column_unit=unit))
        told = replace(log, columns={**log.columns, guess.column: unit})
        return Driving(inputs, _run(plant, told, inputs, step_ns), driving.untried)
    if odd[own] <= SAME_SIZE * len(channels):
        return driving
    why = f"{guess.why}; it says no unit, and what is measured is of another size than what comes out"
    return replace(driving, inputs=_with(driving.inputs, replace(guess, why=why)))


def _share(plant: Plant, log: Run, driving: Driving, channels: Sequence[ChannelGuess], step_ns: int) -> Driving | None:
    """With the unit of an input without one whose column is in %, where the model fits better in size if it counts shares
    otherwise than its description and bounds let one think, to one or to a hundred; None where it does not."""
    (guess,), fmu = driving.inputs, plant.fmu
    if fmu.variables[guess.variable].unit not in units.UNSAID or not is_share(log.columns[guess.column]):
        return None
    now = counted_in(fmu.variables[guess.variable])
    other = "1" if now == "%" else "%"
    factor = units.conversion(now, other, "")
    own, changed = (_odd(fmu, log, driving.trial, channels, by) for by in (1.0, factor))
    if own - changed <= SAME_SIZE or changed > SAME_SIZE * len(channels):
        return None
    inputs = (replace(guess, variable_unit=other),)
    return Driving(inputs, _run(plant, log, inputs, step_ns), driving.untried)


def _odd(fmu: FmuDescription, log: Run, trial: Trial, channels: Sequence[ChannelGuess], factor: float) -> float:
    """Powers of ten by which measured and simulated differ in size, of all channels together, had the model been driven
    `factor` times as hard; a channel whose column says no unit has the one that fits best."""
    found = 0.0
    for guess in channels:
        output, ratio = fmu.variables[guess.output].unit, trial.ratio(guess.column, guess.output) / factor
        if log.columns[guess.column] not in units.UNSAID:
            own = si(guess.unit) if output in units.UNSAID else output
            found += abs(np.log10(ratio * units.conversion(guess.unit, own, guess.column, fmu.defined)))
        else:
            own = guess.variable_unit or output
            found += min(off + RARE * (unit != own) for unit, off in away(own, ratio, fmu.defined).items())
    return float(found)


def _with(inputs: Sequence[InputGuess], told: InputGuess) -> tuple[InputGuess, ...]:
    return tuple(told if guess.variable == told.variable else guess for guess in inputs)
