"""What a logger would write of a mass on a spring that is pushed and rubs: loud.csv, soft.csv, check.csv."""

import numpy as np

STEP, ROWS, PARTS = 1e-3, 4000, 10  # s; samples; steps of the integration a sample
rng = np.random.default_rng(0)
time = np.arange(ROWS) * STEP

for name, size in (("loud", 20.0), ("soft", 8.0), ("check", 14.0)):
    push = size * np.sin(2 * np.pi * (1.0 + time) * time)  # N, 1 to 9 Hz
    x = v = 0.0
    rows = []
    for force in push:
        rows.append(1e3 * x)
        for _ in range(PARTS):
            friction = 2.0 * np.tanh(v / 1e-4)  # N: what the model lacks
            v += STEP / PARTS * (force - 1000.0 * x - 4.0 * v - friction)
            x += STEP / PARTS * v
    measured = np.array(rows) + 0.01 * rng.standard_normal(ROWS)  # mm
    table = np.column_stack([time, push, measured])
    np.savetxt(f"{name}.csv", table, "%.6f", ",", header="time,mass1.f [N],x [mm]", comments="")
