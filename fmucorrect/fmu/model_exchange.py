"""An FMU of model exchange, which has states, derivatives and events but no solver, with CVODE in it: it is stepped as one
for co-simulation is.

Within a step inputs are held. What a step meets is dealt with as FMI asks: a state event where an indicator changes its
sign, a time event when it is due, a step event where the model says so after a step of the integrator; each time the model
settles its discrete states, and the integrator begins anew. Continuous inputs that are set between two steps are no event
unless they move an indicator across zero: the integrator is told by how much the derivatives have jumped, and keeps its order.
Measured on a mass on a spring that starts at 1 mm under a force of 3 Hz, in samples of 1 ms at a tolerance of 1e-6, against the
exact solution: 0.003 % of error so, 0.7 % where the jump is kept from the integrator, 2.5 % where it begins anew with each
sample.
"""

from __future__ import annotations

import ctypes
import math
import struct
from abc import abstractmethod
from collections.abc import Callable, Sequence
from ctypes import CFUNCTYPE, POINTER, byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_void_p
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, final

import numpy as np
from fmpy import fmi2
from jaxtyping import Float64

from fmucorrect.errors import FmuError
from fmucorrect.fmu.cvode import Cvode, Stuck
from fmucorrect.fmu.description import Exchange
from fmucorrect.fmu.fmi2 import Instance2
from fmucorrect.fmu.fmi3 import Instance3
from fmucorrect.fmu.instance import DISCARD, Instance
from fmucorrect.fmu.solverlog import LOGGER3

TOLERANCE = 1e-8
"""Of a state's nominal value, where neither the study nor the FMU says one. Few FMUs say nominal values, so that it is one of
1 m: of motions of a millimetre, fmpy's 1e-5 would leave some per cent, and a corrector would learn them."""
SAME = 0.5e-9
"""s by which two moments are one: samples lie whole nanoseconds apart."""
_STEPS, _UPDATES = 100_000, 1000
"""Internal steps and events within one step, and updates of the discrete states at one event, after which a model is taken for
one that never gets through: stiff models take dozens, some seconds of processor time go by here."""
_ERROR = 3


class Update(NamedTuple):
    """What the FMU answers to an update of its discrete states. next_event: s, inf without one."""

    again: bool
    terminate: bool
    next_event: float


class ModelExchange(Instance):
    """What FMI 2 and 3 have in common here; Instance has the call order."""

    DERIVATIVES: ClassVar[str]
    BOOLEAN: ClassVar[type[Any]]

    @abstractmethod
    def _counts(self) -> tuple[int, int]:
        """Continuous states and event indicators."""

    @abstractmethod
    def _update_discrete_states(self) -> Update: ...

    def _bind_step(self) -> Callable[[], int]:
        self._cvode: Cvode | None = None
        self._t, self._next_event = 0.0, math.inf
        self._touched = self._in_event = False
        self._states, self._indicators = 0, np.zeros(0)
        self._positive, self._rate = b"", np.zeros(1)
        self._moments: dict[int | None, tuple[float, float]] = {}
        self._moment = c_double()
        self._go = self.function("SetTime")
        self._put_states = self.function("SetContinuousStates")
        self._take_derivatives = self.function(self.DERIVATIVES)
        self._take_indicators = self.function("GetEventIndicators")
        self._completed, self._wants_event = self.function("CompletedIntegratorStep"), self.BOOLEAN()
        self._ends = self.BOOLEAN()
        return self._step

    # the instance, as steppers see it

    def begin(self) -> None:
        super().begin()
        self._touched = self._in_event = False
        self._moments.clear()

    def exit_initialisation(self) -> None:
        super().exit_initialisation()
        self._t, self._in_event = self.time.value, True
        states, indicators = self._counts()
        self._release()
        self._states, self._indicators = states, np.zeros(indicators)
        tolerance = self._description.tolerance or TOLERANCE
        # CVODE wants a state at least: one that rests
        self._cvode = Cvode(max(states, 1), indicators, tolerance, self._derivatives, self._at_indicators)
        self._event()

    def bind(self, verb: str, kind: str, references: Sequence[int], pointer: c_void_p, count: int) -> Callable[[], int]:
        call = super().bind(verb, kind, references, pointer, count)
        if verb == "Get":

            def get() -> int:
                if self._touched:
                    self._settle()
                return call()

            return get
        if all((kind, reference) in self._continuous for reference in references):

            def put() -> int:
                self._touched = self._initialised
                return call()

            return put
        ctype: Any = self.TYPES[kind][1]
        there = (ctype * count)()
        look = super().bind("Get", kind, references, c_void_p(ctypes.addressof(there)), count)

        def put_at_event() -> int:
            if self._initialised:
                self.check(look(), f"{self.PREFIX}Get{self.TYPES[kind][0]}")
                if ctypes.string_at(pointer.value or 0, ctypes.sizeof(there)) == bytes(there):
                    return 0  # what stays as it is, is no event
                self._touched = True
                self._enter_event_mode()
            return call()

        return put_at_event

    def directional(self, unknowns: Sequence[int], known: int) -> Float64[np.ndarray, " U"]:
        self._settle()
        return super().directional(unknowns, known)

    def finish_step(self, status: int) -> None:
        raise AssertionError("a step here succeeds or raises")

    def get_state(self) -> c_void_p:
        """The integrator begins anew here too, so that going on and coming back give the same numbers."""
        self._settle()
        self._restart()
        state = super().get_state()
        self._moments[state.value] = self._t, self._next_event
        return state

    def set_state(self, state: c_void_p) -> None:
        self._settle()  # to be in the mode in which it was copied
        super().set_state(state)
        self._t, self._next_event = self._moments[state.value]
        self._restart()

    def free_state(self, state: c_void_p) -> None:
        self._moments.pop(state.value, None)
        super().free_state(state)

    def serialise(self, state: c_void_p) -> bytes:
        return struct.pack("dd", *self._moments[state.value]) + super().serialise(state)

    def deserialise(self, content: bytes) -> c_void_p:
        head = struct.calcsize("dd")
        state = super().deserialise(content[head:])
        self._moments[state.value] = struct.unpack("dd", content[:head])
        return state

    def close(self) -> None:
        self._release()
        super().close()

    def _release(self) -> None:
        cvode, self._cvode = self._cvode, None
        if cvode is not None:
            cvode.close()

    # one step

    def _step(self) -> int:
        target = self.time.value + self.size.value
        self._settle()
        change = self._rates() - self._rate
        if change.any():
            self._integrator.bend(change)
        left = _STEPS
        while target - self._t > SAME:
            due = self._next_event <= target + SAME
            until = self._next_event if due else target
            event = until - self._t > SAME and self._integrate(until)
            if event or (due and self._t >= until - SAME):
                self._enter_event_mode()
                self._event()
            left -= 1
            if not left:
                raise self.failed(
                    f"the model does not get from t = {self.time.value:.9g} s to {target:.9g} s: CVODE, the integrator, is at"
                    f" {self._t:.12g} s after {_STEPS} steps and events",
                    DISCARD,
                )
        self._rate = self._rates()
        return 0

    def _integrate(self, until: float) -> bool:
        """One step of the integrator, to `until` at most. Whether an event is to be dealt with there."""
        cvode = self._integrator
        try:
            root = cvode.step(until)
        except Stuck as error:
            raise self.failed(f"CVODE, the integrator, gave up at t = {cvode.t:.9g} s: {error}", DISCARD) from error
        self._t = cvode.t
        self.check(self._at(self._t, cvode.x.ctypes.data), "SetContinuousStates")
        if self._exchange.completed_steps:
            self.check(
                self._completed(self._component, self.BOOLEAN(True), byref(self._wants_event), byref(self._ends)),
                f"{self.PREFIX}CompletedIntegratorStep",
            )
            if self._ends.value:
                raise self._ended()
        return root or bool(self._wants_event.value) or self._signs() != self._positive

    def _settle(self) -> None:
        """Deal with what was set since the last step."""
        self._touched = False
        if not self._in_event and self._signs() != self._positive:
            self._enter_event_mode()
        if self._in_event:
            self._event()

    def _enter_event_mode(self) -> None:
        if not self._in_event:
            self.call("EnterEventMode")
            self._in_event = True

    def _event(self) -> None:
        """From event mode back to continuous time."""
        for _ in range(_UPDATES):
            update = self._update_discrete_states()
            if update.terminate:
                raise self._ended()
            if not update.again:
                break
        else:
            raise self.failed(
                f"the model does not settle at its event at t = {self._t:.9g} s: it asks for more after {_UPDATES} updates of"
                " its discrete states",
                DISCARD,
            )
        self._next_event = update.next_event
        self.call("EnterContinuousTimeMode")
        self._in_event = self._wants_event.value = False
        self._restart()

    def _restart(self) -> None:
        """Begin to integrate from where the model is."""
        cvode = self._integrator
        if self._states:
            self.call("GetContinuousStates", c_void_p(cvode.x.ctypes.data), c_size_t(self._states))
            self.call("GetNominalsOfContinuousStates", c_void_p(cvode.scale.ctypes.data), c_size_t(self._states))
            if not (cvode.scale > 0.0).all():
                raise self.failed(f"nominal values of states must be above zero, got {cvode.scale.min():g}", DISCARD)
        self._positive = self._signs()
        self._rate = self._rates()
        cvode.restart(self._t)

    def _rates(self) -> Float64[np.ndarray, " n"]:
        """The derivatives where the model is."""
        rates = np.zeros(max(self._states, 1))
        if self._states:
            self.call(self.DERIVATIVES, c_void_p(rates.ctypes.data), c_size_t(self._states))
        return rates

    def _signs(self) -> bytes:
        """Which indicators are above zero: another sign is another branch of the model."""
        if not len(self._indicators):
            return b""
        pointer, count = c_void_p(self._indicators.ctypes.data), c_size_t(len(self._indicators))
        self.check(self._take_indicators(self._component, pointer, count), f"{self.PREFIX}GetEventIndicators")
        return (self._indicators > 0.0).tobytes()

    def _ended(self) -> FmuError:
        return self.failed(f"the model asked to end the simulation at t = {self._t:.9g} s", DISCARD)

    @property
    def _exchange(self) -> Exchange:
        assert self._description.exchange is not None
        return self._description.exchange

    @property
    def _integrator(self) -> Cvode:
        assert self._cvode is not None
        return self._cvode

    @cached_property
    def _continuous(self) -> set[tuple[str, int]]:
        """Types and references of what may be set in continuous time: the rest wants an event."""
        variables = self._description.of("input")
        return {(v.type, v.reference) for v in variables if v.variability == "continuous" and not v.discrete}

    # what CVODE asks

    def _at(self, t: float, x: int) -> int:
        self._moment.value = t
        status = self._go(self._component, self._moment)
        if status < DISCARD and self._states:
            status = max(status, self._put_states(self._component, c_void_p(x), c_size_t(self._states)))
        return status

    def _derivatives(self, t: float, x: int, answer: int) -> int:
        status = self._at(t, x)
        if not self._states:
            c_double.from_address(answer).value = 0.0
        elif status < DISCARD:
            status = self._take_derivatives(self._component, c_void_p(answer), c_size_t(self._states))
        return self._accepted(status, self.DERIVATIVES)

    def _at_indicators(self, t: float, x: int, answer: int) -> int:
        status = self._at(t, x)
        if status < DISCARD:
            status = self._take_indicators(self._component, c_void_p(answer), c_size_t(len(self._indicators)))
        return self._accepted(status, "GetEventIndicators")

    def _accepted(self, status: int, function: str) -> int:
        if status == DISCARD:  # not there: perhaps with a shorter step
            return 1
        self.check(status, f"{self.PREFIX}{function}")
        return 0

    # for loops in C

    def address(self, name: str) -> int:
        return ctypes.cast(self._for_c, c_void_p).value or 0 if name == "DoStep" else super().address(name)

    @cached_property
    def _for_c(self) -> Any:
        """DoStep as a C function. Errors wait for ended()."""
        flags = [POINTER(c_bool)] * 3
        more = [c_bool, *flags, POINTER(c_double)] if self.COUNTED else [c_int]

        def step(_: int, t: float, size: float, *answers: Any) -> int:
            for answer in answers[1:4]:
                answer[0] = False
            self.time.value, self.size.value = t, size
            try:
                return self._step()
            except BaseException as error:
                self._kept = error
                return _ERROR

        return CFUNCTYPE(c_int, c_void_p, c_double, c_double, *more)(step)


@final
class ModelExchange2(ModelExchange, Instance2):
    """FMI 2.0."""

    KIND: ClassVar[int] = fmi2.fmi2ModelExchange
    DERIVATIVES: ClassVar[str] = "GetDerivatives"
    BOOLEAN: ClassVar[type[Any]] = c_int

    def _counts(self) -> tuple[int, int]:
        return self._exchange.states, self._exchange.indicators

    def _update_discrete_states(self) -> Update:
        info = fmi2.fmi2EventInfo()
        self.call("NewDiscreteStates", byref(info))
        due = info.nextEventTime if info.nextEventTimeDefined else math.inf
        return Update(bool(info.newDiscreteStatesNeeded), bool(info.terminateSimulation), due)


@final
class ModelExchange3(ModelExchange, Instance3):
    """FMI 3.0."""

    DERIVATIVES: ClassVar[str] = "GetContinuousStateDerivatives"
    BOOLEAN: ClassVar[type[Any]] = c_bool

    def _instantiate(self) -> int | None:
        function = self.function("InstantiateModelExchange")
        function.restype = c_void_p
        no = c_bool(False)
        return function(
            c_char_p(self._description.name.encode()), c_char_p(self._description.token.encode()), self._resources, no,
            c_bool(self._log.verbose), c_void_p(self._log.key), LOGGER3,
        )  # fmt: skip

    def _counts(self) -> tuple[int, int]:
        states, indicators = c_size_t(), c_size_t()
        self.call("GetNumberOfContinuousStates", byref(states))
        self.call("GetNumberOfEventIndicators", byref(indicators))
        return states.value, indicators.value

    def _update_discrete_states(self) -> Update:
        again, terminate, nominals, values, defined = (c_bool() for _ in range(5))
        due = c_double()
        answers = (again, terminate, nominals, values, defined, due)
        self.call("UpdateDiscreteStates", *map(byref, answers))
        return Update(again.value, terminate.value, due.value if defined.value else math.inf)
