"""The FMU variable that is the running speed, in m/s whatever the FMU's own unit is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from fmucorrect.errors import FmuError
from fmucorrect.fmu import FmuDescription
from fmucorrect.railway.constants import KMH
from fmucorrect.units import conversion


@dataclass(frozen=True)
class SpeedParameter:
    """name: of the FMU's parameter or input. unit: of its values, needed only where the FMU says none."""

    name: str = "speed"
    unit: str = ""

    def factor(self, description: FmuDescription) -> float:
        """What a speed in m/s is multiplied by to be in the FMU's unit.

        Raises FmuError when there is no such variable, it cannot be set, or nobody says its unit; SignalError when the
        unit is that of no speed.
        """
        where = str(description.path)
        problems = description.unknown([self.name], "speed parameter")
        if problems:
            raise FmuError(problems[0], where=where)
        variable = description.variables[self.name]
        if not (variable.settable and variable.number):
            what = f"{self.name!r} is a {variable.variability} {variable.causality}, whose value the model computes"
            raise FmuError(what, where=where, expected="a parameter or an input of one number")
        unit = variable.unit or self.unit
        if not unit:
            raise FmuError(
                f"the FMU does not say the unit of {self.name!r}",
                where=where,
                expected="a unit of speed",
                remedy="Give it, for example 'm/s' or 'km/h'.",
            )
        return conversion("m/s", unit, f"speed parameter {self.name!r}", description.defined)

    def outside(self, description: FmuDescription, speeds: Iterable[float]) -> list[str]:
        """What is wrong with speeds (m/s) that the FMU does not run at. Raises as factor() does."""
        factor, variable = self.factor(description), description.variables[self.name]
        low, high = (KMH * bound / factor for bound in (variable.minimum, variable.maximum))
        wrong = [KMH * v for v in speeds if not variable.minimum <= v * factor <= variable.maximum]
        return [
            f"{v:g} km/h is outside of the FMU's {self.name!r}, {low:g} to {high:g} km/h" for v in dict.fromkeys(wrong)
        ]
