"""Running a study's FMU at a condition over a time grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fmucorrect.errors import RecordError, StudyError
from fmucorrect.fmu.stepper import FmuStepper
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Record, Times, join
from fmucorrect.study import Study

_ROWS = 4096


def input_record(t_ns: Times, series: Record) -> Record:
    """The columns of `series` at the times `t_ns`: linear between its rows, held at its ends. Raises RecordError
    when it has none."""
    if not len(series):
        raise RecordError("the time series of the inputs has no rows", where=series.metadata.get("path"))
    seconds, known = (t_ns - series.t_ns[0]) / NANOSECONDS, series.seconds(int(series.t_ns[0]))
    columns = [np.interp(seconds, known, column) for column in series.values.T]
    values = np.stack(columns, axis=1) if columns else np.zeros((len(t_ns), 0))
    return replace(series, t_ns=t_ns, values=values)


def simulate(
    study: Study,
    condition: Condition,
    t_ns: Times,
    *,
    inputs: Record | None = None,
    progress: Callable[[int], object] | None = None,
) -> Record:
    """Run the study's FMU at `condition` and return its channels, then its excitation, at the times `t_ns`.

    inputs: series for FMU inputs on any grid (condition.inputs, read). progress is called with the number of rows done
    since its last call. Raises StudyError when the study has no FMU, and what FmuStepper raises.
    """
    if study.fmu is None:
        raise StudyError(str(study.path), ["[simulation] has no fmu, so that no condition can be simulated"])
    names = inputs.names if inputs is not None else ()
    with FmuStepper(
        study.fmu, study.channels, extra=excitation_channel(study), inputs=names, parameters=study.parameters
    ) as stepper:
        stepper.reset(condition)
        parts: list[Record] = []
        for start in range(0, max(len(t_ns), 1), _ROWS):
            times = t_ns[start : start + _ROWS]
            none = Record(times, np.zeros((len(times), 0)), ())
            parts.append(stepper.process(input_record(times, inputs) if inputs is not None else none))
            if progress is not None:
                progress(len(times))
    return join(parts)


def excitation_channel(study: Study) -> tuple[Channel, ...]:
    """The excitation as a channel to log beside the responses; () where the study names none, or where
    a response carries it already."""
    excitation = study.excitation
    if excitation is None or excitation.simulation in {channel.name for channel in study.channels}:
        return ()
    return (Channel(excitation.simulation, unit="", simulation=excitation.simulation),)
