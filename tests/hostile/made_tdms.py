"""TDMS files that are well formed and mean harm."""

# ruff: noqa: E501 (tables of hostile values read best in rows)
from __future__ import annotations

import io
import random

import numpy as np
from made import Made
from seeds import NAMES, ROWS, T_NS, VALUES


def tdms(rng: random.Random) -> Made:
    import nptdms

    kind, out = rng.randrange(8), io.BytesIO()
    time = T_NS / 1e9

    def channel(name: str = "FW", data: object = VALUES[:, 0], **properties: object):
        return nptdms.ChannelObject("simulation", name, data, {"unit_string": "mm", **properties})

    objects = [channel("time", time), *(channel(name, VALUES[:, i]) for i, name in enumerate(NAMES))]
    if kind == 0:
        objects = [
            channel(
                name,
                wf_increment=rng.choice((0.0, -1e-3, float("nan"), 1e300, 1e-12, "abc")),
                wf_start_offset=rng.choice((0.0, 1e300, float("nan"))),
            )
            for name in NAMES
        ]
    elif kind == 1:
        objects[1] = channel(data=np.array(["a"] * ROWS) if rng.random() < 0.5 else np.array([1 + 2j] * ROWS))
    elif kind == 2:
        objects[1] = channel(NI_Scaling_Status="unscaled", NI_Number_Of_Scales=rng.choice((1, 2, 2**31 - 1)), **{"NI_Scale[0]_Scale_Type": rng.choice(("Polynomial", "Linear", "Add", "Thermocouple", "x")), "NI_Scale[0]_Linear_Slope": float("nan"), "NI_Scale[0]_Linear_Y_Intercept": 0.0, "NI_Scale[0]_Linear_Input_Source": rng.choice((0, 0xFFFFFFFF, 5))})  # fmt: skip
    elif kind == 3:
        objects += [nptdms.ChannelObject(f"g{i}", "x", np.arange(3.0)) for i in range(rng.choice((50, 2000)))]
    elif kind == 4:
        objects = [
            nptdms.ChannelObject(
                rng.choice(("", "a'b", "\x1b[31m", "x" * 5000)), rng.choice(("", "FW", "'", "/")), VALUES[:, 0]
            )
        ]
    elif kind == 5:
        stamps = time.copy()
        stamps[rng.randrange(ROWS)] = rng.choice((np.nan, np.inf, 1e300, -5.0))
        objects[0] = channel("time", stamps)
    elif kind == 6:
        objects[1] = channel(data=VALUES[: rng.randrange(ROWS), 0])
    else:
        objects[1:] = [channel(name, VALUES[:, 0].astype(rng.choice(("i1", "u2", "i8", "f4")))) for name in NAMES]
    with nptdms.TdmsWriter(out) as file:
        file.write_segment(objects)
    return ".tdms", out.getvalue(), f"TDMS: kind {kind}"
