"""Closed-form plants and correctors, so that most tests need neither an FMU nor a trained network."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import Correction, Status, Step, Window

CHANNELS = (Channel("FW", unit="mm", quantity="displacement"), Channel("FB", unit="mm", quantity="displacement"))
STEP_NS = 1_000_000


def response(t_ns: np.ndarray, condition: Condition) -> np.ndarray:
    """(T, 2) mm: two sines of the condition's frequency, amplitude growing with speed."""
    phase = 2.0 * np.pi * condition.frequency * (t_ns - condition.start_ns) * 1e-9
    return condition.speed / 100.0 * np.stack([np.sin(phase), 0.5 * np.cos(phase)], axis=1)


class SinePlant:
    """A Stepper whose response is known in closed form; it has no inputs. `broken` makes one sample NaN."""

    def __init__(self, broken_ns: int | None = None) -> None:
        self._condition = Condition("none")
        self._broken = broken_ns
        self.closed = 0

    @property
    def channels(self) -> tuple[Channel, ...]:
        return CHANNELS

    def reset(self, condition: Condition) -> None:
        self._condition = condition

    def _values(self, t_ns: np.ndarray) -> np.ndarray:
        values = response(t_ns, self._condition)
        values[t_ns == self._broken, 1] = np.nan
        return values

    def step(self, t_ns: int, u: np.ndarray) -> Step:
        values = self._values(np.array([t_ns]))[0]
        return Step(t_ns, values, values, np.zeros(2), Status.OK)

    def process(self, record: Record) -> Record:
        return Record(record.t_ns, self._values(record.t_ns), CHANNELS)

    def close(self) -> None:
        self.closed += 1


class LinearCorrector:
    """A Corrector whose every number is known: delta = weights . window, summed in float32 row by row, so that one row and
    many rows give the same bits. Beyond `limit` km/h nothing is admitted."""

    def __init__(self, rows: int = 5, scale: float = 0.1, limit: float = 1e9, step_ns: int = STEP_NS) -> None:
        self.rows, self.step_ns, self.channels = rows, step_ns, CHANNELS
        self.uncorrected = np.array([0.3, 0.4], np.float32)
        self.sees, self.held = (), ()
        self._weights = (scale * np.linspace(-1.0, 1.0, rows)).astype(np.float32)
        self._limit = limit

    def correct(self, windows: np.ndarray, condition: np.ndarray, seconds: np.ndarray) -> Correction:
        inside = np.full(len(windows), float(condition[0] <= self._limit), np.float32)
        delta = np.zeros((len(windows), 2), np.float32)
        for row, weight in enumerate(self._weights):
            delta += weight * windows[:, row]
        return Correction(delta * inside[:, None], np.full_like(delta, 0.1), inside)

    def unlike(self, given: dict[str, float], defaults: dict[str, float]) -> list[str]:
        return []

    def start(self) -> ClosedRun:
        return ClosedRun(self, Window(self.rows, len(self.channels)))


@dataclass
class ClosedRun:
    """A CorrectorRun of a corrector that needs no state."""

    corrector: LinearCorrector
    window: Window

    def __post_init__(self) -> None:
        self.condition, self.seconds = np.zeros((1, 3), np.float32), np.zeros((1, 1))
        self.state = np.zeros(0, np.float32)
        self.answer = self.corrector.correct(self.window.array, self.condition[0], self.seconds[0])

    def reset(self) -> None:
        self.window.clear()

    def step(self) -> bool:
        for old, new in zip(
            self.answer,
            self.corrector.correct(self.window.array, self.condition[0], self.seconds[0]),
            strict=True,
        ):
            old[:] = new
        return True

    def correct(self, windows: np.ndarray, condition: np.ndarray, seconds: np.ndarray) -> Correction:
        return self.corrector.correct(windows, condition, seconds)
