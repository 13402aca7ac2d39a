"""The linear response of an FMU around a run of it: what laws at its joints and other parameters change, without running it.

    y(model) = y(known) + h * (f(model) - f(known)) + g (p(model) - p(known)),

f the forces of laws, held for a step each, h the FMU's response to a unit of one for one step, * the convolution, and g its
response to a parameter, or an error of what excites it, while forces stay as they were. The forces are not known beforehand:
each law acts in the loop with what the forces before it did to its joint. h and g (identified.py) are of the FMU without
laws, its parameters about as the known model has them. What they leave out (contacts that stiffen with the motion, say) makes
what a law changes on a bogie 11 % wrong in the median, 1 % of its energy in its direction: enough to rank by, and to tell
which way to step; where a step led is simulated.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from ctypes import Structure, c_double, c_int, c_long, c_void_p
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.catalogue import PORTS
from fmucorrect.discovery.identified import NEAR, TOGETHER, Identified, Pulsed, convolved
from fmucorrect.discovery.model import Model, overrides, simulate, start_value
from fmucorrect.discovery.motion import ports
from fmucorrect.discovery.native import Road, Solver
from fmucorrect.discovery.problem import Problem
from fmucorrect.discovery.simulator import LawAt, Simulator, place_of
from fmucorrect.discovery.terms import ForceTerm, SignalTerm
from fmucorrect.discovery.trials import Trial
from fmucorrect.errors import FmuError
from fmucorrect.signals import NANOSECONDS, Channel

TOLD = 0.3
"""Error of what the response tells of a force that is tried out, below which a joint is told of by it, and by that of the first
joint parameters; what is not is simulated. A bogie: 0.1; one whose dampers have a third of their strength, so that it all but
hunts: 0.4 and more."""
ANEW, KEPT = 1.25, 2
"""Ratio of the values of a parameter with which the FMU is another one, and how many of these are kept."""
MOST_MOVED = 0.25
"""Share of a parameter by which a model may differ from the run that it is told from."""
RECENT = 4
"""Runs of a condition that are kept, since what is fitted is asked for again: by its sensitivities, and by what is tried."""


class _Response(Structure):
    """As response.c has it."""

    _fields_ = [
        ("rows", c_long),
        ("n_ports", c_long),
        ("n_forces", c_long),
        ("reach", c_long),
        ("shown", c_void_p),
        ("felt", c_void_p),
        ("acted", c_void_p),
        ("near", c_void_p),
        ("far", c_void_p),
        ("change", c_void_p),
        ("groups", c_void_p),
        ("now", c_long),
        ("first", c_long),
    ]


class Response(Simulator):
    """A condition's simulator, with what changes around a run of it."""

    def __init__(self, problem: Problem, trial: Trial) -> None:
        assert problem.library is not None
        study = problem.study
        self._count, self._ports = len(study.channels), ports(study.joints)
        moved = {joint.force: joint.displacement for joint in study.joints}
        self._forces = list(moved)
        self._along_joint = [self._count + self._ports.index(name) for name in moved.values()]
        shown = tuple(Channel(f"at joints: {name}", "", simulation=name) for name in self._ports)
        self._study = replace(study, channels=(*study.channels, *shown))
        seconds = (trial.rows.stop - 1) * study.simulation.step_size
        substeps, budget = problem.substeps, problem.budget
        super().__init__(self._study, trial.condition, problem.library, seconds, substeps, self._forces, budget)
        self._trial, self._tolerated = trial, problem.tolerated
        variables = self.description.variables
        self._port_at = {variables[name].reference: p for p, name in enumerate(self._ports)}
        self._force_at = {variables[name].reference: f for f, name in enumerate(self._forces)}
        self._functions = (c_void_p * 3).in_dll(ctypes.CDLL(str(problem.library)), "RESPONSE")
        self._runs: list[tuple[Model, Float64[np.ndarray, "T R"]]] = []
        self._known: list[Identified] = []

    def covers(self, model: Model, around: Model) -> bool:
        """Whether the response tells a model by what is known of another. What excites by no input is not seen."""
        if model == around:
            return not model.exciting or self._condition.inputs is not None
        if model.exciting != around.exciting and self._condition.inputs is None:
            return False
        here, there = self._set(around), self._set(model)
        for name in {*here, *there}:
            own = self._own(name)
            if abs(there.get(name, own) - here.get(name, own)) > MOST_MOVED * abs(own):
                return False
        try:
            known = self._identified(around)
            asked = {*self._used(model), *self._used(around)} or {0}
            pulsed = [known.to(f) for f in asked]
            if self._begins_early([*model.laws, *around.laws]) and not all(one.fades for one in pulsed):
                return False
            return all(one.error < TOLD for one in pulsed)
        except FmuError:
            return False

    def evidence(self, model: Model, around: Model) -> Float64[np.ndarray, " n"]:
        """Of a model, from a run of another, exact where both are the same. Raises FmuError where it is not stable."""
        y = self._exact(around)
        found = y[:, : self._count] + (0.0 if model == around else self._change(model, around, y))
        for term in model.terms:
            if isinstance(term, SignalTerm):
                for j in term.channels:
                    found[:, j] = term.law.apply(found[:, j], self._study.simulation.step_size, term.values)
        return self._trial.evidence(found[self._trial.rows]).ravel()

    def _used(self, model: Model) -> set[int]:
        names = {joint.force for term in model.terms if isinstance(term, ForceTerm) for joint in term.joints}
        return {f for f, name in enumerate(self._forces) if name in names}

    def _exact(self, model: Model) -> Float64[np.ndarray, "T R"]:
        """A run of the FMU: sensors without their own errors, and ports."""
        kept = tuple(term for term in model.terms if not (isinstance(term, SignalTerm) and term.channels))
        bare = replace(model, terms=kept)
        known = next((y for one, y in self._runs if one == bare), None)
        y = simulate(self._study, self, self._trial.condition, bare, self._tolerated) if known is None else known
        others = [row for row in self._runs if row[0] != bare]
        self._runs = [*others, (bare, y)][-RECENT:]
        return y

    def _identified(self, around: Model) -> Identified:
        """With the parameters that `around` has moved, about as they are: a damper that is off by two thirds makes another FMU,
        whose response is asked anew, and one that is off by 5 % does not."""
        at = dict[str, float]()
        for name, value in self._set(around).items():
            own = self._own(name)
            about = own * ANEW ** round(math.log(value / own, ANEW)) if own * value > 0.0 else float(f"{value:.0e}")
            if about != own:
                at[name] = about
        found = next((one for one in self._known if one.parameters == at), None)
        found = Identified(self, self._count, self._forces, self._along_joint, at) if found is None else found
        self._known = [*(one for one in self._known if one is not found), found][-KEPT:]
        return found

    def _own(self, name: str) -> float:
        return start_value(self._study, self.description, self._trial.condition, name)

    def _change(self, model: Model, around: Model, y: Float64[np.ndarray, "T R"]) -> Float64[np.ndarray, "T J"]:
        """At the sensors, from `around`, whose run y is, to `model`."""
        here, there, known = self._set(around), self._set(model), self._identified(around)
        shown = y
        for name in sorted({*here, *there}):
            own = self._own(name)
            by = there.get(name, own) - here.get(name, own)
            if by != 0.0:
                shown = shown + by * known.knob(name, own)
        for sign, term in (*((1.0, term) for term in model.exciting), *((-1.0, term) for term in around.exciting)):
            ((name, value),) = ((name, term.values[name]) for name in term.estimated)
            by = value - (term.parameter(name).neutral or 0.0)
            if by != 0.0:
                shown = shown + sign * by * known.drive(term)
        found = shown[:, : self._count] - y[:, : self._count]
        before, laws = around.laws, model.laws
        if before or laws:
            used = sorted(self._used(around) | self._used(model))
            early = self._begins_early([*before, *laws])
            acted = self._forced(before, np.concatenate([np.repeat(y[:1], early, axis=0), y]), used)
            rows = np.concatenate([np.repeat(shown[:1], early, axis=0), shown])
            pulsed = [known.to(f) for f in used]
            for one, force in zip(pulsed, self._forced(laws, rows, used, acted, pulsed), strict=True):
                if force.any():
                    found += convolved(one.sensors, force)[early:]
        return found

    def _set(self, model: Model) -> Mapping[str, float]:
        return overrides(self._study, self.description, self._trial.condition, model, self._tolerated)

    def _felt(self, reference: int, laws: Sequence[LawAt]) -> bool:
        """Whether a law hangs on what it reads there. The displacement in the middle of a step has part of the velocity, and
        the other way round where only one of them is shown."""
        motion = {"displacement", "velocity"}
        for item in laws:
            needs = {*item.law.inputs} | (motion if motion & {*item.law.inputs} else set())
            for name, port in zip(PORTS, place_of(self.description, item.joint).ports, strict=True):
                if port is not None and port.variable.reference == reference and name in needs:
                    return True
        return False

    def _forced(
        self,
        laws: Sequence[LawAt],
        y: Float64[np.ndarray, "t R"],
        used: Sequence[int],
        acted: Float64[np.ndarray, "F t"] | None = None,
        pulsed: Sequence[Pulsed] = (),
    ) -> Float64[np.ndarray, "F t"]:
        """The laws' force at each of the inputs `used` beyond what acted in a run, where joints show y without that; without
        `acted` what the laws do beside joints that move just so."""
        reads: list[int] = []
        forces = [reference for f in used for reference, at in self._force_at.items() if at == f]
        placed, kept = self._placed(laws, reads, forces)
        columns = [self._port_at[reference] for reference in reads]
        shown = np.ascontiguousarray(y[:, [self._count + column for column in columns]])
        felt = np.array([self._felt(reference, laws) for reference in reads], np.int32)
        known = np.zeros((len(y), len(used))) if acted is None else np.ascontiguousarray(acted.T)
        change = np.zeros((len(used), len(y)), np.float32)
        sums = np.zeros((len(used), len(y) // TOGETHER + 1), np.float32)
        reach = max((part.far.shape[2] for part in pulsed), default=0)
        near = np.zeros((len(columns), len(used), NEAR + TOGETHER - 1), np.float32)
        far = np.zeros((len(columns), len(used), TOGETHER, reach), np.float32)
        for k, part in enumerate(pulsed):
            near[:, k] = part.near[columns]
            far[:, k, :, reach - part.far.shape[2] :] = part.far[columns]
        held = _Response(
            len(y),
            len(columns),
            len(used),
            reach,
            shown.ctypes.data,
            felt.ctypes.data,
            known.ctypes.data,
            near.ctypes.data,
            far.ctypes.data,
            None if acted is None else change.ctypes.data,
            sums.ctypes.data,
            0,
            0,
        )
        values, pushed = np.zeros(len(reads) + 1), np.zeros(len(used) + 1)
        road = Road(
            (self._t_ns[-1] - (len(y) - 1) * self._step_ns) / NANOSECONDS,
            self._step_ns / NANOSECONDS,
            len(y) - 1,
            1,
            self._references([]),
            0,
            values.ctypes.data,
            self._references(reads),
            len(reads),
            0,
            values.ctypes.data,
            values.ctypes.data,
            self._references(forces),
            (c_long * len(forces))(*[-1] * len(forces)),
            (c_double * len(forces))(),
            len(forces),
            pushed.ctypes.data,
        )
        solver = Solver(ctypes.addressof(held), *self._functions, 2)
        self._march(ctypes.byref(solver), ctypes.byref(road), placed, c_long(len(laws)), ctypes.byref(c_int()))
        del kept
        if not np.isfinite(change).all():
            raise FmuError("the linear response is not stable with these laws", where=str(self.description.path))
        return known.T if acted is None else change.astype(np.float64)
