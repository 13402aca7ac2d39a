"""The score as a page: score.md beside score.json."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scoring import Case, cases, figures, reliability

PROGRAMMES = {
    "oscillator": "Chains of two and three masses",
    "sweep": "Roller rig, swept runs at two amplitudes",
    "tone": "Roller rig, the single 2 Hz tone (classes are expected: no targets)",
}


def write_score(folder: Path, names: Sequence[str] | None = None, after: Mapping[str, Any] | None = None) -> str:
    """Scores what was run and writes both files; the text of score.md. after: what looking again told
    (looking_again.py)."""
    found = cases(folder, names)
    parts: list[str] = ["# Score of the hidden-effect suite", ""]
    told: dict[str, Any] = {"programmes": {}, "cases": [_case(c) for c in found]}
    groups = {key: [c for c in found if c["label"]["programme"] == key] for key in PROGRAMMES}
    groups["with targets"] = groups["oscillator"] + groups["sweep"]
    titles = PROGRAMMES | {"with targets": "Chains and swept rig together"}
    for key, group in groups.items():
        if not group or (key == "with targets" and not (groups["oscillator"] and groups["sweep"])):
            continue
        rows = figures(group)
        claims = [claim for c in group for claim in c["judged"].claims]
        told["programmes"][key] = {"figures": rows, "reliability": reliability(claims)}
        parts += [f"## {titles[key]}: {len(group)} cases", "", *_figures(rows, key != "tone"), ""]
        parts += _reliability(reliability(claims))
    if after:
        told["looked_again"] = after
        parts += ["## Ambiguous cases, looked at again with the test they asked for", ""]
        parts += [f"{after['true']} of {after['looked']} were true: with the test the hidden effect was named.", ""]
    parts += ["## What went wrong", "", *_wrong(found), ""]
    text = "\n".join(parts)
    (folder / "score.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    (folder / "score.md").write_text(text, encoding="utf-8")
    return text


def _figures(rows: Sequence[Mapping[str, Any]], targets: bool) -> list[str]:
    lines = ["| figure | value | of | target | reached |", "|---|---|---|---|---|"]
    for row in rows:
        if not row["of"]:
            continue
        target = row["target"] if targets else None
        sign = "at least" if row["at_least"] else "at most"
        reached = "" if target is None or row["reached"] is None else "yes" if row["reached"] else "**no**"
        wanted = "" if target is None else f"{sign} {_number(target, row['what'])}"
        lines.append(f"| {row['what']} | {_number(row['value'], row['what'])} | {row['of']} | {wanted} | {reached} |")
    return lines


def _number(value: float | None, what: str) -> str:
    if value is None:
        return "-"
    if what.startswith(("seconds", "peak", "held-out")):
        return f"{value:.3g}" if value < 1000 else f"{value:.0f}"
    return f"{100.0 * value:.3g} %"


def _reliability(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    if not rows:
        return []
    lines = ["| probability | claims | mean | right |", "|---|---|---|---|"]
    lines += [
        f"| {r['from']:g} to {r['to']:g} | {r['claims']} | {r['probability']:.3f} | {r['right']:.3f} |" for r in rows
    ]
    return [*lines, ""]


def _wrong(found: Sequence[Case]) -> list[str]:
    lines = ["| case | kind | bench | hidden | mark | verdict | said | score |", "|---|---|---|---|---|---|---|---|"]
    for c in found:
        if c["judged"].score == 1.0 and not c["judged"].wrong:
            continue
        told = _case(c)
        hidden = "; ".join(f"{e['effect']} at {e['joint']}" for e in c["label"]["effects"]) or "-"
        marks = ", ".join(f"{e['mark']:.0f}" for e in c["label"]["effects"])
        said = told["error"].splitlines()[-1][:80] if told["error"] else "; ".join(told["said"]) or "-"
        spec = c["label"]["spec"]
        cells = [told["name"], spec["kind"], spec["bench"], hidden, marks, told["verdict"], said, f"{told['score']:g}"]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _case(case: Case) -> dict[str, Any]:
    report, judged, label = case["report"] or {}, case["judged"], case["label"]
    return {
        "name": label["name"],
        "kind": label["spec"]["kind"],
        "verdict": report.get("verdict", "-"),
        "hidden": [f"{e['effect']} at {e['joint']}" for e in label["effects"]],
        "said": [_said(row) for row in report.get("effects", [])],
        "score": judged.score,
        "strict": judged.strict,
        "wrong": list(judged.wrong),
        "errors": dict(judged.errors),
        "seconds": case["run"].get("seconds"),
        "peak_mb": case["run"].get("peak_mb"),
        "error": case["run"].get("error"),
    }


def _said(row: Mapping[str, Any]) -> str:
    rivals = [f"{m['effect']} at {m['joint']}" for m in row.get("indistinguishable_from", [])]
    return " or ".join([f"{row['effect']} at {row['joint']}", *rivals])
