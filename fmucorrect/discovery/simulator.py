"""One condition of a study, simulated with laws at its joints and other parameters, at the speed of C."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import c_double, c_int, c_long, c_uint
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect import sources
from fmucorrect.catalogue import CATALOGUE, Law
from fmucorrect.discovery.budget import Budget
from fmucorrect.discovery.native import LAWS, Placed, Road, Solver
from fmucorrect.errors import FmuError
from fmucorrect.fmu import FmuDescription, Variable
from fmucorrect.fmu.feedthrough import feedthrough
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Record, join
from fmucorrect.study import Joint, Study
from fmucorrect.wrapping.generated import Place
from fmucorrect.wrapping.laws import Wire
from fmucorrect.wrapping.places import places

STILL, RESTS = 1e-9, 1e-3
"""Share of a response's range that may move at rest: in rows that are left out, before a record."""


def spans(y: Float64[np.ndarray, "T J"]) -> Float64[np.ndarray, " J"]:
    """Peak to peak by column; turned first, since NumPy goes along short rows at a tenth of the pace."""
    return np.ptp(np.ascontiguousarray(y.T), axis=1)


def still(y: Float64[np.ndarray, "T J"], rows: int, most: Float64[np.ndarray, " J"]) -> bool:
    """Whether nothing moves by more than that in the first rows."""
    return bool((spans(y[:rows]) <= most).all())


def ends(y: Float64[np.ndarray, "T J"]) -> bool:
    """Whether a motion comes to an end: no channel goes on one way, in the last quarter still by half as much as at first."""
    steps = np.diff([part.mean(0) for part in np.array_split(y, 4)], axis=0)
    one_way = (np.sign(steps) == np.sign(steps[0])).all(0)
    return not bool((one_way & (np.abs(steps[-1]) > 0.5 * np.abs(steps[0]))).any())


RUN_IN = 8.0
"""Seconds that a constant or periodic force has acted before a record begins."""
LEAD = 1.0
"""Seconds at rest before the first motion of an input from which on it is simulated."""
PROBE = 1e-3
"""N or N.m, that shows whether anything holds a joint."""
_NONE: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class LawAt:
    """A law at a joint. values: all its parameters, SI, in the law's order (Law.complete)."""

    law: Law
    joint: Joint
    values: Mapping[str, float]


class Simulator:
    """A condition of a study, opened once and run many times; not shared between threads.

    library: what native.build made. times: (T,) s, of every row that run() gives. substeps: in how many
    the solver takes each of the study's steps, inputs held, laws asked in each: the wrapped FMU's coupling_step.
    extra: names of further FMU inputs, 0 unless run() is given others: columns of `inputs` behind the condition's own. budget:
    counts what runs.
    """

    def __init__(
        self,
        study: Study,
        condition: Condition,
        library: Path,
        duration: float | None = None,
        substeps: int = 1,
        extra: Sequence[str] = (),
        budget: Budget | None = None,
    ) -> None:
        if substeps < 1:
            raise ValueError(f"substeps must be at least 1, got {substeps}")
        sources.fmu_of(study)  # what is missing is told before what drives it
        self._substeps, self._budget = substeps, budget or Budget()
        chunk = join(list(sources.inputs(study, condition, duration)))
        self._condition, self._step_ns = condition, study.simulation.step_ns
        self._names = (*chunk.names, *(name for name in dict.fromkeys(extra) if name not in chunk.names))
        self._stepper = sources.solver(study, study.channels, self._names)
        self._description = self._stepper.description
        self._parameters = {**study.simulation.parameters, **condition.parameters}
        self._check_scalars(study)
        held = [self._begins(self._description.variables[name]) for name in self._names[len(chunk.names) :]]
        values = np.concatenate([chunk.values, np.tile(held, (len(chunk), 1))], axis=1)
        channels = (*chunk.channels, *(Channel(name, "") for name in self._names[len(chunk.names) :]))
        self._inputs = self._stepper.input_values(Record(chunk.t_ns, values, channels))
        self._t_ns = chunk.t_ns
        self._march = ctypes.CDLL(str(library)).march
        self._march.restype = c_long
        self._input_references = self._references([self._description.variables[name].reference for name in self._names])
        self._responses = self._stepper.references
        self._factors = self._stepper.factors
        self._speed = condition.speed / 3.6
        self._waits: bool | None = None
        self._settled: dict[Joint | None, bool] = {}
        self._answers: dict[tuple[str, str], float] = {}
        self._asked: tuple[list[LawAt], dict[str, float]] | None = None
        self._given = self._inputs
        self.nominal: Float64[np.ndarray, "T J"] | None = None

    @property
    def times(self) -> Float64[np.ndarray, " T"]:
        """Of all rows, s."""
        return self._t_ns / NANOSECONDS

    @property
    def step(self) -> float:
        """s between rows."""
        return self._step_ns / NANOSECONDS

    @property
    def inputs(self) -> tuple[tuple[str, ...], Float64[np.ndarray, "T I"]]:
        """What drives the FMU: names, and a row a sample in the FMU's units."""
        return self._names, self._inputs

    def run(
        self,
        laws: Sequence[LawAt] = (),
        parameters: Mapping[str, float] = _NONE,
        inputs: Float64[np.ndarray, "T I"] | None = None,
    ) -> Float64[np.ndarray, "T J"]:
        """The response in the channels' units, read-only: `nominal` until the next one. With the same laws, parameters and
        inputs it is the last one once more: candidates at sensors ask for that. parameters: start values, over those of study
        and condition. inputs: in place of the condition's own.

        A law of the family "load" acts at rest too: with one, the simulation begins RUN_IN earlier, the first row of inputs
        held, so that the record begins settled, as a measurement does; not where the FMU moves then anyway (a record that
        begins in motion), or nothing holds the joint (a body without a spring has run away by then). Without one, a model
        that rests until the inputs move is simulated from LEAD before on: what is left out is its first row. Neither is done
        where start values are not known. Raises FmuError where the solver gives up: with these laws the model is not stable,
        say.
        """
        given = self._inputs if inputs is None else np.ascontiguousarray(inputs)
        asked = [*laws], {**parameters}
        if asked != self._asked or not np.array_equal(given, self._given):
            self._asked = None  # nothing to show where the solver gives up
            self.nominal = self._simulated(laws, parameters, given)
            self.nominal.setflags(write=False)
            self._asked, self._given = asked, given.copy()
        assert self.nominal is not None
        return self.nominal

    def _simulated(
        self, laws: Sequence[LawAt], parameters: Mapping[str, float], given: Float64[np.ndarray, "T I"]
    ) -> Float64[np.ndarray, "T J"]:
        condition = replace(self._condition, parameters={**self._condition.parameters, **parameters})
        known = not condition.free  # else it need not have rested before the record
        early = self._begins_early(laws)
        if early:
            given = np.ascontiguousarray(np.concatenate([np.repeat(given[:1], early, axis=0), given]))
            return self._along(laws, condition, given, -early)[early:]
        rest = self._rest(given)
        if known and rest and self._can_wait():
            y = self._along(laws, condition, given[rest:], rest)
            if still(y, self._lead, STILL * spans(y)):
                return np.concatenate([np.repeat(y[:1], rest, axis=0), y])
        return self._along(laws, condition, given, 0)

    @property
    def _early(self) -> int:
        return round(RUN_IN * NANOSECONDS / self._step_ns)

    def _begins_early(self, laws: Sequence[LawAt]) -> int:
        """Rows before the record that loads among the laws have acted."""
        loads = [item.joint for item in laws if item.law.family == "load"]
        if not loads or self._condition.free:
            return 0
        return self._early if all(self._settles(joint) for joint in (None, *loads)) else 0

    def _settles(self, joint: Joint | None) -> bool:
        """Whether a small force at the joint moves the FMU to another place of rest in RUN_IN; None: whether it rests then
        without one."""
        if joint not in self._settled:
            (law,) = CATALOGUE["preload"]
            probe = [] if joint is None else [LawAt(law, joint, law.complete({"force": PROBE}))]
            held = np.repeat(self._inputs[:1], self._early, axis=0)
            try:
                y = self._along(probe, self._condition, held, -self._early)
                most = RESTS * spans(self._alone) if joint is None else None
            except FmuError:
                self._settled[joint] = True
            else:
                self._settled[joint] = ends(y) if most is None else still(y, len(y), most)
        return self._settled[joint]

    @property
    def _lead(self) -> int:
        return max(round(LEAD * NANOSECONDS / self._step_ns), 2)

    def _rest(self, given: Float64[np.ndarray, "T I"]) -> int:
        """Rows that may be left out at the beginning: inputs rest, and go on resting for LEAD."""
        moves = (given != given[0]).any(axis=1)
        return max(int(np.argmax(moves)) - self._lead, 0) if moves.any() else 0

    def _can_wait(self) -> bool:
        """Whether the FMU alone may be started late: it rests, and time as such is nothing to it."""
        if self._waits is None:
            rest = self._rest(self._inputs)
            try:
                whole = self._alone
                late = self._along((), self._condition, self._inputs[rest:], rest)
            except FmuError:
                return False
            far = np.abs(whole - np.concatenate([np.repeat(late[:1], rest, axis=0), late])).max(axis=0)
            self._waits = rest > 0 and bool((far <= STILL * spans(whole)).all())
        return self._waits

    @cached_property
    def _alone(self) -> Float64[np.ndarray, "T J"]:
        """The FMU alone over the whole record. Raises FmuError."""
        return self._along((), self._condition, self._inputs, 0)

    def _along(
        self, laws: Sequence[LawAt], condition: Condition, given: Float64[np.ndarray, "t I"], first: int
    ) -> Float64[np.ndarray, "t J"]:
        """Simulated over the rows of `given`, of which the first is row `first` of the record. Raises FmuError."""
        begin = int(self._t_ns[0]) + first * self._step_ns
        reads = list(self._responses)
        forces: list[int] = []
        placed, kept = self._placed(laws, reads, forces)
        self._stepper.reset(condition)
        self._stepper.step(begin, given[0])
        native = self._stepper.native()
        solver = Solver(native.component, native.step, native.get, native.set, native.fmi)
        own = self._input_references[: given.shape[1]]
        steps, count = len(given) - 1, len(self._responses)
        values, out, pushed = np.zeros(len(reads)), np.zeros((steps + 1, count)), np.zeros(max(len(forces), 1))
        begins = {v.reference: self._begins(v) for v in self._description.of("input")}
        road = Road(
            begin / NANOSECONDS,
            self._step_ns / NANOSECONDS,
            steps,
            self._substeps,
            self._input_references,
            given.shape[1],
            given.ctypes.data,
            self._references(reads),
            len(reads),
            count,
            values.ctypes.data,
            out.ctypes.data,
            self._references(forces),
            (c_long * max(len(forces), 1))(*(own.index(force) if force in own else -1 for force in forces)),
            (c_double * max(len(forces), 1))(*(begins[force] for force in forces)),
            len(forces),
            pushed.ctypes.data,
        )
        self._budget.add(steps * self._step_ns / NANOSECONDS)
        status = c_int()
        reached = self._march(ctypes.byref(solver), ctypes.byref(road), placed, c_long(len(laws)), ctypes.byref(status))
        del kept
        if reached != steps:
            native.ended(status.value)
        if reached != steps or not np.isfinite(out).all():
            raise FmuError(
                f"the solver gave up at t = {(begin + max(reached, 0) * self._step_ns) / NANOSECONDS:.6g} s",
                where=f"{self._description.path}, condition {self._condition.name!r}",
            )
        return out * self._factors

    def _placed(
        self, laws: Sequence[LawAt], reads: list[int], forces: list[int]
    ) -> tuple[ctypes.Array[Placed], list[object]]:
        """The laws for C; what they read is appended to `reads`, what they push to `forces`."""
        rows = (Placed * max(len(laws), 1))()
        kept: list[object] = []
        found = [place_of(self._description, item.joint) for item in laws]
        inputs = list(dict.fromkeys(place.force.name for place in found))
        for row, item, place in zip(rows, laws, found, strict=False):
            for p, port in enumerate(place.ports):
                row.port[p], row.factor[p] = -1, 1.0
                if port is not None:
                    if port.variable.reference not in reads:
                        reads.append(port.variable.reference)
                    row.port[p], row.factor[p] = reads.index(port.variable.reference), port.factor
            if place.force.reference not in forces:
                forces.append(place.force.reference)
            row.force, row.force_factor = forces.index(place.force.reference), place.factor
            law, values = self._at_this_speed(item)
            row.law = LAWS.index(law)
            numbers = (c_double * max(len(values), 1))(*values)
            states = (c_double * max(len(law.states), 1))(*(state.start for state in law.states))
            row.p, row.z = numbers, states
            kept += [numbers, states]
            if "acceleration" in law.inputs:
                row.answer = (c_double * len(inputs))(*(self._answer(place, name) for name in inputs))
                kept.append(row.answer)
        return rows, kept

    def _answer(self, place: Place, force: str) -> float:
        """How the acceleration of a joint answers to a force input at once, m/s2 a unit of the FMU; 0 where that cannot be
        tried out."""
        port = place.ports[2]
        assert port is not None
        key = port.variable.name, force
        if key not in self._answers:
            self._stepper.close()  # there may be an FMU of which a process can hold one
            step_ns, held = (
                round(self._step_ns / self._substeps),
                dict(zip(self._names, self._inputs[0].tolist(), strict=True)),
            )
            try:
                (row,) = feedthrough(
                    self._description.path, [force], key[:1], step_ns, self._parameters, held, isolated=False
                )
            except FmuError:
                row = np.zeros(1)
            self._answers[key] = float(row[0])
        return port.factor * self._answers[key]

    def _at_this_speed(self, item: LawAt) -> tuple[Law, list[float]]:
        """A law that follows the speed, as one of fixed frequency."""
        if "speed" not in item.law.inputs:
            return item.law, list(item.values.values())
        plain = next(law for law in LAWS if law.name == item.law.name)
        given = dict(item.values)
        frequency = given.pop("order") * self._speed / (2.0 * np.pi * given.pop("radius"))
        return plain, list(plain.complete(given | {"frequency": frequency}).values())

    def _begins(self, variable: Variable) -> float:
        """What the study has a variable begin with."""
        return self._parameters.get(variable.name, variable.begins)

    def _check_scalars(self, study: Study) -> None:
        """Raises FmuError for elements of arrays: the loop in C moves no arrays."""
        named = [channel.simulation or channel.name for channel in study.channels]
        for joint in study.joints:
            named += [joint.force, joint.displacement, joint.velocity, joint.acceleration, joint.nominal_force]
        every = self._description.variables
        inside = [name for name in dict.fromkeys([*named, *self._names]) if name in every and every[name].size > 1]
        if inside:
            raise FmuError(
                f"discovery cannot read or set elements of arrays: {', '.join(inside)}",
                where=str(self._description.path),
                expected="variables of one number",
                remedy="Export them as scalars, or as FMI 2.0.",
            )

    @staticmethod
    def _references(numbers: Sequence[int]) -> ctypes.Array[c_uint]:
        return (c_uint * max(len(numbers), 1))(*numbers)

    @property
    def description(self) -> FmuDescription:
        """The FMU."""
        return self._description

    def close(self) -> None:
        """Release the solver."""
        self._stepper.close()


def place_of(fmu: FmuDescription, joint: Joint) -> Place:
    """The FMU's variables behind all that a joint shows and its force, with their factors to SI. Raises WrapError."""
    ports = joint.displacement, joint.velocity, joint.acceleration, joint.nominal_force
    (place,) = places(fmu, [Wire("", joint.name, joint.force, *ports, joint.sign, False)])
    return place
