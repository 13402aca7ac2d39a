"""A first study, drafted from an FMU and the logs of some runs: every guess is marked as one, with its reason.

    found = draft("quarter_car.fmu", ["run1.mf4", "run2.mf4"])
    print(found.text(Path("study.toml")))

Columns that are named as inputs of the FMU drive it. Then the model runs once with them, and measured columns are paired
with outputs by name, unit and what they show, sign included (`pairing`). Joints are inputs that push and outputs that give
way; the sign is found by pushing (`joints`). `parameters` are those of stiffness, damping and inertia, `written` is the text.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path

from fmucorrect.drafting.joints import find_joints, joint_units
from fmucorrect.drafting.pairing import find_channels, find_inputs, input_units, quiet, read_run, step_of, try_out
from fmucorrect.drafting.parameters import find_parameters
from fmucorrect.drafting.written import Draft, DraftedRun
from fmucorrect.errors import FmuError, RecordError, few
from fmucorrect.fmu import open_fmu

__all__ = ["STEPS", "Draft", "draft"]

STEPS = ("reading", "simulating", "pushing")
"""What draft() does, as it tells `progress`."""


def draft(
    fmu: str | PathLike[str],
    runs: Sequence[str | PathLike[str]],
    references: Sequence[str | PathLike[str]] = (),
    progress: Callable[[str], object] = lambda step: None,
) -> Draft:
    """What a study of these runs would say. references: simulated records, one a run, which replace running the FMU for it.
    The model runs once, over the first run. Raises FmuError and RecordError for files that cannot be used, and where no
    column shows any output.
    """
    if not runs:
        raise RecordError("there is no run to draft from", remedy="Name one log or more.")
    if references and len(references) != len(runs):
        raise RecordError(
            "there must be one simulated record for each run, or none", expected=len(runs), got=len(references)
        )
    progress(STEPS[0])
    model = open_fmu(Path(fmu))
    if not [v for v in model.of("output") if v.number]:
        raise FmuError("it has no outputs that could be compared", where=str(fmu))
    logs = [read_run(Path(run)) for run in runs]
    step_ns, why = step_of(model, logs[0])
    inputs = find_inputs(model, logs[0])
    progress(STEPS[1])
    trial = try_out(model, logs[0], inputs, step_ns)
    channels = find_channels(model, logs[0], trial)
    if not channels:
        raise RecordError(
            "no column shows an output of the FMU, by its name or by what it holds",
            where=str(runs[0]),
            expected=f"measurements of {few([v.name for v in trial.outputs])}",
            got=few(trial.columns),
            remedy="Write the study by hand (fmucorrect/README.md), or give the columns the names of the outputs.",
        )
    progress(STEPS[2])
    joints = find_joints(model, tuple(inputs))
    units = joint_units(model, joints) | input_units(model, logs[0], inputs)
    units |= {guess.output: guess.variable_unit for guess in channels if guess.variable_unit}
    held_out = len(logs) - 1 if len(logs) > 1 else None
    drafted = [
        DraftedRun(
            log.path,
            Path(references[i]) if references else None,
            "evaluation" if i == held_out else "development",
            tuple(column for column in (*(g.column for g in channels), *inputs.values()) if column not in log.columns),
        )
        for i, log in enumerate(logs)
    ]
    return Draft(
        model=model,
        step_ns=step_ns,
        why_step=why,
        inputs=inputs,
        channels=channels,
        joints=joints,
        parameters=find_parameters(model),
        runs=tuple(drafted),
        quiet=quiet(trial),
        units=units,
        unpaired=tuple(c for c in trial.columns if c not in {guess.column for guess in channels}),
        left_out=logs[0].left_out,
    )
