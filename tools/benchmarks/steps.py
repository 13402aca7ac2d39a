"""The corrector alone: one row a call, and batches."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from benchmark import Row

from fmucorrect import bundle
from fmucorrect.signals import Condition, Record
from fmucorrect.stepper import CorrectedStepper, ReplayStepper

MODEL = Path(__file__).resolve().parent.parent.parent / "exported_models" / "roller_rig" / "corrector.onnx"
CONDITION = Condition("385", speed=385.0, amplitude=0.03, frequency=2.0)


def median_us(call: Callable[[int], object], count: int) -> float:
    """Median time of one call, microseconds."""
    times = np.empty(count)
    for i in range(count):
        begun = time.perf_counter_ns()
        call(i)
        times[i] = time.perf_counter_ns() - begun
    return float(np.median(times)) / 1e3


def measure(quick: bool) -> list[Row]:
    model = bundle.load(MODEL)
    rng = np.random.default_rng(0)
    count = 3000 if quick else 20_000
    rows = rng.normal(size=(count, len(model.channels))) * 0.5
    stepper = CorrectedStepper(ReplayStepper(model.channels), model)
    bound = model.start()
    bound.window.array[:], bound.condition[:] = 0.1, CONDITION.features
    whole, alone = [], []
    for _ in range(3 if quick else 7):  # in turn, so that both see the same machine
        stepper.reset(CONDITION)
        whole.append(median_us(lambda i: stepper.step(i * model.step_ns, rows[i]), count))
        alone.append(median_us(lambda _: bound.step(), count))
    rate, limit = batch_rate(model, quick)
    call, blas = "bound arrays, no copies", "batched replay / BLAS on as many multiply-adds"
    return [
        Row("corrector call, one window, ONNX Runtime from Python", min(alone), "us", 6.0, False, call),
        Row("CorrectedStepper.step, all of it", min(whole), "us", 8.0, False, "checks, window, network, result"),
        Row("batched replay, one core", rate / 1e6, "million samples/s", 2.0, True, "CorrectedStepper.process"),
        Row(blas, 100 * rate / limit, "%", 55.0, True, "numpy, float32, one thread, no tanh"),
    ]


def batch_rate(model: bundle.Bundle, quick: bool) -> tuple[float, float]:
    """Samples/s of process(), and what float32 BLAS would reach on as many multiply-adds, in turn."""
    count = 40_000 if quick else 400_000
    values = np.random.default_rng(1).normal(size=(count, len(model.channels))) * 0.5
    record = Record(np.arange(count, dtype=np.int64) * model.step_ns, values, model.channels)
    stepper = CorrectedStepper(ReplayStepper(model.channels), model)
    (inputs, outputs), *_ = shapes = layers()
    block, weight = np.ones((bundle.CHUNK, inputs), np.float32), np.full((inputs, outputs), 1e-3, np.float32)
    product = np.empty((bundle.CHUNK, outputs), np.float32)
    share = inputs * outputs / sum(a * b for a, b in shapes)  # the largest product runs at BLAS's best rate
    ours, bare = [], []
    for _ in range(5):
        stepper.reset(CONDITION)
        begun = time.perf_counter()
        stepper.process(record)
        ours.append(count / (time.perf_counter() - begun))
        begun = time.perf_counter()
        for _ in range(20):
            np.matmul(block, weight, out=product)
        bare.append(20 * bundle.CHUNK * share / (time.perf_counter() - begun))
    return float(np.median(ours)), float(np.median(bare))


def layers() -> list[tuple[int, int]]:
    """Inputs and outputs of every matrix product of the shipped network."""
    return [(163, 96), (96, 64), (96, 4), (64, 4), (163, 22), (22, 4), (22, 4)]
