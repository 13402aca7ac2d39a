"""The full vehicle: how much faster than real time it runs, in processor time of one core."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from benchmark import Row

from fmucorrect.fmu import FmuStepper, open_fmu
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import grid, run

VEHICLE = Path(__file__).resolve().parent.parent.parent / "fmus" / "full_vehicle" / "full_vehicle.fmu"
FEW = ("frame_1.y", "frame_2.y", "car_body.y")
CURVE = {
    "speed": 70.0 / 3.6,
    "curve_radius": 300.0,
    "cant": 0.1,
    "curve_start": 10.0,
    "transition_length": 60.0,
    "curve_length": 1e4,
}


def times_real_time(outputs: tuple[str, ...], parameters: dict[str, float], seconds: float, repeats: int) -> float:
    """Simulated seconds a second of processor time, streamed in steps of 1 ms."""
    condition, found = Condition("run", parameters=parameters), []
    with FmuStepper(VEHICLE, tuple(Channel(name, unit="") for name in outputs)) as stepper:
        for _ in range(repeats):
            begun = time.process_time()
            run(stepper, condition, grid(seconds, 1_000_000), lambda _: None)
            found.append(seconds / (time.process_time() - begun))
    return float(np.median(found))


def measure(quick: bool) -> list[Row]:
    seconds, repeats = (3.0, 3) if quick else (20.0, 7)
    everything = tuple(v.name for v in open_fmu(VEHICLE).variables.values() if v.causality == "output")
    straight = times_real_time(FEW, {"speed": 300.0 / 3.6}, seconds, repeats)
    curved = times_real_time(everything, CURVE, seconds, repeats)
    what = "full vehicle at 1 ms, times real time, one core"
    return [
        Row(what, straight, "", 30.0, True, f"300 km/h, straight, {len(FEW)} outputs, streamed; processor time"),
        Row("the same in a curve of 300 m", curved, "", None, True, f"70 km/h, all {len(everything)} outputs"),
    ]
