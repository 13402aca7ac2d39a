"""How far a command is, where no terminal shows a bar."""

import threading

import pytest

from fmucorrect.cli import group


def test_a_line_after_half_a_minute_then_each_minute(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [100.0]
    monkeypatch.setattr(group.time, "monotonic", lambda: now[0])
    with group.progress_bar(10, "epoch", "train") as advance, group.stages("discover") as progress:
        for _ in range(10):
            now[0] += 20.0
            advance(1)
            progress("fit", 3, 7)
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.splitlines() == [
        *("train: 2 of 10 epochs, 40 s, 3 min more at this pace, or less", "discover, fit: 3 of 7, 40 s"),
        *("train: 5 of 10 epochs, 2 min, 2 min more at this pace, or less", "discover, fit: 3 of 7, 2 min"),
        *("train: 8 of 10 epochs, 3 min, 40 s more at this pace, or less", "discover, fit: 3 of 7, 3 min"),
    ]


def test_a_long_stage_goes_on_being_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Between two of its steps, too."""
    told = threading.Event()
    monkeypatch.setattr(group, "AGAIN", 0.001)
    for wait in ("MINUTE", "BEGINNING"):
        monkeypatch.setattr(group, wait, 0.0)
    said = group.click.echo

    def echo(text: str, err: bool) -> None:
        said(text, err=err)
        if threading.current_thread() is not threading.main_thread():
            told.set()

    monkeypatch.setattr(group.click, "echo", echo)
    before = threading.active_count()
    with group.stages("discover") as progress:
        progress("ending", 0, 0)
        assert told.wait(60.0)
    assert {*capsys.readouterr().err.splitlines()} == {"discover, ending: 0 of 1, 0 min"}
    assert threading.active_count() == before


def test_what_a_step_says_is_told_without_a_terminal_too(capsys: pytest.CaptureFixture[str]) -> None:
    """What each kind of corrector leaves where conditions were left out: a first estimate long before the end."""
    with group.progress_bar(10, "epoch", "train"):
        group.note("linear filter: NRMSE (%) when left out: a 4.20")
    assert capsys.readouterr().err == "linear filter: NRMSE (%) when left out: a 4.20\n"


def test_a_short_command_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with group.progress_bar(None, "sample", "385") as advance:
        advance(1000)
    assert capsys.readouterr().err == ""


def test_what_came_before_the_first_step_is_no_part_of_the_pace(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Reading and simulating took 39 s; of 100 epochs one takes a second then."""
    now = [0.0]
    monkeypatch.setattr(group.time, "monotonic", lambda: now[0])
    with group.progress_bar(100, "epoch", "train") as advance:
        now[0] = 39.0
        for _ in range(20):
            advance(1)
            now[0] += 1.0
    assert capsys.readouterr().err.splitlines() == [
        "train: 1 of 100 epochs, 39 s",
        "train: 16 of 100 epochs, 54 s, 1 min more at this pace, or less",
    ]
