"""Names from a file are shown as they are: they neither steer a terminal nor become markup."""

from pathlib import Path

import bundles
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from fmucorrect import cli
from fmucorrect.errors import FmucorrectError, RecordError, StudyError, one_line, printable
from fmucorrect.report.base.html import Page, Row
from fmucorrect.signals import Channel

STEERING = ["\x1b[2J", "\x9b31m", "\u202e", "\u2066", "\x07", "\r", "\u2028", "\ud800", "\x7f"]


@given(st.text(st.characters()))
def test_nothing_that_steers_is_left(text: str) -> None:
    shown = printable(text)
    assert all(c.isprintable() or c.isspace() or ord(c) > 0xA0 for c in shown)
    assert not any(mark in shown for mark in "\x1b\x9b\u202e\u2066\r\x07")
    assert "\n" not in one_line(text)
    shown.encode()


def test_what_is_printable_stays() -> None:
    text = "Prüfstand 1, Δx [µm]\n\tzweite Zeile \U0001f682 通道"
    assert printable(text) == text


@pytest.mark.parametrize("mark", STEERING)
def test_an_error_shows_them(mark: str) -> None:
    said = str(
        RecordError(f"channel {mark}", where=f"a{mark}\nb", expected=mark, got=f"{mark}\nx", remedy="Rename it.")
    )
    assert mark not in said
    assert "\n" not in said
    assert mark not in str(StudyError(f"a{mark}", [f"unknown {mark}", "two"]))
    assert str(StudyError("a", ["one", "two"])).count("\n") == 2


def test_an_error_of_several_lines_keeps_them() -> None:
    assert str(FmucorrectError("the compiler refused:\nline 1\nline 2")).count("\n") == 2


@pytest.mark.parametrize("mark", ["\x1b[2J", "\u202e", "a\nfake: line"])
def test_inspect_shows_them(mark: str, tmp_path: Path) -> None:
    channels = (Channel(f"FW{mark}", "mm", simulation="x"), *bundles.CHANNELS[1:])
    path = bundles.make(tmp_path / "corrector.onnx", channels)
    done = CliRunner().invoke(cli.main, ["inspect", str(path)])
    assert done.exit_code == 0
    assert mark not in done.output
    assert f"FW{one_line(mark)}" in done.output


def test_a_page_takes_no_name_for_markup() -> None:
    go = pytest.importorskip("plotly.graph_objects")
    name = "</script><!--<script><img src=x onerror=alert(1)>"
    page = Page(name, name, name)
    page.section(name, name)
    page.table([name], [Row([name])])
    page.figure(go.Figure([go.Scatter(x=[0], y=[1], name=name)]), [(name, {"xaxis": (0.0, 1.0)})])
    page.end()
    text = page.text()
    assert name not in text
    assert "<img" not in text
    assert "<!--<script" not in text
