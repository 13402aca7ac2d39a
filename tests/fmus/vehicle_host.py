"""The full vehicle on contact tables made here, for laws in closed form; its wheels, bodies and weights by name."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from host import Fmu

WHEELS = [f"{i}{side}" for i in range(1, 5) for side in "lr"]
OUT = np.array([-1.0, 1.0] * 4)
"""+1 for right wheels, whose outside is at the right."""
MASSES = {"car_body": 34299.0, "frame_1": 4343.0, "frame_2": 4343.0} | {f"wheelset_{i}": 1936.0 for i in range(1, 5)}
HEIGHTS = {"car_body": 1.642, "frame_1": 0.566, "frame_2": 0.566} | {f"wheelset_{i}": 0.43 for i in range(1, 5)}
BODIES = tuple(MASSES)
MASS = sum(MASSES.values())
GRAVITY, RADIUS, HALF_BASE, BASE = 9.81, 0.43, 0.75, 1.5
AREA = 5.94e-3 * 4.67e-3
"""m2: a b of the cones' contact ellipse at 60 kN."""
CREEP = {"f11": 9.98e6, "f22": 9.15e6, "f23": 21.3e3}
"""N, N, N m: of one wheel at 60 kN."""
CENTRED = {"car_cg_y": 0.0}
"""Start values of a vehicle whose left and right are alike."""


MODULUS = 8.2e10
"""Pa, the model's shear modulus."""


def cone(conicity: float, creep: dict[str, float] | None = None, reach: float = 0.02) -> dict[str, np.ndarray]:
    """Columns of a table for a conical wheel on a round rail, without a flange; creep: other coefficients than CREEP."""
    step, creep = 1e-4, CREEP | (creep or {})
    y = np.arange(-round(reach / step), round(reach / step) + 1) * step
    one = np.ones_like(y)
    return {
        "y": y,
        "radius": RADIUS + conicity * y,
        "angle": np.arctan(conicity) * one,
        "lift": conicity * y,
        "wheel_y": -y,
        "rail_curvature": one / 0.3,
        "wheel_curvature": 0.0 * y,
        "a": 5.94e-3 * one,
        "b": 4.67e-3 * one,
        "c11": creep["f11"] / MODULUS / AREA * one,
        "c22": creep["f22"] / MODULUS / AREA * one,
        "c23": creep["f23"] / MODULUS / AREA**1.5 * one,
    }


def worn(conicity: float, angle: float = 0.03) -> dict[str, np.ndarray]:
    """Columns of a table for a worn wheel: a small contact angle (rad) when centred, which grows by conicity y / l0, while the
    rolling radius grows as on a cone. A cone that steep would spin so much on its rail that nothing is left for creep."""
    table = cone(conicity)
    y, step = table["y"], table["y"][1] - table["y"][0]
    slope = np.tan(angle) + np.clip(conicity * y / HALF_BASE, -0.02, 0.1)
    lift = np.concatenate([[0.0], np.cumsum(0.5 * step * (slope[1:] + slope[:-1]))])
    return table | {"angle": np.arctan(slope), "lift": lift - np.interp(0.0, y, lift)}


def with_flange(table: dict[str, np.ndarray], clearance: float = 0.006, angle: float = 70.0) -> dict[str, np.ndarray]:
    """The same wheel with a flange of that angle (deg) beyond the clearance (m), reached over 2 mm."""
    y, step = table["y"], table["y"][1] - table["y"][0]
    slope = np.tan(table["angle"]) + np.tan(np.radians(angle)) * np.clip((y - clearance) / 0.002, 0.0, 1.0)
    lift = np.concatenate([[0.0], np.cumsum(0.5 * step * (slope[1:] + slope[:-1]))])
    flange = lift - np.interp(y, table["y"], table["lift"])
    flange -= flange[0]
    return table | {"angle": np.arctan(slope), "lift": table["lift"] + flange, "radius": table["radius"] + flange}


def write(path: Path, table: dict[str, np.ndarray]) -> None:
    rows = np.column_stack(list(table.values()))
    lines = [
        "# made by tests/fmus/vehicle_host.py",
        ",".join(table),
        *(",".join(f"{x:.12g}" for x in row) for row in rows),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def copy_with(
    source: Path,
    place: Path,
    contact: dict[str, np.ndarray] | None = None,
    irregularity: dict[str, np.ndarray] | None = None,
) -> Path:
    """A copy of the extracted FMU with other tables."""
    shutil.copytree(source, place)
    for name, table in (("contact", contact), ("irregularity", irregularity)):
        if table is not None:
            write(place / "resources" / f"{name}.csv", table)
    return place


def wheels(fmu: Fmu, what: str) -> np.ndarray:
    """(8,): 1l, 1r, 2l, ..."""
    return fmu.get(*(f"wheel_{wheel}.{what}" for wheel in WHEELS))


def bodies(fmu: Fmu, what: str) -> np.ndarray:
    """(7,) in the order of BODIES."""
    return fmu.get(*(f"{body}.{what}" for body in BODIES))


def run(fmu: Fmu, seconds: float, names: tuple[str, ...] = (), h: float = 0.001, start: float = 0.0) -> np.ndarray:
    """Values of the names after every step, (steps, names)."""
    rows = []
    for i in range(round(seconds / h)):
        fmu.step(start + i * h, h)
        if names:
            rows.append(fmu.get(*names))
    return np.array(rows)
