"""FMU inputs at the times of a simulation, from a time series on any grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmucorrect.errors import RecordError
from fmucorrect.signals import Record, Times


def input_record(t_ns: Times, series: Record | None) -> Record:
    """FMU inputs at `t_ns` (simulation times): linear between the rows of `series`, held before its first and after its
    last row; without a series a record with no columns. Raises RecordError when the series has no row.

    A row depends on its own time alone, so any chunks of a time base give the same values.
    """
    if series is None:
        return Record(t_ns, np.zeros((len(t_ns), 0)), ())
    if not len(series):
        raise RecordError("the time series of the inputs has no row", where=series.metadata.get("path"))
    known, wanted = ((times - series.t_ns[0]).astype(np.float64) for times in (series.t_ns, t_ns))
    values = np.empty((len(t_ns), len(series.channels)))
    for column in range(values.shape[1]):
        values[:, column] = np.interp(wanted, known, series.values[:, column])
    return replace(series, t_ns=t_ns, values=values)
