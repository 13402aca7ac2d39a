"""FMU runs: corrected over bare, on a trivial solver, on one of 100 us a step, and on the rig."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from benchmark import Row
from benchmarks.steps import CONDITION, MODEL

from fmucorrect import bundle
from fmucorrect.fmu import FmuStepper, IsolatedStepper
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, Step, Stepper, grid, run

FMUS = Path(__file__).resolve().parent.parent.parent / "fmus"


class SlowPlant:
    """A plant that keeps the processor busy until `extra` s have passed at every sample, as a larger solver would."""

    def __init__(self, plant: Stepper, extra: float) -> None:
        self._plant, self._extra = plant, extra

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._plant.channels

    def reset(self, condition: Condition) -> None:
        self._plant.reset(condition)

    def step(self, t_ns: int, u: np.ndarray) -> Step:
        until = time.perf_counter() + self._extra
        result = self._plant.step(t_ns, u)
        while time.perf_counter() < until:
            pass
        return result

    def process(self, record: Record) -> Record:
        raise NotImplementedError

    def close(self) -> None:
        self._plant.close()


def rows_per_second(stepper: Stepper, condition: Condition, count: int) -> float:
    """Row by row, as a co-simulation host does it."""
    nothing = np.zeros(0)
    stepper.reset(condition)
    begun = time.perf_counter()
    for i in range(count):
        stepper.step(i * 1_000_000, nothing)
    return count / (time.perf_counter() - begun)


def streamed_per_second(stepper: Stepper, condition: Condition, count: int) -> float:
    """In chunks, as run() does it."""
    begun = time.perf_counter()
    run(stepper, condition, grid((count - 1) / 1e3, 1_000_000), lambda _: None)
    return count / (time.perf_counter() - begun)


def isolated_over_bare(make: Callable[..., Stepper], count: int, pairs: int) -> tuple[float, float]:
    """Time of a run by run(), the solver in a process of its own, over that in this process: the median of pairs taken in
    turn, when the process is there already; and what it took to get there, s."""
    bare, isolated = make(FmuStepper), make(IsolatedStepper)
    bare.reset(CONDITION)
    begun = time.perf_counter()
    isolated.reset(CONDITION)
    start = time.perf_counter() - begun
    ratios: list[float] = []
    for turn in range(pairs):
        rate = {
            s: streamed_per_second(s, CONDITION, count) for s in ((bare, isolated) if turn % 2 else (isolated, bare))
        }
        ratios.append(rate[bare] / rate[isolated])
    bare.close()
    isolated.close()
    return float(np.median(ratios)), start


def measure(quick: bool) -> list[Row]:
    model = bundle.load(MODEL)
    count, repeats = (3000, 3) if quick else (20_000, 7)
    named = tuple(replace(c, unit="mm", simulation=f"mass{i + 1}.x") for i, c in enumerate(model.channels))
    parameters = {"masses": 4.0, "x1": 1e-3}

    def oscillator(kind: Callable[..., Stepper] = FmuStepper) -> Stepper:
        return kind(FMUS / "oscillator" / "oscillator.fmu", named, parameters=parameters)

    def rig() -> FmuStepper:
        return FmuStepper(FMUS / "roller_rig" / "roller_rig.fmu", model.channels, parameters={"speed": 385 / 3.6})

    ratios: dict[str, list[float]] = {"step": [], "stream": [], "slow": [], "rig": [], "real time": [], "bare us": []}
    for _ in range(repeats):
        bare, corrected = oscillator(), CorrectedStepper(oscillator(), model)
        one, two = (rows_per_second(stepper, CONDITION, count) for stepper in (bare, corrected))
        ratios["step"].append(one / two)
        ratios["bare us"].append(1e6 / one)
        ratios["stream"].append(
            streamed_per_second(bare, CONDITION, count) / streamed_per_second(corrected, CONDITION, count)
        )
        slow, slower = SlowPlant(bare, 1e-4), CorrectedStepper(SlowPlant(oscillator(), 1e-4), model)
        ratios["slow"].append(
            rows_per_second(slow, CONDITION, count // 10) / rows_per_second(slower, CONDITION, count // 10)
        )
        plain, better = rig(), CorrectedStepper(rig(), model)
        one, two = (streamed_per_second(stepper, CONDITION, count) for stepper in (plain, better))
        ratios["rig"].append(one / two)
        ratios["real time"].append(two / 1e3)
        for stepper in (bare, corrected, slower, plain, better):
            stepper.close()
    apart, start = isolated_over_bare(oscillator, 20_000, 5 * repeats)
    m = {name: float(np.median(values)) for name, values in ratios.items()}
    trivial = f"oscillator FMU, {m['bare us']:.2f} us a step bare"
    return [
        Row("corrected / bare run, trivial FMU, one call a sample", m["step"], "", 3.6, False, trivial),
        Row("corrected / bare run, trivial FMU, streamed in chunks", m["stream"], "", 3.6, False, "the same by run()"),
        Row(
            "corrected / bare run, 100 us a step",
            m["slow"],
            "",
            1.07,
            False,
            "the same, the solver held busy for 100 us",
        ),
        Row(
            "solver in a process of its own / in this one, trivial FMU, streamed in chunks",
            apart,
            "",
            1.05,
            False,
            f"the same by run(); the process is there after {start:.2f} s",
        ),
        Row("corrected / bare run, roller rig, streamed", m["rig"], "", None, False, "run()"),
        Row("real-time factor of the corrected roller rig", m["real time"], "", None, True, "1 ms a step, streamed"),
    ]
