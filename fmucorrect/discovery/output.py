"""What a discovery leaves behind: the report as a table, effects.toml, augmented.fmu and the study on it."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect import effects as effects_file
from fmucorrect.catalogue.law import unit
from fmucorrect.catalogue.signal import unit as signal_unit
from fmucorrect.catalogue.text import latex, modelica
from fmucorrect.discovery.confirm import Gap
from fmucorrect.discovery.decide import Decision, Rival, held_out
from fmucorrect.discovery.naming import Naming
from fmucorrect.discovery.pictures import units_at
from fmucorrect.discovery.problem import Problem, start_value, tolerance_of
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, SignalTerm, Term
from fmucorrect.effects import Effects, ForceEffect, ParameterOffset, Remarks
from fmucorrect.errors import FmucorrectError
from fmucorrect.study import Study
from fmucorrect.wrapping.laws import functions

NOTICED = 0.05
"""Tolerances that a parameter must have moved to be reported."""
SHOWN = 2000
"""Points of a time series in the report."""
SECONDS = 4.0
"""Of a condition that are shown in time."""


def effect_row(
    problem: Problem, term: Term, std: Mapping[str, float], probability: float, rivals: Sequence[Term]
) -> dict[str, Any]:
    """One entry of the report's effects."""
    row: dict[str, Any] = {
        "effect": term.effect,
        "joint": term.where,
        "parameters": {
            name: {
                "value": term.values[name],
                "std": std.get(name, 0.0),
                "unit": unit_of(problem, term, name),
                "symbol": term.parameter(name).symbol,
                "meaning": term.parameter(name).meaning,
            }
            for name in dict.fromkeys([*term.estimated, *term.values])
        },
        "equation": equation(term),
        "probability": probability,
        "indistinguishable_from": [{"effect": other.effect, "joint": other.where} for other in rivals],
    }
    if isinstance(term, ForceTerm):
        row |= {
            "description": term.law.description,
            "latex": latex(term.law),
            "c": "\n".join(functions(term.law)),
            "modelica": modelica(
                term.law, term.values, _identifier(term.law.label), *units_at(problem, term.joints[0])
            ),
        }
    elif isinstance(term, SignalTerm):
        row |= {"description": term.law.description, "latex": latex(term.law)}
    else:
        row |= {"description": f"The FMU's parameter {term.where} is off by more than its tolerance."}
    return row


def equation(term: Term) -> str:
    """As text."""
    return f"{term.where} + Delta" if isinstance(term, OffsetTerm) else term.law.equation


def unit_of(problem: Problem, term: Term, name: str) -> str:
    """The unit of a number of a term."""
    if isinstance(term, OffsetTerm):
        return term.unit
    template = term.parameter(name).unit
    if isinstance(term, SignalTerm):
        return signal_unit(template, problem.study.channels[term.channels[0]].unit if term.channels else "1")
    text = unit(template, *units_at(problem, term.joints[0]))
    return text.replace("^n", f"^{term.values.get('exponent', 1.0):g}") if "^n" in text else text


def _identifier(text: str) -> str:
    return "".join(part.capitalize() for part in re.split(r"\W|_", text))


def candidate_rows(problem: Problem, naming: Naming, decision: Decision) -> list[dict[str, Any]]:
    """The report's candidates: every fitted set, the most likely first; a set of several is named with plus signs."""
    rows: list[dict[str, Any]] = []
    for rival in sorted(decision.rivals, key=lambda rival: rival.behind):
        if rival.chosen.model.terms:
            rows.append(_candidate(problem, naming, rival))
    return rows


def _candidate(problem: Problem, naming: Naming, rival: Rival) -> dict[str, Any]:
    fitted = rival.chosen
    left_out = held_out(problem, naming, fitted)
    spans = [np.ptp(trial.evidence(trial.measured), axis=0) for trial in problem.trials]
    error = float(np.sqrt(np.mean(fitted.residual**2))) / max(float(np.mean(spans)), 1e-300) * 100.0
    return {
        "effect": " + ".join(term.effect for term in fitted.model.terms),
        "joint": " + ".join(term.where for term in fitted.model.terms),
        "held_out_error": float(np.mean(left_out)) if np.isfinite(left_out).all() else None,
        "error": error,
        "probability": rival.probability,
        "behind": rival.behind,
    }


def gap_row(gap: Gap) -> dict[str, Any]:
    """One entry of the report's gap."""
    return {
        "condition": gap.condition.name,
        "role": gap.condition.role,
        "nrmse_before": gap.nrmse_before,
        "nrmse_after": gap.nrmse_after,
        "noise_floor": gap.noise_floor,
        "r2_before": gap.r2_before,
        "r2_after": gap.r2_after,
    }


def series(study: Study, gaps: Sequence[Gap]) -> dict[str, Any]:
    """A stretch of every condition in time, the liveliest of its length."""
    found: dict[str, Any] = {}
    for gap in gaps:
        step = study.simulation.step_size
        length = min(round(SECONDS / step), len(gap.t))
        energy = np.convolve((gap.measured - gap.before).std(axis=1) ** 2, np.ones(length), "valid")
        first = int(np.argmax(energy))
        rows = slice(first, first + length, max(1, -(-length // SHOWN)))
        found[gap.condition.name] = {
            "t": _short(gap.t[rows]),
            "channels": {
                channel.name: {
                    "unit": channel.unit,
                    "measured": _short(gap.measured[rows, j]),
                    "before": _short(gap.before[rows, j]),
                    "after": _short(gap.after[rows, j]),
                }
                for j, channel in enumerate(study.channels)
            },
        }
    return found


def _short(x: np.ndarray) -> list[float]:
    return [float(f"{value:.6g}") for value in x]


def adjusted(
    problem: Problem, base: Sequence[float], least: float = NOTICED
) -> tuple[dict[str, float], dict[str, float]]:
    """The tolerated parameters that moved by at least so many tolerances: where they are, and where they were."""
    now: dict[str, float] = {}
    before: dict[str, float] = {}
    for adjustable, z in zip(problem.tolerated, base, strict=True):
        if abs(z) < least:
            continue
        for name in adjustable.parameters:
            start = start_value(problem.study, problem.fmu, None, name)
            if np.isfinite(start):
                before[name], now[name] = start, start + z * tolerance_of(adjustable, start)
    return now, before


def effects_of(
    problem: Problem, terms: Sequence[Term], base: Sequence[float], rows: Sequence[Mapping[str, Any]]
) -> Effects:
    """What the solver can be given: forces, and parameters with the study's own start values, so that the FMU starts as the
    model that was confirmed; what sits in sensors cannot be put into an FMU."""
    forces: list[ForceEffect] = []
    used: set[str] = set()
    now, before = adjusted(problem, base, 0.0)
    study, fmu = problem.study, problem.fmu
    assert fmu is not None
    offsets = {name: value - float(fmu.variables[name].start or "nan") for name, value in study.parameters.items()}
    for name, value in now.items():
        offsets[name] = offsets.get(name, 0.0) + value - before[name]
    for term, row in zip(terms, rows, strict=True):
        if isinstance(term, ForceTerm):
            given = row["parameters"]
            remarks = Remarks(
                {name: float(entry["std"]) for name, entry in given.items() if entry["std"] > 0.0},
                {name: entry["unit"] for name, entry in given.items() if entry["unit"]},
                row["equation"],
                float(row["probability"]),
            )
            values = {name: float(value) for name, value in term.values.items() if name != "radius"}
            rotation = next((r.name for r in study.rotations if r.radius == term.values.get("radius")), "")
            forces.append(ForceEffect(term.effect, term.where, values, rotation, remarks))
            used.update(joint.name for joint in term.joints)
        elif isinstance(term, OffsetTerm):
            for name in term.adjustable.parameters:
                scale = 1.0 if len(term.adjustable.parameters) == 1 else start_value(study, fmu, None, name)
                offsets[name] = offsets.get(name, 0.0) + term.values["value"] * scale
    places = {term.where for term in terms if isinstance(term, ForceTerm)}
    groups = tuple(group for group in study.groups if group.name in places)
    rotations = tuple(r for r in study.rotations if r.name in {force.rotation for force in forces})
    return Effects(
        tuple(forces),
        tuple(ParameterOffset(name, value) for name, value in offsets.items() if value != 0.0),
        tuple(joint for joint in study.joints if joint.name in used),
        groups,
        rotations,
        study.simulation.step_size / problem.substeps,
    )


def write_model(study: Study, found: Effects, out: Path) -> tuple[list[str], list[str]]:
    """effects.toml, augmented.fmu and study.toml in `out`: the names of what was written, and notes on what was not."""
    from fmucorrect.wrapping.package import wrap

    written: list[str] = []
    notes: list[str] = []
    assert study.fmu is not None
    effects_file.write(found, out / "effects.toml")
    written.append("effects.toml")
    try:
        wrap(study.fmu, None, out / "augmented.fmu", effects_file=out / "effects.toml")
    except FmucorrectError as error:
        return written, [f"augmented.fmu was not written: {error}"]
    written.append("augmented.fmu")
    (out / "study.toml").write_text(augmented_study(study, out), encoding="utf-8")
    written.append("study.toml")
    return written, notes


def augmented_study(study: Study, out: Path) -> str:
    """The study file with the augmented FMU in place of the solver's, which brings the start values with it; everything else
    stays, paths made relative to `out`."""
    text = _without_start_values(study.path.read_text(encoding="utf-8"))

    def moved(match: re.Match[str]) -> str:
        target = (study.path.parent / json.loads(match[3])).resolve()
        return f"{match[1]}{match[2]}{json.dumps(Path(os.path.relpath(target, out)).as_posix())}"

    text = re.sub(r'(?m)^(\s*fmu\s*)(=\s*)("(?:[^"\\]|\\.)*")', r'\1\2"augmented.fmu"', text)
    return re.sub(
        r'(?m)^(\s*(?:inputs|measurement|simulated)\s*)(=\s*)("(?:[^"\\]|\\.)*")', _only_conditions(moved, text), text
    )


def _without_start_values(text: str) -> str:
    """Without `parameters` of [simulation], in either way that TOML has to write them."""
    text = re.sub(r"(?ms)^[ \t]*\[simulation\.parameters\].*?(?=^[ \t]*\[|\Z)", "", text)
    section = re.search(r"(?ms)^[ \t]*\[simulation\].*?(?=^[ \t]*\[|\Z)", text)
    if section is None:
        return text
    bare = re.sub(r"(?ms)^[ \t]*parameters[ \t]*=[ \t]*\{.*?\}[^\n]*\n", "", section[0])
    return text[: section.start()] + bare + text[section.end() :]


def _only_conditions(moved: Any, text: str) -> Any:
    """`measurement` and `simulated` are files in [[conditions]] only; in channels they are columns."""
    begins = [m.start() for m in re.finditer(r"(?m)^\s*\[", text)]

    def change(match: re.Match[str]) -> str:
        heads = [b for b in begins if b < match.start()]
        return moved(match) if heads and text[heads[-1] :].lstrip().startswith("[[conditions]]") else match[0]

    return change
