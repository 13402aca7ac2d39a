"""A whole study in closed form: simulated and measured records of five speeds, no FMU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fmucorrect.records import writer
from fmucorrect.signals import Channel, Record
from fmucorrect.study_training import Corrector, Pinn, Proposed, Tdnn, TdnnResidual, Training

SMALL = Training(
    window=8,
    decimation=10,
    tdnn=Tdnn(widths=(8,)),
    pinn=Pinn(widths=(16, 16), epochs=60),
    tdnn_residual=TdnnResidual(widths=(16, 16), epochs=60, tdnn_epochs=40),
    proposed=Proposed(widths=(16, 16), head_width=16, epochs=60, tdnn_epochs=40),
    corrector=Corrector(
        families=("window",),
        baseline_width=6,
        baseline_epochs=30,
        history=4,
        widths=(16, 16),
        members=2,
        epochs=(30, 60),
        batch=2048,
        stride=4,
    ),
)
BRIEF = replace(SMALL, corrector=replace(SMALL.corrector, baseline_epochs=6, epochs=(4, 8)))
"""For laws that hold however little was learned."""
HEAD = """format = 1
name = "closed form"

[simulation]
step_size = 0.001

[[channels]]
name = "FW"
simulation = "FW"
measurement = "lvdt_FW"
quantity = "displacement"
unit = "mm"

[[channels]]
name = "FB"
simulation = "FB"
measurement = "lvdt_FB"
quantity = "displacement"
unit = "mm"

[excitation]
simulation = "yaw"
measurement = "yaw"
kind = "command"
"""
SPEEDS = (300, 320, 340, 360, 385)


def _write(path: Path, topic: str, t_ns: np.ndarray, columns: dict[str, tuple[np.ndarray, str]]) -> None:
    channels = tuple(Channel(name, unit=unit) for name, (_, unit) in columns.items())
    with writer(path) as out:
        out.write(topic, Record(t_ns, np.stack([values for values, _ in columns.values()], axis=1), channels))


def make_study(folder: Path, speeds: Sequence[int] = SPEEDS) -> Path:
    """Simulated: two damped tones; measured: another amplitude and phase that depend on speed, with noise. From 385 km/h on
    held out."""
    text = HEAD
    t = np.arange(5001) * 1e-3
    t_ns = np.arange(5001, dtype=np.int64) * 1_000_000
    rng = np.random.default_rng(0)
    for speed in speeds:
        on = (t >= 1.0) & (t < 4.0)
        phase = 2 * np.pi * 2.0 * (t - 1.0)
        yaw = np.where(on, 0.03 * np.sin(phase), 0.0)
        fw, fb = np.where(on, np.sin(phase), 0.0), np.where(on, 0.6 * np.sin(phase - 0.7), 0.0)
        angle = 0.3 + (speed - 300) / 200.0
        real_fw, real_fb = (
            np.where(on, 1.4 * np.sin(phase - angle), 0.0),
            np.where(on, 0.9 * np.sin(phase - 2 * angle), 0.0),
        )
        noise = 0.01 * rng.normal(size=(2, len(t)))
        simulated = {"FW": (fw, "mm"), "FB": (fb, "mm"), "yaw": (yaw, "deg")}
        measured = {"lvdt_FW": (real_fw + noise[0], "mm"), "lvdt_FB": (real_fb + noise[1], "mm"), "yaw": (yaw, "deg")}
        _write(folder / f"simulated_{speed}.mcap", "/simulation", t_ns, simulated)
        _write(folder / f"measured_{speed}.mcap", "/measured", t_ns, measured)
        role = "evaluation" if speed >= 385 else "development"
        text += (
            f'\n[[conditions]]\nname = "{speed}"\nrole = "{role}"\nspeed = {speed}.0\namplitude = 0.03\nfrequency = 2.0\n'
            f'start = 1.0\nmeasurement = "measured_{speed}.mcap"\nsimulated = "simulated_{speed}.mcap"\n'
        )
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"
