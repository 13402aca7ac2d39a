"""Trains the shipped correctors: python tools/train_models.py [A B C] -> exported_models/roller_rig[_B|_C]/

Four to six minutes a rig on one core; the same seed gives the same file.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from fmucorrect.study import load_study
from fmucorrect.training.protocol import total_epochs
from fmucorrect.training.results import lines, train_into
from fmucorrect.training.settings import Settings

ROOT = Path(__file__).resolve().parent.parent


def make(rig: str) -> None:
    """Train, evaluate and write one rig's corrector."""
    study = load_study(ROOT / "fmus" / "roller_rig" / rig / "study.toml")
    folder = ROOT / "exported_models" / ("roller_rig" if rig == "A" else f"roller_rig_{rig}")
    settings = Settings()
    with tqdm(
        total=total_epochs(len(study.development), settings), unit="epoch", desc=f"rig {rig}", disable=None
    ) as bar:
        results = train_into(folder, study, settings, f"python tools/train_models.py {rig}", bar.update)
    print(f"rig {rig}\n{lines(results.evaluations)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Train the shipped correctors.")
    parser.add_argument("rigs", nargs="*", default=["A", "B", "C"])
    for name in parser.parse_args().rigs:
        make(name)
