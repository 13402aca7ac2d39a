"""CVODE, the integrator of SUNDIALS for stiff systems that comes with fmpy: variable order and step, roots located.

fmpy's own CVodeSolver goes over many internal steps at once, past the point that is asked for, and prints what goes wrong in
a callback. Here each internal step is one call, none goes beyond the point, and errors of callbacks come out as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import CFUNCTYPE, byref, c_double, c_int, c_void_p, cast
from typing import Any, final

import fmpy
import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError

try:
    from fmpy import sundials
    from fmpy.sundials.libraries import sundials_core, sundials_cvode
except (ImportError, OSError, AttributeError) as error:
    raise FmuError(
        f"fmpy brings no CVODE for this machine ({error}), with which model exchange is integrated",
        got=fmpy.platform_tuple,
        remedy="Export the FMU for co-simulation, with its tool's own solver in it.",
    ) from error

Callback = Callable[[float, int, int], int]
"""Time, the address of the states, and where the answer goes; 0, 1 where a shorter step may do better, or -1."""
_FUNCTION = CFUNCTYPE(c_int, c_double, c_void_p, c_void_p, c_void_p)
_WEIGHTS = CFUNCTYPE(c_int, c_void_p, c_void_p, c_void_p)
_DIGITS = 1e-13
"""What a difference of two numbers may lose, of the larger one: a thousand roundings."""
_ROOT, _ONE_STEP = 2, 2
_AGAIN = (-3, -4)
"""CVODE's flags for an error test that failed too often and for Newton's iteration that did: of a step too long for what the
right-hand side is now."""


def _bound(library: Any, name: str, *arguments: Any) -> Any:
    """A function that fmpy leaves without a prototype."""
    function = library[name]
    function.argtypes, function.restype = arguments, c_void_p if name == "N_VGetArrayPointer" else c_int
    return function


_data = _bound(sundials_core, "N_VGetArrayPointer", c_void_p)
_stop_at = _bound(sundials_cvode, "CVodeSetStopTime", c_void_p, c_double)
_weigh_by = _bound(sundials_cvode, "CVodeWFtolerances", c_void_p, _WEIGHTS)
_warn_of_no_step = _bound(sundials_cvode, "CVodeSetMaxHnilWarns", c_void_p, c_int)
_quiet = _bound(sundials_core, "SUNContext_ClearErrHandlers", c_void_p)
_FREE = {
    name: _bound(library, name, c_void_p)
    for library, names in (
        (sundials_cvode, ("CVodeFree",)),
        (sundials_core, ("SUNLinSolFree", "SUNMatDestroy", "N_VDestroy", "SUNContext_Free")),
    )
    for name in names
}


class Stuck(FmuError):
    """CVODE cannot go on, in its own words."""


@final
class Cvode:
    """x' = f(t, x) with the roots of g(t, x), both as callbacks.

    x: (n,) the states, where the last step() left them. scale: (n,) size of each; the error allowed in a step is `tolerance`
    of it and of the state itself. Set both, then restart(t), then step(), and bend() where f jumps between two steps.

    What CVODE integrates is w = x - p with p piecewise linear: the jumps of f become corners of p, and w has none. So it keeps
    its order and its step (the predictor for inputs that jump of Andersson, Fuehrer and Akesson, Efficient Predictor for
    Co-Simulation with Multistep Sub-System Solvers). Without, it has the choice to begin anew with each sample, at order 1
    and with its damping, or to take the old slopes for the new ones, which delays what was set by half a sample.
    """

    def __init__(self, states: int, roots: int, tolerance: float, derivatives: Callback, indicators: Callback) -> None:
        self._said = ""
        self._time = c_double()
        self._tolerance = tolerance
        self._error: BaseException | None = None
        self._right = _FUNCTION(self._guarded(derivatives, _data))
        self._zero = _FUNCTION(self._guarded(indicators, int))
        self._hear = sundials.SUNErrHandlerFn(self._heard)
        self._context = c_void_p()
        self._free: list[tuple[str, Any]] = []
        self._require(sundials.SUNContext_Create(sundials.SUN_COMM_NULL, byref(self._context)))
        self._free.append(("SUNContext_Free", byref(self._context)))
        _quiet(self._context)
        sundials.SUNContext_PushErrHandler(self._context, self._hear, None)
        self._states = sundials.N_VNew_Serial(states, self._context)
        self._free.append(("N_VDestroy", self._states))
        self._w = np.ctypeslib.as_array(sundials.NV_DATA_S(self._states), (states,))
        self.x, self.scale = np.zeros(states), np.ones(states)
        self._slope, self._corner, self._since = np.zeros(states), np.zeros(states), 0.0
        self._bent = False
        self._vector = c_double * states
        self._tried = np.zeros(states)
        self._memory = c_void_p(sundials.CVodeCreate(sundials.CV_BDF, self._context))
        self._free.append(("CVodeFree", byref(self._memory)))
        self._require(sundials.CVodeInit(self._memory, cast(self._right, sundials.CVRhsFn), 0.0, self._states))
        self._weigh = _WEIGHTS(self._weights)
        self._require(_weigh_by(self._memory, self._weigh))
        self._require(sundials.CVodeRootInit(self._memory, roots, cast(self._zero, sundials.CVRootFn)))
        self._require(sundials.CVodeSetNoInactiveRootWarn(self._memory))
        self._require(_warn_of_no_step(self._memory, -1))  # step() looks itself
        matrix = c_void_p(sundials.SUNDenseMatrix(states, states, self._context))
        self._free.append(("SUNMatDestroy", matrix))
        linear = c_void_p(sundials.SUNLinSol_Dense(self._states, matrix, self._context))
        self._free.append(("SUNLinSolFree", linear))
        self._require(sundials.CVodeSetLinearSolver(self._memory, linear, matrix))

    @property
    def t(self) -> float:
        """s, where the last step() went."""
        return self._time.value

    def restart(self, t: float) -> None:
        """Begin anew at t from x: what was before is no guide any more."""
        self._bent = False
        self._slope[:] = self._corner[:] = 0.0
        self._w[:] = self.x
        self._time.value = t
        self._require(sundials.CVodeReInit(self._memory, t, self._states))

    def bend(self, change: Float64[np.ndarray, " n"]) -> None:
        """f has jumped by `change` here. Begins anew where p has grown so large that its digits fail x."""
        self._corner += self._slope * (self.t - self._since)
        self._since = self.t
        self._slope += change
        self._bent = True
        if (_DIGITS * np.abs(self._corner) > self._tolerance * (np.abs(self.x) + self.scale)).any():
            self.restart(self.t)

    def step(self, until: float) -> bool:
        """One internal step, to `until` at most; whether a root ended it. Where the derivatives have changed so much since the
        last one that no step gets through, it begins anew and tries once more. Raises Stuck, and what callbacks raise."""
        before = self.t
        flag = self._step(until)
        if flag in _AGAIN:
            self.restart(self.t)
            flag = self._step(until)
        if flag < 0:
            raise Stuck(self._said or f"flag {flag}")
        if flag != _ROOT and self.t == before:
            raise Stuck("steps that are short enough for it do not move the time any more")
        return flag == _ROOT

    def _step(self, until: float) -> int:
        self._said = ""
        _stop_at(self._memory, until)
        flag = sundials.CVode(self._memory, until, self._states, byref(self._time), _ONE_STEP)
        self.x[:] = self._w
        if self._bent:
            self.x += self._p(self.t)
        error, self._error = self._error, None
        if error is not None:
            raise error
        return flag

    def close(self) -> None:
        """Release everything. May be called twice."""
        while self._free:
            name, held = self._free.pop()
            _FREE[name](held)

    def _p(self, t: float) -> Float64[np.ndarray, " n"]:
        return self._corner + self._slope * (t - self._since)

    def _there(self, address: int) -> Float64[np.ndarray, " n"]:
        return np.ctypeslib.as_array(self._vector.from_address(address))

    def _weights(self, _: int, answer: int, __: int | None) -> int:
        """Of the errors in w: those of x, where the last step left it."""
        weights = self._there(_data(answer))
        np.divide(1.0 / self._tolerance, np.abs(self.x) + self.scale, out=weights)
        return 0

    def _guarded(self, callback: Callback, place: Callable[[int], int]) -> Callable[..., int]:
        """The callback as CVODE calls it, with `place` of where its answer goes. What it raises waits for step(), as C knows no
        exceptions."""

        def call(t: float, x: int, answer: int, _: int | None) -> int:
            try:
                if not self._bent:
                    return callback(t, _data(x), place(answer))
                np.add(self._there(_data(x)), self._p(t), out=self._tried)
                status = callback(t, self._tried.ctypes.data, place(answer))
                if place is _data:
                    rates = self._there(_data(answer))
                    rates -= self._slope
                return status
            except BaseException as error:
                self._error = error
                return -1

        return call

    def _heard(self, line: int, function: bytes, file: bytes, message: bytes, code: int, *_: Any) -> None:
        self._said = message.decode(errors="replace").strip()

    def _require(self, flag: int) -> None:
        if flag != 0:
            raise Stuck(self._said or f"flag {flag}")
