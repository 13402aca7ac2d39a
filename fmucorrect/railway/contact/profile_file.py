"""Reads a wheel or rail profile: Simpack's .prw and .prr, or two columns of text with their unit."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from fmucorrect.errors import RecordError, SignalError
from fmucorrect.railway.contact.profile import Kind, Points, Profile
from fmucorrect.railway.contact.standard_profiles import STANDARD_PROFILES, standard_profile
from fmucorrect.records.text import encoding_of, opened

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
"""Metres in a unit of length."""

HEADER = "y [mm],z [mm]"
"""The first line of two columns of text, in millimetres."""

_COMMENTS = ("#", "!", "%", "//")
_HEADER = re.compile(
    r"^\s*\"?y\s*[\[(]\s*(\w+)\s*[\])]\"?\s*[,;\t ]\s*\"?z\s*[\[(]\s*(\w+)\s*[\])]\"?\s*$", re.IGNORECASE
)
_SIMPACK = (".prw", ".prr")
_WITH_COMMA = re.compile(r"[^,]+(?:,\d+(?:[eE][+-]?\d+)?)?")
"""A number, perhaps with a decimal comma."""


def knows_its_unit(name: str) -> bool:
    """Whether nothing comes of a unit that is given for this profile: built in, or of a format that has one."""
    return name.lower() in STANDARD_PROFILES or Path(name).suffix.lower() in _SIMPACK


def load_profile(name: str, kind: Kind, unit: str | None = None) -> Profile:
    """A built-in profile by its name, or the file of that name. Raises as standard_profile and read_profile do, and
    SignalError for a built-in profile of the other kind."""
    if name.lower() not in STANDARD_PROFILES:
        return read_profile(Path(name), kind, unit)
    profile = standard_profile(name)
    if profile.kind != kind:
        raise SignalError(f"{profile.name} is a {profile.kind} profile", expected=f"a {kind} profile")
    return profile


def read_profile(path: Path, kind: Kind, unit: str | None = None) -> Profile:
    """The profile in a file: .prw and .prr as Simpack writes them (right wheel, right rail; y right, z down), everything
    else as two columns of numbers y z, y to the field side and z up, with the header `y [mm],z [mm]` or a unit given here.

    Raises RecordError for a file that cannot be read as such, SignalError for points that are no profile of this kind.
    """
    text = _text(path)
    if path.suffix.lower() in _SIMPACK or "point.begin" in text:
        points = _simpack_points(str(path), text, kind)
    else:
        points = _text_points(str(path), text, unit)
    return Profile(path.name, kind, points)


def _text(path: Path) -> str:
    """All of it; in UTF-16 too, as spreadsheets write it."""
    built_in = ", ".join(name.upper() for name in STANDARD_PROFILES)
    if path.is_dir():
        raise RecordError(
            "this is a folder", where=str(path), expected=f"the file of a profile, or a built-in one: {built_in}"
        )
    try:
        with opened(str(path), encoding_of(str(path))[0]) as stream:
            text = stream.read()
    except RecordError as error:
        raise RecordError(
            str(error),
            remedy=f"A file, or one of the built-in profiles {built_in}, is needed",
        ) from error
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise RecordError(
            f"line {line} holds a character of code 0",
            where=str(path),
            expected="a text file",
            remedy="Export the profile as text: two columns y and z, or Simpack's .prw and .prr",
        )
    if not text.strip():
        raise RecordError(
            "the file is empty", where=str(path), expected="points of a profile", remedy="Export the profile again"
        )
    return text


def _simpack_points(where: str, text: str, kind: Kind) -> Points:
    """Points in m, z up. The settings act in the order that the file numbers them in: distance, shift, rotation, bounds,
    mirroring, unit; the order of the points does not matter here."""
    lines = [line.split("!")[0].strip() for line in text.splitlines()]
    try:
        first, last = lines.index("point.begin"), lines.index("point.end")
    except ValueError as error:
        missing = [mark for mark in ("point.begin", "point.end") if mark not in lines]
        raise RecordError(
            f"no points in this Simpack profile: {' and '.join(missing)} is missing",
            where=where,
            expected="lines point.begin, y and z, point.end",
            remedy="Export it again, or give two columns of text in a file of another ending",
        ) from error
    body = lines.index("header.end") if "header.end" in lines else 0
    settings = _settings(lines[body:first])
    written: Kind = "wheel" if _settings(lines[:body]).get("type") == "1" else "rail"
    if written != kind:
        raise SignalError(f"the file holds a {written} profile", where=where, expected=f"a {kind} profile")
    points = _numbers(where, lines, range(first + 1, last), None)[:, :2]

    def setting(key: str, default: float) -> float:
        try:
            return float(settings.get(key, default))
        except ValueError as error:
            raise RecordError(f"{key} is no number", where=where, got=settings[key]) from error

    points = _apart(points, setting("point.dist.min", 0.0))
    points = points + np.array([setting("shift.y", 0.0), setting("shift.z", 0.0)])
    angle = setting("rotate", 0.0) / setting("units.ang.f", 1.0)
    points = points @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    for axis, name in enumerate("yz"):
        low, high = setting(f"bound.{name}.min", 1.0), setting(f"bound.{name}.max", 0.0)
        if low < high:
            points = points[(points[:, axis] >= low) & (points[:, axis] <= high)]
    signs = [-1.0 if setting(f"mirror.{name}", 0.0) == 1.0 else 1.0 for name in "yz"]
    return points * signs * (1.0, -1.0) / setting("units.len.f", 1.0)


def _settings(lines: list[str]) -> dict[str, str]:
    pairs = [line.split("=", 1) for line in lines if "=" in line]
    return {key.strip(): value.strip() for key, value in pairs}


def _apart(points: Points, distance: float) -> Points:
    """Without the points that are closer than a distance to the one before."""
    kept = [0]
    for i in range(1, len(points)):
        if np.hypot(*(points[i] - points[kept[-1]])) >= distance:
            kept.append(i)
    return points[kept]


def _text_points(where: str, text: str, unit: str | None) -> Points:
    lines = text.splitlines()
    rows = [i for i, line in enumerate(lines) if line.strip() and not line.strip().startswith(_COMMENTS)]
    if not rows:
        raise RecordError("the file holds comments alone", where=where, expected="points of a profile")
    first, at = lines[rows[0]], f"line {rows[0] + 1}"
    header = _HEADER.match(first)
    if header:
        rows, said = rows[1:], header[1].lower()
        if said != header[2].lower():
            raise RecordError(
                f"{at} names two units",
                where=where,
                expected=f"one of both columns, as {HEADER!r}",
                got=_shown(first),
                remedy="Bring both columns to one unit",
            )
        if unit is not None and unit != said:
            raise RecordError(
                f"the units do not agree: {at} says [{header[1]}]",
                where=where,
                expected=f"[{unit}], the unit that was given",
                remedy="Leave out the unit that was given, or mend the line",
            )
        unit = said
    elif _cells(first) is None:
        raise RecordError(
            f"{at} is neither two numbers nor a header",
            where=where,
            expected=f"{HEADER!r}, or with another of {', '.join(UNITS)}",
            got=_shown(first),
            remedy="Write the header so; y is across the track, z upwards, and they stand in this order",
        )
    if unit is None:
        raise RecordError(
            f"the profile's unit is not given: {at} holds numbers",
            where=where,
            expected=f"a first line {HEADER!r}",
            got=_shown(first),
            remedy="Write that line, or name the unit (--wheel-unit or --rail-unit on the command line)",
        )
    if unit not in UNITS:
        raise RecordError(
            f"{at} names an unknown unit of length" if header else "an unknown unit of length",
            where=where,
            expected=f"one of {', '.join(UNITS)}",
            got=unit,
        )
    return _numbers(where, lines, rows, 2) * UNITS[unit]


def _numbers(where: str, lines: list[str], rows: range | list[int], columns: int | None) -> Points:
    """The numbers of these lines, (P, 2); of `columns` a line, None for two or more."""
    values: list[list[float]] = []
    for i in rows:
        if not lines[i].strip():
            continue
        numbers = _cells(lines[i]) or []
        if len(numbers) < 2 or (columns is not None and len(numbers) != columns):
            raise RecordError(
                f"line {i + 1} does not hold two numbers",
                where=where,
                expected="y and z",
                got=_shown(lines[i]),
                remedy="Remove the line if it is no point, and columns beside y and z",
            )
        if not np.isfinite(numbers[:2]).all():
            raise RecordError(
                f"line {i + 1} holds what is not finite",
                where=where,
                expected="y and z as finite numbers",
                got=_shown(lines[i]),
                remedy="Remove the line: a point that was not measured is none",
            )
        values.append(numbers[:2])
    return np.array(values, dtype=np.float64).reshape(-1, 2)


def _cells(line: str) -> list[float] | None:
    """The numbers of a line, None where there are others than numbers; separated by blanks, comma, semicolon or tab, a decimal
    comma where it is not by commas."""
    cells = line.replace(";", " ").split()
    if len(cells) > 1 and all(map(_WITH_COMMA.fullmatch, cells)):
        cells = [cell.replace(",", ".") for cell in cells]
    else:
        cells = line.replace(",", " ").split()
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        return None


def _shown(line: str) -> str:
    return repr(line.strip()[:60])
