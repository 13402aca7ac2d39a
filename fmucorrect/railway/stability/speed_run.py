"""A vehicle that is disturbed, run at one speed after another, and put back to where it was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Literal, final

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import FmuError
from fmucorrect.fmu import FmuDescription, open_fmu
from fmucorrect.fmu.simulation import SavedState, Simulation
from fmucorrect.railway.speed_parameter import SpeedParameter
from fmucorrect.railway.stability.disturbance import Disturbance, start_numbers
from fmucorrect.railway.stability.state_start import start_at, start_offsets
from fmucorrect.signals import Channel

Carry = Literal["saved state", "start values", "disturbance"]
"""How a motion is taken up again: the FMU's saved state; its states as start values of a new run; or a new run that is
disturbed once more, for an FMU that can do neither."""
States = Mapping[str, float]
"""Continuous states by name, in the FMU's units."""
_NONE: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Checkpoint:
    """Where a run can be taken up again: at `speed` (m/s); saved and states are None where the FMU gives none."""

    speed: float
    saved: SavedState | None
    states: States | None


@final
class SpeedRun:
    """One FMU of a vehicle. Call order: begin or resume; then advance and change; begin again; close.

    speed: the FMU's speed parameter. channels: what is watched, the first one leads. disturbance: what size 1 is. start:
    start values of every run, in the FMU's units. step_size: s, the FMU's own where None. flags: outputs that are not 0
    where the motion is beyond the model, as where a wheel lifts.

    Raises FmuError (file, names, values, what the solver refuses) and SignalError (units).
    """

    def __init__(
        self,
        path: str | Path,
        speed: SpeedParameter,
        channels: tuple[Channel, ...],
        disturbance: Disturbance,
        *,
        start: Mapping[str, float] = _NONE,
        step_size: float | None = None,
        flags: Sequence[str] = (),
    ) -> None:
        description = open_fmu(path)
        if not channels:
            raise FmuError("no output is watched", where=str(path), expected="at least one channel")
        self._factor = speed.factor(description)
        problems = description.unknown([*disturbance.start, *disturbance.pulse], "variable to disturb")
        if problems or not (disturbance.start or disturbance.pulse):
            raise FmuError("; ".join(problems) or "nothing is disturbed", where=str(path))
        raising = tuple(Channel(name, unit="") for name in flags)
        self._simulation = Simulation(path, (*channels, *raising), step_size=step_size)
        self._width = len(channels)
        self._raised: tuple[str, ...] = ()
        states = self._simulation.structure.states
        self._states = tuple(v.name for v in states) if all(v.settable for v in states) else ()
        self.tunable = self._simulation.settable(speed.name)
        self._name, self._disturbance, self._start = speed.name, disturbance, start
        self._known = start_numbers(description)
        self._speed = float("nan")

    @property
    def carry(self) -> Carry:
        """How this FMU's motions are taken up again at another speed."""
        if self.tunable and self._simulation.can_save:
            return "saved state"
        return "start values" if self._states else "disturbance"

    @property
    def description(self) -> FmuDescription:
        """What the FMU says of itself."""
        return self._simulation.description

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What is watched, with units."""
        return self._simulation.channels[: self._width]

    @property
    def raised(self) -> tuple[str, ...]:
        """Flags that were not 0 while the run last advanced."""
        return self._raised

    @property
    def speed(self) -> float:
        """m/s, now."""
        return self._speed

    @property
    def step_size(self) -> float:
        """s."""
        return self._simulation.step_size

    def begin(self, speed: float, size: float) -> Float64[np.ndarray, "T K"]:
        """A new run at `speed` (m/s), disturbed by `size`; what happened while a pulse lasted (T may be 0)."""
        self._speed = speed
        values = {**self._start, self._name: speed * self._factor}
        self._simulation.start(self._disturbance.started(values, self._known, size))
        if not self._disturbance.pulse:
            return np.zeros((0, len(self.channels)))
        pulses = self._disturbance.pulses(values, self._known, size, self.step_size)
        return self._watched(self._simulation.run(len(pulses), tuple(self._disturbance.pulse), pulses))

    def advance(self, seconds: float, to: float | None = None) -> Float64[np.ndarray, "T K"]:
        """Go on for `seconds`, the speed moving evenly to `to` (m/s) where one is given, which needs a tunable speed."""
        steps = max(1, round(seconds / self.step_size))
        if to is None or to == self._speed:
            return self._watched(self._simulation.run(steps))
        if not self.tunable:
            raise FmuError(
                f"the speed parameter {self._name!r} cannot be changed while it runs",
                where=str(self.description.path),
                expected="a tunable parameter or an input",
                remedy="Export it as tunable, or step the speed down instead of decelerating.",
            )
        speeds = self._speed + (to - self._speed) * np.arange(1, steps + 1) / steps
        result = self._simulation.run(steps, (self._name,), (speeds * self._factor)[:, None])
        self._speed = to
        return self._watched(result)

    def states(self) -> States | None:
        """The continuous states now, None where the FMU does not list them or does not let them be start values."""
        if not self._states:
            return None
        return dict(zip(self._states, self._simulation.get(self._states).tolist(), strict=True))

    def begin_at(self, speed: float, states: States) -> None:
        """A new run at `speed` (m/s) from these states. Raises FmuError for a state that does not keep its start value."""
        self._speed = speed
        values = {**self._start, self._name: speed * self._factor}
        wanted = np.array([states[name] for name in self._states])
        offsets = start_offsets(self._simulation, values, self._states)
        start_at(self._simulation, values, self._states, wanted, offsets)

    def checkpoint(self) -> Checkpoint:
        """Where the run is now; resume() goes back to it."""
        saved = self._simulation.save() if self.carry == "saved state" else None
        return Checkpoint(self._speed, saved, self.states())

    def resume(self, checkpoint: Checkpoint, speed: float, seconds: float) -> None:
        """Take a motion up again and lead it to `speed` (m/s), over `seconds` where the speed is tunable.

        Of an FMU that carries nothing over, a new run is disturbed by size 1, at once at `speed` where the speed is fixed.
        """
        begun = checkpoint.speed if self.tunable else speed
        if checkpoint.saved is not None and self._simulation.holds(checkpoint.saved):
            self._simulation.restore(checkpoint.saved)
            self._speed = checkpoint.speed
        elif checkpoint.states is not None:
            self.begin_at(begun, checkpoint.states)
        else:
            self.begin(begun, 1.0)
            self.advance(seconds)
        if speed != self._speed:
            self.advance(seconds, to=speed)

    def close(self) -> None:
        """Release the FMU. May be called twice."""
        self._simulation.close()

    def __enter__(self) -> SpeedRun:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _watched(self, rows: Float64[np.ndarray, "T W"]) -> Float64[np.ndarray, "T K"]:
        if not np.isfinite(rows).all():
            row, column = np.argwhere(~np.isfinite(rows))[0]
            raise FmuError(
                f"{self._simulation.channels[column].name!r} is {rows[row, column]} at {self._speed:.6g} m/s",
                where=str(self.description.path),
                expected="finite numbers",
                remedy="The motion has left what the model can do: disturb it less, or start slower.",
            )
        flags = self._simulation.channels[self._width :]
        self._raised = tuple(
            flag.name for flag, column in zip(flags, rows[:, self._width :].T, strict=True) if column.any()
        )
        return rows[:, : self._width]
