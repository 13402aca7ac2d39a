"""Time series for the inputs of an FMU, at the times at which it is stepped."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.signals import NANOSECONDS, Record, Times


def input_record(t_ns: Times, series: Record, held: Container[str] = ()) -> Record:
    """The columns of `series` at the times `t_ns`: linear between its rows, those named in `held` (switches, gears) as the
    row before says; held at its ends. Raises RecordError when it has none."""
    if not len(series):
        raise RecordError("the time series of the inputs has no rows", where=series.metadata.get("path"))
    seconds, known = (t_ns - series.t_ns[0]) / NANOSECONDS, series.seconds(int(series.t_ns[0]))
    columns = [
        column[np.maximum(np.searchsorted(series.t_ns, t_ns, side="right") - 1, 0)]
        if channel.name in held
        else np.interp(seconds, known, column)
        for channel, column in zip(series.channels, series.values.T, strict=True)
    ]
    values = np.stack(columns, axis=1) if columns else np.zeros((len(t_ns), 0))
    return replace(series, t_ns=t_ns, values=values)
