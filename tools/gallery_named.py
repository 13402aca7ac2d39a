"""What is known of the gallery's plants once their effects are named: by a discovery here, or from committed results of one."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gallery_plants import MEASURED, RIGS

from fmucorrect.metrics import score
from fmucorrect.pairs import pair
from fmucorrect.study import load_study

ROOT = Path(__file__).resolve().parent.parent


def discovered(study: Path, folder: Path, minutes: int) -> dict[str, Any]:
    """What `fmucorrect discover` says within so many minutes, and NRMSE (%) of its model, where there is one, at the conditions
    that are held out."""
    command = [sys.executable, "-m", "fmucorrect", "discover", str(study), "-o", str(folder)]
    done = subprocess.run([*command, "--time-limit", f"{minutes}min"], stdout=subprocess.DEVNULL)  # stderr says why not
    if done.returncode:
        return {"verdict": "ended in an error", "effects": [], "held out": {}}
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    effects = [f"{effect['effect']} at {effect['joint']}" for effect in report["effects"]]
    found: dict[str, Any] = {"verdict": report["verdict"], "effects": effects, "held out": {}}
    if (folder / "study.toml").is_file():
        augmented = load_study(folder / "study.toml")
        for condition in augmented.evaluation:
            item = pair(augmented, condition)
            error = score(item.response, item.measured).mean_nrmse
            found["held out"][condition.name] = {"named": round(error, 4)}
    return found


def named(plant: str, row: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """What the model with named effects gave, and a corrector of it ("both"), NRMSE %, by condition that was held out; nothing
    where nobody looked or nothing was found. row: the gallery's own figures of the plant."""
    found: dict[str, dict[str, Any]] = {}
    if plant in RIGS:
        found = _committed(
            ROOT / "exported_models" / ("roller_rig" if plant == "rig A" else f"roller_rig_{RIGS[plant]}")
        )
    elif plant in MEASURED:
        found = _told(MEASURED[plant], row["held out"])
    for name, errors in row.get("discovered", {}).get("held out", {}).items():
        found[name] = found.get(name, {}) | errors
    return found


def _committed(rig: Path) -> dict[str, dict[str, Any]]:
    """Of a rig's model, from what lies beside it."""
    told = (rig / "discovery" / "README.md").read_text(encoding="utf-8")
    error = re.search(r"Error at (\d+) km/h, held out: [\d.]+ -> ([\d.]+) %", told)
    found: dict[str, dict[str, Any]] = {error[1]: {"named": float(error[2])}} if error else {}
    if (rig / "models.json").is_file():
        rows = json.loads((rig / "models.json").read_text(encoding="utf-8"))["rows"]
        corrected = next(r for r in rows if r["model"] == "augmented" and r["kind"] == "corrector")
        for name, errors in found.items():
            errors["both"] = corrected["conditions"][name]["nrmse"]
    return found


def _told(name: str, held: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """What tools/real_data/README.md says that discovery reached: in published units, and of the first figure of a condition
    as NRMSE."""
    text = (ROOT / "tools" / "real_data" / "README.md").read_text(encoding="utf-8")
    reached = re.search(rf"^\| {name} \|[^|]*\|([^|]*\([^|]*)\|[^|]*\|$", text, re.M)
    values = re.findall(r"([\d.]+(?:e-?\d+)?)[^(,]*\(([^)]*)\)", reached[1]) if reached else []
    known = {words.replace(" ", ""): float(value) for value, words in values}
    found: dict[str, dict[str, Any]] = {}
    for condition, figures in held.items():
        there = {key: known[key.replace(" ", "")] for key in figures["published"] if key.replace(" ", "") in known}
        if there:
            first = next(iter(there))
            error = there[first] * figures["published"][first]["% of range a unit"]
            found[condition] = {"named": float(f"{error:.4g}"), "published": there}
    return found
