"""The examples of tools/examples say what CorrectedStepper says."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fmucorrect import sources
from fmucorrect.bundle import load
from fmucorrect.runs import run_study
from fmucorrect.stepper import CorrectedStepper, Status, run
from fmucorrect.study import load_study

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "tools" / "examples"
BUNDLE = ROOT / "exported_models" / "roller_rig" / "corrector.onnx"
DURATION = 12.0  # s; the excitation begins at 10 s, with a surge
CHANNELS = 4
CONDITION = ["385", "0.03", "2", "10"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """run.csv and run.mcap, as `fmucorrect run` writes them without a corrector."""
    path = tmp_path_factory.mktemp("examples")
    study = load_study(ROOT / "fmus" / "roller_rig" / "A" / "study.toml")
    for name in ("run.csv", "run.mcap"):
        run_study(study, study.condition("385"), path / name, duration=DURATION)
    return path


@pytest.fixture(scope="module")
def wanted() -> np.ndarray:
    """time, corrected, sigma, status"""
    study = load_study(ROOT / "fmus" / "roller_rig" / "A" / "study.toml")
    condition = study.condition("385")
    stepper = CorrectedStepper(sources.plant(study, condition), load(BUNDLE))
    result = run(stepper, condition, sources.inputs(study, condition, DURATION))
    stepper.close()
    assert result is not None
    return np.column_stack([result.t_ns / 1e9, result.values[:, -2 * CHANNELS - 1 :]])


@pytest.fixture(scope="module")
def correct(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The C example, generated and compiled as its README says."""
    pytest.importorskip("emx_onnx_cgen")
    build = tmp_path_factory.mktemp("c") / "build"
    generate = [sys.executable, str(EXAMPLES / "c" / "generate.py"), str(BUNDLE), str(build)]
    subprocess.run(generate, check=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
    compiler = [found] if (found := shutil.which("cc")) else [sys.executable, "-m", "ziglang", "cc"]
    if not found:
        pytest.importorskip("ziglang")
    program = build / "correct"
    files = [str(EXAMPLES / "c" / "correct.c"), *map(str, sorted(build.glob("network*.c")))]
    subprocess.run([*compiler, "-O2", "-o", str(program), "-I", str(build), *files, "-lm"], check=True)
    return program


def agree(path: Path, wanted: np.ndarray) -> None:
    header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    assert header[:2] == ["time", "FW_corrected [mm]"]
    assert header[-2:] == ["RB_sigma [mm]", "corrector_status"]
    got = np.loadtxt(path, delimiter=",", skiprows=1)
    assert got.shape == wanted.shape
    np.testing.assert_allclose(got[:, 0], wanted[:, 0], rtol=0, atol=1e-9)
    fades = wanted[:, -1] == Status.OUTSIDE  # there single precision's last digits count more
    np.testing.assert_allclose(got[~fades, 1:-1], wanted[~fades, 1:-1], rtol=0, atol=1e-5)
    np.testing.assert_allclose(got[fades, 1:-1], wanted[fades, 1:-1], rtol=0, atol=1e-3)
    np.testing.assert_array_equal(got[:, -1], wanted[:, -1])


def test_c_says_what_python_says(correct: Path, folder: Path, wanted: np.ndarray) -> None:
    out = folder / "c.csv"
    with (folder / "run.csv").open("rb") as log, out.open("wb") as stream:
        subprocess.run([str(correct), *CONDITION], stdin=log, stdout=stream, check=True)
    agree(out, wanted)


HEADER = "time,FW [mm],FB [mm],RW [mm],RB [mm]\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,FW [m],FB [mm],RW [mm],RB [mm]\n0,1,2,3,4\n", "line 1: expected the columns time,FW [mm]"),
        (HEADER + "0,1,2,3,4\n0.001,1,nan,3,4\n", "line 3: expected a finite number"),
        (HEADER + "0,1,2,3\n", "line 2: expected a finite number"),
        (HEADER + "0,1,2,3,4\n0.002,1,2,3,4\n", "line 3: the time does not follow"),
        (HEADER + "0,1,2,3,4\n0.001,1,2,3,4", "line 3: the line is cut off"),
    ],
)
def test_c_refuses_what_it_cannot_correct(correct: Path, text: str, message: str) -> None:
    result = subprocess.run([str(correct), *CONDITION], input=text, capture_output=True, text=True)
    assert result.returncode == 1
    assert message in result.stderr


@pytest.mark.slow  # a hundred megabytes come over the network
def test_node_says_what_python_says(folder: Path, wanted: np.ndarray, tmp_path: Path) -> None:
    node, npm = shutil.which("node"), shutil.which("npm")
    if not node or not npm:
        pytest.skip("there is no node or no npm")
    version = subprocess.run([node, "--version"], capture_output=True, text=True, check=True).stdout
    if int(version.lstrip("v").split(".")[0]) < 18:
        pytest.skip(f"node {version.strip()} is too old")
    for name in ("package.json", ".npmrc", "correct.mjs"):
        shutil.copy(EXAMPLES / "node" / name, tmp_path)
    try:
        install = [npm, "install", "--no-audit", "--no-fund", "--fetch-retries=1"]
        subprocess.run(install, cwd=tmp_path, check=True, capture_output=True, timeout=240)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"the npm packages cannot be had: {error}")
    out = tmp_path / "corrected.csv"
    command = [node, "correct.mjs", str(BUNDLE), str(folder / "run.mcap"), str(out)]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=120)
    agree(out, wanted)
