"""h and g of a linear response: what forces at joints, parameters and errors of what excites an FMU change, from runs of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64

from fmucorrect.discovery.simulator import Simulator, spans
from fmucorrect.discovery.terms import SignalTerm
from fmucorrect.errors import FmuError

PLACES = (0.1, 0.4)
"""Where in a condition's motion pulses come, in shares of it. Eight places were no better than these two on a bogie: what is
wrong then is that the response changes along the motion, not that it is met badly."""
PULSE, TRIES = 0.1, 4
"""What a pulse changes at most, in shares of what that sensor or joint goes through: between a solver's noise and what is no
longer small; on a bogie 0.02 to 0.4 are equal. Runs until one is about as large."""
NEAR, TOGETHER = 128, 4
"""As response.c has them: rows after which a response is taken in groups of so many."""
FADED = 0.01
"""Share of the area under a response, without its sign, with which it has come to its end."""
SHIFTED, SHIFTED_STEPS = 0.01, 2.0
"""What a parameter, or the gain of what excites, is moved by, as a share of it; a lag, in steps. At 5 % a resonance has moved
by too much of its width."""


@dataclass(frozen=True)
class Pulsed:
    """h of one force input. sensors: (J, S) for a unit of it, the row after its step first, as far as it lasts. near, far: the
    same of the ports, as response.c has it. apart: by how much the responses to two pulses differ, rms over their mean."""

    sensors: Float64[np.ndarray, "J S"]
    near: Float32[np.ndarray, "P N"]
    far: Float32[np.ndarray, "P G K"]
    apart: float


class Identified:
    """Of a condition's FMU with some start values; each part when it is first asked for.

    simulator: shows sensors, `count` of them, and behind them ports. parameters: the start values that are not its own. forces:
    the inputs at its joints, among those of the simulator. Raises FmuError where the FMU does not run so.
    """

    def __init__(
        self, simulator: Simulator, count: int, forces: Sequence[str], parameters: Mapping[str, float]
    ) -> None:
        self._simulator, self._count, self._forces = simulator, count, forces
        self.parameters = parameters
        self._bare = np.array(simulator.run((), parameters))
        self._pulses: dict[int, Pulsed] = {}
        self._knobs: dict[str, Float32[np.ndarray, "T R"]] = {}

    def to(self, f: int) -> Pulsed:
        """To the force input of that number."""
        if f not in self._pulses:
            self._pulses[f] = self._pulsed(self._simulator.inputs[0].index(self._forces[f]))
        return self._pulses[f]

    def knob(self, name: str, value: float) -> Float32[np.ndarray, "T R"]:
        """To one unit of a parameter that is `value` by the study."""
        if name not in self._knobs:
            at = self.parameters.get(name, value)
            by = SHIFTED * abs(at) or SHIFTED
            moved = self._simulator.run((), {**self.parameters, name: at + by})
            self._knobs[name] = ((moved - self._bare) / by).astype(np.float32)
        return self._knobs[name]

    def drive(self, term: SignalTerm) -> Float32[np.ndarray, "T R"]:
        """To one unit of the number of an error of what excites the FMU, from where it is none."""
        if term.law.label not in self._knobs:
            names, given = self._simulator.inputs
            (name,), step = term.estimated, self._simulator.step
            by = SHIFTED_STEPS * step if term.parameter(name).unit == "s" else SHIFTED
            values = {**term.values, name: (term.parameter(name).neutral or 0.0) + by}
            moved = given.copy()
            for i in range(len(names)):
                moved[:, i] = term.law.apply(given[:, i], step, values)
            self._knobs[term.law.label] = ((self._simulator.run((), self.parameters, moved) - self._bare) / by).astype(
                np.float32
            )
        return self._knobs[term.law.label]

    def _pulsed(self, column: int) -> Pulsed:
        """By pulses of one step in a column of the inputs."""
        y, (_, given) = self._bare, self._simulator.inputs
        size = spans(y) + 1e-300
        begin = int(np.argmax((np.abs(y - y[0]) > 1e-3 * size).any(axis=1)))
        push, found = 1.0, list[Float64[np.ndarray, "R S"]]()
        for place in PLACES:
            at = begin + round(place * (len(y) - 1 - begin))
            for _ in range(TRIES):
                pushed = given.copy()
                pushed[at, column] += push
                try:
                    change = (np.array(self._simulator.run((), self.parameters, pushed)) - y)[at:].T
                except FmuError:
                    push *= 0.1
                    continue
                most = float((np.abs(change).max(axis=1) / size).max())
                if 0.3 * PULSE < most < 3.0 * PULSE:
                    break
                push *= PULSE / max(most, 1e-6 * PULSE)
            else:
                continue
            change[:, 1] += change[:, 0]  # what is passed on at once shows to a law where its force is still held
            found.append(change[:, 1:] / push)
        if not found:
            return _of_ports(np.zeros((len(size), 1)), self._count, np.inf)
        both = min(part.shape[1] for part in found)
        shared = np.mean([part[:, :both] for part in found], axis=0)
        scale = np.linalg.norm(shared, axis=1, keepdims=True) + 1e-300
        apart = float(np.sqrt(np.mean([np.sum(((part[:, :both] - shared) / scale) ** 2, axis=1) for part in found])))
        whole = found[0].copy()
        whole[:, :both] = shared
        ahead = np.cumsum(np.abs(whole[:, ::-1]), axis=1)[:, ::-1]  # of its area, from a row on
        reach = int(np.count_nonzero((ahead > FADED * ahead[:, :1]).any(axis=0)))
        return _of_ports(whole[:, :reach], self._count, apart)


def _of_ports(change: Float64[np.ndarray, "R S"], count: int, apart: float) -> Pulsed:
    """Of sensors, the first `count` rows of it, and ports."""
    ports, groups = change[count:], -(-max(change.shape[1] - NEAR, 0) // TOGETHER)
    whole = np.zeros((len(ports), NEAR + TOGETHER * (groups + 1)))
    whole[:, : change.shape[1]] = ports[:, : whole.shape[1]]
    near = whole[:, : NEAR + TOGETHER - 1]
    far = [
        whole[:, NEAR + phase : NEAR + phase + TOGETHER * groups].reshape(len(ports), groups, TOGETHER).mean(axis=2)
        for phase in range(TOGETHER)
    ]
    return Pulsed(
        np.ascontiguousarray(change[:count]),
        near[:, ::-1].astype(np.float32),
        np.stack(far, axis=1)[:, :, ::-1].astype(np.float32),
        apart,
    )
