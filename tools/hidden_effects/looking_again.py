"""Simulates the tests that ambiguous reports ask for and looks again: was the ambiguity true?

A report's next_test["conditions"] are tables: "like" (a condition of the study whose excitation is repeated; the first,
unless said), "scale" (factor on it), "speed" (km/h), "inputs" (instead: FMU input -> values at the study's step). The
measurement comes from the label, with the case's own noise; the condition joins the study as one of development.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from bench import Bench, Run, bench
from discovering import discover_here
from hidden import Numbers
from making import Made, measure, seed_of
from physical import Placed
from scoring import cases, read_report
from specs import Spec, Wanted
from writing import condition_text, write_record, write_series


def look(names: Sequence[str], folder: Path, workers: int) -> dict[str, Any]:
    """Every ambiguous report with a next_test of conditions: how many were looked at again, and in how many of them the
    extra conditions left exactly the hidden effects. DIR/again is a suite like DIR."""
    again = folder / "again"
    asked: list[str] = []
    for name in names:
        report = read_report(folder / "results" / name / "report.json")
        conditions = ((report or {}).get("next_test") or {}).get("conditions") or []
        conditions = [row for row in conditions if isinstance(row, Mapping)]
        if report and report["verdict"] == "ambiguous" and conditions:
            extend(name, folder, again, conditions)
            asked.append(name)
    for _ in discover_here([n for n in asked if not (again / "results" / n / "run.json").is_file()], again, workers):
        pass
    judged = {case["label"]["name"]: case["judged"].score for case in cases(again, asked)} if asked else {}
    true = sorted(name for name, score in judged.items() if score == 1.0)
    return {"looked": len(asked), "true": len(true), "cases": {name: judged.get(name, 0.0) for name in asked}}


def extend(name: str, folder: Path, again: Path, conditions: Sequence[Mapping[str, Any]]) -> None:
    """The case in `again`, with the conditions measured as well."""
    label = json.loads((folder / "labels" / f"{name}.json").read_text(encoding="utf-8"))
    made = remade(label)
    place = again / "cases" / name
    shutil.copytree(folder / "cases" / name, place, dirs_exist_ok=True)
    shutil.copytree(folder / "fmus", again / "fmus", dirs_exist_ok=True)
    (again / "labels").mkdir(parents=True, exist_ok=True)
    (again / "labels" / f"{name}.json").write_text(json.dumps(label, indent=1) + "\n", encoding="utf-8")
    rng = np.random.default_rng(seed_of(name) + 7)
    added = [extra_run(made.bench, row, i) for i, row in enumerate(conditions)]
    for run in added:
        write_series(made.bench, run, place / f"inputs_{run.name}.csv")
        write_record(made.bench, made.spec, *measure(made, run, rng), place / f"measured_{run.name}.parquet")
    text = (place / "study.toml").read_text(encoding="utf-8")
    (place / "study.toml").write_text("\n".join([text, *map(condition_text, added)]), encoding="utf-8", newline="\n")


def extra_run(on: Bench, row: Mapping[str, Any], number: int) -> Run:
    """A run as a report asks for it."""
    like = next((run for run in on.runs if run.name == row.get("like")), on.runs[0])
    scale = float(row.get("scale", 1.0))
    inputs = {name: scale * series for name, series in like.inputs.items()}
    if isinstance(row.get("inputs"), Mapping):
        inputs = {name: np.asarray(values, float) for name, values in row["inputs"].items()}
    parameters, extra = dict(like.parameters), dict(like.extra)
    if "amplitude" in extra:
        extra["amplitude"] *= scale
    if "speed" in row and "speed" in parameters:
        parameters["speed"], extra["speed"] = float(row["speed"]) / 3.6, float(row["speed"])
    return replace(
        like, name=f"again_{number + 1}", role="development", inputs=inputs, parameters=parameters, extra=extra
    )


def remade(label: Mapping[str, Any]) -> Made:
    """The case with the label's numbers."""
    given = dict(label["spec"])
    effects = tuple(Wanted(**row) for row in given.pop("effects"))
    spec = Spec(**{**given, "effects": effects, "without": tuple(given["without"])})
    placed = tuple(
        Placed(
            *(row["effect"], row["joint"], tuple(row["joints"])),
            Numbers(row["law"], tuple(row["numbers"]), row["parameters"]),
            row["other"],
        )
        for row in label["effects"]
    )
    noise = np.array(list(label["noise"].values()))
    return Made(spec, bench(spec.bench), dict(label["parameters"]), placed, noise, dict(label))
