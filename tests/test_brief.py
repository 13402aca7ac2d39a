"""What a notebook prints of a result that has no table of its own: what it is, in a line or two, and no array."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import bundles
import numpy as np
import pytest
from study_example import EXAMPLE, files, write

import fmucorrect as fc
from fmucorrect.brief import ENTRIES, brief
from fmucorrect.comparison import Comparison
from fmucorrect.diagnosis import Agreement, Diagnosis
from fmucorrect.inspection import Inspection
from fmucorrect.pairs import Pair
from fmucorrect.railway.contact.standard_profiles import s1002
from fmucorrect.study import Simulation

FMU = Path(__file__).parents[1] / "fmus" / "roller_rig" / "roller_rig.fmu"
ROWS = 3000
WORDS = 500
"""Characters that fit a few lines of a screen."""


def record() -> fc.Record:
    channels = tuple(fc.Channel(name, "mm") for name in ("FW", "FB"))
    return fc.Record(np.arange(ROWS) * 1_000_000, np.ones((ROWS, 2)), channels, {"path": "run.mcap"})


def results() -> dict[str, object]:
    it, condition, column = record(), fc.Condition("385", speed=385.0), np.linspace(0.0, 1.0, 513)
    measured = np.full((ROWS, 2), 2.0)
    pair = Pair(condition, it, slice(0, ROWS), measured, measured, fc.Offset(np.float64(0.25), 1.0, 1e-6, 1.0), None)
    agreements = tuple(
        Agreement(name, "385", "development", 0.9, 0.9, 0.9, 0, 1.0, column, column) for name in map(str, range(20))
    )
    status = np.zeros(ROWS, np.int64)
    return {
        "record": it,
        "pair": pair,
        "comparison": Comparison(condition, it.channels, it.t_ns, measured, measured, measured, measured, status),
        "diagnosis": Diagnosis(agreements, ("FW", "FB"), (1.0, 10.0)),
        "inspection": Inspection(({"path": "a" * 5000},), ("it fits",), (), pairs={Path("s.toml"): [pair]}),
        "profile": s1002(),
    }


def things(folder: Path) -> dict[str, object]:
    """What is read, and what runs."""
    model = fc.load_bundle(bundles.make(folder / "corrector.onnx"))
    channels = model.channels
    replay, logged = fc.ReplayStepper(channels), Path("shared") / ("runs" * 30) / "run.csv"
    condition = fc.Condition("385", speed=385.0, measurement=logged, parameters={"v": 83.3}, reading=fc.Reading())
    return {
        "condition": condition,
        "channel": channels[0],
        "simulation": Simulation(logged, 1_000_000, {"v": 83.3}),
        "bundle": model,
        "info": model.info,
        "replay": replay,
        "corrected": fc.CorrectedStepper(replay, model),
        "isolated": fc.IsolatedStepper(FMU, channels),
        "fmu": fc.open_fmu(FMU),
        "window": fc.Window(40, 4),
        "contents": fc.describe(FMU.parent / "A" / "platform_yaw.csv"),
    }


def test_what_is_read_and_what_runs_is_told_in_a_line(tmp_path: Path) -> None:
    shown = {name: repr(it) for name, it in things(tmp_path).items()}
    assert {name for name, text in shown.items() if len(text) > 1.5 * WORDS or " object at 0x" in text} == set()
    assert shown["condition"] == "Condition(name='385', speed=385.0, parameters={v}, measurement='run.csv')"
    names = "channels=['FW', 'FB', 'RW', 'RB']"
    assert shown["bundle"] == f"Bundle(path='corrector.onnx', {names}, rows=40, step_ns=1000000)"
    assert shown["replay"] == f"ReplayStepper({names})"
    assert shown["corrected"] == f"CorrectedStepper(plant=ReplayStepper({names}), corrector=Bundle(...))"
    assert shown["isolated"] == f"IsolatedStepper(description='roller_rig', {names})"
    assert shown["window"] == "Window(array=float32 (1, 40, 4), full=False)"


@pytest.mark.parametrize("name", results())
def test_no_array_is_printed(name: str) -> None:
    shown = repr(results()[name])
    assert shown.startswith(f"{type(results()[name]).__name__}(")
    assert len(shown) < WORDS
    assert "\n" not in shown
    assert "array(" not in shown


def test_what_is_printed_says_what_it_is() -> None:
    shown = {name: repr(it) for name, it in results().items()}
    assert shown["record"] == (
        f"Record(t_ns=int64 ({ROWS},), values=float64 ({ROWS}, 2), channels=['FW', 'FB'], metadata={{path}})"
    )
    assert "condition='385'" in shown["pair"]
    assert "offset=Offset(offset=0.25, gain=1.0, std=1e-06, explained=1.0)" in shown["pair"]
    assert shown["diagnosis"] == "Diagnosis(agreements=[20 x Agreement(...)], channels=['FW', 'FB'], band=[1.0, 10.0])"


def test_a_study_is_short(tmp_path: Path) -> None:
    study = fc.load_study(write(files(tmp_path), EXAMPLE))
    shown = repr(study)
    assert len(shown) < 2 * WORDS
    assert all(repr(channel.name) in shown for channel in study.channels)


def test_defaults_are_left_out_and_many_are_counted() -> None:
    @dataclass(frozen=True)
    class Some:
        many: tuple[int, ...]
        flag: bool = False
        text: str = "x"
        hidden: int = field(default=0, repr=False)
        empty: tuple[float, ...] = ()

        __repr__ = brief

    many = tuple(range(ENTRIES + 3))
    few = ", ".join(map(str, range(ENTRIES)))
    assert repr(Some(many, hidden=3)) == f"Some(many=[{few}, ... {ENTRIES + 3} in all])"
    assert repr(Some((1,), True, "y", 0, (2.0,))) == "Some(many=[1], flag=True, text='y', empty=[2.0])"
