"""Objects of JSON as dataclasses: blanks for what is missing, one sentence for what is of another type."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from fmucorrect.report.base.json_table import Numbers, read
from fmucorrect.report.discovery.content import Discovery


@dataclass(frozen=True)
class Part:
    size: float
    name: str


@dataclass(frozen=True)
class Whole:
    from_: Numbers
    part: Part
    perhaps: Part | None
    rows: Sequence[Part]
    named: Mapping[str, Sequence[str]]
    whether: bool = True


def test_each_key_is_what_its_field_says() -> None:
    text = {"from": [1, None, 2.5], "part": {"size": 3, "other": "x"}, "perhaps": {"name": "b"}}
    found = read(Whole, text | {"rows": [{"name": "c"}, None], "named": {"d": ["e"]}, "whether": False}, "it")
    np.testing.assert_array_equal(found.from_, [1.0, np.nan, 2.5])
    assert (found.part.size, type(found.part.size), found.part.name) == (3.0, float, "")
    assert found.perhaps is not None
    assert found.perhaps.name == "b"
    assert [part.name for part in found.rows] == ["c", ""]
    assert (found.named, found.whether) == ({"d": ("e",)}, False)


@pytest.mark.parametrize("given", [{}, dict.fromkeys(("from", "part", "perhaps", "rows", "named", "whether"))])
def test_what_is_missing_or_null_is_blank(given: dict[str, Any]) -> None:
    found = read(Whole, given, "it")
    assert (len(found.from_), found.perhaps, found.rows, found.named, found.whether) == (0, None, (), {}, True)
    assert (np.isnan(found.part.size), found.part.name) == (True, "")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "it: expected an object, got '[]'"),
        ({"part": {"size": "1"}}, "it.part.size: expected a number, got '1'"),
        ({"part": {"size": True}}, "it.part.size: expected a number, got 'True'"),
        ({"rows": {}}, "it.rows: expected a list, got '{}'"),
        ({"rows": [{}, {"name": 2}]}, "it.rows[1].name: expected a text, got '2'"),
        ({"from": [0.0, "1"]}, "it.from: expected a number, got '1'"),
        ({"named": {"d": [[]]}}, "it.named.d[0]: expected a text, got '[]'"),
        ({"whether": 1}, "it.whether: expected true or false, got '1'"),
    ],
)
def test_what_is_of_another_type_is_told_with_its_place(given: Any, said: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(said)}$"):
        read(Whole, given, "it")


def test_another_file_is_no_report() -> None:
    for other in ({}, {"cases": []}, {"verdict": None}):
        with pytest.raises(ValueError, match=r"report\.json: expected the report of a discovery, got no verdict"):
            Discovery.read(other)
