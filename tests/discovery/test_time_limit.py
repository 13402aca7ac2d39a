"""A search that its time limit ends: a verdict so far, plainly marked, and the same search goes on. The truth is integrated by
scipy (test_discover)."""

import json
from types import SimpleNamespace

import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from click.testing import CliRunner
from one_mass import T
from test_discover import cubic, friction, write_study
from test_resuming import without_times
from test_stepwise import problem_of

from fmucorrect.cli import main
from fmucorrect.discovery import budget, discover, naming, stepwise
from fmucorrect.discovery.decide import decide
from fmucorrect.discovery.stepwise import AHEAD
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.report.discovery.page import lead

MB = 1e6


@pytest.fixture
def over_at(monkeypatch):
    """Lets the time be over where a stage begins its number-th piece: its progress."""
    now = [0.0]
    monkeypatch.setattr(budget, "time", SimpleNamespace(monotonic=lambda: now[0]))

    def at(stage, number):
        now[0] = 0.0

        def progress(name, done, total):
            if (name, done) == (stage, number):
                now[0] = float("inf")

        return progress

    return at


def limited(study, out, progress):
    return discover(study, out, progress=progress, time_limit=1e9)


def test_a_verdict_in_the_midst_is_marked_and_the_search_goes_on_to_the_same_end(tmp_path, over_at, found):
    folder, fresh = found
    study, out = folder / "study.toml", tmp_path / "out"
    nothing = limited(study, out, over_at("calibration", 0))
    assert nothing["verdict"] == "unexplained"
    assert "nothing that was looked at explains it" in nothing["sentence"]
    assert nothing["not_looked_at"][:2] == [AHEAD["parameters"], AHEAD["singles"]]
    assert not (out / "augmented.fmu").exists()
    some = limited(study, out, over_at("fits", 6))
    assert not some["complete"]
    assert [effect["effect"] for effect in some["effects"]] == ["cubic_stiffness"]
    assert AHEAD["singles"] in some["not_looked_at"]
    assert AHEAD["parameters"] not in some["not_looked_at"]
    assert some["sentence"].startswith("Verdict so far")
    assert "so far" in some.lines()[0]
    assert "--time-limit" in some.lines()[-1]
    assert lead(Discovery.read(some))[0].startswith("So far")
    assert "Not looked at yet" in (out / "report.html").read_text()
    assert (out / "augmented.fmu").exists()
    kept = sum(path.stat().st_size for path in (out / ".progress").iterdir())
    assert 0 < kept < 20 * MB
    # over where all is named, it is over for nothing: what is left is the verdict's
    assert without_times(limited(study, out, over_at("confirm", 0))) == without_times(fresh)
    assert fresh["complete"]
    assert not (out / ".progress").exists()


@pytest.mark.slow
def test_a_continued_search_learns_nothing_from_the_evaluation_conditions_that_were_shown(tmp_path, over_at, found):
    """They are others when it goes on, and what it finds is the same."""
    _, fresh = found
    study, out = write_study(tmp_path, cubic, garbage=True), tmp_path / "out"
    shown = limited(study, out, over_at("fits", 6))
    assert shown["verdict"] == "unexplained"  # they do not bear it out
    write_study(tmp_path, cubic)
    whole = discover(study, out)
    assert whole["candidates"] == fresh["candidates"]
    assert whole["effects"] == fresh["effects"]


@pytest.mark.slow
def test_files_of_a_verdict_so_far_go_where_the_last_one_has_none(tmp_path, over_at):
    out = tmp_path / "out"
    assert limited(write_study(tmp_path, cubic), out, over_at("fits", 6))["files"][2:]
    (out / "notes.txt").write_text("mine")
    assert limited(write_study(tmp_path, friction, garbage=True), out, over_at("calibration", 0))["files"] == [
        "report.json",
        "report.html",
    ]
    assert not (out / "augmented.fmu").exists()
    assert (out / "notes.txt").exists()


def test_the_command_takes_a_time_and_refuses_what_is_none(found, tmp_path):
    folder, _ = found
    run = CliRunner().invoke(
        main, ["discover", str(folder / "study.toml"), "-o", str(tmp_path / "o"), "--time-limit", "1ms"]
    )
    assert run.exit_code == 2
    assert "15min" in run.output
    run = CliRunner().invoke(
        main, ["discover", str(folder / "study.toml"), "-o", str(tmp_path / "o"), "--time-limit", "1s"]
    )
    assert run.exit_code == 0, run.output
    assert run.output.startswith("so far unexplained: Verdict so far, 1.00 s into")
    assert json.loads((tmp_path / "o" / "report.json").read_text())["complete"] is False


def test_ctrl_c_says_that_the_same_command_goes_on(found, tmp_path, monkeypatch):
    folder, _ = found

    def broken_off(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr("fmucorrect.discovery.stepwise.calibrated", broken_off)
    run = CliRunner().invoke(main, ["discover", str(folder / "study.toml"), "-o", str(tmp_path / "o")])
    assert run.exit_code == 130
    assert "the same command goes on" in run.output


@pytest.mark.parametrize(("begun", "conditions"), [("fits", 2), ("all conditions", 5)])
def test_a_verdict_stands_on_all_conditions_once_the_likeliest_set_was_fitted_to_them(
    library, tmp_path, monkeypatch, over_at, begun, conditions
):
    monkeypatch.setattr(stepwise, "QUICK", 2 * len(T))
    monkeypatch.setattr(stepwise, "PLACES", 1)
    with problem_of(tmp_path, library) as problem:
        problem.budget.until = 1e9
        over, seen = over_at("behind it", 0), []

        def progress(name, done, total):
            seen.append(name)
            if seen.count(begun) > 3 or (seen.count("all conditions") and name != begun):
                over("behind it", 0, 1)

        found = naming.name(problem, progress)
        with found.stopped.problem as stands:
            assert len(stands.trials) == conditions
            assert len(found.setting.measured) == len(stands.measured)
        assert "conditions" in found.stopped.ahead
        assert ("sets" in found.stopped.ahead) == (conditions == 2)
        assert {term.key for term in decide(found).best.model.terms} == {("cubic_stiffness", "joint 1")}
        assert problem.budget.until == float("inf")
