"""A corrector that is not used: the model runs with other start values than those that its corrector was trained with.

Nothing in the motion need show that: another damper moves much like the one that was trained with, and what the model lacks
is another thing all the same. Every row is then `outside`, the simulation passes through, and why is said by name.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import final

import numpy as np
from jaxtyping import Float32, Float64

from fmucorrect.bundle import Bundle
from fmucorrect.signals import Channel
from fmucorrect.stepper import Correction, Corrector, Window


def admitted(corrector: Corrector, given: Mapping[str, float], defaults: Mapping[str, float]) -> tuple[Corrector, str]:
    """`corrector`, or what stands for it where the model's start values are others than in its training; and why, "" where
    they are not. given: those that are set. defaults: those that hold otherwise, as far as they are known."""
    why = "; ".join(corrector.info.unlike(given, defaults)) if isinstance(corrector, Bundle) else ""
    return (Withheld(corrector), why) if why else (corrector, "")


def shown_otherwise(model: Bundle, channels: Sequence[Channel]) -> list[str]:
    """Channels of a study that show another output of the FMU than in the corrector's training, in words: a slip, or a model
    whose outputs were renamed."""
    now = {channel.name: channel.simulation or channel.name for channel in channels}
    then = {channel.name: channel.simulation or channel.name for channel in model.channels}
    return [
        f"channel {name!r} shows {now[name]!r} of the FMU, and showed {output!r} when the corrector was trained"
        for name, output in then.items()
        if now.get(name, output) != output
    ]


def left_alone(model: Bundle, driven: Collection[str]) -> list[str]:
    """Inputs of the FMU that nothing drives now and that a column drove when the corrector was trained, in words."""
    return [
        f"nothing drives {name!r} of the FMU, which a column drove when the corrector was trained"
        for name in model.info.driven
        if name not in driven
    ]


@final
class Withheld:
    """A stepper.Corrector that adds nothing, everywhere `outside`."""

    def __init__(self, corrector: Corrector) -> None:
        self._corrector = corrector

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._corrector.channels

    @property
    def sees(self) -> tuple[Channel, ...]:
        return self._corrector.sees

    @property
    def held(self) -> tuple[str, ...]:
        return self._corrector.held

    @property
    def rows(self) -> int:
        return self._corrector.rows

    @property
    def step_ns(self) -> int:
        return self._corrector.step_ns

    @property
    def uncorrected(self) -> Float32[np.ndarray, " J"]:
        return self._corrector.uncorrected

    def start(self) -> WithheldRun:
        return WithheldRun(self._corrector.rows, len(self.channels) + len(self.sees), self.uncorrected)


@final
class WithheldRun:
    """A stepper.CorrectorRun."""

    def __init__(self, rows: int, columns: int, uncorrected: Float32[np.ndarray, " J"]) -> None:
        self.window = Window(rows, columns)
        self.condition, self.seconds = np.zeros((1, 3), np.float32), np.zeros((1, 1))
        self.state = np.zeros(0, np.float32)
        self.answer = Correction(
            np.zeros((1, len(uncorrected)), np.float32), uncorrected[None], np.zeros(1, np.float32)
        )

    def reset(self) -> None:
        self.window.clear()

    def step(self) -> bool:
        return True

    def correct(
        self,
        windows: Float32[np.ndarray, "N W V"],
        condition: Float32[np.ndarray, " 3"],
        seconds: Float64[np.ndarray, " N"],
    ) -> Correction:
        one, count = self.answer, len(windows)
        return Correction(*(np.repeat(values, count, axis=0) for values in one))
