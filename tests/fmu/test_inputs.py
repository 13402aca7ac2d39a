"""input_record(): FMU inputs between the rows of a time series."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmucorrect.errors import RecordError
from fmucorrect.fmu import input_record
from fmucorrect.signals import Channel, Record


def series(*rows: tuple[int, float]) -> Record:
    t_ns, values = zip(*rows, strict=True)
    return Record(np.array(t_ns, np.int64), np.array(values)[:, None], (Channel("base.d", "m"),))


def test_input_record_is_linear_and_held():
    out = input_record(np.array([-5, 0, 5, 10, 20, 99], np.int64), series((0, 1.0), (10, 3.0), (20, 0.0)))
    assert out["base.d"].tolist() == [1.0, 1.0, 2.0, 3.0, 0.0, 0.0]
    assert out.channels == (Channel("base.d", "m"),)


def test_input_record_of_nothing():
    nothing = Record(np.array([], np.int64), np.zeros((0, 1)), (Channel("u"),), {"path": "inputs.csv"})
    with pytest.raises(RecordError, match=r"inputs.csv: the time series of the inputs has no rows"):
        input_record(np.arange(3), nothing)


@given(st.integers(-(10**18), 10**18), st.integers(1, 10**9))
def test_input_record_keeps_its_own_grid(start: int, step: int):
    t_ns = start + step * np.arange(5, dtype=np.int64)
    values = np.array([[1.0], [-2.0], [0.1], [3.0], [7.0]])
    record = Record(t_ns, values, (Channel("u"),))
    np.testing.assert_allclose(input_record(t_ns, record).values, values, atol=1e-9)
