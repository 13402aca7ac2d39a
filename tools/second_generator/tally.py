"""Scores the reports of a run by tools/hidden_effects/judging.py, which says word by word how."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scoring import Case, cases, gap, unreliable

KINDS = ("single", "pair", "background", "unmodelled", "null")


def scored(folder: Path, names: Sequence[str], seed: int, planned: int) -> dict[str, Any]:
    """figures (what, value, of how many, target, whether it is to be at least that), and a row for each case."""
    found = cases(folder, names)
    of = {kind: [c for c in found if c["label"]["spec"]["kind"] == kind] for kind in KINDS}
    hidden = [c for c in found if c["label"]["effects"]]
    named = [c for c in found if (c["report"] or {}).get("verdict") == "named"]
    errors = [error for c in found for _, error in c["judged"].errors]
    gaps = [ratio for c in named for ratio in gap(c["report"])]
    claims = [claim for c in found for claim in c["judged"].claims]
    figures = [
        _figure("single effects: effect and joint right", [c["judged"].score for c in of["single"]], 0.92, True),
        _figure("- strictly: the mechanism's other names count as wrong", [c["judged"].strict for c in of["single"]]),
        _figure("- named, and exactly right", [c["judged"].score == 1.0 for c in of["single"]]),
        _figure(
            "a wrong name among the named ones, all cases with something hidden",
            [bool(c["judged"].wrong) for c in hidden],
            0.05,
            False,
        ),
        _figure("pairs: both right", [c["judged"].score for c in of["pair"]]),
        _figure("background of further effects: the main one found", [c["judged"].found for c in of["background"]]),
        _figure("before something outside the catalogue (cavitation)", [c["judged"].score for c in of["unmodelled"]]),
        _figure("nulls called none", [c["judged"].score for c in of["null"]]),
        _figure("main parameter: share within 5 %", [error <= 0.05 for error in errors]),
    ]
    return {
        "seed": seed,
        "planned": planned,
        "run": len(found),
        "figures": [row for row in figures if row["of"]],
        "medians": {
            "main parameter, relative error": statistics.median(errors) if errors else None,
            "held-out gap after over noise floor, of named": statistics.median(gaps) if gaps else None,
            "seconds a case, beside other work": statistics.median(c["run"]["seconds"] for c in found)
            if found
            else None,
        },
        "probability": {"claims": len(claims), "largest distance from frequency": unreliable(claims)},
        "cases": [_row(c) for c in found],
    }


def _figure(
    what: str, values: Sequence[float | bool], target: float | None = None, at_least: bool = True
) -> dict[str, Any]:
    value = statistics.fmean(values) if values else None
    return {"what": what, "value": value, "of": len(values), "target": target, "at_least": at_least}


def _row(case: Case) -> dict[str, Any]:
    label, report, judged = case["label"], case["report"] or {}, case["judged"]
    return {
        "name": label["name"],
        "kind": label["spec"]["kind"],
        "plant": label["spec"]["plant"],
        "hidden": [f"{e['effect']} at {e['joint']} ({e['drawn']})" for e in label["effects"]],
        "marks": [round(e["mark"], 1) for e in label["effects"]],
        "shares": [round(e["share"], 4) for e in label["effects"]],
        "verdict": report.get("verdict", "-"),
        "said": [_said(row) for row in report.get("effects", [])],
        "score": judged.score,
        "strict": judged.strict,
        "found": judged.found,
        "wrong": list(judged.wrong),
        "errors": dict(judged.errors),
        "gaps": gap(case["report"]),
        "seconds": case["run"].get("seconds"),
        "error": case["run"].get("error"),
    }


def _said(row: Mapping[str, Any]) -> str:
    rivals = [f"{m['effect']} at {m['joint']}" for m in row.get("indistinguishable_from", [])]
    probability = f" ({100.0 * row['probability']:.0f} %)" if "probability" in row else ""
    return " or ".join([f"{row['effect']} at {row['joint']}{probability}", *rivals])


def words(found: Mapping[str, Any]) -> str:
    """A score for a terminal."""
    lines = [f"seed {found['seed']}: {found['run']} of {found['planned']} cases"]
    for row in found["figures"]:
        target = (
            ""
            if row["target"] is None
            else f" (target: at {'least' if row['at_least'] else 'most'} {100 * row['target']:g} %)"
        )
        lines.append(f"  {row['what']}: {100.0 * row['value']:.3g} % of {row['of']}{target}")
    lines += [
        f"  {c['name']} {c['kind']} {c['plant']}: {'; '.join(c['hidden']) or 'nothing'} -> {c['verdict']}: "
        f"{'; '.join(c['said']) or '-'} [{c['score']:g}]"
        for c in found["cases"]
        if c["score"] < 1.0 or c["wrong"]
    ]
    return "\n".join(lines)
