"""Records to and from pandas and xarray, what a notebook shows, and the names of the package."""

from __future__ import annotations

import inspect
import subprocess
import sys
from typing import get_type_hints

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import fmucorrect as fc
from fmucorrect.errors import MissingExtra, RecordError

T_NS = 1_700_000_000 * 10**9 + np.array([0, 1, 3, 1_000_000_007], np.int64)


def record() -> fc.Record:
    values = np.array([[1.0, -2.0], [3.0, 4.5], [0.1, 1e9], [7.0, 0.0]])
    return fc.Record(T_NS, values, (fc.Channel("a<b>", "mm"), fc.Channel("F", "N")), {"path": "run.mcap"})


def test_a_record_goes_through_pandas_unchanged() -> None:
    frame = record().to_pandas()
    assert frame["F"].iloc[1] == 4.5
    assert frame.index[1] - frame.index[0] == pd.Timedelta(1, "ns")
    back = fc.Record.from_pandas(frame)
    assert back.t_ns.tolist() == T_NS.tolist()
    np.testing.assert_array_equal(back.values, record().values)
    assert [(c.name, c.unit) for c in back.channels] == [("a<b>", "mm"), ("F", "N")]
    assert back.metadata["path"] == "run.mcap"


@pytest.mark.parametrize(
    ("index", "t_ns"),
    [
        (pd.Index([0.0, 0.1, 86400.25]), [0, 10**8, 86400 * 10**9 + 25 * 10**7]),
        (pd.Index([0, 1, 2]), [0, 10**9, 2 * 10**9]),
        (pd.to_datetime(["1970-01-01 01:00:00.5+01:00", "1970-01-01 01:00:01.0+01:00", "1970-01-01 01:00:02.0+01:00"]),
         [5 * 10**8, 10**9, 2 * 10**9]),
        (pd.date_range("1970-01-01", periods=3, freq="ms"), [0, 10**6, 2 * 10**6]),
    ],
    ids=["seconds", "whole seconds", "a zone", "ms"],
)  # fmt: skip
def test_times_of_pandas(index: pd.Index, t_ns: list[int]) -> None:
    frame = pd.DataFrame({"q": [1, 2, 3], "on": [True, False, True]}, index=index)
    read = fc.Record.from_pandas(frame, units={"q": "mm"})
    assert read.t_ns.tolist() == t_ns
    assert read["on"].tolist() == [1, 0, 1]
    assert [c.unit for c in read.channels] == ["mm", "1"]


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (pd.DataFrame({"q": ["a", "b"]}, index=[0.0, 1.0]), "'q' holds no numbers"),
        (pd.DataFrame({"q": [1.0, np.nan]}, index=[0.0, 1.0]), "'q' is nan at row 1"),
        (pd.DataFrame({"q": [1.0, 2.0]}, index=["x", "y"]), "index is no time"),
        (pd.DataFrame({"q": [1.0, 2.0]}, index=[1.0, 0.0]), "does not increase at row 1"),
        (pd.DataFrame({"q": [1.0, 2.0]}, index=pd.DatetimeIndex([pd.Timestamp(0), pd.NaT])), "NaT"),
    ],
)
def test_tables_that_are_no_records(frame: pd.DataFrame, words: str) -> None:
    with pytest.raises(RecordError, match=words):
        fc.Record.from_pandas(frame)


def test_a_dataset_of_xarray() -> None:
    time = ("time", [0.0, 0.5])
    data = xr.Dataset({"q": ("time", [1.0, 2.0], {"units": "mm"}), "F": ("time", [3, 4])}, {"time": time})
    read = fc.Record.from_xarray(data)
    assert read.t_ns.tolist() == [0, 5 * 10**8]
    assert [(c.name, c.unit) for c in read.channels] == [("q", "mm"), ("F", "1")]
    assert read["F"].tolist() == [3, 4]
    with pytest.raises(RecordError, match="'m' does not lie over 'time' alone"):
        fc.Record.from_xarray(data.assign(m=(("time", "k"), np.ones((2, 3)))))
    with pytest.raises(RecordError, match="no coordinate 't'"):
        fc.Record.from_xarray(data, "t")


def test_without_pandas_an_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("pandas", "xarray"):
        monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtra, match=r"fmucorrect\[pandas\]"):
        record().to_pandas()
    with pytest.raises(MissingExtra, match=r"fmucorrect\[xarray\]"):
        fc.Record.from_xarray(xr.Dataset())


def test_what_a_notebook_shows_is_escaped_and_has_every_peak() -> None:
    shown = record()._repr_html_()
    assert "a&lt;b&gt;" in shown
    assert "<b>" not in shown
    assert "4 rows" in shown
    svg = str(record().plot())
    assert "a&lt;b&gt; [mm]" in svg
    assert svg.count("<polyline") == 2
    t_ns = np.arange(100_000, dtype=np.int64)
    values = np.zeros((len(t_ns), 1))
    values[12_345] = 1.0
    lone = str(fc.Record(t_ns, values, (fc.Channel("x"),)).plot())
    assert "24.0" in lone.split('points="')[1]  # the top of the curve
    empty = fc.Record(t_ns[:0], values[:0], (fc.Channel("x"),))
    assert "0 rows" in empty._repr_html_()
    assert "polyline" not in str(empty.plot())
    assert "[N]" not in str(record().plot(["a<b>"]))


def test_public_names_are_there_typed_and_say_units_and_shapes() -> None:
    assert set(fc.__all__) | {"__version__"} == set(dir(fc))
    for name in fc.__all__:
        thing = getattr(fc, name)
        said = inspect.getdoc(thing) or ""
        assert said, f"{name} has no docstring"
        if inspect.isfunction(thing):
            hints = inspect.get_annotations(thing)
            missing = set(inspect.signature(thing).parameters) - set(hints)
            assert not missing, f"{name}: {missing} has no type"
            arrays = [key for key, hint in hints.items() if "ndarray" in str(hint) or "Float64" in str(hint)]
            assert not arrays or "(" in said, f"{name} takes arrays {arrays} and says no shape"
        elif inspect.isclass(thing) and not issubclass(thing, Exception):
            for key, member in vars(thing).items():
                if callable(member) and not key.startswith("_"):
                    # what a stepper's or corrector's method does stands on the interface
                    told = [inspect.getdoc(getattr(one, key, None)) for one in (thing, fc.Stepper, fc.Corrector)]
                    assert any(told), f"{name}.{key} has no docstring"
    assert get_type_hints(fc.Channel)["unit"] is str


def test_import_is_light_and_a_missing_extra_is_told() -> None:
    code = (
        "import sys, fmucorrect as fc; heavy = {'torch', 'pandas', 'xarray', 'plotly', 'scipy', 'numpy'} & set(sys.modules);"
        "assert not heavy, heavy; sys.modules['torch'] = None\n"
        "try: fc.train\nexcept ImportError as e: print(e)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "fmucorrect[train]" in ran.stdout
