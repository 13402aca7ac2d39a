"""A study whose FMU is of model exchange: run, trained, compared, and simulated with laws in the loop as discovery does; wrap
refuses it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from exchange_fmu import exchange

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from fmucorrect import pairs
from fmucorrect.catalogue import find
from fmucorrect.cli import main
from fmucorrect.discovery import native
from fmucorrect.discovery.simulator import LawAt, Simulator
from fmucorrect.errors import FmuError, WrapError
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.study import Study, load_study
from fmucorrect.wrapping.package import wrap

STUDY = """format = 1
name = "a mass on a spring"
[simulation]
fmu = "mass.fmu"
step_size = 0.002
[[channels]]
name = "x"
simulation = "x"
measurement = "x"
quantity = "displacement"
unit = "mm"
[[joints]]
name = "spring"
force = "f"
displacement = "x"
velocity = "v"
sign = -1
[[conditions]]
name = "sweep"
role = "development"
inputs = "force.csv"
measurement = "measured.csv"
"""
T = np.arange(1501) * 0.002
SHORT = """
[training]
window = 8
[training.tdnn]
widths = [4]
[training.pinn]
widths = [4]
epochs = 2
[training.tdnn_residual]
widths = [4]
epochs = 2
tdnn_epochs = 2
[training.proposed]
widths = [4]
head_width = 4
epochs = 2
tdnn_epochs = 2
[training.corrector]
families = ["window"]
baseline_width = 4
baseline_epochs = 10
history = 4
widths = [8, 8]
members = 1
epochs = [10]
"""


@pytest.fixture
def study(tmp_path: Path, exchange_library: Path, version: str) -> Study:
    exchange(tmp_path / "mass.fmu", "mass", exchange_library, version)
    force = 0.9 * np.sin(2 * np.pi * (1 + T) * T)
    for name, values in (("force.csv", force), ("measured.csv", 0 * T)):
        column = "f [N]" if name == "force.csv" else "x [mm]"
        np.savetxt(tmp_path / name, np.column_stack([T, values]), "%.9g", ",", header=f"time,{column}", comments="")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    return load_study(tmp_path / "study.toml")


def test_run(study: Study, tmp_path: Path):
    arguments = ["run", str(study.path), "--condition", "sweep", "-o", str(tmp_path / "run.csv")]
    done = CliRunner().invoke(main, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert len((tmp_path / "run.csv").read_text().splitlines()) == len(T) + 1


@pytest.mark.slow
def test_train_and_compare(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Measured: the same mass on a spring that is stiffer by a tenth. Networks this small and brief learn little."""
    pytest.importorskip("torch")
    pytest.importorskip("onnx")
    from fmucorrect import places
    from fmucorrect.training import cases

    monkeypatch.setattr(places, "CORES", 1)
    monkeypatch.setattr(cases, "EPOCHS", 2)  # of the GRU
    head, _, condition = STUDY.partition("[[conditions]]")
    excitation = '[excitation]\nsimulation = "f"\nmeasurement = "f"\nkind = "command"\n'
    text, noise = head.partition("[[joints]]")[0] + excitation, np.random.default_rng(0)
    force = 0.9 * np.sin(2 * np.pi * 4.0 * T)
    for speed in (300, 320, 340, 385):
        damping = 30.0 + 0.2 * (speed - 300)
        table = np.column_stack([T, force])
        np.savetxt(tmp_path / f"force_{speed}.csv", table, "%.9g", ",", header="time,f [N]", comments="")
        role = "evaluation" if speed == 385 else "development"
        row = condition.replace("sweep", str(speed)).replace("force.csv", f"force_{speed}.csv")
        row = row.replace("measured.csv", f"measured_{speed}.csv").replace("development", role)
        text += f"[[conditions]]{row}speed = {speed}.0\namplitude = 0.9\nfrequency = 4.0\nstart = 0.0\n"
        text += f"parameters = {{ c = {damping} }}\n"
        with FmuStepper(tmp_path / "mass.fmu", (Channel("x", "mm"),), inputs=("f",)) as real:
            real.reset(Condition("real", parameters={"k": 1980.0, "c": damping}))
            given = Record(np.round(T * 1e9).astype(np.int64), force[:, None], (Channel("f", "N"),))
            x = real.process(given).values + 1e-3 * noise.normal(size=(len(T), 1))
        table = np.column_stack([T, x, force])
        np.savetxt(tmp_path / f"measured_{speed}.csv", table, "%.9g", ",", header="time,x [mm],f [N]", comments="")
    study.path.write_text(text + SHORT, encoding="utf-8")
    for words in (
        ["train", str(study.path), "-o", str(tmp_path / "model")],
        ["run", str(study.path), "--condition", "385", "--corrector", str(tmp_path / "model/corrector.onnx"),
         "-o", str(tmp_path / "run.csv")],
        ["compare", str(study.path), "-o", str(tmp_path / "comparison"), "--seeds", "1"],
    ):  # fmt: skip
        done = CliRunner().invoke(main, words, catch_exceptions=False)
        assert done.exit_code == 0, done.output
    rows = json.loads((tmp_path / "comparison/compare.json").read_text())
    assert rows


def test_a_law_in_the_loop_is_a_parameter_of_the_model(study: Study, tmp_path: Path):
    """What discovery does in C: a spring added by a law, against a stiffer spring in the FMU."""
    condition = study.condition("sweep")
    simulator = Simulator(study, condition, native.build(tmp_path / "library"))
    try:
        alone = simulator.run().copy()
        streamed = pairs.simulate(study, condition).values[:, :1]
        np.testing.assert_allclose(
            alone, streamed, rtol=0, atol=2e-4
        )  # mm; times rounded otherwise, other steps in CVODE
        law = find("linear_stiffness", {"stiffness": 300.0})
        with_law = simulator.run([LawAt(law, study.joints[0], law.complete({"stiffness": 300.0}))]).copy()
        stiffer = simulator.run((), {"k": 2100.0})
        assert np.abs(with_law - stiffer).max() < 0.01 * np.abs(stiffer).max() < 0.2 * np.abs(alone - stiffer).max()
        with pytest.raises(FmuError, match=r"CVODE|gave up"):
            simulator.run((), {"k": -1e9})
    finally:
        simulator.close()


def test_wrap_says_what_to_do_instead(study: Study, tmp_path: Path):
    assert study.fmu is not None
    (tmp_path / "effects.toml").write_text("format = 1\n", encoding="utf-8")
    with pytest.raises(
        WrapError, match=r"model exchange only, .* carries no integrator, .*Export it for co-simulation"
    ):
        wrap(study.fmu, None, tmp_path / "out.fmu", effects_file=tmp_path / "effects.toml")
    assert not (tmp_path / "out.fmu").exists()
