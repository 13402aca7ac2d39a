"""Assesses the shipped models and keeps the figures: python tools/assess_models.py [--from DIR] -> tools/assessed.json

--from takes the folders DIR/MODEL that `fmucorrect assess all fmus/MODEL/assess.toml -o DIR/MODEL` wrote, and runs nothing.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
MODELS = {"full_vehicle": "full vehicle", "roller_rig": "roller rig", "cooperrider": "Cooperrider's bogie"}
KMH = 3.6
# section 2.5 and 4.1 of the preprint
PAPER = {
    "force elements that settle": "all",
    "residual acceleration, m/s² (threshold 0.1)": "0.0189",
    "loads against the independent equilibrium (5 %)": "within 5 %",
    "nonlinear critical speed, stepping down or slowing down, km/h": "1124",
}


def main() -> None:
    parser = argparse.ArgumentParser(description="Assess the shipped models.")
    parser.add_argument("--from", dest="done", type=Path, help="folder of assessments that were made")
    done = parser.parse_args().done
    with tempfile.TemporaryDirectory() as folder:
        place = done or Path(folder)
        for model in MODELS:
            if not done:
                command = [str(Path(sys.executable).with_name("fmucorrect")), "assess", "all"]
                subprocess.run(
                    [*command, str(ROOT / "fmus" / model / "assess.toml"), "-o", str(place / model)], check=True
                )
        found = {
            name: figures(json.loads((place / m / "assessment.json").read_text("utf-8"))) for m, name in MODELS.items()
        }
    text = json.dumps({**found, "the paper's vehicle": PAPER}, indent=1, ensure_ascii=False) + "\n"
    (ROOT / "tools" / "assessed.json").write_text(text, encoding="utf-8")


def figures(report: dict[str, Any]) -> dict[str, str]:
    """What an assessment says, one line each."""
    said: dict[str, str] = {}
    if preload := report["preload"]:
        count = len(preload["elements"])
        said["force elements that settle"] = f"{sum(row['converged'] for row in preload['elements'])} of {count}"
        said["residual acceleration, m/s² (threshold 0.1)"] = f"{preload['residual_acceleration']:.1g}"
        said["loads against the independent equilibrium (5 %)"] = per_cent(preload["largest_load_error"])
    if speed := report["critical_speed"]:
        said["conicity"] = f"{speed['conicity']:.3g}"
        linear = f"{KMH * speed['linear_critical_speed']:.4g}"
        for row in speed["published"]:
            if row["kind"] == "linear":
                linear += f" ({row['name']}: {KMH * row['speed']:.4g})"
        said["linear critical speed, km/h"] = linear
        down, slowing = speed["nonlinear_critical_speed"], speed["deceleration"]["critical_speed"]
        said["nonlinear critical speed, stepping down or slowing down, km/h"] = (
            f"{KMH * down:.0f} / {KMH * slowing:.0f}"
        )
    if safety := report["safety"]:
        for quantity, label in (("derailment_quotient", "largest Y/Q"), ("wheel_unloading", "largest wheel unloading")):
            rows = [row for row in safety["values"] if row["quantity"] == quantity]
            largest = max(rows, key=lambda row: row["extreme"])
            radius = f"{float(largest['radius']):.0f}"
            said[f"{label}, in which curve"] = (
                f"{largest['extreme']:.2f} in {radius} m at {KMH * safety['speeds'][radius]:.0f} km/h"
            )
    return said


def per_cent(share: float) -> str:
    return f"{100 * share:.2g} %" if share >= 1e-5 else "< 0.001 %"


if __name__ == "__main__":
    main()
