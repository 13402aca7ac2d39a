"""The published figures of a study by make.py, before and after discovery: python tools/real_data/score.py DIR OUT [--json]

DIR has what make.py wrote, OUT what `fmucorrect discover DIR/study.toml -o OUT` made of it. Every evaluation condition is
simulated with the FMU of DIR and with that of OUT/study.toml (augmented.fmu), and compared with the record's own samples,
none of them resampled. Without OUT, or where nothing was added, there is the model's own figure alone.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from real_study import SCORE

from fmucorrect import pairs, records, units
from fmucorrect.errors import FmucorrectError
from fmucorrect.study import Study, load_study


def error(study: Study, figure: Mapping[str, Any], ratio: int, cache: dict[str, np.ndarray]) -> float:
    """A figure as `study` has it, in the figure's unit. cache: responses by condition, filled here."""
    condition, channel = study.condition(figure["condition"]), study.channels[0]
    if condition.name not in cache:
        cache[condition.name] = pairs.simulate(study, condition).values[:, 0]
    assert condition.measurement is not None
    raw = records.read(condition.measurement, [channel.measurement])
    factor = units.conversion(raw.channels[0].unit, channel.unit, str(condition.measurement)) * channel.measurement_sign
    rows = slice(*figure["rows"])
    measured = raw.values[rows, 0] * factor
    wrong = float(np.sqrt(np.mean((cache[condition.name][::ratio][rows] - measured) ** 2)))
    if figure["kind"] == "share":
        wrong /= float(np.sqrt(np.mean(measured**2)))
    return wrong * figure["factor"]


def figures(folder: Path) -> list[dict[str, Any]]:
    """What score.json of `folder` says, one row a figure."""
    told = json.loads((folder / SCORE).read_text(encoding="utf-8"))
    return [dict(figure, ratio=told["ratio"]) for figure in told["figures"]]


def score(folder: Path, out: Path | None) -> list[dict[str, Any]]:
    """The figures of `folder` (score.json), each with "before", and with "after" and "reached" where OUT has a study."""
    studies = {"before": folder / "study.toml"}
    if out is not None and (out / "study.toml").is_file():
        studies["after"] = out / "study.toml"
    rows = figures(folder)
    for key, path in studies.items():
        study, cache = load_study(path), {}
        for row in rows:
            row[key] = error(study, row, row["ratio"], cache)
    for row in rows:
        if "after" in row:
            row["reached"] = row["after"] <= row["target"]
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """For people."""
    lines = [f"{'figure':32}{'model':>11}{'corrected':>11}{'target':>11}           published"]
    for row in rows:
        after, reached = (f"{row['after']:.4g}", row["reached"]) if "after" in row else ("-", None)
        verdict = {True: "reached", False: "missed", None: ""}[reached]
        others = ", ".join(f"{name} {value:.4g}" for name, value in row["published"].items())
        name = f"{row['name']} [{row['unit']}]"
        lines.append(f"{name:32}{row['before']:>11.4g}{after:>11}{row['target']:>11.4g}  {verdict:9}{others}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="Score a study by make.py against the published figures.")
    parser.add_argument("folder", type=Path, metavar="DIR", help="what make.py wrote")
    parser.add_argument("out", type=Path, metavar="OUT", nargs="?", help="what fmucorrect discover wrote")
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    try:
        rows = score(arguments.folder, arguments.out)
    except FileNotFoundError as missing:
        sys.exit(f"score: {missing.filename} is not there: make.py writes it")
    except FmucorrectError as problem:
        sys.exit(f"score: {problem}")
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main()
