"""Many models simulated on other machines: pieces of work that bring with them all they need.

Any executor that takes a function of this package and bytes will do. What a piece gives are the numbers that this machine
would have found; only large batches are worth the way, the others stay here.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fmucorrect import records
from fmucorrect.clocks import begins
from fmucorrect.companions import files_of
from fmucorrect.discovery import native
from fmucorrect.discovery.kept import digest, packed, unpacked
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import Elsewhere, Problem
from fmucorrect.discovery.trials import Trial
from fmucorrect.errors import RecordError
from fmucorrect.ownfolder import own_folder
from fmucorrect.study import Adjustable, Study
from fmucorrect.workfolder import WorkFolder

PIECE = 1_000_000
"""Steps of the solver in a piece of work, about: the FMU travels with each."""


@dataclass(frozen=True)
class Parcel:
    """What a worker needs to simulate models as a Problem does. files: content by name; study and trials name them."""

    study: Study
    trials: tuple[Trial, ...]
    tolerated: tuple[Adjustable, ...]
    substeps: int
    files: Mapping[str, bytes]


def by(executor: Executor) -> Elsewhere:
    """By an executor, for a Problem of a study with an FMU, where there is work for at least two pieces."""

    def many(
        problem: Problem, models: Sequence[Model], done: Callable[[int], object]
    ) -> Iterator[np.ndarray | None] | None:
        size = max(1, PIECE // sum(trial.rows.stop for trial in problem.trials))  # models a piece
        if problem.fmu is None or len(models) < 2 * size:
            return None
        return _many(executor, problem, [packed(list(models[i : i + size])) for i in range(0, len(models), size)], done)

    return many


def _many(
    executor: Executor, problem: Problem, pieces: Sequence[bytes], done: Callable[[int], object]
) -> Iterator[np.ndarray | None]:
    parcel = packed(_parcel(problem))
    for rows, runs, seconds in executor.map(work, [parcel] * len(pieces), pieces):
        problem.budget.add(seconds, runs)
        for row in rows:
            done(1)
            yield row


def _parcel(problem: Problem) -> Parcel:
    """Without what was measured, which a simulation has no need of."""
    files: dict[str, bytes] = {}

    def moved(path: Path | None) -> Path | None:
        if path is None:
            return None
        if len(files_of(path)) > 1 or records.is_recording(path):
            raise RecordError(
                "a record of several files cannot be sent to other machines",
                where=str(path),
                remedy="Join its files into one, or leave --scheduler out.",
            )
        content = path.read_bytes()
        name = f"{digest(content)}{path.suffix}"
        files[name] = content
        return Path(name)

    study = problem.study
    simulation = replace(study.simulation, fmu=moved(study.fmu))
    trials = [
        replace(
            trial,
            condition=replace(
                trial.condition,
                inputs=moved(trial.condition.inputs),
                simulated=moved(trial.condition.simulated),
                measurement=None,
                begins_ns=begins(study, trial.condition),
            ),
            measured=np.zeros((0, len(study.channels))),
        )
        for trial in problem.trials
    ]
    bare = Study(study.path, study.hash, study.name, simulation, study.channels, (), study.excitation)
    return Parcel(bare, tuple(trials), problem.tolerated, problem.substeps, files)


def work(parcel: bytes, models: bytes) -> tuple[list[np.ndarray | None], int, float]:
    """On a worker, which has fmucorrect[discover]: the evidence of every model, None where the solver gives up; runs of the
    FMU, and s that they simulated."""
    sent: Parcel = unpacked(parcel)
    with WorkFolder() as folder:
        place = folder.path
        for name, content in sent.files.items():
            (place / name).write_bytes(content)

        def here(path: Path | None) -> Path | None:
            return None if path is None else place / path

        study = replace(sent.study, simulation=replace(sent.study.simulation, fmu=here(sent.study.fmu)))
        trials = tuple(
            replace(
                t,
                condition=replace(t.condition, inputs=here(t.condition.inputs), simulated=here(t.condition.simulated)),
            )
            for t in sent.trials
        )
        with quietly(), Problem(study, None, library(), trials, sent.tolerated, 1, sent.substeps) as problem:
            return list(problem.many(unpacked(models))), problem.budget.runs, problem.budget.seconds


def library() -> Path:
    """The native loop with the laws, kept between runs where the user has a folder of his own."""
    return native.build(own_folder())


@contextmanager
def quietly() -> Generator[None]:
    """Without what solvers say when a candidate makes them unstable, which is no one's fault."""
    solvers = logging.getLogger("fmucorrect.fmu")
    before = solvers.level
    solvers.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        solvers.setLevel(before)
