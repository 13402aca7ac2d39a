"""MDF files that are well formed and mean harm."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path

import numpy as np
from made import Made
from seeds import NAMES, ROWS, T_NS, VALUES


def mf4(rng: random.Random) -> Made:
    import asammdf

    kind, time = rng.randrange(9), T_NS / 1e9
    values = VALUES[:, 0].copy()
    version = rng.choice(("4.00", "4.10", "4.11", "4.20"))

    def signal(name: str = "FW", samples: object = values, stamps: np.ndarray = time, **more: object):
        return asammdf.Signal(samples, stamps, unit="mm", name=name, **more)

    with tempfile.TemporaryDirectory() as folder, asammdf.MDF(version=version) as file:
        signals = [signal(name) for name in NAMES[:4]]
        if kind == 0:  # a formula is text that an interpreter would run
            formula = rng.choice(
                (
                    "__import__('os').system('touch evil')",
                    "X1*2",
                    "X1**X1**X1**99",
                    "X1/0",
                    "(" * 2000 + "X1" + ")" * 2000,
                    'exec(\'open("evil","w")\')',
                    "",
                    "X2",
                    "9**9**9**9",
                )
            )
            signals[0] = signal(conversion={"formula": formula})
            what = f"formula {formula[:40]!r}"
        elif kind == 1:
            signals[0] = signal(
                conversion=rng.choice(
                    (
                        {"a": float("nan"), "b": 1.0},
                        {"a": 0.0, "b": 0.0},
                        {"a": 1e308, "b": 1e308},
                        {"P1": 0, "P2": 0, "P3": 0, "P4": 0, "P5": 0, "P6": 0},
                    )
                )
            )
            what = "factors that are none"
        elif kind == 2:
            stamps = time.copy()
            stamps[rng.randrange(ROWS)] = rng.choice((np.nan, np.inf, 1e300, -1.0))
            signals = [signal(name, stamps=stamps) for name in NAMES[:4]]
            what = "odd stamps"
        elif kind == 3:
            signals = [
                signal(name, values.astype(rng.choice(("i1", "u1", "i2", "u8", "f4", "i8")))) for name in NAMES[:4]
            ]
            what = "integers"
        elif kind == 4:
            signals[0] = (
                signal(samples=np.array([b"text"] * ROWS), encoding="utf-8")
                if rng.random() < 0.5
                else signal(samples=np.zeros((ROWS, 3)))
            )
            what = "text or arrays"
        elif kind == 5:
            signals = [
                signal(rng.choice(("FW", "\0", "x" * 5000, "\x1b[31m", "a.b", "time", "FW\\a"))) for _ in range(4)
            ]
            what = "odd names"
        elif kind == 6:
            for i in range(rng.choice((20, 200))):
                file.append([signal(f"c{i}")])
            what = "many groups"
        elif kind == 7:
            signals[0] = signal(invalidation_bits=np.arange(ROWS) % 7 == 0)
            what = "invalid samples"
        else:
            file.append([signal("slow", values[::10], time[::10])])
            what = "another rate"
        file.append(signals, common_timebase=True)
        path = Path(folder) / "a.mf4"
        file.save(path, overwrite=True, compression=rng.choice((0, 0, 1, 2)))
        return ".mf4", path.read_bytes(), f"MDF {version}: {what}"
