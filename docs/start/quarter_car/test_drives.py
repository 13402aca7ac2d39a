"""What the real car's logger wrote: drive_10.csv ... drive_25.csv, 12 s each at 500 Hz.

The real car has what the model lacks: 70 N of friction in the damper. Roads are of ISO 8608, class B.
"""

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

STEP, ROWS, PARTS = 2e-3, 6000, 10  # s; samples; steps of the integration a sample
rng = np.random.default_rng(1)


def road(speed):
    """Height in m, at rest for the first second; nothing shorter than what a tyre feels (20 Hz)."""
    noise = rng.standard_normal(ROWS) / np.sqrt(STEP)
    gain = 2 * np.pi * 0.1 * np.sqrt(64e-6 * speed)
    height = lfilter([STEP * gain], [1, STEP * 2 * np.pi * 0.01 * speed - 1], noise)
    height = sosfilt(butter(2, 20.0, fs=1 / STEP, output="sos"), height)
    return height * np.clip(np.arange(ROWS) * STEP - 1, 0, 1)


def drive(height):
    """Body and travel in m."""
    body = wheel = body_speed = wheel_speed = 0.0
    rows, h = [], STEP / PARTS
    for now, then in zip(height, np.append(height[1:], height[-1]), strict=True):
        rows.append((body, body - wheel))
        for part in range(PARTS):
            under = now + (then - now) * (part + 0.5) / PARTS
            force = 20e3 * (body - wheel) + 1200.0 * (body_speed - wheel_speed)
            force += 70.0 * np.tanh((body_speed - wheel_speed) / 5e-3)
            body_speed -= h * force / 300.0
            wheel_speed += h * (force - 180e3 * (wheel - under)) / 40.0
            body, wheel = body + h * body_speed, wheel + h * wheel_speed
    return np.array(rows)


for speed in (10, 15, 20, 17, 25):
    height = road(speed)
    measured = 1e3 * drive(height) + 0.02 * rng.standard_normal((ROWS, 2))  # mm
    time = np.arange(ROWS) * STEP
    table = np.column_stack([time, 1e3 * height, measured])
    header = "time,road [mm],LVDT body [mm],LVDT travel [mm]"
    np.savetxt(f"drive_{speed}.csv", table, "%.6f", delimiter=",", header=header, comments="")
