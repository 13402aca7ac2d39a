"""Writes the golden outputs of the models: python tools/make_golden.py -> fmus/<model>/golden.csv

One second from a state that moves, every output of the FMI 2.0 FMU each 20 ms. tests/fmus/test_golden.py holds the FMUs to
them; they change only when a model is meant to change.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from fmucorrect.fmu import FmuStepper, open_fmu
from fmucorrect.records import writer
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import grid, run

FMUS = Path(__file__).resolve().parent.parent / "fmus"
START = {
    "cooperrider": {"wheelset_front.y": 0.002},
    "full_vehicle": {
        "wheelset_1.y": 0.003,
        "curve_radius": 800.0,
        "cant": 0.1,
        "curve_start": 10.0,
        "transition_length": 20.0,
        "curve_length": 20.0,
    },
    "oscillator": {"masses": 3.0, "x1": 0.01},
    "roller_rig": {"platform_start": 0.0},
    "wheelset": {"y": 0.002},
}


def golden(model: str, suffix: str = "") -> Record:
    """The outputs of one model (FMI 3.0 with the suffix "_fmi3") as golden.csv holds them."""
    path = FMUS / model / f"{model}{suffix}.fmu"
    names = [name for name, variable in open_fmu(path).variables.items() if variable.causality == "output"]
    channels = tuple(Channel(name, unit="", simulation=name) for name in names)
    with FmuStepper(path, channels, parameters=START[model]) as stepper:
        result = run(stepper, Condition("golden"), grid(1.0, 1_000_000))
    assert result is not None
    return replace(result, t_ns=result.t_ns[::20], values=np.ascontiguousarray(result.values[::20]))


if __name__ == "__main__":
    for name in START:
        with writer(FMUS / name / "golden.csv") as out:
            out.write("/golden", golden(name))
        print(f"fmus/{name}/golden.csv")
