"""The variables that the wrapped FMU has beside the solver's own, and where their value references lie.

The numbers are those of wrapping/c/wrapper.h: with J channels, `<channel>_corrected` at base + 0 .. J-1, `<channel>_sigma` at
base + J .. 2J-1, then `corrector_status`, `correction_enabled`, the four conditions and `effects_enabled`. A place stays empty
where its variable is not there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fmucorrect.signals import Channel
from fmucorrect.wrapping.wiring import CONDITIONS

STATUS: Mapping[str, str] = {
    "ok": "Corrected",
    "warmup": "Uncorrected: the window is not full yet",
    "outside": "Held back, in part or in whole: outside of the conditions that the corrector was trained for",
    "invalid": "Uncorrected: a channel of the solver is not finite",
    "off": "Uncorrected: correction_enabled is false",
}
"""Items of the enumeration CorrectorStatus, whose values count from 0, with what they mean."""

_MEANING = {
    "speed": "Running speed that the correction is for",
    "amplitude": "Amplitude of the excitation that the correction is for",
    "frequency": "Frequency of the excitation that the correction is for",
    "start": "Time at which the excitation begins",
}


@dataclass(frozen=True)
class Added:
    """What is added. channels: J, in the corrector's order, () with effects alone. sources: the solver's variables that the
    corrector reads, for its channels and its conditions. tunables: start value of each condition (a key of CONDITIONS)
    that the solver does not know itself. effects: whether there are any. starts: start values that the wrapper gives to
    solver variables, by name, in their own units.

    What the effects read and write adds no dependency: their forces are held over a sub-step, so at a communication point
    nothing follows from them at once.
    """

    channels: tuple[Channel, ...] = ()
    sources: tuple[str, ...] = ()
    tunables: Mapping[str, float] = field(default_factory=dict)
    effects: bool = False
    starts: Mapping[str, float] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """How many value references are reserved."""
        return 2 * len(self.channels) + 3 + len(CONDITIONS)


@dataclass(frozen=True)
class AddedVariable:
    """offset: of its value reference from the base. type: Real, Enumeration or Boolean; Real is Float64 in FMI 3. start: ""
    for an output."""

    name: str
    offset: int
    type: str
    causality: str
    variability: str
    unit: str
    start: str
    description: str

    @property
    def attributes(self) -> dict[str, str]:
        """What both versions of FMI write the same way."""
        initial = "calculated" if self.causality == "output" else "exact"
        return {"causality": self.causality, "variability": self.variability, "initial": initial}


def variables(added: Added) -> tuple[AddedVariable, ...]:
    """All of them, by offset."""
    count = len(added.channels)
    found: list[AddedVariable] = []
    for j, channel in enumerate(added.channels):
        what = f"{channel.name}: the solver's, corrected to what is measured"
        if channel.measurement_sign < 0:
            what += "; positive in the solver's direction, which is the other one than the sensor's"
        found.append(_output(f"{channel.name}_corrected", j, channel.unit, what))
    for j, channel in enumerate(added.channels):
        what = f"Standard deviation of what remains between {channel.name}_corrected and a measurement"
        found.append(_output(f"{channel.name}_sigma", count + j, channel.unit, what))
    if added.channels:
        what = "Whether the outputs are corrected, and why not"
        found.append(AddedVariable("corrector_status", 2 * count, "Enumeration", "output", "discrete", "", "", what))
        what = "Whether the outputs are corrected; false: they are the solver's own"
        found.append(_parameter("correction_enabled", 2 * count + 1, "Boolean", "", "true", what))
        for place, (key, unit) in enumerate(CONDITIONS.items(), 2 * count + 2):
            if key in added.tunables:
                start = repr(float(added.tunables[key]))
                found.append(_parameter(f"corrector_{key}", place, "Real", unit, start, _MEANING[key]))
    if added.effects:
        what = "Whether the effects that the solver lacks are fed back into it"
        place = 2 * count + 2 + len(CONDITIONS)
        found.append(_parameter("effects_enabled", place, "Boolean", "", "true", what))
    return tuple(found)


def _output(name: str, offset: int, unit: str, description: str) -> AddedVariable:
    return AddedVariable(name, offset, "Real", "output", "continuous", unit, "", description)


def _parameter(name: str, offset: int, kind: str, unit: str, start: str, description: str) -> AddedVariable:
    return AddedVariable(name, offset, kind, "parameter", "tunable", unit, start, description)
