"""The contact table of one wheel on one rail that the full vehicle reads: made from two profiles, and written.

Rigid contact jumps from place to place; elastic contact passes over, and where two places are nearly as high both carry.
The table follows the quasi-elastic contact of Arnold and Netter (1998): the lift is the soft maximum of the gap function,
e ln(integral of exp((R(s) - W(s - y)) / e) ds), every other column a mean with these weights. It keeps
d lift / d y = tan(angle), so that a model built on the table neither makes nor loses energy, and a mean over a patch of
lateral curvature k has the variance e/k. A last smoothing over a stated width in y, which keeps that law too, lets a finite
step show the passage to the flange.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fmucorrect import outputs
from fmucorrect.brief import brief
from fmucorrect.errors import RecordError, SignalError
from fmucorrect.railway.contact.geometry import WheelOnRail
from fmucorrect.railway.contact.kalker import hertz_ellipse, kalker_coefficients

Column = Float64[np.ndarray, " Y"]

LOAD = 60e3
"""N, the normal force that a and b belong to; they grow with its cube root."""

_FINER = 10  # places of the last smoothing in one step of the table


@dataclass(frozen=True)
class Smoothing:
    """How a table is kept continuous; m.

    softness: e of the soft maximum, the difference of height over which the share of the load falls to 1/2.7. 15 um gives a
    cone on a rail of 300 mm nearly the variance b^2/5 of Hertz's pressure under 60 kN. width: full width in y of the
    last smoothing (a raised cosine), 0 for none.
    """

    softness: float = 15e-6
    width: float = 0.4e-3


@dataclass(frozen=True)
class ContactTable:
    """Columns of one length over a uniform grid of y, SI units, signs as in geometry.Contact.

    y: lateral displacement of the wheel relative to the rail, towards the flange. radius: rolling radius. angle: contact
    angle. lift: of the wheel's centre. wheel_y: contact point across the wheel. rail_curvature, wheel_curvature: transverse,
    1/m, convex positive, means over the contact patch. a, b: semi-axes of Hertz's ellipse along and across the rail under
    60 kN. c11, c22, c23: Kalker's coefficients for that ellipse.
    """

    y: Column
    radius: Column
    angle: Column
    lift: Column
    wheel_y: Column
    rail_curvature: Column
    wheel_curvature: Column
    a: Column
    b: Column
    c11: Column
    c22: Column
    c23: Column

    __repr__ = brief


COLUMNS = tuple(field.name for field in fields(ContactTable))


def make_contact_table(pair: WheelOnRail, y: Column, smoothing: Smoothing) -> ContactTable:
    """The table over a rising uniform grid y (m) that holds 0. Raises SignalError for another grid, a softness or a width
    out of range, and as WheelOnRail.contact does."""
    steps = np.diff(y)
    if not (len(y) > 2 and y[0] <= 0.0 <= y[-1] and (np.abs(steps - steps.mean()) < 1e-6 * steps.mean()).all()):
        raise SignalError("a contact table needs a rising uniform grid that holds y = 0", got=f"{len(y)} displacements")
    if not (1e-6 <= smoothing.softness <= 1e-4 and 0.0 <= smoothing.width <= 5e-3):
        raise SignalError(
            "a smoothing out of range",
            expected="a softness of 0.001 to 0.1 mm and a width of 0 to 5 mm",
            got=f"{smoothing.softness * 1e3:g} mm and {smoothing.width * 1e3:g} mm",
        )
    step = float(steps.mean())
    half = int(np.ceil(smoothing.width / step * _FINER / 2.0))
    fine = y[0] + np.arange(-half, (len(y) - 1) * _FINER + half + 1) * (step / _FINER)
    pair.contact(fine)  # raises where the contact runs off a profile
    kernel = np.cos(np.linspace(-np.pi / 2.0, np.pi / 2.0, 2 * half + 3)[1:-1]) ** 2
    wheel_y, wheel_z, slope, lift, rail_curvature, wheel_curvature = (
        np.convolve(column, kernel / kernel.sum(), "valid")[::_FINER]
        for column in _soft_contact(pair, fine, smoothing.softness)
    )
    angle, radius = np.arctan(slope), pair.placement.radius - wheel_z
    ellipse = hertz_ellipse(np.cos(angle) / radius, np.maximum(rail_curvature + wheel_curvature, 0.0), LOAD)
    c = kalker_coefficients(ellipse.a / ellipse.b)
    return ContactTable(
        y=np.asarray(y, dtype=np.float64),
        radius=radius,
        angle=angle,
        lift=lift - np.interp(0.0, y, lift),
        wheel_y=wheel_y,
        rail_curvature=rail_curvature,
        wheel_curvature=wheel_curvature,
        a=ellipse.a,
        b=ellipse.b,
        c11=c.c11,
        c22=c.c22,
        c23=c.c23,
    )


def write_contact_table(path: Path, table: ContactTable, comments: Sequence[str], by: str = "") -> None:
    """CSV: the comments as lines that begin with #, the columns' names, rows of numbers. by: the command that
    writes it, as in `outputs.write`. Raises RecordError."""
    rows = np.column_stack([getattr(table, name) for name in COLUMNS])
    lines = [f"# {line}" for line in comments] + [",".join(COLUMNS)]
    lines += [",".join(f"{value:.9g}" for value in row) for row in rows]
    try:
        outputs.write(path, "\n".join(lines) + "\n", by)
    except OSError as error:
        raise RecordError(f"the contact table cannot be written: {error.strerror}", where=str(path)) from error


def _soft_contact(pair: WheelOnRail, y: Column, softness: float) -> tuple[Column, ...]:
    """wheel_y, wheel_z, slope, lift and both curvatures: means over the rail, weighted by exp(gap / softness)."""
    s = pair.grid
    rail_curvature = -pair.rail(s, 2) / (1.0 + pair.rail(s, 1) ** 2) ** 1.5
    columns: list[Float64[np.ndarray, "B 6"]] = []
    for first in range(0, len(y), 128):  # blocks, so that the grid times the block stays small
        across = s - y[first : first + 128, None]
        inside = (across >= pair.wheel.x[0]) & (across <= pair.wheel.x[-1])
        across = np.clip(across, pair.wheel.x[0], pair.wheel.x[-1])
        z, slope = pair.wheel(across), pair.wheel(across, 1)
        gap = np.where(inside, pair.grid_heights - z, -np.inf)
        highest = gap.max(axis=1)
        weights = np.exp((gap - highest[:, None]) / softness)
        total = weights.sum(axis=1)
        wheel_curvature = pair.wheel(across, 2) / (1.0 + slope**2) ** 1.5
        values = (across, z, slope, rail_curvature, wheel_curvature)
        means = [(value * weights).sum(axis=1) / total for value in values]
        columns.append(np.column_stack((*means[:3], highest + softness * np.log(total), *means[3:])))
    return tuple(np.concatenate(columns).T)
