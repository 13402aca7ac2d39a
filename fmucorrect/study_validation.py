"""What the tables of a study file have in common: nothing unknown, nothing converted, and errors in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict

from fmucorrect.study_places import nearest


class Table(BaseModel):
    """A table that takes no other keys than its own and no string for a number."""

    model_config = ConfigDict(extra="forbid", strict=True)


TYPES = {
    "string_type": "a string in quotes",
    "float_type": "a number",
    "list_type": "an array, as [ ... ]",
    "dict_type": "a table, as { key = value }",
    "model_type": "a table",
    "finite_number": "a finite number",
    "string_too_short": "a name, not empty",
    "too_long": "of two numbers, as [begin, end]",
}


def message(error: Mapping[str, Any], fields: Mapping[str, Any]) -> str:
    """What is wrong, what was expected, what stands there; `fields`: the keys that the table has, by name."""
    kind, loc, value = error["type"], error["loc"], error["input"]
    if kind == "extra_forbidden":
        return f"is not known{nearest(loc[-1], fields) or '; known here: ' + ', '.join(fields)}"
    if kind == "missing":
        return f"is missing: {fields[loc[-1]].description}"
    if kind == "literal_error":
        expected = str(error["ctx"]["expected"])
        quoted, known = "'" in expected, expected.replace("'", "").replace(" or ", ", ").split(", ")
        return f"must be {expected}, got {value!r}{nearest(value, known) if isinstance(value, str) and quoted else ''}"
    if kind == "value_error":
        return str(error["ctx"]["error"])
    if kind == "too_short" and loc[-1] == "quiet":
        kind = "too_long"
    expected = f"must be {TYPES[kind]}" if kind in TYPES else error["msg"].replace("Input should", "must")
    return f"{expected}, got {value!r}"
