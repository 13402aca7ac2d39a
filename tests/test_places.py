"""Solvers in Python add to sys.path at every start, thousands of times in a discovery: own processes begin all the same."""

import sys
from pathlib import Path

import numpy as np
import pytest

from fmucorrect import places, records
from fmucorrect.errors import RecordError
from fmucorrect.fmu import IsolatedStepper
from fmucorrect.railway.stability.watched_modes import watched_modes
from fmucorrect.records import writer
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import grid, run

OSCILLATOR = Path(__file__).resolve().parent.parent / "fmus" / "oscillator" / "oscillator.fmu"
CHANNELS = (Channel("mass1.x", "mm"),)


@pytest.fixture
def many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More than a command line holds."""
    monkeypatch.setattr(sys, "path", [*sys.path, *(str(tmp_path / f"solver {i}" / "resources") for i in range(50_000))])


@pytest.mark.usefixtures("many")
def test_a_solver_begins() -> None:
    with IsolatedStepper(OSCILLATOR, CHANNELS) as stepper:
        result = run(stepper, Condition("a"), grid(0.05, 1_000_000))
    assert result is not None
    assert len(result) == 51


@pytest.mark.usefixtures("many")
def test_a_library_for_logs_begins(tmp_path: Path) -> None:
    record = Record(np.arange(5) * 1_000_000, np.arange(5.0)[:, None], (Channel("x", "mm"),))
    with writer(tmp_path / "log.parquet") as file:
        file.write("/log", record)
    np.testing.assert_array_equal(records.read(tmp_path / "log.parquet").values, record.values)


def test_a_library_that_cannot_begin_is_no_fault_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.parquet"
    path.write_bytes(b"PAR1")
    monkeypatch.setattr(places, "PLACES", tuple(str(i) for i in range(50_000)))
    with pytest.raises(RecordError, match=r"log\.parquet: the process that is to read it cannot be started"):
        records.read(path)


@pytest.mark.usefixtures("many")
def test_a_linearisation_begins() -> None:
    assert len(watched_modes(OSCILLATOR, CHANNELS, {}, None).eigenvalues) > 0
