"""What a notebook prints of a result that has no table of its own: what it is, in a line or two, and no array."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

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
