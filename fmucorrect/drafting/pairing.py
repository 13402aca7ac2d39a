"""Which columns of a log are measurements of which output: by name and unit, and by what they show when the model has run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fmucorrect import units
from fmucorrect.drafting.guess import SENSED, quantity, role, si, words
from fmucorrect.drafting.joints import kind, kind_by_name, unit_of, written_out
from fmucorrect.drafting.log import Run
from fmucorrect.drafting.trial import Trial
from fmucorrect.drafting.vocabulary import COMMAND, MEASURED, meaning
from fmucorrect.fmu import FmuDescription, Variable
from fmucorrect.metrics import linear_share
from fmucorrect.signals import QUANTITIES
from fmucorrect.study_places import like
from fmucorrect.units import UNSAID

NAMED = 0.8
"""Likeness of names from which a column is what it is named as."""
SHOWS = 0.5
"""Correlation from which a column shows an output, whatever it is called."""
HINTS = 0.2
"""Correlation that a column needs whose name says it already, but not word for word: a model that lacks something may be far
off. With less nothing is known of a sensor's sign."""
HEARD = 0.5
"""Share of a column's power that is linear in an output, from which it is of it, where no correlation says so: a model whose
resonance is elsewhere than the machine's answers a random excitation with quite another series."""
SIZED = 1.0
"""Powers of ten by which it may be larger or smaller; what is only related to the output is off by more."""
MOST_OF_SIZE = 0.5
"""What their sizes take at most from the correlation of a column and an output and the likeness of their names, where both say
their units, as many as powers of ten are between them: letters that happen to be alike are worth less, and outputs that go
alike are told apart by it."""
TIED = 0.05
"""Correlation and likeness together, by which another column may stand behind the best and still be the one."""


@dataclass(frozen=True)
class ChannelGuess:
    """A measured column and the output that it shows. unit: of the column, or of the output where it says none. sign: -1
    where the sensor's positive direction is the other way. shown: their correlation. variable_unit: of an output that the
    FMU leaves without, "" where it says one. column_unit: of a column that the file leaves without, "" where it says one.
    rivals: columns that show it as well. twins: outputs that the column may as well show, as neither names nor numbers tell.
    heard: whether `shown` is what `Run.heard` looks at. run: the run that tells, "" for the first that was looked at."""

    column: str
    output: str
    unit: str
    quantity: str
    sign: int
    shown: float
    alike: float
    variable_unit: str = ""
    column_unit: str = ""
    rivals: tuple[str, ...] = ()
    twins: tuple[str, ...] = ()
    heard: bool = False
    run: str = ""

    @property
    def why(self) -> str:
        """What tells that the column shows the output."""
        if self.heard:
            return f"of its size and linear in it ({abs(self.shown):.2f} of 1), though no correlation tells"
        where = f" in {self.run}" if self.run else ""
        return f"correlation {self.shown:+.2f}{where}{', which says little' * self.by_name}"

    @property
    def by_name(self) -> bool:
        """Whether nothing but its name tells."""
        return not self.heard and abs(self.shown) < HINTS


def may_be(one: str, other: str, known: Mapping[str, units.Unit] = units.NONE) -> bool:
    """Whether values in these units, which `known` explains first, can be of one thing; a unit that nobody says may be any."""
    one, other = (SENSED.get(unit, unit) for unit in (one, other))
    return one in units.UNSAID or other in units.UNSAID or like(one, other, known)


def find_channels(fmu: FmuDescription, log: Run, trial: Trial) -> tuple[ChannelGuess, ...]:
    """The best assignment of columns to outputs, each used once."""
    from scipy.optimize import linear_sum_assignment

    shown = correlation = correlations(trial.measured, trial.simulated)
    if trial.heard:
        shown = _heard(fmu, log, trial, shown)
    alike = np.array([[log.alike(c, o.name) for o in trial.outputs] for c in trial.columns]).reshape(shown.shape)
    fits = [
        [
            c not in log.repeated and _may_show(log.columns[c], c, o, fmu) and not _other_role(log.role(c), o)
            for o in trial.outputs
        ]
        for c in trial.columns
    ]
    score = np.where(
        np.reshape(fits, shown.shape), np.maximum(np.abs(shown) + alike - _misfit(log, trial, fmu), 0.0), -1.0
    )
    # its own name is enough, of what moves, in a log without numbers that look like lost samples
    same = np.array([[log.same(c, o.name) for o in trial.outputs] for c in trial.columns]).reshape(shown.shape)
    by_name = same & (correlation != 0.0) & (not log.stand_ins)
    said = by_name | ((alike >= NAMED) & (np.abs(shown) >= HINTS))
    sure = (score >= 0.0) & ((np.abs(shown) >= SHOWS) | said)
    pairs = [(int(c), int(o)) for c, o in zip(*linear_sum_assignment(-score), strict=True) if sure[c, o]]
    free = sorted(set(range(len(trial.columns))) - {c for c, _ in pairs})
    found: list[ChannelGuess] = []
    for c, o in pairs:
        r, name = float(shown[c, o]), float(alike[c, o])
        column, variable = trial.columns[c], trial.outputs[o]
        ratio = trial.ratio(column, variable.name)
        unit, variable_unit, column_unit = _units(log.columns[column], variable, ratio, fmu.defined)
        what = quantity(unit, fmu.defined)
        if what is not None:
            found.append(
                ChannelGuess(
                    column,
                    variable.name,
                    unit,
                    what,
                    -1 if correlation[c, o] <= -HINTS else 1,
                    r,
                    name,
                    variable_unit,
                    column_unit or (unit if column in log.spelled else ""),
                    tuple(trial.columns[i] for i in free if score[i, o] > score[c, o] - TIED),
                    tuple(trial.outputs[i].name for i in _twins(score, pairs, c, o)),
                    trial.heard,
                )
            )
    return tuple(sorted(found, key=lambda guess: trial.columns.index(guess.column)))


def _misfit(log: Run, trial: Trial, fmu: FmuDescription) -> Float64[np.ndarray, "C O"]:
    """What speaks against each column being each output as one is larger, where both say their units; 0 where one says none."""
    found = np.zeros((len(trial.columns), len(trial.outputs)))
    for (c, o), _ in np.ndenumerate(found):
        unit, output = log.columns[trial.columns[c]], trial.outputs[o].unit
        if not {unit, output} & UNSAID and may_be(unit, output, fmu.defined) and np.ptp(trial.simulated[:, o]) > 0.0:
            factor = units.conversion(SENSED.get(unit, unit), output, "", fmu.defined)
            off = abs(np.log10(max(factor * trial.ratio(trial.columns[c], trial.outputs[o].name), 1e-300)))
            found[c, o] = min(off, MOST_OF_SIZE)
    return found


def _twins(score: Float64[np.ndarray, "C O"], pairs: Sequence[tuple[int, int]], c: int, o: int) -> list[int]:
    """Outputs that a column shows as well as its own: those that no column shows, and those whose column may change places."""
    column = {output: one for one, output in pairs}
    found: list[int] = []
    for other in range(score.shape[1]):
        own, free = column.get(other, c), other not in column
        least = min(score[c, other], score[own, o])
        change = score[c, o] - score[c, other] + (0.0 if free else score[own, other] - score[own, o])
        if other != o and least >= 0.0 and change < TIED:
            found.append(other)
    return found


def _may_show(unit: str, column: str, output: Variable, fmu: FmuDescription) -> bool:
    """By their units, and where one of them has none by what its name says: no acceleration shows a displacement."""
    if unit in units.UNSAID:
        told, own = kind_by_name(column), kind(output)
    elif output.unit in units.UNSAID:
        told, own = quantity(unit, fmu.defined) or "", written_out(output)
        told = "displacement" if told == "angle" else told
    else:
        told = own = ""
    return may_be(unit, output.unit, fmu.defined) and (not told or own in ("", told))


def _other_role(told: str, output: Variable) -> bool:
    """Whether one of them is named as a command and the other is not: what was asked for shows no response."""
    own = role(output.name)
    return (told == COMMAND) != (own == COMMAND) and told in (COMMAND, MEASURED)


def _units(column: str, variable: Variable, ratio: float, defined: Mapping[str, units.Unit]) -> tuple[str, str, str]:
    """The unit of a channel, and those of output and column where they say none. ratio: measured over simulated, numbers
    alone. Where neither says one, the output's name may tell what it is; else it is a displacement. A model without units
    computes in SI, unless that makes it smaller or larger than the measurement by far."""
    output = variable.unit
    if column not in units.UNSAID:
        unit = SENSED.get(column, column)
        return unit, "" if output not in units.UNSAID else _model_unit(unit, ratio), ""
    unit = output if output not in units.UNSAID else unit_of(variable) or _of_quantity(variable.name) or "m"
    told = min(off := away(unit, ratio, defined), key=lambda other: off[other])
    return told, "" if output not in units.UNSAID else unit, told


def _of_quantity(name: str) -> str:
    """The SI unit of a current or a pressure by that word of a name; "" where it has none."""
    told = {means for word in words(name) for means in (word, *meaning(word))}
    return next((QUANTITIES[what][0] for what in ("current", "pressure") if what in told), "")


def away(unit: str, ratio: float, defined: Mapping[str, units.Unit] = units.NONE) -> dict[str, float]:
    """Powers of ten between measured and simulated, by the unit of a measurement whose numbers are `ratio` times as large as
    those of an output in `unit`."""
    return {
        other: abs(float(np.log10(max(ratio, 1e-300) * units.conversion(other, unit, "", defined))))
        for other in family(unit, defined)
    }


def _model_unit(unit: str, ratio: float) -> str:
    """The unit of an output whose numbers are `ratio` times smaller than a measurement in `unit`."""
    off = away(unit, 1.0 / max(ratio, 1e-300))
    return min(off, key=lambda other: off[other] + RARE * (other != si(unit)))


def family(unit: str, defined: Mapping[str, units.Unit] = units.NONE) -> list[str]:
    """Units of the same quantity, SI first, of one that `defined` explains first."""
    usual = _FAMILIES.get(quantity(unit, defined) or "", ())
    return list(dict.fromkeys([si(unit), unit, *(other for other in usual if may_be(other, unit, defined))]))


_FAMILIES = {
    "displacement": ("m", "cm", "mm", "um"),
    "velocity": ("m/s", "mm/s", "m/min", "km/h", "rpm", "deg/s"),
    "acceleration": ("m/s2", "gn", "mgn", "mm/s2"),
    "force": ("N", "kN"),
    "angle": ("rad", "deg", "mrad"),
    "pressure": ("Pa", "bar", "MPa"),
    "current": ("A", "mA"),
}


RARE = 0.15
"""Powers of ten by which numbers have to speak more for another unit than for SI: a model in m/s is taken for one in km/h if it
is 2.3 times too slow, one in rad/s for one in rpm if it is 3.6 times too slow."""


def correlations(
    measured: Float64[np.ndarray, "T C"], simulated: Float64[np.ndarray, "T O"]
) -> Float64[np.ndarray, "C O"]:
    """Of all columns with all outputs, means taken off; 0 where either does not move."""
    a, b = (x - x.mean(axis=0) for x in (measured, simulated))
    norms = [np.linalg.norm(x, axis=0) for x in (a, b)]
    scale = np.outer(*norms)
    moving = np.outer(norms[0] > 0.0, norms[1] > 0.0)
    return np.where(moving, (a.T @ b) / np.where(moving, scale, 1.0), 0.0)


def _heard(
    fmu: FmuDescription, log: Run, trial: Trial, correlation: Float64[np.ndarray, "C O"]
) -> Float64[np.ndarray, "C O"]:
    """The share of each column's power that is linear in each output, less what it is larger or smaller (powers of ten), with
    the sign of their correlation; 0 where it is of another size. A column without a unit is taken in the output's."""
    found, length = np.zeros_like(correlation), len(trial.measured) // 8
    if length < 8:
        return found
    for (c, o), sign in np.ndenumerate(np.copysign(1.0, correlation)):
        column, output = trial.columns[c], trial.outputs[o]
        measured, simulated, unit = trial.measured[:, c], trial.simulated[:, o], log.columns[column]
        if np.ptp(measured) > 0.0 and np.ptp(simulated) > 0.0 and may_be(unit, output.unit, fmu.defined):
            said = unit not in units.UNSAID and output.unit not in units.UNSAID
            factor = units.conversion(SENSED.get(unit, unit), output.unit, column, fmu.defined) if said else 1.0
            away = abs(np.log10(trial.ratio(column, output.name) * factor)) / SIZED
            share = linear_share(measured, simulated, length)
            if share >= HEARD and away <= 1.0:
                found[c, o] = sign * share * (1.0 - away / 2.0)
    return found
