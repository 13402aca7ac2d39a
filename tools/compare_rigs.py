"""Compares all cases on rig A, and ablates the paper's case 3 on all rigs: python tools/compare_rigs.py [A B C]

A: everything that `fmucorrect compare --ablate` does, the paper's epochs, five seeds, into exported_models/roller_rig/
compare.json; the page lies in .compare/A. B and C: the ablation alone, into exported_models/roller_rig_[B|C]/ablation.json,
C, which has three times the records, with 150 epochs instead of 400.
Half an hour, and ten minutes each, on two cores. Killed, it goes on from the folder .compare.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from fmucorrect.pairs import pair
from fmucorrect.places import CORES
from fmucorrect.report.training import compare_page
from fmucorrect.report.training.table import Table
from fmucorrect.study import Study, load_study
from fmucorrect.training.ablation import VARIANTS, ablation_table, budget, fit_variants
from fmucorrect.training.cases import needed
from fmucorrect.training.compare import compare_study, total
from fmucorrect.training.compare_table import lines
from fmucorrect.training.data import samples
from fmucorrect.training.protocol import screened
from fmucorrect.training.resolved import resolved
from fmucorrect.training.results import save_comparison
from fmucorrect.training.tasks import Workshop

ROOT = Path(__file__).resolve().parent.parent
SEEDS = range(5)


def compare(study: Study, place: Path, model: Path) -> None:
    """Everything under `place`, and the figures without loss curves beside the model."""
    count = total(study, study.training, len(SEEDS), True)
    with tqdm(total=count, unit="epoch", desc=study.name, disable=None) as bar:
        workshop = Workshop(place / "work", CORES, advance=bar.update)
        result = compare_study(study, study.training, SEEDS, True, workshop)
    save_comparison(place, result.table, result.histories)
    compare_page.build(Table.read(result.table), result.histories).write(place / "compare.html")
    save_comparison(model, result.table | {"cases": [{**row, "curves": []} for row in result.table["cases"]]})
    print(lines(result.table))


def ablate(study: Study, place: Path, model: Path) -> None:
    """The ablation alone; evaluation conditions are opened when everything is fitted."""
    pairs = list(screened(study).pairs)
    known, told = resolved(study, study.training, pairs)
    training = needed(known)
    print(*told, sep="\n")
    if len(pairs) > 4:
        training = replace(training, proposed=replace(training.proposed, epochs=150, tdnn_epochs=75))
    development = [samples(item, training.window) for item in pairs]
    count = len(VARIANTS) * len(SEEDS) * sum(budget(training.proposed))
    with tqdm(total=count, unit="epoch", desc=study.name, disable=None) as bar:
        workshop = Workshop(place / "work", CORES, advance=bar.update)
        fits = fit_variants(development, training, SEEDS, workshop)
    held = [samples(pair(study, condition), training.window) for condition in study.evaluation]
    table = {"study_sha256": study.hash, "ablation": ablation_table(fits, SEEDS, held)}
    (model / "ablation.json").write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    for row in table["ablation"]["rows"]:
        print(f"{row['label']:<45} {' '.join(f'{value:7.3f}' for value in row['nrmse'])}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Compare cases and losses on the rigs.")
    parser.add_argument("rigs", nargs="*", default=["A", "B", "C"])
    for rig in parser.parse_args().rigs:
        one = load_study(ROOT / "fmus" / "roller_rig" / rig / "study.toml")
        beside = ROOT / "exported_models" / ("roller_rig" if rig == "A" else f"roller_rig_{rig}")
        (compare if rig == "A" else ablate)(one, ROOT / ".compare" / rig, beside)
