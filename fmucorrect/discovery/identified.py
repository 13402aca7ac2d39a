"""h and g of a linear response: what forces at joints, parameters and errors of what excites an FMU change, from runs of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from scipy.signal import fftconvolve

from fmucorrect.discovery.simulator import Simulator, spans
from fmucorrect.discovery.terms import SignalTerm
from fmucorrect.errors import FmuError

PULSE, TRIES = 0.1, 4
"""What a pulse changes at most, in shares of what that sensor or joint goes through: between a solver's noise and what is no
longer small; on a bogie 0.02 to 0.4 are equal. Runs until one is about as large."""
NEAR, TOGETHER = 128, 4
"""As response.c has them: rows after which a response is taken in groups of so many."""
FADED, LAST_PART = 0.01, 0.1
"""Share of the area under a response, without its sign, with which it has come to its end; and that part of it in which it must
have less. The loop is told no more of it, sensors all."""
SHIFTED, SHIFTED_STEPS = 0.01, 2.0
"""What a parameter, or the gain of what excites, is moved by, as a share of it; a lag, in steps. At 5 % a resonance has moved
by too much of its width."""


@dataclass(frozen=True)
class Pulsed:
    """h of one force input. sensors: (J, S) for a unit of it, the row after its step first. near, far: the same of the ports,
    as response.c has it. fades: whether all of it comes to an end within the record. error: of what it tells of a force that
    follows the joint's motion as a spring's and a damper's do, in shares of what sensors show; inf where no pulse shows."""

    sensors: Float64[np.ndarray, "J S"]
    near: Float32[np.ndarray, "P N"]
    far: Float32[np.ndarray, "P G K"]
    fades: bool
    error: float


class Identified:
    """Of a condition's FMU with some start values; each part when it is first asked for.

    simulator: shows sensors, `count` of them, and behind them ports. parameters: the start values that are not its own. forces:
    the inputs at its joints, among those of the simulator. along: of each the column of a displacement of its joint. Raises
    FmuError where the FMU does not run so.
    """

    def __init__(
        self,
        simulator: Simulator,
        count: int,
        forces: Sequence[str],
        along: Sequence[int],
        parameters: Mapping[str, float],
    ) -> None:
        self._simulator, self._count, self._forces, self._along = simulator, count, forces, along
        self.parameters = parameters
        self._bare = np.array(simulator.run((), parameters))
        self._pulses: dict[int, Pulsed] = {}
        self._knobs: dict[str, Float32[np.ndarray, "T R"]] = {}

    def to(self, f: int) -> Pulsed:
        """To the force input of that number."""
        if f not in self._pulses:
            self._pulses[f] = self._pulsed(self._simulator.inputs[0].index(self._forces[f]), self._along[f])
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
            changed = self._simulator.run((), self.parameters, moved) - self._bare
            self._knobs[term.law.label] = (changed / by).astype(np.float32)
        return self._knobs[term.law.label]

    def _pulsed(self, column: int, along: int) -> Pulsed:
        """By a pulse of one step in a column of the inputs, where the motion begins: all is seen that a force in it does. Tried
        out by a force that goes `along` another of what is shown, and stays on for a while at first."""
        y = self._bare
        size = spans(y) + 1e-300
        begin = int(np.argmax((np.abs(y - y[0]) > 1e-3 * size).any(axis=1)))
        at, push, found = min(begin, len(y) - 3), 1.0, None
        for _ in range(TRIES):
            changed = self._pushed(column, np.where(np.arange(len(y)) == at, push, 0.0))
            if changed is None:
                push *= 0.1
                continue
            found = changed[at:].T / push
            most = float((np.abs(changed).max(axis=0) / size).max())
            if 0.3 * PULSE < most < 3.0 * PULSE:
                break
            push *= PULSE / max(most, 1e-6 * PULSE)
        if found is None or not found.any():
            return _of_ports(np.zeros((y.shape[1], 1)), self._count, np.inf)
        change = found
        change[:, 1] += change[:, 0]  # what is passed on at once shows to a law where its force is still held
        change = change[:, 1:]
        d = y[:, along] - y[0, along]
        v = np.gradient(d)
        force = d / max(float(d.std()), 1e-300) + v / max(float(v.std()), 1e-300)
        force[at : at + round(LAST_PART * (len(y) - at))] += 1.0
        told = convolved(change[: self._count], force)
        force *= PULSE / max(float((np.abs(told).max(axis=0) / size[: self._count]).max()), 1e-300)
        shown, told = self._pushed(column, force), convolved(change[: self._count], force)
        if shown is None or not np.isfinite(force).all():
            return _of_ports(change, self._count, np.inf)
        seen = shown[:, : self._count] / size[: self._count]
        error = np.linalg.norm(told / size[: self._count] - seen) / max(float(np.linalg.norm(seen)), 1e-300)
        return _of_ports(change, self._count, float(error))

    def _pushed(self, column: int, force: Float64[np.ndarray, " T"]) -> Float64[np.ndarray, "T R"] | None:
        """What a force in a column of the inputs changes; None where the solver gives up."""
        given = self._simulator.inputs[1].copy()
        given[:, column] += force
        try:
            return self._simulator.run((), self.parameters, given) - self._bare
        except FmuError:
            return None


def convolved(h: Float64[np.ndarray, "J S"], force: Float64[np.ndarray, " t"]) -> Float64[np.ndarray, "t J"]:
    """What a force that is held for a step each changes, a row after it begins."""
    found = fftconvolve(force[None], h, axes=1).T
    return np.concatenate([np.zeros((1, len(h))), found[: len(force) - 1]])


def _of_ports(change: Float64[np.ndarray, "R S"], count: int, error: float) -> Pulsed:
    """Of sensors, the first `count` rows of it, and ports."""
    ahead = np.cumsum(np.abs(change[:, ::-1]), axis=1)[:, ::-1]  # of its area, from a row on
    lasts = np.any(ahead > FADED * ahead[:, :1], axis=0)
    fades = not lasts[round((1.0 - LAST_PART) * change.shape[1]) :].any()
    ports = change[count:, : int(np.count_nonzero(lasts))]
    groups = -(-max(ports.shape[1] - NEAR, 0) // TOGETHER)
    whole = np.zeros((len(ports), NEAR + TOGETHER * (groups + 1)))
    whole[:, : ports.shape[1]] = ports
    near = whole[:, : NEAR + TOGETHER - 1]
    far = [
        whole[:, NEAR + phase : NEAR + phase + TOGETHER * groups].reshape(len(ports), groups, TOGETHER).mean(axis=2)
        for phase in range(TOGETHER)
    ]
    return Pulsed(
        np.ascontiguousarray(change[:count]),
        near[:, ::-1].astype(np.float32),
        np.stack(far, axis=1)[:, :, ::-1].astype(np.float32),
        fades,
        error,
    )
