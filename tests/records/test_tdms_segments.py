"""TDMS files that were appended to: what a later segment says otherwise, and scales that nobody knows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nptdms
import numpy as np
import pytest

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.signals import join

ROWS = np.arange(400.0)
WAVE: dict[str, Any] = {"wf_increment": 0.001, "wf_start_offset": 0.0, "unit_string": "mm"}
MIDNIGHT = np.datetime64("2024-01-01T00:00:00")
HOUR = np.timedelta64(1, "h")


def channel(name: str, rows: np.ndarray = ROWS, **changed: Any) -> nptdms.ChannelObject:
    return nptdms.ChannelObject("g", name, rows, {**WAVE, **changed})


def save(folder: Path, *segments: list[nptdms.ChannelObject]) -> Path:
    path = folder / "run.tdms"
    with nptdms.TdmsWriter(str(path)) as file:
        for segment in segments:
            file.write_segment(segment)
    return path


def test_each_part_has_its_own_start(tmp_path: Path) -> None:
    path = save(tmp_path, [channel("x", wf_start_time=MIDNIGHT)], [channel("x", wf_start_time=MIDNIGHT + HOUR)])
    record = records.read(path)
    later = 3600 * 10**9
    assert record.t_ns.tolist() == [*(10**6 * i for i in range(400)), *(later + 10**6 * i for i in range(400))]
    assert record.metadata["wf_start_time"].startswith("2024-01-01T00:00:00")
    assert "each of its 2 parts" in record.metadata["assumed"]
    assert join(list(records.stream(path, rows=99))).t_ns.tolist() == record.t_ns.tolist()


def test_a_start_that_goes_on_from_the_one_before_is_no_gap(tmp_path: Path) -> None:
    starts = [MIDNIGHT + np.timedelta64(400 * i, "ms") for i in range(5)]
    record = records.read(save(tmp_path, *([channel("x", wf_start_time=start)] for start in starts)))
    assert record.t_ns.tolist() == [10**6 * i for i in range(2000)]
    assert "assumed" not in record.metadata


def test_a_start_told_behind_the_values_is_that_of_all(tmp_path: Path) -> None:
    last = nptdms.ChannelObject("g", "x", np.empty(0), {"wf_start_time": MIDNIGHT + HOUR, "unit_string": "m"})
    record = records.read(save(tmp_path, [channel("x", wf_start_time=MIDNIGHT)], [last]))
    assert record.t_ns.tolist() == [10**6 * i for i in range(400)]
    assert record.metadata["wf_start_time"].startswith("2024-01-01T01:00:00")
    assert record.channels[0].unit == "m"


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("unit_string", "m"),
        ("wf_increment", 0.002),
        ("wf_start_offset", 1.0),
        ("NI_Scale[0]_Linear_Slope", 3.0),
    ],
)
def test_what_changes_the_meaning_of_numbers_leaves_the_channel_out(key: str, value: Any, tmp_path: Path) -> None:
    scale: dict[str, Any] = {
        "NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 2.0,
        "NI_Scale[0]_Linear_Y_Intercept": 0.0,
    }  # fmt: skip
    path = save(tmp_path, [channel("x", **scale), channel("y")], [channel("x", **{**scale, key: value}), channel("y")])
    assert records.read(path).names == ("y",)
    (told,) = records.describe(path).left_out
    assert f"its {key} changes" in told
    assert "at row 400" in told
    path = save(tmp_path, [channel("x", **scale)], [channel("x", **scale)])
    assert records.read(path)["x"].tolist() == [*(2 * ROWS), *(2 * ROWS)]


def test_the_unit_of_a_time_channel_may_not_change(tmp_path: Path) -> None:
    def part(first: float, unit: str) -> list[nptdms.ChannelObject]:
        return [nptdms.ChannelObject("g", "time", first + ROWS, {"unit_string": unit}), channel("x")]

    assert len(records.read(save(tmp_path, part(0, "ms"), part(400, "ms")))) == 800
    with pytest.raises(RecordError, match=r"its time: its unit_string changes: ms becomes s at row 400"):
        records.read(save(tmp_path, part(0, "ms"), part(400, "s")))


@pytest.mark.parametrize("before", [["x", "y"], ["x"], []])
def test_a_channel_that_was_missing_for_a_while_is_left_out(before: list[str], tmp_path: Path) -> None:
    first = [[channel(name) for name in before]] if before else []
    path = save(tmp_path, *first, [channel("x")], [channel("x"), channel("y")])
    assert records.read(path).names == ("x",)
    (told,) = records.describe(path).left_out
    assert "'g/y': it was missing" in told


def test_channels_written_by_turns_or_that_ended_are_whole(tmp_path: Path) -> None:
    by_turns = save(tmp_path, *([channel(name)] for name in "xyxyxy"))
    assert records.read(by_turns).names == ("x", "y")
    ended = save(tmp_path, [channel("x"), channel("y")], [channel("x")])
    assert len(records.read(ended, ["x"])) == 800
    assert len(records.read(ended, ["y"])) == 400


@pytest.mark.parametrize("kind", ["Reciprocal", "String"])
def test_counts_of_an_unknown_scale_are_no_measurement(kind: str, tmp_path: Path) -> None:
    counts = ROWS.astype("i2")
    scale: dict[str, Any] = {
        "NI_Number_Of_Scales": 1,
        "NI_Scale[0]_Scale_Type": kind,
        "NI_Scale[0]_Linear_Slope": 0.001,
    }
    path = save(tmp_path, [channel("x", counts, **scale), channel("y")])
    assert records.read(path).names == ("y",)
    assert records.describe(path).left_out == (
        f"channel 'g/x': its numbers are counts of a scale that is not known ({kind})",
    )
    path = save(tmp_path, [channel("x", counts, **scale, NI_Scaling_Status="scaled")])
    assert records.read(path)["x"].tolist() == ROWS.tolist()


def test_an_index_of_another_file_is_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "run.tdms"
    with nptdms.TdmsWriter(str(path), index_file=True) as file:
        file.write_segment([channel("x", unit_string="m")])
    assert path.with_name("run.tdms_index").is_file()
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment([channel("x")])
    assert records.read(path).channels[0].unit == "mm"
