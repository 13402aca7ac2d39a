"""Writes a case as a user would have it: study.toml, the inputs and the measured records."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from bench import ROOT, STEP, Bench, Run, bench
from marks import listed
from specs import Spec

from fmucorrect.records import writer
from fmucorrect.signals import Channel, Record


def write_case(
    on: Bench,
    spec: Spec,
    records: Mapping[str, tuple[np.ndarray, np.ndarray]],
    noise: np.ndarray,
    folder: Path,
    fmus: Path,
) -> None:
    """Everything of a case into `folder`, the FMU into `fmus` once."""
    folder.mkdir(parents=True, exist_ok=True)
    fmus.mkdir(parents=True, exist_ok=True)
    if not (fmus / on.fmu).exists():
        shutil.copy(ROOT / "fmus" / on.fmu.removesuffix(".fmu") / on.fmu, fmus / on.fmu)
    for run in on.runs:
        (folder / f"inputs_{run.name}.csv").write_text(_inputs(on.name, run.name), encoding="utf-8", newline="\n")
        write_record(on, spec, *records[run.name], folder / f"measured_{run.name}.parquet")
    (folder / "study.toml").write_text(study(on, spec, noise), encoding="utf-8", newline="\n")


@cache
def _inputs(name: str, run_name: str) -> str:
    on = bench(name)
    return series_text(on, next(run for run in on.runs if run.name == run_name))


def write_series(on: Bench, run: Run, path: Path) -> None:
    """What the study commands in a run, at every sample of its motion."""
    path.write_text(series_text(on, run), encoding="utf-8", newline="\n")


def series_text(on: Bench, run: Run) -> str:
    """As a CSV file."""
    names = list(run.inputs)
    head = ",".join(["time", *(f"{name} [{on.units[name]}]" for name in names)])
    columns = np.column_stack([np.arange(len(run.inputs[names[0]])) * STEP, *run.inputs.values()])
    moving = np.flatnonzero(np.any(columns[:, 1:] != 0.0, axis=1))
    columns = columns[max(moving[0] - 1, 0) : moving[-1] + 2]
    lines = [head, *(f"{row[0]:.3f}," + ",".join(f"{value:.9g}" for value in row[1:]) for row in columns)]
    return "\n".join(lines) + "\n"


def write_record(on: Bench, spec: Spec, values: np.ndarray, drive: np.ndarray, path: Path) -> None:
    """What the acquisition recorded."""
    channels = [Channel(f"lvdt_{name}", "mm", "displacement") for name in on.channels]
    if spec.recorded != "none":
        channels.append(Channel(on.excitation[1], on.units[on.excitation[0]]))
        values = np.column_stack([values, drive])
    t_ns = np.arange(len(values), dtype=np.int64) * round(STEP * 1e9)
    with writer(path) as out:
        out.write("/measured", Record(t_ns, np.ascontiguousarray(values), tuple(channels)))


def study(on: Bench, spec: Spec, noise: np.ndarray) -> str:
    """study.toml; it says nothing of what is hidden."""
    parts = [
        f"format = 1\nname = {json.dumps(f'{on.name}, {spec.name}')}\n",
        _table("[simulation]", {"fmu": f"../../fmus/{on.fmu}", "step_size": STEP, "parameters": on.parameters}),
    ]
    for (name, variable), level in zip(on.channels.items(), noise, strict=True):
        row = {"name": name, "simulation": variable, "measurement": f"lvdt_{name}", "quantity": "displacement"}
        row |= {"unit": "mm"} | ({"noise": float(f"{level:.4g}")} if spec.noise_known else {})
        parts.append(_table("[[channels]]", row))
    if spec.recorded != "none":
        row = {"simulation": on.excitation[0], "measurement": on.excitation[1], "kind": spec.recorded}
        parts.append(_table("[excitation]", row))
    parts += [_table("[[joints]]", row) for row in on.joints]
    parts += [_table("[[groups]]", row) for row in on.groups]
    parts += [_table("[[rotations]]", row) for row in on.rotations]
    parts += [_table("[[adjustable]]", row) for row in listed(on, spec)]
    return "\n".join([*parts, *map(condition_text, on.runs)])


def condition_text(run: Run) -> str:
    """A run in the study file."""
    row = {"name": run.name, "role": run.role, **run.extra, "start": run.start, "quiet": list(run.quiet)}
    if run.parameters:
        row["parameters"] = dict(run.parameters)
    row |= {"inputs": f"inputs_{run.name}.csv", "measurement": f"measured_{run.name}.parquet"}
    return _table("[[conditions]]", row)


def _table(head: str, row: Mapping) -> str:
    return f"{head}\n" + "".join(f"{key} = {_value(value)}\n" for key, value in row.items())


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return (
        json.dumps(value) if isinstance(value, str | int) else f"{float(value):.12g}" if value % 1 else f"{value:.1f}"
    )
