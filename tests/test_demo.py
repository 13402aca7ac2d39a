"""The demonstration from end to end: its files, and that what it prints is what its files hold."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import bundles
import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

import fmucorrect
from fmucorrect import cli, demo, records
from fmucorrect.demo import Data, Result
from fmucorrect.errors import RecordError
from fmucorrect.metrics import score

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "fmus" / "roller_rig" / "A" / "study.toml"
CORRECTOR = ROOT / "exported_models" / "roller_rig" / "corrector.onnx"
NAMES = ["FW", "FB", "RW", "RB"]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Data:
    """With the shipped corrector where there is one."""
    return Data(STUDY, CORRECTOR if CORRECTOR.exists() else bundles.make(tmp_path_factory.mktemp("m") / "toy.onnx"))


@pytest.fixture(scope="module")
def result(data: Data, tmp_path_factory: pytest.TempPathFactory) -> Result:
    steps: list[str] = []
    made = demo.run_demo(tmp_path_factory.mktemp("demo"), data, steps.append)
    assert steps == list(demo.STEPS)
    return made


def test_printed_figures_are_those_of_its_record(result: Result) -> None:
    corrected = records.read(
        result.record, [*(f"{n}_corrected" for n in NAMES), "corrector_status"], topic="/corrected"
    )
    simulated = records.read(result.record, NAMES, topic="/simulation")
    measured = records.read(result.record, [f"{n}_measured" for n in NAMES], topic="/measured")
    rows = np.searchsorted(simulated.t_ns, measured.t_ns)
    assert np.array_equal(simulated.t_ns[rows], measured.t_ns)
    scored = corrected["corrector_status"][rows] != 1.0
    before = score(simulated.values[rows][scored], measured.values[scored])
    after = score(corrected.values[rows, :4][scored], measured.values[scored])
    for label, scores in (("simulated", before), ("corrected", after)):
        line = next(line for line in demo.table(result.comparison).splitlines() if line.startswith(label))
        expected = [scores.mean_r2, *scores.r2, scores.mean_nrmse, scores.mean_nmae]
        assert [float(cell) for cell in line.split()[1:]] == pytest.approx(expected, abs=6e-5)


def test_the_uncorrected_simulation_is_as_bad_as_the_study_says(result: Result) -> None:
    assert -1.0 < result.comparison.before.mean_r2 < -0.7
    assert 13.0 < result.comparison.before.mean_nrmse < 15.5


@pytest.mark.skipif(not CORRECTOR.exists(), reason="the shipped corrector is not there")
def test_the_shipped_corrector_reaches_the_paper(result: Result) -> None:
    assert demo.unseen(result.comparison, result.model)
    assert result.comparison.after.mean_r2 >= 0.82
    assert (result.comparison.after.r2 > 0.79).all()


def test_one_sample_a_call_gives_the_same(result: Result) -> None:
    assert result.online.difference <= 1e-6
    assert result.online.step < 1e-3  # faster than the samples come


def test_oracle_is_apart_and_said_to_be_no_score(result: Result) -> None:
    lines = demo.table(result.comparison).splitlines()
    oracle = next(line for line in lines if "best single time shift" in line)
    assert "no score" in oracle
    assert lines.index(oracle) == len(lines) - 1


@pytest.mark.slow
def test_the_command_from_an_empty_folder_without_torch(
    data: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = (
        "import sys; from pathlib import Path\n"
        "class NoTorch:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] == 'torch': raise ImportError('torch is not installed')\n"
        "sys.meta_path.insert(0, NoTorch())\n"
        "from fmucorrect import cli, demo\n"
        f"data = demo.Data(Path({str(data.study)!r}), Path({str(data.corrector)!r}))\n"
        "demo.find_data = lambda: data\n"
        "cli.main(['demo'])"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUTF8": "1"}
    command = [sys.executable, "-c", code]
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8")
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.startswith("At 385 km/h, which the corrector never saw, the error ")
    for text in ("paper: proposed method", "0.8197", "virtual rig", "Try next", "fmucorrect replay", "fmucorrect wrap"):
        assert text in ran.stdout
    assert {file.name for file in (tmp_path / "fmucorrect-demo").iterdir()} == {
        ".fmucorrect",
        "demo.mcap",
        "demo.html",
        "demo.foxglove.json",
        "corrector.onnx",
        "roller_rig.fmu",
    }
    log = tmp_path / "fmucorrect-demo" / "demo.mcap"
    fields = {f"{t.topic.name}.{c.name}" for t in records.describe(log).topics for c in t.topic.columns}
    panels = json.loads((log.parent / "demo.foxglove.json").read_text())["configById"].values()
    assert {path["value"] for panel in panels for path in panel["paths"]} <= fields
    with log.open("rb") as stream:
        made = next(iter(make_reader(stream).iter_metadata())).metadata
    assert made == {
        "fmucorrect_version": fmucorrect.__version__,
        "study_sha256": hashlib.sha256(data.study.read_bytes()).hexdigest(),
        "corrector_sha256": hashlib.sha256(data.corrector.read_bytes()).hexdigest(),
    }
    monkeypatch.chdir(tmp_path)
    replay = next(line for line in ran.stdout.splitlines() if "fmucorrect replay" in line)
    words = replay.split()[1:]
    again = CliRunner().invoke(cli.main, words)
    assert again.exit_code == 0, again.output


def test_figures_as_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, result: Result) -> None:
    monkeypatch.setattr(demo, "run_demo", lambda *_, **__: result)
    ran = CliRunner().invoke(cli.main, ["demo", "-o", str(tmp_path / "out"), "--json"])
    figures = json.loads(ran.stdout)
    assert figures["corrected"]["mean_r2"] == result.comparison.after.mean_r2
    assert set(figures["simulated"]["nrmse"]) == set(NAMES)


def test_missing_files_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "__file__", str(tmp_path / "fmucorrect" / "demo.py"))
    with pytest.raises(RecordError, match=r"study\.toml"):
        demo.find_data()
