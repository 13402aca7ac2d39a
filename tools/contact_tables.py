"""Makes the contact table of a wheel on a rail: python tools/contact_tables.py WHEEL RAIL [options] -o contact.csv

WHEEL and RAIL are S1002 and 60E1 (made from their standards), or files: Simpack's .prw and .prr, or two columns of text
`y [mm],z [mm]` of a right wheel and a right rail, y to the field side, z upwards, the wheel's running circle at the origin.
Laid into resources/ of full_vehicle.fmu the table makes the vehicle run on these profiles. Its first lines say how it was
made, where the rigid contact jumps, and which equivalent conicity (EN 15302) profiles and table have.
The shipped one: python tools/contact_tables.py S1002 60E1 --inclination 1:40 -o fmus/full_vehicle/contact.csv
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fmucorrect.errors import FmucorrectError, SignalError
from fmucorrect.railway.contact.equivalent_conicity import (
    Column,
    equivalent_conicity,
    radius_difference,
    wheelset_contact,
)
from fmucorrect.railway.contact.geometry import Placement, WheelOnRail
from fmucorrect.railway.contact.profile_file import UNITS, load_profile
from fmucorrect.railway.contact.smoothing import smoothed
from fmucorrect.railway.contact.table import LOAD, ContactTable, Smoothing, make_contact_table, write_contact_table

AMPLITUDES = (1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3)
LARGE = 1e-3  # m: jumps of the contact point that are told one by one


def parse_inclination(text: str) -> float:
    """The angle in rad of an inclination written 1:40, or 0. Raises SignalError."""
    match = re.fullmatch(r"1\s*:\s*(\d+(?:\.\d+)?)", text.strip())
    if text.strip() == "0":
        return 0.0
    if match is None or float(match[1]) < 10.0:
        raise SignalError(f"no inclination of a rail: {text!r}", expected="1:40, 1:30, 1:20 or 0")
    return float(np.arctan(1.0 / float(match[1])))


def conicities(difference: Callable[[Column], Column]) -> str:
    """Equivalent conicity at AMPLITUDES as far as it is defined."""
    y = np.linspace(-8e-3, 8e-3, 3201)
    values: list[str] = []
    for amplitude in AMPLITUDES:
        try:
            values.append(f"{equivalent_conicity(y, difference(y), amplitude):.3f} at {amplitude * 1e3:g} mm")
        except SignalError:
            values.append(f"none at {amplitude * 1e3:g} mm")
    return ", ".join(values)


def with_roll(pair: WheelOnRail) -> str:
    """Equivalent conicity of a wheelset that rolls on its rails, at 3 mm: what the table leaves out is the difference."""
    y = np.arange(-40, 41) * 1e-4
    try:
        return f"{equivalent_conicity(y, wheelset_contact(pair, pair, y).radius_difference, 3e-3):.3f} at 3 mm"
    except SignalError:
        return "none at 3 mm"


def table_difference(table: ContactTable) -> Callable[[Column], Column]:
    """Radius difference of a wheelset with this table on both sides."""
    return lambda y: np.interp(y, table.y, table.radius) - np.interp(-y, table.y, table.radius)


def origin(arguments: argparse.Namespace, placement: Placement, smoothing: Smoothing) -> list[str]:
    """What the table was made from."""
    return [
        f"wheel {Path(arguments.wheel).name}, rail {Path(arguments.rail).name}, rail inclination {arguments.inclination}, "
        f"gauge {placement.gauge * 1e3:g} mm taken {placement.gauge_depth * 1e3:g} mm below the top, "
        f"back-to-back {placement.back_to_back * 1e3:g} mm, running circle {placement.running_circle * 1e3:g} mm from the "
        f"inner face, r0 {placement.radius * 1e3:g} mm (radius at wheel_y = 0)",
        f"SI units; y towards the flange; a, b under a normal force of {LOAD * 1e-3:g} kN, growing with its cube root; no roll",
        f"softness of the contact {smoothing.softness * 1e3:g} mm, then smoothed over {smoothing.width * 1e3:g} mm in y; "
        f"profiles smoothed over {arguments.smooth:g} mm",
    ]


def findings(pair: WheelOnRail, table: ContactTable) -> list[str]:
    """Jumps of the rigid contact, and conicities."""
    slope = np.gradient(table_difference(table)(table.y), table.y)[np.argmin(np.abs(table.y))] / 2.0
    jumps = pair.jumps(table.y)
    large = [jump for jump in jumps if abs(jump.wheel_y[1] - jump.wheel_y[0]) > LARGE]
    return [
        *(
            f"rigid contact jumps at y = {jump.y * 1e3:.3f} mm from wheel_y = {jump.wheel_y[0] * 1e3:.2f} "
            f"to {jump.wheel_y[1] * 1e3:.2f} mm"
            for jump in large
        ),
        f"and at {len(jumps) - len(large)} places by less than {LARGE * 1e3:g} mm",
        f"equivalent conicity of the rigid profiles: {conicities(lambda y: radius_difference(pair, pair, y))}",
        f"the same with the wheelset's roll: {with_roll(pair)}",
        f"equivalent conicity of this table: {conicities(table_difference(table))}; its slope at y = 0: {slope:.3f}",
    ]


def main() -> int:
    """Exit status: 0, or 2 on an error of the user's."""
    usage, _, text = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        description=usage, epilog=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    nominal, smooth = Placement(), Smoothing()
    parser.add_argument("wheel", metavar="WHEEL")
    parser.add_argument("rail", metavar="RAIL")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the table to write")
    parser.add_argument("--inclination", default="1:40", help="of the rail; 0 for a rail profile that holds it (1:40)")
    parser.add_argument("--wheel-unit", choices=UNITS, help="unit of a wheel profile in columns without one")
    parser.add_argument("--rail-unit", choices=UNITS, help="unit of a rail profile in columns without one")
    parser.add_argument(
        "--smooth", type=float, default=0.0, help="mm along measured profiles; 8 for a noise of 10 um (0)"
    )
    for name, value, what in (
        ("gauge", nominal.gauge, "mm, track gauge"),
        ("back-to-back", nominal.back_to_back, "mm, distance of the wheels' inner faces"),
        ("radius", nominal.radius, "mm, wheel radius at the running circle"),
        ("softness", smooth.softness, "mm, difference of height over which two places share the load"),
        ("width", smooth.width, "mm, last smoothing in y"),
        ("reach", 15e-3, "mm, largest displacement"),
        ("step", 0.05e-3, "mm, step in y"),
    ):
        parser.add_argument(f"--{name}", type=float, default=value * 1e3, help=f"{what} ({value * 1e3:g})")
    arguments = parser.parse_args()
    try:
        profiles = [
            load_profile(arguments.wheel, "wheel", arguments.wheel_unit),
            load_profile(arguments.rail, "rail", arguments.rail_unit),
        ]
        wheel, rail = (smoothed(p, arguments.smooth * 1e-3) if arguments.smooth else p for p in profiles)
        placement = Placement(
            gauge=arguments.gauge * 1e-3,
            inclination=parse_inclination(arguments.inclination),
            back_to_back=arguments.back_to_back * 1e-3,
            radius=arguments.radius * 1e-3,
        )
        smoothing = Smoothing(arguments.softness * 1e-3, arguments.width * 1e-3)
        pair = WheelOnRail(wheel, rail, placement)
        if not 0.0 < arguments.step <= arguments.reach:
            raise SignalError("the step must be positive and no larger than the reach", got=f"{arguments.step:g} mm")
        half = round(arguments.reach / arguments.step)
        table = make_contact_table(pair, np.arange(-half, half + 1) * arguments.step * 1e-3, smoothing)
        comments = (*origin(arguments, placement, smoothing), *findings(pair, table))
        write_contact_table(arguments.output, table, comments)
    except FmucorrectError as problem:
        print(problem, file=sys.stderr)
        return 2
    print("\n".join((*comments, f"{len(table.y)} rows written to {arguments.output}")))
    return 0


if __name__ == "__main__":
    sys.exit(main())
