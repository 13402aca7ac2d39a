"""Time series for the inputs of an FMU, at the times at which it is stepped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.signals import NANOSECONDS, Record, Times


def input_record(t_ns: Times, series: Record) -> Record:
    """The columns of `series` at the times `t_ns`: linear between its rows, held at its ends. Raises RecordError
    when it has none."""
    if not len(series):
        raise RecordError("the time series of the inputs has no rows", where=series.metadata.get("path"))
    seconds, known = (t_ns - series.t_ns[0]) / NANOSECONDS, series.seconds(int(series.t_ns[0]))
    columns = [np.interp(seconds, known, column) for column in series.values.T]
    values = np.stack(columns, axis=1) if columns else np.zeros((len(t_ns), 0))
    return replace(series, t_ns=t_ns, values=values)
