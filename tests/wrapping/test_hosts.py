"""A wrapped solver says in every host what CorrectedStepper says of the bare one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from models import (
    COMBINATIONS,
    LONG,
    MODELS,
    OSCILLATOR,
    RIG,
    STEP_NS,
    columns,
    direct,
    expected,
    known,
    largest,
    solver,
)

from fmucorrect.fmu import open_fmu
from fmucorrect.signals import Record, join
from fmucorrect.wrapping.package import Wrapped

CLOSE = 1e-4
"""mm: what the wrapper's proof allows of responses of 10 mm"""
STATUS = "corrector_status"
EXCITED = 11.0
"""s; the roller rig's excitation has begun."""
Wrap = Callable[..., Wrapped]
each = pytest.mark.parametrize("model", MODELS)
each_way = pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)


@each_way
@each
def test_it_says_what_the_stepper_says(model: str, inner: int, outer: int, wrapped: Wrap) -> None:
    theirs, mine = expected(model, inner, LONG), direct(model, wrapped(model, inner, outer).path, LONG)
    names = [channel.name for channel in known(model).channels]
    assert mine.names == theirs.names
    assert np.array_equal(mine.select(names).values, theirs.select(names).values)
    assert np.array_equal(mine[STATUS], theirs[STATUS])
    assert set(mine[STATUS]) >= {0.0, 1.0}
    for name in names:
        assert largest(mine[f"{name}_corrected"], theirs[f"{name}_corrected"]) < CLOSE
        assert largest(mine[f"{name}_sigma"], theirs[f"{name}_sigma"]) < CLOSE
        assert largest(mine[f"{name}_corrected"], mine[name]) > 0.01


@cache
def problems(fmu: Path) -> list[str]:
    return validate_fmu(str(fmu))


@each_way
@each
def test_it_is_as_valid_as_the_solver(model: str, inner: int, outer: int, wrapped: Wrap) -> None:
    assert problems(solver(model, inner)) == []
    assert problems(wrapped(model, inner, outer).path) == []


def assert_alike(got: np.ndarray, model: str, fmu: Path) -> None:
    """got: a structured array with the samples from 0 on, of the added outputs that the host knows."""
    reference = direct(model, fmu, LONG).rows(0, len(got))
    names = [name for name in reference.names if name in (got.dtype.names or ())]
    assert {name for name in reference.names if name.endswith(("_corrected", "_sigma"))} <= set(names)
    for name in names:
        assert largest(got[name], reference[name]) < CLOSE
    assert any(reference[name].any() for name in names if name.endswith("_corrected"))


def added(model: str) -> list[str]:
    """Names of the outputs that the wrapper adds."""
    return [channel.name for channel in columns(model)[len(known(model).channels) :]]


def driven(model: str) -> np.ndarray | None:
    """Its inputs as fmpy wants them."""
    record: Record = join(list(known(model).drive(EXCITED)))
    if not record.channels:
        return None
    return np.rec.fromarrays([record.t_ns / 1e9, *record.values.T], names=["time", *record.names])


@each_way
@each
def test_in_fmpy(model: str, inner: int, outer: int, wrapped: Wrap) -> None:
    fmu = wrapped(model, inner, outer).path
    got = fmpy.simulate_fmu(
        str(fmu), stop_time=EXCITED if model == RIG else 1.0, step_size=1e-3, output_interval=1e-3,
        start_values=dict(known(model).parameters), input=driven(model), output=added(model),
    )  # fmt: skip
    assert STATUS in got.dtype.names
    assert_alike(got, model, fmu)


@pytest.mark.parametrize("inner", [2, 3])
def test_in_libcosimpy(inner: int, wrapped: Wrap) -> None:
    """It knows FMI 2 alone, and none of its enumerations: corrector_status is not to be had there."""
    pytest.importorskip("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    fmu = wrapped(OSCILLATOR, inner, 2).path
    variables, names = open_fmu(fmu).variables, added(OSCILLATOR)[:-1]
    execution, observer = CosimExecution.from_step_size(STEP_NS), CosimObserver.create_last_value()
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name="wrapped"))
    assert execution.add_observer(observer)
    references = [variables[name].reference for name in names]
    rows = [[0.0] * len(names)]
    for _ in range(500):
        assert execution.step()
        rows.append(observer.last_real_values(slave, references))
    assert largest(np.array(rows[1:]), direct(OSCILLATOR, fmu, LONG).select(names).values[1:501]) < CLOSE


@pytest.mark.parametrize("holder", [2, 3])
@pytest.mark.parametrize("outer", [2, 3])
def test_in_a_container(outer: int, holder: int, wrapped: Wrap, tmp_path: Path) -> None:
    pytest.importorskip("fmu_manipulation_toolbox")
    from fmu_manipulation_toolbox.container import FMUContainer

    fmu = wrapped(OSCILLATOR, outer).path
    shutil.copy(fmu, tmp_path / "part.fmu")
    container = FMUContainer("holder", tmp_path, fmi_version=holder)
    container.get_fmu("part.fmu")
    names = added(OSCILLATOR)
    if (outer, holder) == (3, 2):  # it has no place in FMI 2 for an enumeration of FMI 3
        names.remove(STATUS)
    for name in names:
        container.add_output("part.fmu", name, name)
    container.make_fmu("holder.fmu", 1e-3)
    got = fmpy.simulate_fmu(
        str(tmp_path / "holder.fmu"), stop_time=0.5, step_size=1e-3, output_interval=1e-3, output=names
    )
    assert_alike(got, OSCILLATOR, fmu)
