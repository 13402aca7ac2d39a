"""Network, named effect, and both on a virtual rig: python tools/compare_models.py RIG [FOUND] [-o OUT]

RIG: A, B or C. FOUND: what `fmucorrect discover fmus/roller_rig/RIG/study.toml -o FOUND` left there (of it augmented.fmu and
study.toml; without the latter the rig's own study is taken). Without FOUND the model is given the rig's own hidden effects, as
far as a discovery could know them (virtual_rig/known.py), and the figures say so.

The rig is measured at 250 and 420 km/h too, which like 385 no training sees: OUT/measured_*.mcap, OUT/roller_rig.toml and
OUT/augmented.toml, which are models of the same measurements (fmucorrect compare). Table, page and correctors lie in OUT
(.compare_models/RIG), the figures beside the rig's model as exported_models/roller_rig[_RIG]/models.json. Minutes a model on
two cores; killed, it goes on from where it was.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent / "virtual_rig"))

import generate
import known
from plant import Plant

from fmucorrect.discovery.augmented import augmented_study, toml
from fmucorrect.places import CORES
from fmucorrect.records import writer
from fmucorrect.report.training import models_page
from fmucorrect.study import Study, load_study
from fmucorrect.training.models import compare_models, lines, require_alike, total, verdict
from fmucorrect.training.tasks import Workshop

ROOT = Path(__file__).resolve().parent.parent
FURTHER = (250.0, 420.0)
"""Speeds, km/h, that are measured beside those of the rig's study."""


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rig", choices=["A", "B", "C"])
    parser.add_argument("found", type=Path, nargs="?")
    parser.add_argument("-o", "--out", type=Path)
    arguments = parser.parse_args()
    name = arguments.rig
    rig = tomllib.loads((ROOT / "tools" / "virtual_rig" / f"{name}.toml").read_text(encoding="utf-8"))
    study = ROOT / "fmus" / "roller_rig" / name / "study.toml"
    out, found = arguments.out or ROOT / ".compare_models" / name, arguments.found
    if found is None:
        found = out / "known"
        known.augment(rig, load_study(study), found)
    table = compare(rig, study, found, out)
    table["augmented"] = "discovery" if arguments.found else "the rig's own hidden effects, written by hand"
    beside = ROOT / "exported_models" / ("roller_rig" if name == "A" else f"roller_rig_{name}")
    (beside / "models.json").write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def compare(rig: dict, study: Path, found: Path, out: Path) -> dict[str, Any]:
    """Everything under `out`; the table."""
    loaded = studies(rig, study, found, out)
    with tqdm(total=total(loaded), unit="epoch", desc=rig["title"], disable=None) as bar:
        table = compare_models(loaded, out, Workshop(out / "work", CORES, advance=bar.update))
    (out / "models.json").write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    models_page.build(models_page.Table.read(table), verdict(table)).write(out / "models.html")
    print(f"{lines(table)}\n\n{verdict(table)}")
    return table


def studies(rig: dict, study: Path, found: Path, out: Path) -> list[Study]:
    """The bare model and the augmented one, of the rig's measurements at all speeds. rig: its .toml. study: the bare model's.
    found: a discovery's folder."""
    out.mkdir(parents=True, exist_ok=True)
    further = measured(rig, at_further_speeds(rig), out)
    own = found / "study.toml"
    text = own.read_text(encoding="utf-8") if own.is_file() else augmented_study(load_study(study), found, {})
    loaded: list[Study] = []
    parts = (("roller_rig", study.read_text(encoding="utf-8"), study.parent), ("augmented", text, found))
    for name, content, folder in parts:
        document = absolute(tomllib.loads(content), folder.resolve())
        document["conditions"] = sorted([*document["conditions"], *further], key=lambda row: row["speed"])
        path = out / f"{name}.toml"
        path.write_text(toml(document), encoding="utf-8", newline="\n")
        loaded.append(load_study(path))
    require_alike(loaded)
    return loaded


def at_further_speeds(rig: dict) -> dict[int, generate.Run]:
    """The rig's tone at FURTHER, to be held out, by the number that the noise is drawn with."""
    tone = generate.tone(generate.AMPLITUDE, rig["surge"])
    like = next(run for run in generate.runs(rig) if run.role == "evaluation")
    return {round(v): generate.Run(f"{v:.0f}", v, tone, like.inputs, like.role, like.extra) for v in FURTHER}


def measured(rig: dict, runs: Mapping[int, generate.Run], out: Path) -> list[dict[str, Any]]:
    """The rig's measurements in further runs and what commanded them, written to `out`; their conditions in a study. runs: by
    the number that the noise is drawn with."""
    plant = Plant("roller_rig")
    for number, run in runs.items():
        generate.write_command(out / run.inputs, run.command)
        with writer(out / f"measured_{run.name}.mcap") as file:
            file.write("/measured", generate.measure(rig, plant, run, np.random.default_rng([rig["seed"], number])))
    document = tomllib.loads(generate.study(rig, list(runs.values())))
    return absolute(document, out.resolve())["conditions"]


def absolute(document: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A study's table with the paths that it names made absolute."""
    document["simulation"]["fmu"] = str((folder / document["simulation"]["fmu"]).resolve())
    for row in document["conditions"]:
        for key in ("inputs", "measurement", "simulated"):
            if key in row:
                row[key] = str((folder / row[key]).resolve())
    return document


if __name__ == "__main__":
    main()
