"""Correctors of many plants, as `fmucorrect train` makes them: python tools/gallery.py [NAME...]

It writes exported_models/gallery.json and gallery.md. Rigs A, B and C; a quarter car over random roads that lacks friction,
a stop or nothing (tools/quarter_car.py); and measured machines (tools/real_data), where their data are there. For each: the
error of the simulation as it is, of what leaving conditions out says of every family, of the corrector on the held-out
conditions, what its 90 % band holds and what it flags. Minutes to half an hour a plant on two cores. Killed, it goes on
from the folder .gallery; figures of plants that are not named stay.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tools"))
import quarter_car  # noqa: E402

from fmucorrect.comparison import BAND_90, Comparison  # noqa: E402
from fmucorrect.stepper import Status  # noqa: E402
from fmucorrect.study import load_study  # noqa: E402
from fmucorrect.training.protocol import total_epochs  # noqa: E402
from fmucorrect.training.results import train_into  # noqa: E402
from fmucorrect.training.tasks import CORES, Workshop  # noqa: E402
from fmucorrect.training.verdict import WORDS  # noqa: E402

WORK = ROOT / ".gallery"
FIGURES = ROOT / "exported_models" / "gallery.json"
RIGS = {f"rig {letter}": letter for letter in "ABC"}
CARS = {f"quarter car, {kind}": kind for kind in quarter_car.KINDS}
MEASURED = ("silverbox", "bouc_wen", "rotary", "mr_damper", "emps")
PLANTS = (*RIGS, *CARS, *MEASURED)


def folder_of(plant: str) -> Path:
    """Where its study, work and model lie."""
    return WORK / plant.replace(", ", "_").replace(" ", "_")


def study_of(plant: str) -> Path:
    """The study's path; it is made where it is not there."""
    if plant in RIGS:
        return ROOT / "fmus" / "roller_rig" / RIGS[plant] / "study.toml"
    path = folder_of(plant) / "study" / "study.toml"
    if not path.is_file():
        if plant in CARS:
            return quarter_car.write(path.parent, CARS[plant])
        make = [sys.executable, str(ROOT / "tools" / "real_data" / "make.py"), plant, "--out", str(path.parent)]
        subprocess.run(make, check=True, stdout=subprocess.DEVNULL)
    return path


def row(plant: str) -> dict[str, Any]:
    """Train and score one plant."""
    study = load_study(study_of(plant))
    folder = folder_of(plant)
    with tqdm(total=total_epochs(study, study.training), unit="epoch", desc=plant, disable=None) as bar:
        workshop = Workshop(folder / "work", CORES, advance=bar.update)
        results = train_into(folder / "model", study, study.training, f"python tools/gallery.py {plant!r}", workshop)
    selection = results.trained.selection
    return {
        "family": selection.family,
        "tried": {family: round(error, 4) for family, error in selection.means.items()},
        "held out": {e.condition.name: _scored(e) for e in results.evaluations if e.condition.role == "evaluation"},
    }


def _scored(item: Comparison) -> dict[str, Any]:
    error = item.corrected[item.scored] - item.measured[item.scored]
    bare = item.simulated[item.scored] - item.measured[item.scored]
    return {
        "bare": round(item.before.mean_nrmse, 4),
        "corrected": round(item.after.mean_nrmse, 4),
        "bare rms": [float(f"{v:.4g}") for v in np.sqrt((bare**2).mean(axis=0))],
        "corrected rms": [float(f"{v:.4g}") for v in np.sqrt((error**2).mean(axis=0))],
        "unit": item.channels[0].unit,
        "coverage": round(float(item.within(BAND_90).mean()), 4),
        "flagged": round(float((item.status[item.scored] == Status.OUTSIDE).mean()), 4),
    }


def table(rows: dict[str, Any]) -> str:
    """gallery.md"""
    families = list(WORDS)
    lines = [
        "# Many plants, and what `fmucorrect train` makes of them",
        "",
        "`python tools/gallery.py`; NRMSE, %. The columns of families: mean over the development conditions, each left out in "
        "turn; the one that was taken is bold. Then the conditions that were held out of everything: as simulated, corrected, "
        "share of samples inside the 90 % band and share flagged as outside. What is not there was not run.",
        "",
        "| plant | " + " | ".join(WORDS[f] for f in families) + " | held out | bare | corrected | band | flagged |",
        "|---|" + "---|" * (len(families) + 5),
    ]
    for plant, found in rows.items():
        tried = [
            ""
            if f not in found["tried"]
            else f"**{found['tried'][f]:.2f}**"
            if f == found["family"]
            else f"{found['tried'][f]:.2f}"
            for f in families
        ]
        for i, (name, scores) in enumerate(found["held out"].items()):
            first = [plant, *tried] if i == 0 else [""] * (1 + len(families))
            after = [f"{scores['bare']:.3f}", f"{scores['corrected']:.3f}", f"{100 * scores['coverage']:.0f} %"]
            lines.append("| " + " | ".join([*first, name, *after, f"{100 * scores['flagged']:.1f} %"]) + " |")
    return "\n".join(lines) + "\n"


def main(plants: Sequence[str]) -> None:
    rows = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else {}
    for plant in plants:
        rows[plant] = row(plant)
        rows = {name: rows[name] for name in PLANTS if name in rows}
        FIGURES.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        FIGURES.with_suffix(".md").write_text(table(rows), encoding="utf-8")
    print(table(rows))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Train and score correctors of many plants.")
    parser.add_argument("plants", nargs="*", default=list(PLANTS), choices=[*PLANTS, []], metavar="NAME")
    main(parser.parse_args().plants or PLANTS)
