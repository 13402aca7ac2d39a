"""What discovery looks at: the measured development conditions, and their simulation with any effects in it.

Candidates are simulated in this process, in threads, by a loop in C: thousands of runs. The solver is tried out first, each
development condition as a whole and in a process of its own (load): one that crashes, hangs or ends its process there is
one FmuError, and one that comes through is taken for harmless.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from queue import SimpleQueue
from types import MappingProxyType, TracebackType
from typing import TypeVar

import numpy as np
from jaxtyping import Float64

from fmucorrect.companions import files_of
from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.kept import Kept, code, digest
from fmucorrect.discovery.ledger import Ledger
from fmucorrect.discovery.model import AS_BEGUN, Model, Runner, runner, simulate, start_value, tolerance_of
from fmucorrect.discovery.starts import fitted
from fmucorrect.discovery.terms import SignalTerm
from fmucorrect.discovery.trials import Trial, read
from fmucorrect.errors import FmuError, StudyError
from fmucorrect.fmu import FmuDescription, open_fmu
from fmucorrect.pairs import Pair
from fmucorrect.places import CORES
from fmucorrect.study import Adjustable, Study

T = TypeVar("T")
R = TypeVar("R")
LARGEST = 1e8
"""A response, in units of the noise, beyond which a model is not stable."""


@dataclass
class Problem:
    """A study's development conditions, loaded. Close it, or use it in a with statement.

    fmu: the study's, None where it has none. trials: their data. tolerated: adjustables that may differ by their tolerance
    anyway. workers: threads that simulate. substeps: couplings of laws and FMU in a communication step. kept: what was found
    already. elsewhere: simulates large batches. response: tells models near another one by its linear response, where a run of
    the FMU is dear. off: errors of sensors and inputs that all models have meanwhile (seen_by). budget: counts runs of the FMU.
    ledger: of all fits of this discovery.
    """

    study: Study
    fmu: FmuDescription | None
    library: Path | None
    trials: tuple[Trial, ...]
    tolerated: tuple[Adjustable, ...]
    workers: int
    substeps: int = 1
    kept: Kept | None = None
    elsewhere: Elsewhere | None = None
    response: Nearby | None = None
    off: Sequence[tuple[SignalTerm, ...]] = ()
    budget: Budget = field(default_factory=Budget)
    ledger: Ledger = field(default_factory=Ledger)
    _free: list[SimpleQueue[Runner]] = field(default_factory=lambda: [])

    def __post_init__(self) -> None:
        self._pool = ThreadPoolExecutor(self.workers)

    def __enter__(self) -> Problem:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Release all solvers."""
        self._pool.shutdown(cancel_futures=True)
        self._release()

    def few(self, steps: int) -> Problem | None:
        """The same with only so many conditions that one model takes about so many `steps`, two at least: the ones that
        differ most in speed, amplitude, frequency and size of response. None where all of them take no more."""
        if len(self.trials) <= 2:
            return None
        count = max(2, int(steps / sum(len(trial.measured) for trial in self.trials) * len(self.trials)))
        if count >= len(self.trials):
            return None
        sizes = [np.log(trial.measured.std(axis=0).mean() + 1e-300) for trial in self.trials]
        rows = np.array([[*t.condition.features, size] for t, size in zip(self.trials, sizes, strict=True)])
        spread = np.ptp(rows, axis=0)
        rows = (rows - rows.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
        chosen = [int(np.argmax((rows**2).sum(axis=1)))]
        while len(chosen) < count:
            distance = ((rows[:, None] - rows[None, chosen]) ** 2).sum(axis=2).min(axis=1)
            chosen.append(int(np.argmax(distance)))
        trials = tuple(self.trials[k] for k in sorted(chosen))
        return self.of(trials)

    def of(self, trials: tuple[Trial, ...]) -> Problem:
        """The same of these conditions only, with solvers of its own."""
        return replace(self, trials=trials, _free=[])

    def longer(self, seconds: float) -> Problem | None:
        """The same with so many seconds of single tones; None where nothing more was measured."""
        trials = tuple(
            read(self.study, trial.condition, seconds) if trial.condition.frequency > 0.0 else trial
            for trial in self.trials
        )
        more = any(new.rows.stop > old.rows.stop for new, old in zip(trials, self.trials, strict=True))
        return self.of(trials) if more else None

    def couple(self, substeps: int) -> None:
        """From now on so many couplings in a communication step."""
        self._release()
        self.substeps = substeps

    def _release(self) -> None:
        for queue in self._free:
            while not queue.empty():
                queue.get().close()
        self._free.clear()

    @property
    def key(self) -> str:
        """Of everything that results depend on: the code, the study, the FMU, what drives it and what was measured."""
        return digest([self._content, self.substeps, self.response is None])

    @cached_property
    def _content(self) -> str:
        given = [path for trial in self.trials for path in (trial.condition.inputs, trial.condition.simulated)]
        every = [file for path in (*given, self.study.fmu) if path is not None for file in files_of(path)]
        read = [digest(file.read_bytes()) for file in every]
        return digest([code(), self.study.hash, read, self.trials, self.tolerated])

    @property
    def nominal(self) -> Model:
        """The FMU as it is."""
        return Model((), (0.0,) * len(self.tolerated))

    @property
    def reach(self) -> Float64[np.ndarray, "A 2"]:
        """How far each base parameter may go down and up within its own bounds, in tolerances."""
        rows: list[tuple[float, float]] = []
        for adjustable in self.tolerated:
            single = len(adjustable.parameters) == 1
            at = (
                start_value(self.study, self.fmu, self.trials[0].condition, adjustable.parameters[0]) if single else 1.0
            )
            one = tolerance_of(adjustable, at)
            ends = (adjustable.minimum - at, adjustable.maximum - at)
            rows.append((ends[0] / one, ends[1] / one) if one > 0.0 else (-np.inf, np.inf))
        return np.array(rows).reshape(-1, 2)

    def _runner(self, k: int) -> Runner:
        trial = self.trials[k]
        return runner(self.study, trial.condition, self.library, trial.rows.stop, self.substeps, self.budget)

    def _ready(self) -> list[SimpleQueue[Runner]]:
        """Every condition's simulators, one a worker."""
        while len(self._free) < len(self.trials):
            queue: SimpleQueue[Runner] = SimpleQueue()
            for _ in range(self.workers):
                queue.put(self._runner(len(self._free)))
            self._free.append(queue)
        return self._free

    def responses(self, model: Model) -> list[Float64[np.ndarray, "_ J"]]:
        """The response at the measured rows of every condition, in the channels' units. Raises FmuError."""
        queues = self._ready()
        return [self._response(queue, k, model) for k, queue in enumerate(queues)]

    def _response(
        self,
        queue: SimpleQueue[Runner],
        k: int,
        model: Model,
        starts: Mapping[str, float] = AS_BEGUN,
        more: Float64[np.ndarray, "T I"] | None = None,
    ) -> Float64[np.ndarray, "N J"]:
        trial, model = self.trials[k], replace(model, terms=(*model.terms, *self.off[k])) if self.off else model
        item = queue.get()
        try:
            return simulate(self.study, item, trial.condition, model, self.tolerated, starts, more)[trial.rows]
        finally:
            queue.put(item)

    def guess(self, k: int) -> Mapping[str, float]:
        """The start values of a condition that are not known, as it has them now."""
        condition = self.trials[k].condition
        return {name: start_value(self.study, self.fmu, condition, name) for name in condition.free if self.fmu}

    def begun(self, k: int, model: Model, starts: Mapping[str, float]) -> Float64[np.ndarray, " n"]:
        """The evidence of one condition begun from other start values. Raises FmuError."""
        return self.trials[k].evidence(self._response(self._ready()[k], k, model, starts)).ravel()

    def inputs(self, k: int) -> Float64[np.ndarray, "T I"]:
        """What drives the FMU in a condition, a row a step of its simulation, in the FMU's units."""
        queue = self._ready()[k]
        item = queue.get()
        queue.put(item)
        return item.inputs[1]

    def driven(self, k: int, model: Model, more: Float64[np.ndarray, "T I"]) -> Float64[np.ndarray, " n"]:
        """The evidence of one condition with `more` in its inputs. Raises FmuError."""
        return self.trials[k].evidence(self._response(self._ready()[k], k, model, more=more)).ravel()

    def with_starts(self) -> Problem:
        """The same with every condition's unknown start values as they suit its record best, in the FMU as it is."""
        if not any(self.guess(k) for k in range(len(self.trials))):
            return self
        trials: list[Trial] = []
        for k, trial in enumerate(self.trials):
            found, guess = trial.condition.parameters, self.guess(k)
            if guess:
                measured = trial.evidence(trial.measured).ravel()
                found = {**found, **fitted(partial(self.begun, k, self.nominal), guess, measured)}
            trials.append(replace(trial, condition=replace(trial.condition, parameters=MappingProxyType(dict(found)))))
        self.close()
        return self.of(tuple(trials))

    def stack(self, responses: Sequence[Float64[np.ndarray, "_ J"]]) -> Float64[np.ndarray, " n"]:
        """All evidence of responses as one vector, in units of the noise."""
        return np.concatenate([t.evidence(y).ravel() for t, y in zip(self.trials, responses, strict=True)])

    @property
    def rows(self) -> list[slice]:
        """Where each condition's evidence lies in a stacked vector."""
        ends = np.cumsum([0, *(trial.blocks * len(self.study.channels) for trial in self.trials)])
        return [slice(a, b) for a, b in pairwise(ends)]

    def split(self, stacked: Float64[np.ndarray, " n"]) -> list[Float64[np.ndarray, "_ J"]]:
        """A stacked vector as (B, J) of every condition."""
        return [stacked[rows].reshape(-1, len(self.study.channels)) for rows in self.rows]

    @property
    def measured(self) -> Float64[np.ndarray, " n"]:
        """All measured evidence as one vector, in units of the noise."""
        return self.stack([trial.measured for trial in self.trials])

    def many(
        self, models: Sequence[Model], done: Callable[[int], object] = lambda _: None
    ) -> Iterator[np.ndarray | None]:
        """`stack(responses(model))` of many models, on all workers, in order; None where the solver gives up, or
        where the response grows beyond all measure."""
        if self.response is not None and len(models) == 1:
            return self.response(self, models, models[0], done)  # kept there, to go on from
        return self.simulated(models, done)

    def near(
        self, models: Sequence[Model], around: Model, done: Callable[[int], object] = lambda _: None
    ) -> Iterator[np.ndarray | None]:
        """`many` of models near another one: to first order, from few runs of the FMU, where one is dear."""
        return self.many(models, done) if self.response is None else self.response(self, models, around, done)

    @contextmanager
    def seen_by(self, off: Sequence[tuple[SignalTerm, ...]]) -> Generator[None]:
        """Meanwhile all is simulated with such errors of sensors and inputs behind each model's own terms, those of a condition
        each, and here."""
        elsewhere, self.elsewhere, self.off = self.elsewhere, None, off
        try:
            with self.by_runs():
                yield
        finally:
            self.elsewhere, self.off = elsewhere, ()

    @contextmanager
    def by_runs(self) -> Generator[None]:
        """Meanwhile all is simulated."""
        response, self.response = self.response, None
        try:
            yield
        finally:
            self.response = response

    def simulated(self, models: Sequence[Model], done: Callable[[int], object]) -> Iterator[np.ndarray | None]:
        """`many`, each a run of the FMU for every condition."""
        rows = self.elsewhere and self.elsewhere(self, models, done)
        return self._here(models, done) if rows is None else rows

    def each(self, tasks: Sequence[T], work: Callable[[T], R]) -> Iterator[R]:
        """What all workers make of the tasks, in their order."""
        return self._pool.map(work, tasks)

    def _here(self, models: Sequence[Model], done: Callable[[int], object]) -> Iterator[np.ndarray | None]:
        queues = self._ready()

        def one(task: tuple[Model, int]) -> np.ndarray | None:
            model, k = task
            try:
                rows = self.trials[k].evidence(self._response(queues[k], k, model)).ravel()
            except FmuError:
                return None
            return rows if float(np.abs(rows).max(initial=0.0)) < LARGEST else None

        tasks = [(model, k) for model in models for k in range(len(queues))]
        parts = self._pool.map(one, tasks)
        for _ in models:
            rows = [next(parts) for _ in queues]
            done(1)
            yield None if any(row is None for row in rows) else np.concatenate(rows)  # type: ignore[arg-type]


Nearby = Callable[[Problem, Sequence[Model], Model, Callable[[int], object]], Iterator[np.ndarray | None]]
"""Problem.near by less than a run of the FMU each."""
Elsewhere = Callable[[Problem, Sequence[Model], Callable[[int], object]], Iterator[np.ndarray | None] | None]
"""Problem.many on other machines; None where that is not worth the way."""


def load(
    study: Study,
    library: Path | None,
    workers: int = 0,
    kept: Kept | None = None,
    elsewhere: Elsewhere | None = None,
    pairs: Sequence[Pair] = (),
) -> Problem:
    """The development conditions of a study, its solver tried out on each as their pairs are simulated; the evaluation
    conditions are not read. pairs: those that were simulated already. Raises StudyError, RecordError, FmuError."""
    if not study.development:
        raise StudyError(str(study.path), ["discovery needs at least one development condition"])
    known = {pair.condition.name: pair for pair in pairs}
    trials = tuple(read(study, condition, pair=known.get(condition.name)) for condition in study.development)
    fmu = None if study.fmu is None else open_fmu(study.fmu).known(study.simulation.units, study.simulation.tolerance)
    tolerated = tuple(a for a in study.adjustable if a.tolerated) if fmu else ()
    workers = workers or min(CORES, 8)
    budget = Budget()
    for trial in trials:
        if fmu is not None and trial.condition.simulated is None:
            budget.add(trial.rows.stop * study.simulation.step_size)
    return Problem(study, fmu, library, trials, tolerated, workers, 1, kept, elsewhere, budget=budget).with_starts()
