"""What a discovery will cost, before it runs: from how many candidates a study has, and one run of its FMU by the clock."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing, nullcontext
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.candidates import adjustables, may_act, parts, places
from fmucorrect.discovery.elsewhere import library
from fmucorrect.discovery.fidelity import DEAR, can_respond
from fmucorrect.discovery.model import Model, runner, simulate
from fmucorrect.discovery.problem import Problem, load
from fmucorrect.discovery.signatures import PROMISING
from fmucorrect.discovery.stepwise import fewer
from fmucorrect.errors import FmucorrectError
from fmucorrect.pairs import Pair
from fmucorrect.report.base.words import duration
from fmucorrect.study import Study, load_study

LOOKS = (1.5, 18.0)
"""Runs of a whole discovery, in those of one look at all candidates. Of 14 chains of masses the least took 1.6, the median 1.9
and the most 7.2; four machines of others took 3.7, 6.3, 17 (friction that falls, beside a wrong mass) and 18 (what no catalogue
holds)."""


FEWER = 0.3
"""Share of these runs that is left where the FMU's linear response tells the rest: of six cases of the second generator 0.23 to
0.35, of two masses 0.33."""


@dataclass(frozen=True)
class Estimate:
    """runs: of the FMU, from and to. seconds: that one takes here, by the clock, beside others. workers: runs at a time. few:
    whether its linear response tells the rest."""

    runs: tuple[int, int]
    seconds: float
    workers: int
    few: bool

    @property
    def text(self) -> str:
        """For people."""
        low, high = (duration(runs * self.seconds / self.workers) for runs in self.runs)
        counts = " to ".join(f"{runs:,}".replace(",", " ") for runs in self.runs)
        return (
            f"discover: about {counts} runs of the FMU, {self.seconds:.2g} s each, {self.workers} at a time here: {low} to "
            f"{high} of simulation, {'beside what its linear response tells; ' if self.few else ''}more where nothing explains "
            f"the measurement{' or that does not hold' if self.few else ''} (--time-limit gives a verdict before)"
        )

    def to_json(self) -> dict[str, object]:
        """For programs."""
        runs = list(self.runs)
        return {"runs": runs, "seconds_a_run": self.seconds, "at_a_time": self.workers, "few_runs": self.few}


def estimate(study: Study, pairs: Sequence[Pair]) -> Estimate | None:
    """Of a study whose conditions are simulated already: `pairs`. None where it has no FMU, or where that does not run as the
    search runs it."""
    if study.fmu is None or not study.development:
        return None
    known = tuple(replace(condition, free=()) for condition in study.conditions)  # fitted with the library
    with load(replace(study, conditions=known), None, pairs=pairs) as problem:
        few = fewer(problem)
        with few or nullcontext(problem) as looked:
            curves, step = _curves(looked), study.simulation.step_size
            length = step * float(np.mean([trial.rows.stop for trial in looked.trials]))
            runs = [factor * (2 * curves + 3 * min(curves, PROMISING)) * len(looked.trials) for factor in LOOKS]
        with ProcessPoolExecutor(
            1, get_context("spawn")
        ) as child:  # a solver that dies takes that process with it alone
            try:
                pace = child.submit(_pace, study.path, problem.trials[0].rows.stop, problem.workers).result()
            except BrokenProcessPool:
                return None
        if pace is None:
            return None
        few_runs = can_respond(problem) and pace * step > DEAR
        low, high = (_rounded(FEWER * count if few_runs else count) for count in runs)
        return Estimate((low, high), pace * length, problem.workers, few_runs)


def _pace(path: Path, rows: int, workers: int) -> float | None:
    """Seconds by the clock for one that is simulated, over so many rows of the first development condition, of as many runs at
    a time as the search makes: solvers in Python wait for each other. None where the FMU does not run."""
    study, budgets = load_study(path), [Budget() for _ in range(workers)]
    condition = study.development[0]
    try:
        with ExitStack() as opened, ThreadPoolExecutor(workers) as pool:
            items = [
                opened.enter_context(closing(runner(study, condition, library(), rows, budget=budget)))
                for budget in budgets
            ]
            begun = time.perf_counter()
            list(pool.map(lambda item: simulate(study, item, condition, Model(), ()), items))
            took, simulated = time.perf_counter() - begun, sum(budget.seconds for budget in budgets) / workers
            return took / simulated if simulated > 0.0 else None
    except (FmucorrectError, ImportError):
        return None


def _rounded(count: float) -> int:
    """To two digits."""
    return int(float(f"{count:.1e}"))


def _curves(problem: Problem) -> int:
    """How many candidates there are: each law at each place by each of its guesses, parameters both ways, errors of sensors and
    excitation."""
    study = problem.study
    laws = [law for forms in CATALOGUE.values() for law in forms if "speed" not in law.inputs]
    forces = sum(len(law.guesses) for joints in places(study).values() for law in laws if may_act(law, joints))
    signals = sum(1 if law.at == "excitation" else len(study.channels) for forms in SIGNALS.values() for law in forms)
    return forces + 2 * len([*adjustables(problem), *parts(problem)]) + signals
