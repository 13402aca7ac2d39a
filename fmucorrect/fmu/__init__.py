"""FMUs: open, validate, step, state. The only place that knows fmpy."""

from fmucorrect.fmu.description import FmuDescription, Variable, open_fmu
from fmucorrect.fmu.inputs import input_record
from fmucorrect.fmu.isolated import IsolatedStepper
from fmucorrect.fmu.process import Limits
from fmucorrect.fmu.startvalues import fixed
from fmucorrect.fmu.stepper import FmuStepper, SolverState

__all__ = [
    "FmuDescription",
    "FmuStepper",
    "IsolatedStepper",
    "Limits",
    "SolverState",
    "Variable",
    "fixed",
    "input_record",
    "open_fmu",
]
