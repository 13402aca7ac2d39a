"""Files that are cut off anywhere, and commands that are killed anywhere."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

pytest.importorskip("asammdf")
pytest.importorskip("nptdms")
pytest.importorskip("pyarrow")
pytest.importorskip("h5py")

import seeds
from generators import Workshop
from judge import Case, Judge
from kills import SCENARIOS, Killer

from fmucorrect import records

CUTS = 16


@pytest.mark.parametrize("suffix", records.SUFFIXES)
def test_a_file_cut_anywhere_gives_a_prefix_or_an_error(suffix: str, judge: Judge, workshop: Workshop) -> None:
    found = [seed for seed in workshop.record_seeds if seed.suffix == suffix]
    assert found
    problems = []
    for seed in found:
        name = f"run{suffix}"
        case = Case("cut", seed.name, {name: seed.path}, (("read-cut", name, str(CUTS)),), name)
        assert not judge.problem(case)
        for line in (judge.folder / "out.txt").read_text("utf-8").splitlines():
            size, rows, told = json.loads(line)
            # a table of text has no count: whole lines are a whole file; so are whole segments of TDMS
            silent_end = (seed.data[:size].endswith((b"\n", b"\r")) and suffix == ".csv") or size in seed.ends
            if rows is not None and (told == "OTHER NUMBERS" or (rows < seeds.ROWS and not told and not silent_end)):
                problems.append(f"{seed.name} cut at {size}: {rows} rows, {told or 'and nothing said'}")
    assert not problems


@pytest.mark.parametrize("name", [pytest.param("run", marks=pytest.mark.slow), "replay"])
def test_a_command_killed_anywhere(name: str, tmp_path: Path) -> None:
    killer, scenario = Killer(tmp_path), next(one for one in SCENARIOS if one.name == name)
    outcomes = [killer.kill(random.Random(f"{name} {number}"), [scenario]) for number in range(2)]
    assert not [outcome for outcome in outcomes if outcome.bad]
