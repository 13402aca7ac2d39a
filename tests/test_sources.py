"""What drives a run: how long it is, and when that cannot be meant."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from fmucorrect import sources
from fmucorrect.errors import RecordError
from fmucorrect.study import load_study

STUDY = load_study(Path(__file__).parents[1] / "fmus" / "roller_rig" / "A" / "study.toml")


def test_a_clock_that_jumps_asks_for_no_run_of_years(tmp_path: Path):
    measured = tmp_path / "measured.csv"
    measured.write_text("time,y [mm]\n0.0,1.0\n1714979289.5,1.0\n1714979289.501,1.0\n")
    condition = replace(STUDY.conditions[0], measurement=measured)
    for ask in (sources.expected_rows, lambda *arguments: next(sources.inputs(*arguments))):
        with pytest.raises(RecordError, match=r"stamps go from 0 s to 1714979289\.\d+ s in 3 rows") as caught:
            ask(STUDY, condition)
        assert str(caught.value).startswith(str(measured))
    assert sources.expected_rows(STUDY, condition, 10.0) == 10_001


def test_a_run_of_years_is_not_meant_either():
    with pytest.raises(RecordError, match=r"1e\+12 samples, expected at most 1e\+09 samples"):
        sources.expected_rows(STUDY, STUDY.conditions[0], 1e9)
