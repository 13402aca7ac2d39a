"""A solver that gives up for good: the standard forbids any further call of it, and the next run is one of another instance."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from exported import by_pythonfmu

from fmucorrect.discovery.confirm import Chain, all_gaps
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.simulator import Simulator
from fmucorrect.errors import FmuError
from fmucorrect.study import load_study

SLIDE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Slide(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.force = self.x = self.v = 0.0
        self.k = 800.0
        self.register_variable(Real("force", causality=Fmi2Causality.input))
        self.register_variable(Real("k", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        for name in ("x", "v"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, time, step):
        for _ in range(10):
            self.v += step / 10 * (self.force - self.k * self.x - 8.0 * self.v) / 2.0
            self.x += step / 10 * self.v
        if abs(self.x) > 0.02:
            raise RuntimeError("out of the guide")
        return True
"""
STUDY = """format = 1
[simulation]
fmu = "Slide.fmu"
step_size = 0.002
units = { force = "N", x = "m", v = "m/s" }
[[channels]]
name = "x"
simulation = "x"
measurement = "x"
quantity = "displacement"
unit = "m"
noise = 1e-4
[[conditions]]
name = "weak"
role = "development"
inputs = "weak.csv"
measurement = "weak.csv"
[[conditions]]
name = "strong"
role = "evaluation"
inputs = "strong.csv"
measurement = "strong.csv"
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("slide")
    by_pythonfmu(folder, "Slide", SLIDE)
    t = np.arange(1001) * 2e-3
    for name, peak in (("weak", 5.0), ("strong", 40.0)):
        force = peak * np.sin(8.0 * t)
        rows = np.column_stack([t, force, force / 800.0])
        np.savetxt(folder / f"{name}.csv", rows, "%.9g", ",", header="time,force [N],x [m]", comments="")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    return load_study(folder / "study.toml")


def test_it_is_an_error_each_time_and_other_runs_go_on(study, library):
    simulator = Simulator(study, study.condition("weak"), library)
    first = simulator.run()
    for _ in range(3):
        with pytest.raises(FmuError, match="'weak': the solver gave up at t ="):
            simulator.run((), {"k": 100.0})
        assert (simulator.run() == first).all()
    simulator.close()


def test_where_that_was_held_out_what_was_found_elsewhere_stands(study, library):
    with load(study, library, 1) as problem:
        checked, unseen = all_gaps(problem, Model(), Chain(np.zeros((1, 2))))
    assert [gap.condition.name for gap in checked] == ["weak"]
    (told,) = unseen
    assert "fatal" in told.partition("strong")[2]
