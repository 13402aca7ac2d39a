"""A study whose FMU is of model exchange: run, and simulated with laws in the loop as discovery does; wrap refuses it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from exchange_fmu import exchange

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from fmucorrect import experiment
from fmucorrect.catalogue import find
from fmucorrect.cli import main
from fmucorrect.discovery import native
from fmucorrect.discovery.simulator import LawAt, Simulator
from fmucorrect.errors import FmuError, WrapError
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


def test_a_law_in_the_loop_is_a_parameter_of_the_model(study: Study, tmp_path: Path):
    """What discovery does in C: a spring added by a law, against a stiffer spring in the FMU."""
    condition = study.condition("sweep")
    simulator = Simulator(study, condition, native.build(tmp_path / "library"))
    try:
        alone = simulator.run().copy()
        streamed = experiment.simulate(study, condition).values[:, :1]
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
