"""The paper's protocol, four folds and the refit of all three cases, against plain full-batch torch on the same two cores.

Plain: the same losses and the same Adam, torch.tanh, all rows at once, one training after the other on all cores. Ours: folds
and refits as processes of one thread, side by side, the quick tanh, rows in pieces. Each training runs a few epochs; its
median epoch times the paper's number of epochs is its share of a protocol.
"""

from __future__ import annotations

import os
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from benchmark import Row

STUDY = Path(__file__).resolve().parent.parent.parent / "fmus" / "roller_rig" / "A" / "study.toml"
CASES = ("pinn", "tdnn_residual", "proposed")


def epochs_of(context: Any, arguments: tuple[Any, ...]) -> list[float]:
    """Median time of an epoch, s, stage by stage, of one fit."""
    from fmucorrect.training.cases import fit_case
    from fmucorrect.training.tasks import Context

    ticks = [time.perf_counter()]
    fit_case(Context(None, lambda _: ticks.append(time.perf_counter()), context.device), *arguments)
    spans = np.array([b - a for a, b in pairwise(ticks)])
    ends = np.cumsum(list(arguments[-1].values()))
    return [float(np.median(part)) for part in np.split(spans, ends[:-1])]


def plain(arguments: tuple[Any, ...], cores: int) -> list[float]:
    """The same by plain torch."""
    import torch

    from fmucorrect.training import mlp
    from fmucorrect.training.tasks import Context

    quick, piece = mlp.ACTIVATIONS["tanh"], mlp.PIECE
    mlp.ACTIVATIONS["tanh"], mlp.PIECE = torch.tanh, 10**9
    torch.set_num_threads(cores)
    try:
        return epochs_of(Context(None, lambda _: None), arguments)
    finally:
        mlp.ACTIVATIONS["tanh"], mlp.PIECE = quick, piece
        torch.set_num_threads(1)


def measure(quick: bool) -> list[Row]:
    from dataclasses import replace

    from fmucorrect.study import load_study
    from fmucorrect.training.cases import CASES as KNOWN
    from fmucorrect.training.data import samples
    from fmucorrect.training.protocol import screened
    from fmucorrect.training.resolved import resolved
    from fmucorrect.training.selection import folds
    from fmucorrect.training.tasks import Task, Workshop

    study = load_study(STUDY)
    pairs = list(screened(study).pairs)
    settings = resolved(study, study.training, pairs)
    development = [samples(pair, settings.window) for pair in pairs]
    cores = os.cpu_count() or 1
    rows: list[Row] = []
    for decimation, few in ((settings.decimation, 24), (1, 4)):
        training = replace(settings, decimation=decimation)
        jobs: list[tuple[Any, ...]] = []
        full: list[list[int]] = []
        for case in (case for case in KNOWN if case.key in CASES):
            most = case.epochs(training)
            for rest, held in [*folds(development), (development, [])][:: 4 if quick or decimation == 1 else 1]:
                jobs.append((case.key, rest, held, training, 0, dict.fromkeys(most, few)))
                full.append(list(most.values()))

        def total(found: list[list[float]], full: list[list[int]] = full) -> float:
            return sum(
                n * t for counts, times in zip(full, found, strict=True) for n, t in zip(counts, times, strict=True)
            )

        side_by_side = [Task(f"{i}", epochs_of, (job,), 1) for i, job in enumerate(jobs)]
        found: list[tuple[float, float]] = []
        for _ in range(1 if quick or decimation == 1 else 3):  # in turn, so that both see the same machine
            ours = total(Workshop(workers=cores).run(side_by_side)) / cores
            found.append((ours, total([plain(job, cores) for job in jobs])))
        ours = float(np.median([a for a, _ in found]))
        ratio = float(np.median([b / a for a, b in found]))
        count = sum(len(item.seconds[::decimation]) for item in development)
        how = f"folds and refit of PINN, TDNN-residual, proposed, {count} rows, {cores} processes"
        rows.append(Row("training, plain full-batch torch / ours", ratio, "times as fast", 1.8, True, how))
        if decimation == settings.decimation and not quick:
            rows.append(
                Row("the paper's protocol on rig A", ours / 60.0, "min", None, True, "four folds and the refit")
            )
    return rows
