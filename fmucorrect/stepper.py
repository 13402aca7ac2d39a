"""Window, Stepper, CorrectedStepper and run(): the one loop that everything streams through.

Online co-simulation, batch and replay differ only in the plant (an FMU, a log) and in how many rows come at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from enum import IntEnum
from types import MappingProxyType
from typing import NamedTuple, Protocol, final, runtime_checkable

import numpy as np
from jaxtyping import Float32, Float64

from fmucorrect.brief import brief_of
from fmucorrect.errors import FmucorrectError, SignalError, require_opened
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Record, join

Row = Float64[np.ndarray, " J"]
"""One value a channel, in the channels' units."""


class Status(IntEnum):
    """What a corrected value is worth. WARMUP: the window is not full, the simulation passes through.
    OUTSIDE: the training envelope is being left or has been left, the correction fades: under another declared condition to
    nothing, where the motion alone is new perhaps to a linear filter."""

    OK = 0
    WARMUP = 1
    OUTSIDE = 2


_OK, _OUTSIDE = Status.OK, Status.OUTSIDE  # looking a member up costs more than making a Step


class Step(NamedTuple):
    """One sample. simulated, corrected and sigma: (J,) float64 in the channels' units; sigma is one standard deviation."""

    t_ns: int
    simulated: Row
    corrected: Row
    sigma: Row
    status: Status


@runtime_checkable
class Stepper(Protocol):
    """Anything that turns inputs into responses, sample by sample.

    Call order: reset(condition); then step or process, freely mixed, with increasing time; reset again for another run;
    close() at last. After any exception the stepper must be reset or closed. `channels` are the responses, in order.
    """

    @property
    def channels(self) -> tuple[Channel, ...]: ...

    def reset(self, condition: Condition) -> None:
        """Start anew. Everything that an earlier run left behind is gone."""
        ...

    def step(self, t_ns: int, u: Row) -> Step:
        """Advance to `t_ns`, then apply the inputs `u` that hold from there on."""
        ...

    def process(self, record: Record) -> Record:
        """The same as step() row by row. The responses are the first columns of what comes back. An error after some of the
        rows carries what came of them as `finished`."""
        ...

    def close(self) -> None:
        """Release everything. May be called twice."""
        ...


class Correction(NamedTuple):
    """What a corrector says of N windows: delta (N, J), to be added to the simulation, and sigma (N, J), in the channels'
    units; inside (N,) in [0, 1], the share of the correction that the training envelope admits (already in delta)."""

    delta: Float32[np.ndarray, "N J"]
    sigma: Float32[np.ndarray, "N J"]
    inside: Float32[np.ndarray, " N"]


@runtime_checkable
class CorrectorRun(Protocol):
    """A corrector at work on one run of samples, with all that it remembers of them.

    step() reads window, condition (1, 3) and seconds (1, 1) since the excitation began, and overwrites answer, of one row, and
    state (S,), S = 0 where the window is all that it needs.
    """

    @property
    def window(self) -> Window: ...
    @property
    def condition(self) -> Float32[np.ndarray, "1 3"]: ...
    @property
    def seconds(self) -> Float64[np.ndarray, "1 1"]: ...
    @property
    def answer(self) -> Correction: ...
    @property
    def state(self) -> Float32[np.ndarray, " S"]: ...

    def reset(self) -> None:
        """Forget every sample: the window is empty, the state zero."""
        ...

    def step(self) -> bool:
        """Correct the window as it stands, which is full, and move the state on. False where answer or state is not finite."""
        ...

    def correct(
        self,
        windows: Float32[np.ndarray, "N W V"],
        condition: Float32[np.ndarray, " 3"],
        seconds: Float64[np.ndarray, " N"],
    ) -> Correction:
        """The same for N windows in turn. Ends before the first for which step() would say False; answer and state are what it
        would leave."""
        ...


@runtime_checkable
class Corrector(Protocol):
    """What CorrectedStepper asks of a corrector; `bundle.Bundle` is the one that ships. Any number of runs share it.

    channels: J channels with their units. sees: what else it sees; the channels and these are the V columns of its window.
    held: names of these that are seen as they were held until a row's time, see as_held. rows: W. step_ns: sample
    time. uncorrected: (J,) standard deviation of the uncorrected simulation against measurement, said while there is no
    correction.
    """

    @property
    def channels(self) -> tuple[Channel, ...]: ...
    @property
    def sees(self) -> tuple[Channel, ...]: ...
    @property
    def held(self) -> tuple[str, ...]: ...
    @property
    def rows(self) -> int: ...
    @property
    def step_ns(self) -> int: ...
    @property
    def uncorrected(self) -> Float32[np.ndarray, " J"]: ...

    def start(self) -> CorrectorRun:
        """A run of its own."""
        ...

    def unlike(self, given: Mapping[str, float], defaults: Mapping[str, float]) -> Sequence[str]:
        """Which start values of the model are others than it was made for, in words. given: those that are set. defaults: those
        that hold otherwise, as far as they are known."""
        ...


@runtime_checkable
class Streaming(Protocol):
    """A Stepper that may work ahead: stream() gives what process() would give for each record, in turn."""

    def stream(self, records: Iterable[Record]) -> Generator[Record]: ...


@runtime_checkable
class Started(Protocol):
    """A Stepper that knows its model's start values."""

    def starts(self, condition: Condition) -> tuple[Mapping[str, float], Mapping[str, float]]:
        """Those that are set in this condition, and those that hold otherwise, in the model's own units."""
        ...


def unlike(plant: Stepper, corrector: Corrector, condition: Condition) -> str:
    """Why `corrector` is withheld from the plant in this condition, in words; "" where it is not. Nothing in the motion need
    show that a model is another than in training: with another damper it moves much alike, and lacks another thing."""
    given, defaults = plant.starts(condition) if isinstance(plant, Started) else (condition.parameters, {})
    return "; ".join(corrector.unlike(given, defaults))


BROKEN_OFF = (FmucorrectError, KeyboardInterrupt)
"""What ends a process() that had finished some rows."""


def finished_rows(error: BaseException) -> Record | None:
    """The rows that had been computed when the error came."""
    return getattr(error, "finished", None)


def keep_finished(error: BaseException, rows: Record) -> None:
    """Have the error carry rows that had been computed when it came."""
    vars(error)["finished"] = rows


def streamed(stepper: Stepper, records: Iterable[Record]) -> Generator[Record]:
    """Results of `records` one by one; close it when not all are taken."""
    if isinstance(stepper, Streaming):
        yield from stepper.stream(records)
    else:
        for record in records:
            yield stepper.process(record)


@final
class Window:
    """The last W rows of what a corrector sees of the simulation, (W, V) float32, oldest first; full, or warming up.

    This is the one definition of a window: push() for a row, extend() for many. `array` is (1, W, V) and stays where it
    is in memory, so that a corrector can be bound to it.
    """

    def __init__(self, rows: int, columns: int) -> None:
        self.array: Float32[np.ndarray, "1 W V"] = np.zeros((1, rows, columns), np.float32)
        self._rows = rows
        self._seen = 0
        self._last = self.array[0, -1]
        # moving up by one row as plain memory takes a third of the time of an overlapping assignment in numpy
        self._memory = self.array.data.cast("B")
        row = self.array.strides[1]
        self._kept, self._moved = slice(0, (rows - 1) * row), slice(row, rows * row)

    def __repr__(self) -> str:
        return brief_of(self, "array", "full")

    def clear(self) -> None:
        """Forget everything."""
        self.array[:] = 0.0
        self._seen = 0

    @property
    def full(self) -> bool:
        """Whether W rows have been seen."""
        return self._seen >= self._rows

    def push(self, row: Row) -> bool:
        """Append one row in place; True when the window is full."""
        self._memory[self._kept] = self._memory[self._moved]
        self._last[:] = row
        self._seen += 1
        return self._seen >= self._rows

    def extend(self, values: Float64[np.ndarray, "T V"]) -> Float32[np.ndarray, "N W V"]:
        """Append T rows. Returns the N <= T windows that end in the last N of these rows (a read-only view)."""
        known = min(self._seen, self._rows - 1)
        history = np.concatenate([self.array[0, self._rows - known :], values.astype(np.float32)])
        self._seen += len(values)
        kept = history[-self._rows :]
        self.array[0, self._rows - len(kept) :] = kept
        count = max(len(history) - self._rows + 1, 0)
        row, column = history.strides
        shape = (count, self._rows, history.shape[1])
        return np.lib.stride_tricks.as_strided(history, shape, (row, row, column), writeable=False)


def as_held(
    rows: Float64[np.ndarray, "T V"], columns: Sequence[int], before: Float64[np.ndarray, " V"] | None = None
) -> Float64[np.ndarray, "T V"]:
    """Rows as a corrector sees them that knows what inputs held: these columns a row later. before: the row before the first;
    None where a run begins, with inputs that have been as they are.

    What a solver shows at a time follows from what its inputs held until then. A host says what they hold from then on when it
    has read that, or as it steps on; whoever looks at that, too, would have to wait for it.
    """
    shifted = rows.copy()
    shifted[1:, columns] = rows[:-1, columns]
    if before is not None:
        shifted[:1, columns] = before[columns]
    return shifted


@final
class ReplayStepper:
    """A plant that only repeats what a log holds: the input row is the simulated response itself, in the channels' units;
    a channel of unit "" takes the log's. defaults: start values of the model that was logged, where no condition says them."""

    def __init__(self, channels: tuple[Channel, ...], defaults: Mapping[str, float] = MappingProxyType({})) -> None:
        self._channels, self._defaults = channels, defaults
        self._nothing = np.zeros(len(channels))

    def __repr__(self) -> str:
        return brief_of(self, "channels")

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._channels

    def reset(self, condition: Condition) -> None:
        pass

    def starts(self, condition: Condition) -> tuple[Mapping[str, float], Mapping[str, float]]:
        """Start values of the model that was logged, in its own units: those of this condition, and its defaults."""
        return condition.parameters, self._defaults

    def step(self, t_ns: int, u: Row) -> Step:
        if len(u) != len(self._nothing):
            raise SignalError(
                f"a row at t = {t_ns / NANOSECONDS:.9g} s has not the log's columns",
                expected=len(self._nothing),
                got=len(u),
            )
        return Step(t_ns, u, u, self._nothing, Status.OK)

    def process(self, record: Record) -> Record:
        pairs = zip(self._channels, record.channels, strict=True)
        channels = tuple(mine if mine.unit else replace(mine, unit=logged.unit) for mine, logged in pairs)
        return replace(record, channels=channels)

    def close(self) -> None:
        pass


@final
class CorrectedStepper:
    """A plant and a corrector as one Stepper. withheld: since the last reset(), why nothing is corrected and all is OUTSIDE:
    start values of the model that the corrector was not made for; "" where it corrects.

    Raises SignalError where the plant lacks what the corrector sees or has it in another unit, where samples do not
    come at the corrector's sample time, and where what it sees is NaN or Inf (naming channel and time).
    """

    def __init__(self, plant: Stepper, corrector: Corrector) -> None:
        require_opened("a Bundle", corrector, "fc.load_bundle(path)")
        self._plant, self._corrector, self._step_ns = plant, corrector, corrector.step_ns
        self._seen = (*corrector.channels, *corrector.sees)
        self._columns = _match(plant.channels, self._seen)
        self._same = self._columns == list(range(len(plant.channels)))
        self._count, self._more = len(corrector.channels), len(corrector.sees) > 0
        self._held = [j for j, channel in enumerate(self._seen) if channel.name in corrector.held]
        self._before: Row | None = None  # the row before, of all columns that are seen
        self._run = run = corrector.start()
        self._window, self._seconds, self._correct = run.window, run.seconds, run.step
        self._delta, self._sigma, self._inside = run.answer.delta[0], run.answer.sigma[0], run.answer.inside
        self._uncorrected = corrector.uncorrected.astype(np.float64)
        self._start_ns = 0
        self._last_ns: int | None = None
        self.withheld = ""

    def __repr__(self) -> str:
        return brief_of(self, "_plant", "_corrector")

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._corrector.channels

    def reset(self, condition: Condition) -> None:
        self._plant.reset(condition)
        self._run.reset()
        self._run.condition[0] = condition.features
        self._start_ns = condition.start_ns
        self._last_ns = None
        self._before = None
        self.withheld = unlike(self._plant, self._corrector, condition)

    def step(self, t_ns: int, u: Row) -> Step:
        seen = simulated = self._plant.step(t_ns, u).simulated
        if not self._same:
            seen = simulated = simulated[self._columns]
        if self._last_ns is not None and t_ns - self._last_ns != self._step_ns:
            raise self._wrong_step(t_ns - self._last_ns, t_ns)
        if not math.isfinite(sum(seen.tolist())):
            raise self._not_finite(seen[None], np.array([t_ns]))
        self._last_ns = t_ns
        if self._more:
            simulated = seen[: self._count]
        if self._held:
            seen = self._hold(seen[None])[0]
        if not self._window.push(seen):
            return Step(t_ns, simulated, simulated, self._uncorrected, Status.WARMUP)
        if self.withheld:
            return Step(t_ns, simulated, simulated, self._uncorrected, Status.OUTSIDE)
        self._seconds[0, 0] = (t_ns - self._start_ns) / NANOSECONDS
        if not self._correct():
            raise self._not_corrected(t_ns)
        status = _OK if self._inside[0] >= 1.0 else _OUTSIDE
        return Step(t_ns, simulated, simulated + self._delta, self._sigma.astype(np.float64), status)

    def process(self, record: Record) -> Record:
        """Columns that come back: those of the plant, then `<name>_corrected`, `<name>_sigma` and `corrector_status`."""
        with closing(self.stream([record])) as results:
            return next(results)

    def stream(self, records: Iterable[Record]) -> Generator[Record]:
        """process() of each; the plant may work ahead."""
        with closing(streamed(self._plant, records)) as results:
            while True:
                try:
                    plant = next(results)
                except StopIteration:
                    return
                except BROKEN_OFF as error:
                    rows = finished_rows(error)
                    if rows is not None and len(rows):
                        keep_finished(error, self._corrected(rows))
                    raise
                yield self._corrected(plant)

    def _corrected(self, plant: Record) -> Record:
        """The plant's rows with their correction. An error at one of them carries those before it, corrected."""
        seen = plant.values if self._same else plant.values[:, self._columns]
        if wrong := self._wrong(plant.t_ns, seen):
            row, error = wrong
            error.finished = self._corrected(plant.rows(0, row)) if row else None
            raise error
        self._last_ns = int(plant.t_ns[-1])
        windows = self._window.extend(self._hold(seen) if self._held else seen)
        start = len(plant) - len(windows)
        corrected, sigma = seen[:, : self._count].copy(), np.tile(self._uncorrected, (len(plant), 1))
        status = np.full(len(plant), float(Status.WARMUP))
        done = len(plant) if self.withheld else start
        if self.withheld:
            status[start:] = float(Status.OUTSIDE)
        elif len(windows):
            seconds = (plant.t_ns[start:] - self._start_ns) / NANOSECONDS
            delta, spread, inside = self._run.correct(windows, self._run.condition[0], seconds)
            done += len(delta)
            corrected[start:done] += delta
            sigma[start:done] = spread
            status[start:done] = np.where(inside >= 1.0, float(Status.OK), float(Status.OUTSIDE))
        result = replace(
            plant,
            values=np.concatenate([plant.values, corrected, sigma, status[:, None]], axis=1),
            channels=(*plant.channels, *corrected_channels(self.channels)),
        )
        if done < len(plant):
            error = self._not_corrected(int(plant.t_ns[done]))
            error.finished = result.rows(0, done) if done else None
            raise error
        return result

    def close(self) -> None:
        self._plant.close()

    def _hold(self, rows: Float64[np.ndarray, "T V"]) -> Float64[np.ndarray, "T V"]:
        """The rows as they are seen, after those that were."""
        known, self._before = as_held(rows, self._held, self._before), rows[-1].copy()
        return known

    def _wrong(self, t_ns: np.ndarray, seen: np.ndarray) -> tuple[int, SignalError] | None:
        """The first row that cannot be corrected, and why."""
        steps = np.diff(t_ns, prepend=t_ns[0] - self._step_ns if self._last_ns is None else self._last_ns)
        late, broken = np.flatnonzero(steps != self._step_ns), np.flatnonzero(~np.isfinite(seen).all(axis=1))
        if len(broken) and (not len(late) or broken[0] <= late[0]):
            return int(broken[0]), self._not_finite(seen, t_ns)
        if len(late):
            return int(late[0]), self._wrong_step(int(steps[late[0]]), int(t_ns[late[0]]))
        return None

    def _not_finite(self, seen: np.ndarray, t_ns: np.ndarray) -> SignalError:
        row, column = np.argwhere(~np.isfinite(seen))[0]
        return SignalError(
            f"channel {self._seen[column].name!r} is {seen[row, column]} at t = {t_ns[row] / NANOSECONDS:.16g} s",
            expected="finite numbers",
            remedy="Look at the simulation there; a corrector is never fed what the solver could not compute.",
        )

    def _not_corrected(self, t_ns: int) -> SignalError:
        """What the run that has just failed says."""
        answer, state = self._run.answer, self._run.state
        said = {f"the correction of channel {c.name!r}": v for c, v in zip(self.channels, answer.delta[0], strict=True)}
        said |= {f"the sigma of channel {c.name!r}": v for c, v in zip(self.channels, answer.sigma[0], strict=True)}
        said |= {"the share that the envelope admits": answer.inside[0]}
        said |= {f"number {i} of the corrector's state": v for i, v in enumerate(state)}
        what = next(name for name, value in said.items() if not math.isfinite(value))
        return SignalError(
            f"{what} is {said[what]} at t = {t_ns / NANOSECONDS:.16g} s",
            expected="finite numbers",
            remedy="Look at the simulation up to there; the network cannot compute with it, or its state grows.",
        )

    def _wrong_step(self, got: int, t_ns: int) -> SignalError:
        return SignalError(
            f"the step to t = {t_ns / NANOSECONDS:.16g} s does not fit the corrector's sample time",
            expected=f"{self._step_ns / NANOSECONDS:.9g} s",
            got=f"{got / NANOSECONDS:.9g} s",
            remedy="Step the simulation at the corrector's sample time. Of a log that is a whole number of times as fast, "
            "replay takes every n-th row, and its repair rule 'resample' puts one that jitters on the corrector's sample time; "
            "one of another rate has to be resampled to it beforehand." + _counted_in(got / self._step_ns),
        )


def _counted_in(ratio: float) -> str:
    """What a step so many times too long speaks of, where that is what a unit of time makes."""
    unit = next((unit for unit, per in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)) if abs(ratio / per - 1.0) < 0.01), "")
    return f" It is so many times too long as a time in {unit} taken for s: --time-unit {unit}." if unit else ""


def corrected_channels(channels: tuple[Channel, ...]) -> tuple[Channel, ...]:
    """The channels that correction adds: `<name>_corrected`, `<name>_sigma` for each, and `corrector_status`."""
    return (
        *(replace(channel, name=f"{channel.name}_corrected") for channel in channels),
        *(replace(channel, name=f"{channel.name}_sigma") for channel in channels),
        Channel("corrector_status", quantity="status"),
    )


def corrections(channels: Sequence[Channel]) -> int:
    """How many channels a corrector has added to these, by corrected_channels; 0 where there was none."""
    if not channels or channels[-1].quantity != "status":
        return 0
    names = [channel.name for channel in channels]
    return next(i for i in range(len(names)) if not names[-2 - i].endswith("_sigma"))


def _match(plant: tuple[Channel, ...], wanted: tuple[Channel, ...]) -> list[int]:
    names = [channel.name for channel in plant]
    missing = [channel.name for channel in wanted if channel.name not in names]
    if missing:
        raise SignalError(f"the simulation lacks {', '.join(missing)}", expected=[c.name for c in wanted], got=names)
    columns = [names.index(channel.name) for channel in wanted]
    for column, channel in zip(columns, wanted, strict=True):
        if plant[column].unit != channel.unit:
            raise SignalError(
                f"channel {channel.name!r} has another unit than the corrector",
                expected=channel.unit,
                got=plant[column].unit,
            )
    return columns


def run(
    stepper: Stepper,
    condition: Condition,
    inputs: Iterable[Record],
    sink: Callable[[Record], object] | None = None,
) -> Record | None:
    """Reset `stepper` to `condition` and stream `inputs`, chunk by chunk, through it.

    Each result goes to `sink` as soon as it is there, and nothing is kept; without a sink the whole result is returned.
    Raises what the stepper raises; what was given to the sink before stays valid.
    """
    require_opened("a Condition", condition, "study.condition(name)")
    kept: list[Record] = []
    accept = sink or kept.append
    stepper.reset(condition)
    with closing(streamed(stepper, inputs)) as results:
        for result in results:
            accept(result)
    return None if sink else join(kept)


def grid(duration: float, step_ns: int, rows: int = 4096, origin_ns: int = 0) -> Iterable[Record]:
    """Records without columns at every step from `origin_ns` over `duration` seconds, both ends included: the inputs of a
    plant that has none."""
    count = round(duration * NANOSECONDS / step_ns) + 1
    for start in range(0, count, rows):
        t_ns = origin_ns + np.arange(start, min(start + rows, count), dtype=np.int64) * step_ns
        yield Record(t_ns, np.zeros((len(t_ns), 0)), ())
