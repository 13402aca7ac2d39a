"""The gate: inputs that do not reach over a run, and what a run says of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_screening import Table, save

from fmucorrect import sources
from fmucorrect.records import writer
from fmucorrect.runs import run_study
from fmucorrect.screening import of_records
from fmucorrect.signals import Channel, Record
from fmucorrect.study import Study, load_study

OSCILLATOR = Path(__file__).resolve().parent.parent / "fmus" / "oscillator" / "oscillator.fmu"
DRIVEN = f"""format = 1
[simulation]
fmu = "{OSCILLATOR.as_posix()}"
step_size = 0.01
[[channels]]
name = "x"
simulation = "mass1.x"
measurement = "x"
quantity = "displacement"
unit = "mm"
[[conditions]]
name = "one"
role = "development"
inputs = "INPUTS"
measurement = "x.csv"
"""


def driven(folder: Path, name: str, *topics: tuple[np.ndarray, Table]) -> Study:
    """An oscillator, measured for 12 s, driven by these topics of a file."""
    t = np.arange(1200) * 0.01
    save(folder / "x.csv", t, {"x": np.sin(3.0 * t) + 1e-3 * np.cos(47.0 * t)}, {})
    with writer(folder / name) as out:
        for k, (at, table) in enumerate(topics):
            channels = tuple(Channel(column, unit="N") for column in table)
            stamps = np.round(at * 1e9).astype(np.int64)
            out.write(f"/{k}", Record(stamps, np.stack(list(table.values()), axis=1), channels))
    (folder / "study.toml").write_text(DRIVEN.replace("INPUTS", name), encoding="utf-8")
    return load_study(folder / "study.toml")


T12 = np.arange(1201) * 0.01


@pytest.mark.parametrize(("lost", "level"), [((300, 700), "error"), ((300, 320), "warning")])
def test_a_hole_in_the_inputs(tmp_path: Path, lost: tuple[int, int], level: str) -> None:
    t = np.delete(T12, np.arange(*lost))
    (finding,) = of_records(driven(tmp_path, "in.csv", (t, {"mass1.f": np.sin(9.0 * t)})))
    assert (finding.kind, finding.level) == ("inputs do not cover the run", level)
    assert f"without rows from 2.99 to {lost[1] / 100:g} s" in finding.seen
    assert "straight line" in finding.meaning


@pytest.mark.parametrize(
    "series",
    [
        (np.array([0.0, 12.0]), np.array([1.0, 1.0])),  # a constant
        (np.array([0.0, 2.0, 2.1, 8.0, 8.1, 12.0]), np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])),  # corners
        (np.delete(T12, np.arange(300, 303)), np.sin(np.delete(T12, np.arange(300, 303)))),  # a straight line will do
        (np.delete(T12, np.arange(300, 700)), np.where(np.delete(T12, np.arange(300, 700)) < 2.0, 1.0, 0.0)),  # at rest
    ],
)
def test_inputs_without_a_hole(tmp_path: Path, series: tuple[np.ndarray, np.ndarray]) -> None:
    assert of_records(driven(tmp_path, "in.csv", (series[0], {"mass1.f": series[1]}))) == ()


def test_an_input_that_ends_early_takes_nothing_of_the_others(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Each is driven as far as its own topic reaches, and held there; what is missing is told by name, in a run, too."""
    short, whole = T12[150:600], np.sin(9.0 * T12)
    study = driven(tmp_path, "in.mcap", (T12, {"mass1.f": whole}), (short + 0.003, {"mass2.f": np.cos(short)}))
    condition = study.conditions[0]
    rows = np.concatenate([chunk.values for chunk in sources.inputs(study, condition)])
    step = study.simulation.step_size
    t = np.arange(len(rows)) * step
    np.testing.assert_allclose(rows[:, 0], np.interp(t, T12, whole), atol=1e-9)
    np.testing.assert_allclose(rows[:, 1], np.interp(t, short + 0.003, np.cos(short)), atol=1e-9)
    (finding,) = of_records(study)
    assert "mass2.f in in.mcap from 1.503 to 5.993 s" in finding.seen
    run_study(study, condition, tmp_path / "out.mcap", duration=14.0)
    told = [record.message for record in caplog.records if "inputs do not cover the run" in record.message]
    assert [("mass1.f in" in text, "from 0 to 14 s" in text) for text in told] == [(True, True), (False, True)]


def test_inputs_that_end_early_in_a_topic_that_is_not_the_first(tmp_path: Path) -> None:
    short = T12[:200]
    study = driven(tmp_path, "in.mcap", (T12, {"other": 0.0 * T12}), (short, {"mass1.f": np.sin(9.0 * short)}))
    (finding,) = of_records(study)
    assert (finding.kind, finding.level) == ("inputs do not cover the run", "error")
    assert "in.mcap from 0 to 1.99 s" in finding.seen
