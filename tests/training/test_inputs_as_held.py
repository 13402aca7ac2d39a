"""From another exporter's FMU with an input to the wrapped FMU in a host that reads before it sets: an actuator that is slower
than its model says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
import road
from exported import by_pythonfmu
from scipy.signal import lfilter

from fmucorrect import bundle
from fmucorrect.pairs import pair
from fmucorrect.sealing import evaluate
from fmucorrect.study import Study, load_study
from fmucorrect.study_training import Corrector
from fmucorrect.training.protocol import train
from fmucorrect.training.results import save, train_into
from fmucorrect.training.tasks import Workshop

STEP = 1e-3
CODE = '''
from math import exp
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Actuator(Fmi2Slave):
    """Follows what is commanded with a time constant of 5 ms."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.command, self.stroke, self.lag = 0.0, 0.0, 5e-3
        self.register_variable(Real("command", causality=Fmi2Causality.input))
        self.register_variable(Real("lag", causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed))
        self.register_variable(Real("stroke", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.stroke = self.command + (self.stroke - self.command) * exp(-step_size / self.lag)
        return True
'''
STUDY = """
format = 1
name = "actuator"

[simulation]
fmu = "Actuator.fmu"
step_size = 0.001

[simulation.units]
command = "mm"
stroke = "mm"

[[channels]]
name = "stroke"
quantity = "displacement"
simulation = "stroke"
measurement = "lvdt"
unit = "mm"

[records]
clock = "common"

[training.corrector]
sees = ["command"]
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """Commands that change from sample to sample; the machine has a time constant of 8 ms. The last record is held out."""
    folder = tmp_path_factory.mktemp("actuator")
    rng, text = np.random.default_rng(8), STUDY
    by_pythonfmu(folder, "Actuator", CODE)
    for i in range(3):
        command = np.asarray(lfilter([0.5], [1.0, -0.5], rng.normal(scale=10.0, size=1500)))
        kept = np.exp(-STEP / 8e-3)
        stroke = np.asarray(
            lfilter([0.0, 1.0 - kept], [1.0, -kept], command)
        )  # of what was held since the sample before
        rows = np.stack(
            [np.arange(len(command)) * STEP, command, stroke + 1e-3 * rng.normal(size=len(command))], axis=1
        )
        np.savetxt(folder / f"run{i}.csv", rows, "%.6f", ",", header="time [s],command [mm],lvdt [mm]", comments="")
        role = "evaluation" if i == 2 else "development"
        text += (
            f'\n[[conditions]]\nname = "run {i}"\nrole = "{role}"\nmeasurement = "run{i}.csv"\ninputs = "run{i}.csv"\n'
        )
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return load_study(folder / "study.toml")


def test_what_an_input_held_stands_beside_what_came_of_it(study: Study) -> None:
    item = pair(study, study.development[0])
    seen = item.seen(["command"])
    command = item.simulated["command"]
    assert np.array_equal(seen[:, 0], item.simulated["stroke"])
    assert np.array_equal(seen[1:, 1], command[:-1])
    assert seen[0, 1] == command[0]
    kept = np.exp(-STEP / 5e-3)
    np.testing.assert_allclose(seen[1:, 0], kept * seen[:-1, 0] + (1.0 - kept) * seen[1:, 1], atol=1e-9)


def test_a_condition_of_another_model_is_no_part_of_the_verdict(study: Study, tmp_path: Path) -> None:
    """Its corrector is withheld there, and the card says why, not how much it learned."""
    settings = replace(road.QUICK, corrector=Corrector(sees=("command",), families=("linear",)))
    held = study.evaluation[0]
    other = replace(held, name="run 3", parameters={"lag": 0.02})
    both = replace(study, conditions=(*study.conditions, other))
    done = train_into(tmp_path, both, settings, "test", Workshop())
    card = (tmp_path / "card.md").read_text(encoding="utf-8")
    assert "At run 2, held out of everything" in card
    assert "At run 3 nothing is corrected: lag is 0.02, trained with 0.005." in card
    assert "| run 3 | evaluation, withheld | corrected |" in card
    assert "run 3, held out" not in card
    assert "1 parameter, as it has them by itself" in card
    assert done.against.unseen == ("run 2",)


def test_a_host_that_reads_before_it_sets_corrects_as_well_as_was_told(study: Study, tmp_path: Path) -> None:
    pytest.importorskip("ziglang")
    pytest.importorskip("emx_onnx_cgen")
    from fmucorrect.wrapping.package import wrap

    settings = Corrector(sees=("command",), families=("linear",))
    path = save(train(study, replace(road.QUICK, corrector=settings)), tmp_path)
    model = bundle.load(path)
    assert model.held == ("command",)
    condition = study.evaluation[0]
    assert condition.inputs is not None
    said = evaluate(pair(study, condition), model)
    assert said.after.mean_nrmse < 0.2 * said.before.mean_nrmse
    made = wrap(study.fmu, model.path, tmp_path / "wrapped.fmu", platforms=["linux64"])
    time, command, lvdt = np.loadtxt(condition.inputs, delimiter=",", skiprows=1).T
    given = np.array([*zip(time, command, strict=True)], dtype=[("time", float), ("command", float)])
    output = "stroke_corrected"
    got = fmpy.simulate_fmu(
        str(made.path), stop_time=time[-1], step_size=STEP, output_interval=STEP, input=given, output=[output]
    )[output]
    left = np.sqrt(np.mean((got - lvdt)[said.scored] ** 2)) / np.ptp(lvdt[said.scored])
    assert 100.0 * left == pytest.approx(said.after.mean_nrmse, rel=0.01)
