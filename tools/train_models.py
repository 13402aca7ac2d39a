"""Trains the shipped correctors: python tools/train_models.py [A B C] -> exported_models/roller_rig[_B|_C]/

Minutes a rig on two cores; the same seed gives the same file. Killed, it goes on from the folder .train_models.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from fmucorrect.places import CORES
from fmucorrect.study import load_study
from fmucorrect.training.protocol import total_epochs
from fmucorrect.training.results import lines, train_into
from fmucorrect.training.tasks import Workshop

ROOT = Path(__file__).resolve().parent.parent


def make(rig: str) -> None:
    """Train, evaluate and write one rig's corrector."""
    study = load_study(ROOT / "fmus" / "roller_rig" / rig / "study.toml")
    folder = ROOT / "exported_models" / ("roller_rig" if rig == "A" else f"roller_rig_{rig}")
    with tqdm(total=total_epochs(study, study.training), unit="epoch", desc=f"rig {rig}", disable=None) as bar:
        workshop = Workshop(ROOT / ".train_models" / rig, CORES, advance=bar.update)
        results = train_into(folder, study, study.training, f"python tools/train_models.py {rig}", workshop)
    print(f"rig {rig}\n{lines(results.evaluations)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Train the shipped correctors.")
    parser.add_argument("rigs", nargs="*", default=["A", "B", "C"])
    for name in parser.parse_args().rigs:
        make(name)
