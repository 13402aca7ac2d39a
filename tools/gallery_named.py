"""What is known of the gallery's plants once their effects are named, from committed results of discovery."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gallery_plants import MEASURED, RIGS

ROOT = Path(__file__).resolve().parent.parent


def named(plant: str, held: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """What the model with named effects gave, and a corrector of it ("both"), NRMSE %, by condition that was held out: as it
    stands in committed results, nothing where it does not. held: the gallery's own figures of these conditions."""
    if plant in RIGS:
        beside = ROOT / "exported_models" / ("roller_rig" if plant == "rig A" else f"roller_rig_{RIGS[plant]}")
        told = (beside / "discovery" / "README.md").read_text(encoding="utf-8")
        found: dict[str, dict[str, float]] = {}
        if error := re.search(r"Error at (\d+) km/h, held out: [\d.]+ -> ([\d.]+) %", told):
            found[error[1]] = {"named": float(error[2])}
        if (beside / "models.json").is_file():
            rows = json.loads((beside / "models.json").read_text(encoding="utf-8"))["rows"]
            corrected = next(r for r in rows if r["model"] == "augmented" and r["kind"] == "corrector")
            for name in found:
                found[name]["both"] = corrected["conditions"][name]["nrmse"]
        return found
    if plant in MEASURED:
        return _told(MEASURED[plant], held)
    return {}


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
