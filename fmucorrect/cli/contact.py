"""contact."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from fmucorrect.cli.group import OVERWRITE, PATH, UserError, ignored, say

LENGTHS = {
    "gauge": "Track gauge, mm; default: 1435.",
    "back-to-back": "Distance of the wheels' inner faces, mm; default: 1360.",
    "radius": "Wheel radius at the running circle, mm; default: 430.",
    "softness": "Difference of height over which two places share the load, mm; default: 0.015.",
    "width": "Last smoothing of the table, mm of its y; default: 0.4.",
}
"""Options whose defaults stand in Placement and Smoothing."""
UNITS = ("m", "cm", "mm", "um", "in")


def _lengths(command: Callable[..., Any]) -> Callable[..., Any]:
    for name, text in reversed(LENGTHS.items()):
        command = click.option(f"--{name}", type=float, help=text)(command)
    return command


@click.command()
@click.argument("wheel")
@click.argument("rail")
@click.option("-o", "--out", type=PATH, required=True, help="The table to write, a CSV file.")
@click.option(
    "--inclination", default="1:40", help="Of the rail; 0 for a rail profile that is inclined already; default: 1:40."
)
@click.option("--wheel-unit", type=click.Choice(UNITS), help="Unit of a wheel profile in columns that name none.")
@click.option("--rail-unit", type=click.Choice(UNITS), help="Unit of a rail profile in columns that name none.")
@click.option("--smooth", type=float, default=0.0, help="Smooth the profiles over so many mm; 8 for 10 um of noise.")
@click.option("--reach", type=float, default=15.0, help="Largest lateral displacement, mm; default: 15.")
@click.option("--step", type=float, default=0.05, help="Step in it, mm; default: 0.05.")
@_lengths
@OVERWRITE
def contact(
    wheel: str,
    rail: str,
    out: Path,
    inclination: str,
    wheel_unit: str | None,
    rail_unit: str | None,
    smooth: float,
    reach: float,
    step: float,
    overwrite: bool,
    **lengths: float | None,
) -> None:
    """Make the contact table of a WHEEL on a RAIL: where they touch over the lateral displacement, and their conicity.

    WHEEL and RAIL are S1002 and 60E1 (made from their standards), or files: Simpack's .prw and .prr, or two columns of text
    `y [mm],z [mm]` of a right wheel and a right rail, y to the field side, z upwards, the wheel's running circle at the
    origin. The first lines of the table say how it was made, where the rigid contact jumps, and which equivalent conicity
    (EN 15302) profiles and table have. The full vehicle runs on it, laid into its resources.

    Example: fmucorrect contact wheel.prw rail.prr --inclination 1:20 -o contact.csv
    """
    import numpy as np

    from fmucorrect import outputs
    from fmucorrect.railway.contact.geometry import Placement, WheelOnRail
    from fmucorrect.railway.contact.profile_file import knows_its_unit, load_profile
    from fmucorrect.railway.contact.remarks import findings, origin
    from fmucorrect.railway.contact.smoothing import smoothed
    from fmucorrect.railway.contact.table import Smoothing, make_contact_table, write_contact_table

    if not 0.001 <= reach <= 100.0:
        raise UserError(f"--reach is {reach:g} mm: 0.001 to 100 mm is expected")
    if not 0.001 <= step <= reach:
        raise UserError(f"--step is {step:g} mm: 0.001 mm to --reach, {reach:g} mm, is expected")
    outputs.check_ending(out, "the table is written as CSV", (".csv", ".txt", ""))
    for name, unit, option in ((wheel, wheel_unit, "wheel-unit"), (rail, rail_unit, "rail-unit")):
        if knows_its_unit(name):
            ignored({option: unit}, f"{name} knows its unit itself")
    profiles = load_profile(wheel, "wheel", wheel_unit), load_profile(rail, "rail", rail_unit)
    outputs.check_file(out, [("the wheel", Path(wheel)), ("the rail", Path(rail))], "contact", overwrite)
    given = {name: value * 1e-3 for name, value in lengths.items() if value is not None}
    placement = Placement(inclination=_angle(inclination), **_some(given, "gauge", "back_to_back", "radius"))
    smoothing = Smoothing(**_some(given, "softness", "width"))
    a, b = (smoothed(profile, smooth * 1e-3) if smooth else profile for profile in profiles)
    pair = WheelOnRail(a, b, placement)
    half = round(reach / step)
    table = make_contact_table(pair, np.arange(-half, half + 1) * step * 1e-3, smoothing)
    names = Path(wheel).name, Path(rail).name
    remarks = [*origin(*names, inclination, smooth, placement, smoothing), *findings(pair, table)]
    write_contact_table(out, table, remarks, "contact")
    say("\n".join([*remarks, f"{len(table.y)} rows written to {out}"]))


def _some(values: dict[str, float], *names: str) -> dict[str, float]:
    return {name: values[name] for name in names if name in values}


def _angle(inclination: str) -> float:
    """In rad, of 1:40 or 0. Raises UserError."""
    match = re.fullmatch(r"1\s*:\s*(\d+(?:\.\d+)?)", inclination.strip())
    if inclination.strip() == "0":
        return 0.0
    if match is None or float(match[1]) < 10.0:
        raise UserError(f"no inclination of a rail: {inclination!r}; expected 1:40, 1:30, 1:20 or 0")
    return math.atan(1.0 / float(match[1]))
