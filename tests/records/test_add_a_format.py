"""The format that records/README.md shows how to add."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.records import assemble
from fmucorrect.records.guarded import Guarded
from fmucorrect.signals import AS_IT_IS, Record

README = Path(records.__file__).with_name("README.md").read_text(encoding="utf-8")


def test_the_shown_format_is_read(tmp_path: Path) -> None:
    made: dict[str, Any] = {"__name__": "shown"}
    exec(re.search(r"```python\n(.*?)```", README, re.DOTALL).group(1), made)
    path = tmp_path / "run.lines"

    def read(columns: list[str]) -> Record:
        return assemble.whole(Guarded(str(path), made["LinesSource"]), columns, None, None, AS_IT_IS)

    path.write_text("a 0 1.5\nb 0.5 7\na 0.25 2.5\n")
    assert read(["a.value"]).t_ns.tolist() == [0, 250_000_000]
    assert read(["a.value"]).values.tolist() == [[1.5], [2.5]]
    assert read(["b.value"]).t_ns.tolist() == [500_000_000]
    path.write_text("a 0 1.5\na 0.25\n")
    with pytest.raises(RecordError, match="line 2 is wrong, expected series time value"):
        read(["a.value"])


def test_the_table_names_every_suffix() -> None:
    for suffix in records.READ:
        assert suffix.removesuffix(".gz") in README, suffix
