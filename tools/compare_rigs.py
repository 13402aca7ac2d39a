"""Compares all cases on the rigs: python tools/compare_rigs.py [A B C] -> exported_models/roller_rig[_B|_C]/compare.json

Rig A with the paper's epochs, B and C with a fifth of them; five seeds and the ablation everywhere. An hour on two cores.
Killed, it goes on from the folder .compare; the page of each rig lies there too.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from fmucorrect.report import compare_page
from fmucorrect.study import load_study
from fmucorrect.study_training import Training
from fmucorrect.training.compare import compare_study, total
from fmucorrect.training.compare_table import lines
from fmucorrect.training.results import save_comparison
from fmucorrect.training.tasks import CORES, Workshop

ROOT = Path(__file__).resolve().parent.parent
SEEDS = range(5)


def shortened(training: Training, share: int) -> Training:
    """The same with a share of the paper's epochs."""
    pinn, second, third = training.pinn, training.tdnn_residual, training.proposed
    return replace(
        training,
        pinn=replace(pinn, epochs=pinn.epochs // share),
        tdnn_residual=replace(second, epochs=second.epochs // share, tdnn_epochs=second.tdnn_epochs // share),
        proposed=replace(third, epochs=third.epochs // share, tdnn_epochs=third.tdnn_epochs // share),
    )


def make(rig: str) -> None:
    """Compare, keep everything under .compare, and the figures without loss curves beside the model."""
    study = load_study(ROOT / "fmus" / "roller_rig" / rig / "study.toml")
    training = study.training if rig == "A" else shortened(study.training, 5)
    place = ROOT / ".compare" / rig
    with tqdm(total=total(study, training, len(SEEDS), True), unit="epoch", desc=f"rig {rig}", disable=None) as bar:
        workshop = Workshop(place / "work", CORES, advance=bar.update)
        result = compare_study(study, training, SEEDS, True, workshop)
    save_comparison(place, result.table, result.histories)
    compare_page.write_page(place / "compare.html", result.table, result.histories)
    bare = result.table | {"cases": [{**row, "curves": []} for row in result.table["cases"]]}
    model = ROOT / "exported_models" / ("roller_rig" if rig == "A" else f"roller_rig_{rig}")
    save_comparison(model, bare)
    print(f"rig {rig}\n{lines(result.table)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Compare all cases on the rigs.")
    parser.add_argument("rigs", nargs="*", default=["A", "B", "C"])
    for name in parser.parse_args().rigs:
        make(name)
