"""Discovery's naming stage against loops of fmpy simulations of the same candidates, and the memory of a discovery.

Candidates: every form of every law of the catalogue that acts on a joint of rig A, once, at the size at which the naming stage
looks at it first, in two of the conditions. Each is simulated up to the last row that the naming stage looks at, by

- the naming stage's own engine (Problem.many), one thread: everything up to the rows of evidence;
- fmpy.simulate_fmu, the law in `step_finished`: what a user would write;
- the tightest loop that fmpy's classes allow: setReal, getReal, the law, doStep.

Both loops are given every ease: one instance for all, the law compiled to Python's math module, nothing read but responses and
what the law needs, no evidence formed. They take the same steps and give the same marks. (simulate_fmu's first step has no
force yet, which is at rest.) Times are those of the processor, so that other work on the machine counts little. The engine
begins 1 s before the excitation where the model rests until then; the loops, like a user's, with the record.
"""

from __future__ import annotations

import io
import logging
import math
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import fmpy
import numpy as np
import sympy
from benchmark import Row

from fmucorrect import sources
from fmucorrect.catalogue import Law
from fmucorrect.discovery import native
from fmucorrect.discovery.candidates import candidates
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.problem import Problem, load
from fmucorrect.discovery.signatures import with_signatures
from fmucorrect.discovery.simulator import RUN_IN
from fmucorrect.discovery.terms import ForceTerm
from fmucorrect.discovery.trials import Trial
from fmucorrect.signals import join
from fmucorrect.study import Study, load_study

STUDY = Path(__file__).resolve().parent.parent.parent / "fmus" / "roller_rig" / "A" / "study.toml"
MEMORY = """
import resource, sys
from pathlib import Path
from fmucorrect.discovery import discover
discover(sys.argv[1], sys.argv[2])
# the kernel's own high-water mark: what getrusage tells of oneself may be the parent's
own = int(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0])
print((own + resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) / 1024**2)
"""


class Scalar:
    """A law in plain Python: force, and states by the steps that the C code takes."""

    def __init__(self, law: Law) -> None:
        symbols, formula = law.symbols, law.formula
        names = [name for name in law.inputs if name != "time"]
        arguments = [*(symbols.inputs[n] for n in (*names, "time")), *symbols.z, *symbols.parameters.values()]

        def compiled(expression: object) -> Callable[..., object]:
            return sympy.lambdify(arguments, expression, modules="math", cse=True)

        self.force = compiled(formula.force)
        self.rates, self.slopes = compiled(list(formula.rates)), compiled(list(law.slopes))
        self.bounds = compiled(list(formula.bounds))

    def advance(self, port: Sequence[float], t: float, z: list[float], p: Sequence[float], h: float) -> list[float]:
        """The states after h s."""
        rates, slopes = self.rates(*port, t, *z, *p), self.slopes(*port, t, *z, *p)
        after = [
            x + h * r * (math.expm1(h * s) / (h * s) if abs(h * s) > 1e-8 else 1.0)
            for x, r, s in zip(z, rates, slopes, strict=True)
        ]
        bounds = self.bounds(*port, t, *z, *p)
        return (
            [min(max(x, -max(abs(o), b)), max(abs(o), b)) for x, o, b in zip(after, z, bounds, strict=False)]
            if bounds
            else after
        )


@cache
def scalar(law: Law) -> Scalar:
    """Compiled once."""
    return Scalar(law)


class Coupled:
    """One law at one joint of an instance of the rig, from one step to the next: what march.c does in a step."""

    def __init__(self, term: ForceTerm, fmu: fmpy.fmi2.FMU2Slave, references: dict[str, int], step: float) -> None:
        joint = term.joints[0]
        self._law, self._p = scalar(term.law), list(term.values.values())
        shown = {"velocity": joint.velocity, "displacement": joint.displacement}
        shown |= {"acceleration": joint.acceleration, "nominal_force": joint.nominal_force}
        ports = ["velocity", "displacement", *(n for n in ("acceleration", "nominal_force") if n in term.law.inputs)]
        self.reads = [references[shown[name]] for name in ports]
        self._signs = [float(joint.sign) if name == "nominal_force" else 1.0 for name in ports]
        self._places = [ports.index(name) for name in term.law.inputs if name != "time"]
        self._force, self._sign = [references[joint.force]], float(joint.sign)
        self._fmu, self._step = fmu, step
        self._z, self._last = [state.start for state in term.law.states], None

    def push(self, t: float, shown: list[float]) -> None:
        """Give the FMU the force for the step from t: the law's, at what the joint will show in the middle of it."""
        h, law, p = self._step, self._law, self._p
        now = [sign * x for sign, x in zip(self._signs, shown, strict=True)]
        last = self._last or now
        middle = [x + 0.5 * (x - before) for x, before in zip(now, last, strict=True)]
        middle[1] = now[1] + 0.5 * h * now[0]
        self._last = now
        port = [middle[place] for place in self._places]
        t += 0.5 * h
        if self._z:
            z = law.advance(port, t, self._z, p, h / 2)
            force = law.force(*port, t, *z, *p)
            self._z = law.advance(port, t, z, p, h / 2)
        else:
            force = law.force(*port, t, *p)
        self._fmu.setReal(self._force, [self._sign * force])


@dataclass
class Rig:
    """The FMU unpacked, with one instance, and what both loops share."""

    folder: str
    study: Study

    def __post_init__(self) -> None:
        self.description = fmpy.read_model_description(self.folder)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.instance = fmpy.instantiate_fmu(self.folder, self.description, "CoSimulation")
        self.responses = [channel.simulation for channel in self.study.channels]
        self.step = self.study.simulation.step_size
        self.driven: dict[str, tuple[tuple[str, ...], np.ndarray]] = {}

    def read(self, trial: Trial) -> None:
        """Its inputs: names, and a table with time first."""
        chunk = join(list(sources.inputs(self.study, trial.condition, (trial.rows.stop - 1) * self.step)))
        self.driven[trial.condition.name] = chunk.names, np.column_stack([chunk.t_ns * 1e-9, chunk.values])

    def prepared(self, trial: Trial, term: ForceTerm) -> tuple[dict[str, float], float]:
        """Start values, and the first time of a simulation."""
        values = {**self.study.parameters, **trial.condition.parameters}
        return values, -RUN_IN if term.law.family == "load" else 0.0

    def simulate_fmu(self, trial: Trial, term: ForceTerm) -> np.ndarray:
        """By fmpy.simulate_fmu."""
        values, begin = self.prepared(trial, term)
        names, table = self.driven[trial.condition.name]
        signals = np.rec.fromarrays(table.T, names=["time", *names])
        coupled = Coupled(term, self.instance, self.references, self.step)

        def finished(t: float, _: object) -> bool:
            coupled.push(t, self.instance.getReal(coupled.reads))
            return True

        with redirect_stdout(io.StringIO()):  # inputs without a signal are named there
            result = fmpy.simulate_fmu(
                self.folder,
                start_time=begin,
                stop_time=float(table[-1, 0]),
                output_interval=self.step,
                start_values=values,
                input=signals,
                output=self.responses,
                model_description=self.description,
                fmu_instance=self.instance,
                step_finished=finished,
                validate=False,
            )
        self.instance.reset()
        return np.column_stack([result[name] for name in self.responses])[-len(table) :]

    def tight(self, trial: Trial, term: ForceTerm) -> np.ndarray:
        """By hand."""
        values, begin = self.prepared(trial, term)
        names, table = self.driven[trial.condition.name]
        fmu, step = self.instance, self.step
        fmu.setupExperiment(startTime=begin)
        fmu.setReal([self.references[name] for name in values], list(values.values()))
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        coupled = Coupled(term, fmu, self.references, step)
        driven = [self.references[name] for name in names]
        reads = [*(self.references[name] for name in self.responses), *coupled.reads]
        rows = [row[1:] for row in table.tolist()]
        early, count = round(-begin / step), len(self.responses)
        rows = [rows[0]] * early + rows
        out: list[list[float]] = []
        for k, row in enumerate(rows):
            t = begin + k * step
            fmu.setReal(driven, row)
            shown = fmu.getReal(reads)
            out.append(shown[:count])
            if k < len(rows) - 1:
                coupled.push(t, shown[count:])
                fmu.doStep(t, step)
        fmu.terminate()
        fmu.reset()
        return np.array(out[early:])


def sampled(problem: Problem) -> list[ForceTerm]:
    """Every form of every law once, at the size at which the naming stage looks at it first."""
    start = problem.responses(problem.nominal)
    at = problem.stack(start)
    moves = motions(problem.study, [trial.condition for trial in problem.trials])
    moves = with_signatures(problem, moves, at, problem.measured - at)
    found: dict[str, ForceTerm] = {}
    for curve in candidates(problem, moves, start):
        term = curve.term(curve.size)
        if isinstance(term, ForceTerm) and len(term.joints) == 1 and "speed" not in term.law.inputs:
            found.setdefault(term.law.label, term)
    return list(found.values())


def measure(quick: bool) -> list[Row]:
    if fmpy.platform != "linux64":
        print("discovery is measured on linux64 only", file=sys.stderr)
        return []
    logging.getLogger("fmucorrect.fmu").setLevel(logging.CRITICAL)  # some candidates are not stable
    work = Path(tempfile.mkdtemp(prefix="benchmark-"))
    try:
        return _speed(work, quick) + ([] if quick else _memory(work))
    finally:
        shutil.rmtree(work)


def _speed(work: Path, quick: bool) -> list[Row]:
    study = load_study(STUDY)
    assert study.fmu is not None
    rig = Rig(fmpy.extract(str(study.fmu), str(work / "rig")), study)
    seconds: dict[str, list[float]] = {"engine": [], "simulate_fmu": [], "tight": []}
    apart: list[float] = []
    with load(study, native.build(work), workers=1) as whole, whole.of((whole.trials[0], whole.trials[-1])) as problem:
        terms = sampled(problem)[:: 5 if quick else 1]
        for trial in problem.trials:
            rig.read(trial)
        nominal = problem.stack(problem.responses(problem.nominal))
        for term in terms:  # in turn, so that all see the same machine
            scalar(term.law)
            begun = time.process_time()
            (said,) = problem.many([Model((term,), problem.nominal.base)])
            took = (time.process_time() - begun) / len(problem.trials)
            if said is None:  # not stable: all would end early
                continue
            seconds["engine"].append(took)
            for name, loop in (("simulate_fmu", rig.simulate_fmu), ("tight", rig.tight)):
                begun = time.process_time()
                rows = [loop(trial, term) for trial in problem.trials]
                seconds[name].append((time.process_time() - begun) / len(problem.trials))
                again = problem.stack([y[t.rows] for y, t in zip(rows, problem.trials, strict=True)])
                apart.append(float(np.linalg.norm(again - said) / np.linalg.norm(said - nominal)))
    total = {name: float(np.sum(values)) for name, values in seconds.items()}
    count = len(seconds["engine"])
    cost = 1e3 * total["engine"] / count
    how = f"{count} laws at rig A's joints, 2 conditions, one thread; marks alike to {np.median(apart):.0e}"
    return [
        Row("discovery: a candidate at a condition", cost, "ms", None, False, "18 s of rig A at 1 ms, law in the loop"),
        Row(
            "fmpy.simulate_fmu / the naming stage",
            total["simulate_fmu"] / total["engine"],
            "times as fast",
            20.0,
            True,
            how,
        ),
        Row(
            "tightest fmpy loop / the naming stage",
            total["tight"] / total["engine"],
            "times as fast",
            None,
            True,
            "setReal, getReal, doStep and the law in Python's math, nothing else",
        ),
    ]


def _memory(work: Path) -> list[Row]:
    """Of a whole discovery."""
    begun = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", MEMORY, str(STUDY), str(work / "out")], capture_output=True, text=True, check=True
    )
    minutes = (time.perf_counter() - begun) / 60.0
    note = f"`fmucorrect discover` on rig A, {minutes:.1f} min; peak, with the compiler's"
    return [Row("memory of a discovery", float(done.stdout.split()[-1]), "GiB", 4.0, False, note)]
