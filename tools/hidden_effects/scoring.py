"""Scores the reports of a suite: DIR/labels and DIR/results to DIR/score.json and DIR/score.md. How: judging.py."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from judging import Judged, Places, judge

from fmucorrect.study import load_study

Case = Mapping[str, Any]
"""label, report (None where there is none), run (seconds ...), judged."""

KINDS = ("single", "faint", "unmodelled", "background", "pair", "triple", "null", "outside")
BINS = (0.0, 0.5, 0.7, 0.85, 0.95, 1.0001)
"""Of the probability."""


def cases(folder: Path, names: Sequence[str] | None = None) -> list[Case]:
    """Every case of the suite that was run."""
    found: list[Case] = []
    for path in sorted((folder / "labels").glob("*.json")):
        if names is not None and path.stem not in names:
            continue
        run = folder / "results" / path.stem / "run.json"
        if not run.is_file():
            continue
        label = json.loads(path.read_text(encoding="utf-8"))
        report = read_report(folder / "results" / path.stem / "report.json")
        places = places_of(folder / "cases" / path.stem / "study.toml")
        run_told = json.loads(run.read_text(encoding="utf-8"))
        found.append({"label": label, "report": report, "run": run_told, "judged": judge(label, report, places)})
    return found


def places_of(study_file: Path) -> Places:
    """What stands behind the names of a study."""
    study = load_study(study_file)
    sets = {group.name: frozenset(group.joints) for group in study.groups}
    sets |= {name: frozenset(row.parameters) for row in study.adjustable for name in row.parameters}
    return Places(sets)


def read_report(path: Path) -> dict[str, Any] | None:
    """None where it is not there or is no report."""
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return report if isinstance(report, dict) and "verdict" in report else None


def figures(found: Sequence[Case]) -> list[dict[str, Any]]:
    """A row each: what, value, of how many, target, whether reached (None without a target)."""
    of_kind = {name: [c for c in found if c["label"]["spec"]["kind"] == name] for name in KINDS}
    single, background, outside = of_kind["single"], of_kind["background"], of_kind["outside"]
    low = [c for c in single if c["label"]["spec"]["noise"] <= 0.011]
    high = [c for c in single if c["label"]["spec"]["noise"] > 0.011]
    places = [place for c in found for place in _judged(c).places]
    errors = [error for c in found for _, error in _judged(c).errors]
    claims = [claim for c in found for claim in _judged(c).claims]
    named = [c for c in found if _is_named(c) and c["label"]["effects"] and c not in outside]
    gaps = [ratio for c in named for ratio in gap(c["report"])]
    seconds = [c["run"]["seconds"] for c in single if c["run"].get("seconds")]
    peaks = [c["run"]["peak_mb"] for c in found if c["run"].get("peak_mb")]
    failed = [c["run"]["error"] is not None or c["report"] is None for c in found]
    scores = lambda cases, name="score": [getattr(_judged(c), name) for c in cases]  # noqa: E731
    return [
        _row("effect and joint right, 1 % noise (rig: 20 um), no background", scores(low), 0.97),
        _row("- strictly: another name of the same equation counts as wrong", scores(low, "strict")),
        _row("- named, and exactly right", [score == 1.0 for score in scores(low)]),
        _row("effect and joint right, 5 % noise, no background", scores(high)),
        _row("effect and joint right, before something outside the catalogue", scores(of_kind["unmodelled"])),
        _row("near the noise: named, or left open where there is no mark", scores(of_kind["faint"])),
        _row("background of further effects: the main one found", scores(background, "found"), 0.95),
        _row("background: a wrong name added", [bool(w) for w in scores(background, "wrong")], 0.05, False),
        _row("joint right among named", places, 0.99),
        _row("main parameter: median error", errors, 0.01, False, statistics.median),
        _row("main parameter: share within 5 %", [error <= 0.05 for error in errors], 0.95),
        _row("pairs: both right", scores(of_kind["pair"]), 0.90),
        _row("triples: all right", scores(of_kind["triple"])),
        _row("nulls wrongly named", [_is_named(c) for c in of_kind["null"]], 1.0 / 30.0, False),
        _row("nulls called none", scores(of_kind["null"])),
        _row("outside the catalogue called by a wrong name", [_is_named(c) for c in outside], 0.10, False),
        _row("held-out gap after over noise floor, median of named", gaps, 1.1, False, statistics.median),
        _row("probability: distance from frequency, largest of the bins", claims, 0.10, False, unreliable),
        _row("seconds a single-effect case, median", seconds, _seconds(found), False, statistics.median),
        _row("peak memory, MB, largest", peaks, 4096.0, False, max),
        _row("ended in an error", failed, 0.0, False),
    ]


def _seconds(found: Sequence[Case]) -> float:
    return 30.0 if all(c["label"]["programme"] == "oscillator" for c in found) else 180.0


def gap(report: Mapping[str, Any] | None) -> list[float]:
    """nrmse after over noise floor of each evaluation condition."""
    rows = [row for row in (report or {}).get("gap", []) if row.get("role") == "evaluation"]
    return [row["nrmse_after"] / row["noise_floor"] for row in rows if row.get("noise_floor")]


def reliability(claims: Sequence[tuple[float, bool]]) -> list[dict[str, Any]]:
    """Of each bin of probability: how many claims, their mean probability and how often they were right."""
    table = []
    for low, high in pairwise(BINS):
        inside = [claim for claim in claims if low <= claim[0] < high]
        if inside:
            row = {"from": low, "to": min(high, 1.0), "claims": len(inside)}
            row |= {name: statistics.fmean(c[i] for c in inside) for i, name in enumerate(("probability", "right"))}
            table.append(row)
    return table


def unreliable(claims: Sequence[tuple[float, bool]]) -> float | None:
    """The largest distance between probability and frequency in bins of ten claims and more."""
    return max((abs(r["probability"] - r["right"]) for r in reliability(claims) if r["claims"] >= 10), default=None)


def _judged(case: Case) -> Judged:
    return case["judged"]


def _is_named(case: Case) -> bool:
    return (case["report"] or {}).get("verdict") == "named"


def _row(
    what: str,
    values: Sequence[Any],
    target: float | None = None,
    at_least: bool = True,
    figure: Callable[[Sequence[Any]], float | None] = statistics.fmean,
) -> dict[str, Any]:
    value = figure(values) if values else None
    reached = None
    if value is not None and target is not None:
        reached = bool(value >= target - 1e-12 if at_least else value <= target + 1e-12)
    return {"what": what, "value": value, "of": len(values), "target": target, "at_least": at_least, "reached": reached}
