"""Trains the shipped correctors: python tools/train_models.py [A B C] -> exported_models/roller_rig[_B|_C]/

Writes corrector.onnx, card.md and evaluation.json. Minutes a rig on one core; the same seed gives the same file.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from tqdm import tqdm

from fmucorrect import bundle
from fmucorrect.experiment import pair
from fmucorrect.study import load_study
from fmucorrect.training.card import card
from fmucorrect.training.protocol import evaluate, save, summary, total_epochs, train
from fmucorrect.training.settings import Settings

ROOT = Path(__file__).resolve().parent.parent


def make(rig: str) -> None:
    """Train, evaluate and write one rig's corrector."""
    study = load_study(ROOT / "fmus" / "roller_rig" / rig / "study.toml")
    settings = Settings()
    started = time.perf_counter()
    with tqdm(
        total=total_epochs(len(study.development), settings), unit="epoch", desc=f"rig {rig}", disable=None
    ) as bar:
        trained = train(study, settings, bar.update)
    minutes = (time.perf_counter() - started) / 60.0
    folder = ROOT / "exported_models" / ("roller_rig" if rig == "A" else f"roller_rig_{rig}")
    model = bundle.load(save(trained, folder))
    evaluations = [evaluate(pair(study, condition), model) for condition in study.conditions]
    text = card(trained, model, evaluations, f"python tools/train_models.py {rig}")
    (folder / "card.md").write_text(text, encoding="utf-8", newline="\n")
    figures = {"training_minutes": round(minutes, 1), "conditions": [summary(item) for item in evaluations]}
    (folder / "evaluation.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8", newline="\n")
    for item in evaluations:
        before, after = item.before, item.after
        print(
            f"{rig} {item.condition.name:>16} {item.condition.role:<11} R2 {before.mean_r2:7.4f} -> {after.mean_r2:.4f}"
            f"  NRMSE {before.mean_nrmse:6.2f} -> {after.mean_nrmse:.2f} %"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Train the shipped correctors.")
    parser.add_argument("rigs", nargs="*", default=["A", "B", "C"])
    for name in parser.parse_args().rigs:
        make(name)
