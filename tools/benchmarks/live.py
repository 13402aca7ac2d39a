"""What a live view costs: the same corrected run with a viewer that has subscribed to everything, and without one."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from benchmark import Row
from benchmarks.steps import MODEL

from fmucorrect import bundle, runs
from fmucorrect.live import Address, Live
from fmucorrect.study import load_study

STUDY = Path(__file__).resolve().parents[2] / "fmus" / "roller_rig" / "A" / "study.toml"
VIEWER = str(Path(__file__).with_name("viewer.py"))


def elapsed(folder: Path, seconds: float, live: bool) -> tuple[float, int]:
    """s of the run itself, and the rows that a viewer in a process of its own was sent."""
    study = load_study(STUDY)
    condition, model = replace(study.condition("385"), measurement=None), bundle.load(MODEL)
    if not live:
        return runs.run_study(study, condition, folder / "run.mcap", model, duration=seconds).elapsed, 0
    with Live(Address(port=0)) as view:
        viewer = subprocess.Popen([sys.executable, VIEWER, view.address.url])
        done = runs.run_study(study, condition, folder / "run.mcap", model, duration=seconds, live=view)
        viewer.wait()
    return done.elapsed, done.live["shown"]


def measure(quick: bool) -> list[Row]:
    seconds, pairs = (60.0, 3) if quick else (240.0, 15)
    ratios: list[float] = []
    shown: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        elapsed(Path(folder), 10.0, live=False)  # what is loaded once
        for turn in range(pairs):
            took: dict[bool, float] = {}
            for live in (False, True) if turn % 2 else (True, False):
                took[live], rows = elapsed(Path(folder), seconds, live)
                shown += [rows / took[live]] if live else []
            ratios.append(took[True] / took[False])
    note = f"roller rig, {seconds:g} s, run_study; {np.median(shown):.0f} rows a second shown, 3 messages each"
    return [Row("run that is watched live / not", float(np.median(ratios)), "", 1.02, False, note)]
