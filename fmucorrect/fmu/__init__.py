"""FMUs: open, check, step. The only place that knows fmpy."""

from fmucorrect.fmu.description import FmuDescription, Variable, describe
from fmucorrect.fmu.inputs import input_record
from fmucorrect.fmu.stepper import FmuStepper

__all__ = ["FmuDescription", "FmuStepper", "Variable", "describe", "input_record"]
