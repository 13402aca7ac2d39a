"""How far a record has travelled along the track, from a speed or from a column of speed or distance."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64

from fmucorrect import units
from fmucorrect.errors import SignalError
from fmucorrect.signals import Record

Series = Float64[np.ndarray, " T"]

_LENGTH, _SPEED = units.parse("m").dimension, units.parse("m/s").dimension


def travelled_distance(record: Record, speed: float | str) -> Series:
    """(T,) distance in m along the track at each row, strictly increasing.

    speed: m/s, constant; or the name of a channel: a speed (unit like m/s or km/h), which may vary and is integrated by
    trapezes, or a distance (unit like m or km), which is taken as it is. From a speed, distance starts at 0 m.
    Raises SignalError for a speed that is not finite and above zero everywhere, a distance that does not increase, and
    a unit that is neither; RecordError where the channel is missing.
    """
    if isinstance(speed, str):
        return _from_channel(record, speed)
    if not (math.isfinite(speed) and speed > 0.0):
        raise SignalError("the speed cannot carry distance", expected="a finite speed above 0 m/s", got=f"{speed} m/s")
    return speed * record.seconds(int(record.t_ns[0]))


def _from_channel(record: Record, name: str) -> Series:
    channel, values = record.channels[record.index(name)], record[name]
    unit = units.parse(channel.unit)
    where = f"channel {name}"
    seconds = record.seconds(int(record.t_ns[0]))
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        raise SignalError(f"the values are not finite at {seconds[wrong[0]]:g} s", where=where)
    if unit.dimension == _LENGTH:
        back = np.flatnonzero(np.diff(values) <= 0.0)
        if len(back):
            raise SignalError(
                f"the distance does not increase at {seconds[back[0] + 1]:g} s",
                where=where,
                remedy="Take the rows in which the vehicle runs, and distance in the direction of running.",
            )
        return values * unit.factor
    if unit.dimension != _SPEED:
        raise SignalError("the unit is neither of speed nor of distance", where=where, got=repr(channel.unit))
    still = np.flatnonzero(values <= 0.0)
    if len(still):
        raise SignalError(
            f"the speed is not above zero at {seconds[still[0]]:g} s",
            where=where,
            got=f"{values[still[0]]:g} {channel.unit}",
            remedy="Take the rows in which the vehicle runs forwards.",
        )
    v = values * unit.factor
    return np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(seconds))])
