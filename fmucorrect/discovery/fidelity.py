"""What tells of models near another one: the FMU itself, or where a run of it is dear its linear response."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.discovery.kept import remembered
from fmucorrect.discovery.model import Model, runner, simulate
from fmucorrect.discovery.problem import LARGEST, Problem
from fmucorrect.discovery.response import Response
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.discovery.trials import Trial
from fmucorrect.errors import FmuError

DEAR = 1e-4
"""s of the clock for a step of the FMU from which on its response is asked in its place, where that is enough: so much that
50 000 runs of 10 s at 1 ms would take half a day, and twenty times and more what the response takes for a step."""


def can_respond(problem: Problem) -> bool:
    """Whether there is a response to ask for: not without an FMU or joints, nor of a solver of which a process holds one."""
    logged = any(trial.condition.simulated is not None for trial in problem.trials)
    return not (problem.fmu is None or logged or problem.fmu.one_instance) and bool(problem.study.joints)


@remembered
def dear(problem: Problem) -> bool:
    """Whether a step of the FMU takes long, by the clock. What was found once stays so when a discovery goes on."""
    study, trial = problem.study, problem.trials[0]
    (law,), joint = CATALOGUE["viscous_damping"], study.joints[0]
    little = ForceTerm(law, joint.name, (joint,), law.complete({"damping": 1e-9}))
    item = runner(study, trial.condition, problem.library, trial.rows.stop, problem.substeps, problem.budget)
    with closing(item):
        took = 0.0
        for model in (problem.nominal, replace(problem.nominal, terms=(little,))):  # the first one opens it
            begun, before = time.perf_counter(), problem.budget.seconds
            simulate(study, item, trial.condition, model, problem.tolerated)
            took = (time.perf_counter() - begun) / max(problem.budget.seconds - before, study.simulation.step_size)
    return took * study.simulation.step_size > DEAR


class Responses:
    """The linear responses of a study's conditions, for `Problem.near`; to be closed."""

    def __init__(self) -> None:
        self._of: dict[str, tuple[tuple[int, int], Response]] = {}

    def __call__(
        self, problem: Problem, models: Sequence[Model], around: Model, done: Callable[[int], object]
    ) -> Iterator[np.ndarray | None]:
        """The evidence of models near another one, exact where they are that one. What the response does not cover is
        simulated."""
        own = [self._response(problem, trial) for trial in problem.trials]
        covered = [all(item.covers(model, around) for item in own) for model in models]
        exact = problem.simulated([model for model, there in zip(models, covered, strict=True) if not there], done)

        def one(task: tuple[Response, Model]) -> np.ndarray | None:
            item, model = task
            problem.budget.add(0.0, 0, told=int(model != around))
            try:
                rows = item.evidence(model, around)
            except FmuError:
                return None
            return rows if float(np.abs(rows).max(initial=0.0)) < LARGEST else None

        for model, there in zip(models, covered, strict=True):
            if not there:
                yield next(exact)
                continue
            rows = list(problem.each([(item, model) for item in own], one))
            done(1)
            yield None if any(row is None for row in rows) else np.concatenate(rows)  # type: ignore[arg-type]

    def _response(self, problem: Problem, trial: Trial) -> Response:
        """One a condition, that of the newest length and coupling: a search goes on to longer records and finer steps."""
        kind, name = (trial.rows.stop, problem.substeps), trial.condition.name
        known, found = self._of.get(name, (None, None))
        if found is None or known != kind:
            if found is not None:
                found.close()
            found = Response(problem, trial)
            self._of[name] = kind, found
        return found

    def close(self) -> None:
        """Release all solvers."""
        for _, item in self._of.values():
            item.close()
        self._of.clear()
