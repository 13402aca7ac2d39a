"""Names in a card are names: no HTML, no link, no other cell or line."""

import re

import pytest

from fmucorrect.training.card import _plain


@pytest.mark.parametrize(
    "name",
    ["<script>alert(1)</script>", "a | b", "x\n# y", "[x](javascript:y)", "![x](y)", "`x`", "**x**", "&lt;", "_x_"],
)
def test_a_name_is_no_markup(name: str) -> None:
    assert not re.search(r"(?<!\\)[<>|`*\[\]#&!]", _plain(name))
    assert "\n" not in _plain(name)


def test_a_plain_name_stays() -> None:
    assert _plain("FW_corrected (mm/s), Δx") == "FW_corrected (mm/s), Δx"
