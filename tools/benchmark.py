"""Measures what tools/benchmark.md says of speed: python tools/benchmark.py [--quick] [--only PART] [--json FILE]

Medians, and ratios of things measured in turn within this one run; one thread. Targets are those of the project's design.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))


@dataclass(frozen=True)
class Row:
    """One line of the table. value: measured, in `unit`. limit: target; above says whether more is better. note: how."""

    what: str
    value: float
    unit: str
    limit: float | None
    above: bool
    note: str

    @property
    def verdict(self) -> str:
        if self.limit is None:
            return ""
        met = self.value >= self.limit if self.above else self.value <= self.limit
        sign = ">=" if self.above else "<="
        if met:
            return f"{sign} {self.limit:g}, met"
        off = abs(self.value / self.limit - 1.0)
        return f"{sign} {self.limit:g}, missed by {100 * off:.0f} %"


def table(rows: list[Row]) -> str:
    """Markdown."""
    lines = ["| quantity | measured | target | how |", "|---|---|---|---|"]
    lines += [f"| {r.what} | {r.value:.3g} {r.unit} | {r.verdict} | {r.note} |" for r in rows]
    return "\n".join(lines)


def main() -> None:
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"  # before numpy is imported
    from benchmarks import discovery, files, live, running, steps, training, vehicle, wrapped

    parser = argparse.ArgumentParser(description="Measure the speed of fmucorrect.")
    parser.add_argument("--quick", action="store_true", help="fewer repeats; for a look, not for quoting")
    known = ["steps", "running", "vehicle", "files", "training", "wrapped", "live", "discovery"]
    parser.add_argument("--only", choices=known, help="one part")
    parser.add_argument("--json", type=Path, help="write the rows there as well")
    arguments = parser.parse_args()
    parts: dict[str, Callable[[bool], list[Row]]] = {
        "steps": steps.measure,
        "running": running.measure,
        "vehicle": vehicle.measure,
        "files": files.measure,
        "training": training.measure,
        "wrapped": wrapped.measure,
        "live": live.measure,
        "discovery": discovery.measure,
    }
    chosen = [arguments.only] if arguments.only else list(parts)
    rows = [row for name in chosen for row in parts[name](arguments.quick)]
    print(table(rows))
    if arguments.json:
        arguments.json.write_text(json.dumps([row.__dict__ for row in rows], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.modules["benchmark"] = sys.modules["__main__"]
    main()
