"""simulate() and input_record()."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from trouble_fmu import OSCILLATOR

from fmucorrect.errors import RecordError, StudyError
from fmucorrect.fmu import input_record, simulate
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.study import Simulation, Study, load_study

STUDY = """
format = 1
name = "a"
[simulation]
fmu = "oscillator.fmu"
step_size = 0.001
parameters = { masses = 2 }
[[channels]]
name = "x"
simulation = "mass1.x"
measurement = "x"
quantity = "displacement"
unit = "mm"
axis = "y"
positive = "right"
frame = "rig"
[excitation]
simulation = "base.d"
measurement = "base"
kind = "command"
[[conditions]]
name = "one"
role = "development"
parameters = { x1 = 0.01 }
measurement = "one.csv"
"""


@pytest.fixture
def study(tmp_path: Path) -> Any:
    (tmp_path / "one.csv").write_text("time,x,base\n0,0,0\n1,0,0\n")
    (tmp_path / "oscillator.fmu").write_bytes((OSCILLATOR / "oscillator.fmu").read_bytes())
    (tmp_path / "study.toml").write_text(STUDY)
    return load_study(tmp_path / "study.toml")


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


def test_simulate(study: Any):
    t_ns = np.arange(10_000, dtype=np.int64) * 1_000_000
    done: list[int] = []
    excited = simulate(study, study.conditions[0], t_ns, inputs=series((0, 0.0), (10**10, 1.0)), progress=done.append)
    assert [(c.name, c.unit) for c in excited.channels] == [("x", "mm"), ("base.d", "m")]
    assert excited["x"][0] == 10.0
    np.testing.assert_allclose(excited["base.d"], t_ns * 1e-10, atol=1e-15)
    assert (sum(done), len(done)) == (10_000, 3)
    free = simulate(study, Condition("rest"), t_ns[:10])
    assert not free["x"].any()
    assert len(simulate(study, Condition("nothing"), t_ns[:0])) == 0


def test_simulate_needs_an_fmu():
    study = Study(Path("s.toml"), "", "s", Simulation(None, 1_000_000), (), ())
    with pytest.raises(StudyError, match=r"no fmu"):
        simulate(study, Condition("a"), np.arange(3))
