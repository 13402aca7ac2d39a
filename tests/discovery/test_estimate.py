"""What `inspect` expects a discovery to cost, held against what it then cost. The truth is integrated by scipy."""

import json

import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from click.testing import CliRunner
from one_mass import begun
from test_discover import cubic, write_study

from fmucorrect.cli import main
from fmucorrect.discovery import estimate
from fmucorrect.discovery.look import around
from fmucorrect.discovery.problem import load
from fmucorrect.study import load_study


def test_runs_that_inspect_expects_are_about_those_that_discover_takes(found):
    folder, report = found
    told = CliRunner().invoke(main, ["inspect", str(folder / "study.toml"), "--json"])
    assert told.exit_code == 0, told.output
    (cost,) = json.loads(told.output)["discover"]
    low, high = cost["runs"]
    assert 0.5 * low < report["cost"]["runs"] < high
    assert cost["seconds_a_run"] < 0.5  # 6000 steps of a shipped FMU, not of a process that is asked for each


def test_a_dear_solver_is_expected_to_take_fewer_runs(found, monkeypatch):
    study = load_study(found[0] / "study.toml")
    cheap = estimate.estimate(study, ())
    monkeypatch.setattr(estimate, "DEAR", 0.0)
    dear = estimate.estimate(study, ())
    assert dear.few
    assert not cheap.few
    assert dear.runs[1] < 0.4 * cheap.runs[1]
    assert "its linear response" in dear.text


def test_candidates_are_counted_without_a_run(library, tmp_path):
    with load(load_study(write_study(tmp_path, cubic)), library, 2) as problem:
        _, base = begun(problem)
        every = around(problem, base).curves(base)
        assert estimate._curves(problem) == pytest.approx(len(every), rel=0.15)


def test_a_solver_that_does_not_run_so_has_no_estimate(found, monkeypatch):
    folder, _ = found
    monkeypatch.setattr(estimate, "_pace", os_exit)
    assert estimate.estimate(load_study(folder / "study.toml"), ()) is None


def os_exit(path, rows, workers):
    import os

    os._exit(3)
