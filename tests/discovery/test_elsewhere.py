"""Where candidates are simulated changes nothing: here, by an executor, in the workers of a dask cluster."""

import json
from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from fmucorrect.catalogue import find
from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.cli import main
from fmucorrect.discovery import elsewhere
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.terms import ForceTerm, OffsetTerm, SignalTerm
from fmucorrect.study import load_study


class Counting(Executor):
    """Does at once what it is given, which must be bytes alone."""

    def __init__(self):
        self.pieces = 0

    def submit(self, fn, /, *args, **kwargs):
        assert all(isinstance(value, bytes) for value in args)
        self.pieces += 1
        future = Future()
        future.set_result(fn(*args))
        return future


@pytest.fixture(scope="module")
def study(found):
    return load_study(found[0] / "study.toml")


def models(study, nominal):
    """A force of every size up to one that is not stable, a parameter, a sensor, base parameters."""
    law = find("cubic_stiffness", {})
    forces = [
        ForceTerm(law, "joint 2", (study.joints[1],), law.complete({"cubic_stiffness": size}))
        for size in (1e6, 2e7, -1e12)
    ]
    offset = OffsetTerm(study.adjustable[0], "k1", 24.0, -1000.0, 1000.0, {"value": 100.0}, "N/m")
    (gain,) = SIGNALS["sensor_gain"]
    sensor = SignalTerm(gain, "x1", (0,), {"gain": 1.1})
    found = [Model((term,), nominal.base) for term in (*forces, offset, sensor)]
    return [*found, Model((), (1.0, -1.0)), replace(nominal, terms=(forces[0], sensor))]


def test_an_executor_gives_the_same_to_the_bit(study, monkeypatch):
    monkeypatch.setattr(elsewhere, "PIECE", 15_000)  # two models
    executor, ticks = Counting(), []
    with load(study, elsewhere.library(), elsewhere=elsewhere.by(executor)) as problem:
        asked = models(study, problem.nominal)
        there = list(problem.many(asked, ticks.append))
        assert executor.pieces == 4
        assert len(list(problem.many(asked[:2]))) == 2
        assert executor.pieces == 4  # not worth the way
    with load(study, elsewhere.library()) as problem:
        here = list(problem.many(asked))
    assert sum(ticks) == len(asked)
    assert [row is None for row in here] == [row is None for row in there] == [False, False, True, *[False] * 4]
    assert all(a is None or (a == b).all() for a, b in zip(here, there, strict=True))
    assert np.abs(here[0] - here[1]).max() > 1.0


def test_what_was_measured_stays_here(study):
    """A piece of work holds the FMU and its inputs alone."""
    with load(study, None) as problem:
        parcel = elsewhere.unpacked(elsewhere.packed(elsewhere._parcel(problem)))
    assert len(parcel.files) == 3
    assert all(len(trial.measured) == 0 and trial.condition.measurement is None for trial in parcel.trials)


@pytest.mark.slow
def test_a_cluster_gives_the_same_report(study, found, tmp_path, monkeypatch):
    """`fmucorrect discover --scheduler`, two worker processes."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(elsewhere, "PIECE", 100_000)
    used = []
    parcels = elsewhere._parcel
    monkeypatch.setattr(elsewhere, "_parcel", lambda problem: used.append(1) or parcels(problem))

    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
    ) as cluster:
        order = ["discover", str(study.path), "-o", str(tmp_path / "out"), "--json"]
        done = CliRunner().invoke(main, [*order, "--scheduler", cluster.scheduler_address])
    assert done.exit_code == 0, done.output
    assert used
    there, here = json.loads(done.stdout), found[1]
    assert there | {"stages": None, "cost": None} == here | {"stages": None, "cost": None}


def test_a_scheduler_that_does_not_answer_is_said(study, tmp_path):
    pytest.importorskip("distributed")
    done = CliRunner().invoke(
        main, ["discover", str(study.path), "-o", str(tmp_path), "--scheduler", "tcp://127.0.0.1:9"]
    )
    assert done.exit_code == 2
    assert "scheduler does not answer" in done.output
