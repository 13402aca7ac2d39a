"""The paper's protocol, four folds and the refit of all three cases, against plain full-batch torch on the same two cores.

Plain: the same losses and the same Adam, torch.tanh, all rows at once, one training after the other on all cores. Ours: folds
and refits as processes of one thread, the quick tanh, rows in pieces. A share of the paper's epochs is run, and the time of a
protocol computed from what the fits took themselves; starting the processes (seconds) is left out on one side only where the
paper's full epochs make it nothing.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

from benchmark import Row

STUDY = Path(__file__).resolve().parent.parent.parent / "fmus" / "roller_rig" / "A" / "study.toml"
CASES = ("pinn", "tdnn_residual", "proposed")


def measure(quick: bool) -> list[Row]:
    import torch

    from fmucorrect.study import load_study
    from fmucorrect.training import mlp
    from fmucorrect.training.cases import CASES as KNOWN
    from fmucorrect.training.cases import fit_case, resolved
    from fmucorrect.training.data import samples
    from fmucorrect.training.protocol import development_pairs
    from fmucorrect.training.selection import folds
    from fmucorrect.training.tasks import Context, Task, Workshop

    share = 100 if quick else 25
    study = load_study(STUDY)
    pairs = development_pairs(study)
    training = resolved(study, study.training, pairs)
    development = [samples(pair, training.window) for pair in pairs]
    tasks: list[Task] = []
    for case in (case for case in KNOWN if case.key in CASES):
        epochs = {stage: count // share for stage, count in case.epochs(training).items()}
        for rest, held in [*folds(development), (development, [])]:
            arguments = (case.key, rest, held, training, 0, epochs)
            tasks.append(Task(case.key, fit_case, arguments, sum(epochs.values())))
    cores = os.cpu_count() or 1
    tasks.sort(key=lambda task: -task.epochs)
    ours, plain = [], []
    quick_tanh, piece = mlp.ACTIVATIONS["tanh"], mlp.PIECE
    for _ in range(1 if quick else 3):  # in turn, so that both see the same machine
        results = Workshop(workers=cores).run(tasks)
        ours.append(sum(fit.seconds for fit in results) / cores)
        mlp.ACTIVATIONS["tanh"], mlp.PIECE = torch.tanh, 10**9
        torch.set_num_threads(cores)
        begun = time.perf_counter()
        for task in tasks:
            task.work(Context(None, lambda _: None), *task.arguments)
        plain.append(time.perf_counter() - begun)
        mlp.ACTIVATIONS["tanh"], mlp.PIECE = quick_tanh, piece
        torch.set_num_threads(1)
    ratio = sorted(p / o for p, o in zip(plain, ours, strict=True))[len(ours) // 2]
    rows = sum(len(item.seconds[:: training.decimation]) for item in development)
    how = f"4 folds and refit of PINN, TDNN-residual, proposed; {rows} rows, {cores} processes; 1/{share} of the epochs"
    minutes = share * sorted(ours)[len(ours) // 2] / 60.0
    return [
        Row("training protocol, plain full-batch torch / ours", ratio, "times as fast", 1.8, True, how),
        Row("training protocol of the paper, rig A", minutes, "min", None, True, "computed from the same run"),
    ]
