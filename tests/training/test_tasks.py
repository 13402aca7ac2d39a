"""Where a fit is done changes nothing: here, in other processes, on a cluster that loses a worker, or after a kill."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from closed_form import SMALL, make_study

from fmucorrect import cli
from fmucorrect.errors import TrainingError
from fmucorrect.pairs import pair
from fmucorrect.study import Study, load_study
from fmucorrect.training import loop
from fmucorrect.training.cases import Fitted, fit_case
from fmucorrect.training.data import Samples, samples
from fmucorrect.training.tasks import Context, Task, Workshop

LONG = replace(SMALL, proposed=replace(SMALL.proposed, epochs=120))


@pytest.fixture(scope="module")
def development(study: Study) -> list[Samples]:
    return [samples(pair(study, condition), SMALL.window) for condition in study.development]


def task(development: list[Samples], seed: int, key: str = "proposed") -> Task:
    return Task(f"seed {seed}", fit_case, (key, development[1:], development[:1], LONG, seed, {}), 160)


def same(a: Fitted, b: Fitted, item: Samples) -> bool:
    return np.array_equal(a.model.predict(item), b.model.predict(item)) and a.curves == b.curves


@pytest.fixture(scope="module")
def here(development: list[Samples]) -> list[Fitted]:
    return Workshop().run([task(development, seed) for seed in (0, 1)])


def test_processes_give_the_same_to_the_bit(development: list[Samples], here: list[Fitted], tmp_path: Path) -> None:
    ticks: list[int] = []
    there = Workshop(tmp_path, 2, advance=ticks.append).run([task(development, seed) for seed in (0, 1)])
    assert all(same(a, b, development[0]) for a, b in zip(here, there, strict=True))
    assert not same(here[0], here[1], development[0])
    assert sum(ticks) == 320
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".result", ".result"]


def test_finished_tasks_are_not_done_again(development: list[Samples], here: list[Fitted], tmp_path: Path) -> None:
    first = Workshop(tmp_path).run([task(development, 0)])
    begun = time.monotonic()
    again = Workshop(tmp_path).run([task(development, 0)])
    assert time.monotonic() - begun < first[0].seconds
    assert same(first[0], again[0], development[0])


@pytest.mark.parametrize("key", ["pinn", "tdnn_residual", "proposed", "gru"])
def test_an_interrupted_fit_goes_on_as_if_nothing_had_been(
    key: str, development: list[Samples], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "CHECKPOINT", 0.0)

    class Killed(Exception):
        pass

    def dies_after(epochs: int) -> Context:
        left = [epochs]

        def tick(n: int) -> None:
            left[0] -= n
            if left[0] < 0:
                raise Killed

        return Context(tmp_path / f"{key}.checkpoint", tick)

    arguments = (key, development[1:], development[:1], LONG, 3, {"gru": 40})
    whole = fit_case(Context(None, lambda _: None), *arguments)
    with pytest.raises(Killed):
        fit_case(dies_after(30), *arguments)
    assert (tmp_path / f"{key}.checkpoint").is_file()
    resumed = fit_case(Context(tmp_path / f"{key}.checkpoint", lambda _: None), *arguments)
    assert same(whole, resumed, development[0])


def test_a_key_names_what_is_done(development: list[Samples]) -> None:
    key = task(development, 0).key
    assert key == task(development, 0).key
    assert key != task(development, 1).key
    other = replace(development[1], measured=development[1].measured + 1e-9)
    assert key != task([development[0], other, *development[2:]], 0).key


@pytest.mark.slow
def test_the_command_goes_on_after_a_kill(tmp_path: Path) -> None:
    """SIGKILL in the middle of `fmucorrect train`; the same command gives the model of a run that was left alone."""
    path = make_study(tmp_path)
    path.write_text(
        path.read_text() + '\n[training]\nwindow = 8\n[training.corrector]\nfamilies = ["window"]\nbaseline_width = 6\n'
        "baseline_epochs = 8\nhistory = 4\n"
        "widths = [16, 16]\nmembers = 2\nepochs = [12, 18]\nbatch = 2048\nstride = 4\n"
    )

    killed, alone = tmp_path / "killed", tmp_path / "alone"
    command = [sys.executable, "-m", "fmucorrect", "train", str(path), "-o", str(killed)]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    end = time.monotonic() + 60.0
    while time.monotonic() < end and not list(killed.glob("work/*.result")) and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert list(killed.glob("work/*.result")), "killed before anything was finished"
    assert not (killed / "corrector.onnx").exists()
    for out in (killed, alone):
        ran = CliRunner().invoke(cli.main, ["train", str(path), "-o", str(out)])
        assert ran.exit_code == 0, ran.output
    assert (killed / "corrector.onnx").read_bytes() == (alone / "corrector.onnx").read_bytes()
    assert "NRMSE" in (alone / "train.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_the_same(
    development: list[Samples], here: list[Fitted], tmp_path: Path
) -> None:
    """dask.distributed, two worker processes, one of them killed while it works."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
    ) as cluster:
        victim = cluster.workers[0].pid
        killed: list[int] = []

        def advance(_: int) -> None:
            if not killed:
                killed.append(victim)
                os.kill(victim, signal.SIGKILL)

        tasks = [task(development, seed) for seed in (0, 1, 2, 3)]
        there = Workshop(tmp_path, scheduler=cluster.scheduler_address, advance=advance).run(tasks)
    assert killed
    assert all(same(a, b, development[0]) for a, b in zip(here, there, strict=False))


def dies(context: Context) -> None:
    os._exit(3)


def test_a_process_that_dies_is_said_and_nothing_is_lost(development: list[Samples], tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match=r"ended by itself.*Run the same command again"):
        Workshop(tmp_path, 2).run([Task("the bad one", dies, ())])


def test_a_gpu_that_is_not_there_is_said(development: list[Samples]) -> None:
    if torch.cuda.is_available():
        pytest.skip("there is one")
    with pytest.raises(TrainingError, match="torch sees no GPU here"):
        Workshop(device="cuda").run([task(development, 0)])


def test_a_scheduler_that_does_not_answer_is_said(development: list[Samples]) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(TrainingError, match="scheduler does not answer"):
        Workshop(scheduler="tcp://127.0.0.1:9").run([task(development, 0)])


def test_the_study_says_how_it_is_trained(tmp_path: Path) -> None:
    path = make_study(tmp_path)
    path.write_text(
        path.read_text() + "\n[training]\nwindow = 20\n[training.proposed]\nphysics = 0.5\nband = [1.0, 3.0]\n"
    )
    training = load_study(path).training
    assert training.window == 20
    assert training.proposed.physics == 0.5
    assert training.proposed.band == (1.0, 3.0)
    assert training.proposed.smooth == 1e-5  # the paper's
