"""A search's ledger as a file: every fit, and what was compared at each stage, so that rules can be judged without an FMU."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.kept import packed, unpacked
from fmucorrect.discovery.ledger import Ledger
from fmucorrect.discovery.naming import Naming
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.search import Progress
from fmucorrect.discovery.stepwise import stepwise

FILE = "ledger.bin"
"""Beside the report; 1 to 20 MB."""


class Recorded:
    """Today's search, which leaves its ledger behind."""

    ledger: Ledger

    def __call__(self, problem: Problem, ledger: Ledger, budget: Budget, progress: Progress) -> None:
        self.ledger = ledger
        stepwise(problem, ledger, budget, progress)


def write(ledger: Ledger, path: Path) -> None:
    """All fits, and of what was compared what rules look at: numbers and residuals, and of the last two stages, which are
    decided on, sensitivities."""
    stages = [
        {
            "base": _bare(stage.base, keep=True),
            "sets": [_bare(fitted, keep=k >= len(ledger.compared) - 2) for fitted in stage.sets],
            "setting": {
                "measured": stage.setting.measured,
                "sensors": stage.setting.sensors.columns,
                "volume": stage.setting.volume,
                "share": stage.setting.share,
                "floor": stage.setting.floor,
                "candidates": stage.setting.candidates,
            },
        }
        for k, stage in enumerate(ledger.compared)
    ]
    path.write_bytes(packed({"rows": ledger.rows, "runs": ledger.runs, "stages": stages}))


def read(path: Path) -> dict[str, Any]:
    """rows (ledger.Row), runs (by move), stages: a Naming each, the last one what the verdict was formed from."""
    content = unpacked(path.read_bytes())
    return content | {"stages": [_naming(stage) for stage in content["stages"]]}


def _bare(fitted: Fitted, keep: bool = False) -> Fitted:
    nothing = np.zeros((len(fitted.residual), 0))
    bare = replace(fitted, at=fitted.residual)
    return bare if keep else replace(bare, base=nothing, slopes=nothing)


def _naming(stage: dict[str, Any]) -> Naming:
    given = stage["setting"]
    base = np.zeros((len(given["measured"]), 0))
    setting = Setting(**{**given, "sensors": Nuisances(given["sensors"]), "base": base})
    return Naming(stage["base"], tuple(stage["sets"]), setting)
