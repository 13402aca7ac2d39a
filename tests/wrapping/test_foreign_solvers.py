"""Solvers that foreign exporters wrote, wrapped: pythonfmu (FMI 2) and pythonfmu3 (FMI 3)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import bundles
import numpy as np
import pytest
from exported import by_pythonfmu
from fmpy.validation import validate_fmu
from models import COMBINATIONS, STEP_NS, largest
from odd import Host

from fmucorrect import bundle
from fmucorrect.fmu import FmuStepper, open_fmu
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, grid, run
from fmucorrect.wrapping.package import Wrapped, wrap

SECONDS = 5.0
PACKAGES = {2: "pythonfmu", 3: "pythonfmu3"}
CHANNELS = tuple(Channel(name, unit="mm", quantity="displacement", simulation=name) for name in ("left", "right"))
UNITS = {"left": "mm", "right": "mm"}  # the exporter writes none
OUTPUTS = (
    *(Channel(channel.name, "") for channel in CHANNELS),
    *(Channel(f"{channel.name}_{what}", "mm") for what in ("corrected", "sigma") for channel in CHANNELS),
    Channel("corrector_status", ""),
)
_SLAVE = """
import math
from {package} import Fmi{v}Slave, Fmi{v}Causality as Causality, {real} as Real, {integer} as Integer, Boolean, String
from {package}.enums import Fmi{v}Variability as Variability
{more}

class {name}(Fmi{v}Slave{mixin}):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.left, self.right, self.time, self.passed, self.gain = 0.0, 2.0, 0.0, 0.0, 1.0
        self.steps, self.mirrored, self.note = 0, False, "none"
        for name in ("left", "right"):
            self.register_variable(Real(name, causality=Causality.output, variability=Variability.continuous))
        self.register_variable(Real("gain", causality=Causality.parameter, variability=Variability.tunable))
        self.register_variable(Integer("steps", causality=Causality.output, variability=Variability.discrete))
        self.register_variable(Boolean("mirrored", causality=Causality.input, variability=Variability.discrete))
        self.register_variable(String("note", causality=Causality.parameter, variability=Variability.tunable))
        {own}

    def do_step(self, now, size):
        self.steps += 1
        self.passed += size
        self.time = {clock}
        self.left = 2.0 * self.gain * math.sin(9.0 * self.time)
        self.right = (-2.0 if self.mirrored else 2.0) * math.cos(9.0 * self.time)
        return {ok}
"""
_TWO = {"real": "Real", "integer": "Integer", "mixin": "", "ok": "True", "more": "", "own": ""}
_THREE = {
    "real": "Float64",
    "integer": "Int32",
    "mixin": ", CoSimulation",
    "ok": "Fmi3StepResult(status=Fmi3Status.ok)",
    "more": "from pythonfmu3 import CoSimulation, Fmi3StepResult, Fmi3Status",
    "own": 'self.register_variable(Real("time", causality=Causality.independent, variability=Variability.continuous))',
}
Solver = Callable[..., Path]
Wrap = Callable[..., Wrapped]
each_way = pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> Solver:
    """solver(fmi, state=None) -> an FMU of the exporter. state: None, not claimed; True, claimed; False, claimed although
    something that matters is no variable, and these are all that the exporter keeps."""

    @cache
    def export(fmi: int, state: bool | None = None) -> Path:
        package = PACKAGES[fmi]
        pytest.importorskip(package)
        name = f"Swing_{fmi}_{state}"  # of one name Python would take the first for all that run in this process
        clock = "self.passed" if state is False else "now + size"
        code = _SLAVE.format(package=package, name=name, v=fmi, clock=clock, **(_TWO if fmi == 2 else _THREE))
        claims = [] if state is None else ["--handle-state", "--serialize-state"]
        return by_pythonfmu(tmp_path_factory.mktemp(package), name, code, *claims, package=package)

    return export


@pytest.fixture(scope="module")
def corrector(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bundles.make(tmp_path_factory.mktemp("toy") / "toy.onnx", CHANNELS, rows=12)


@pytest.fixture(scope="module")
def foreign(solver: Solver, corrector: Path, tmp_path_factory: pytest.TempPathFactory) -> Wrap:
    """foreign(inner, outer, state=None) -> the exporter's FMU, wrapped."""
    for package in ("ziglang", "emx_onnx_cgen", "onnx"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("foreign")

    @cache
    def one(inner: int, outer: int, state: bool | None = None) -> Wrapped:
        out = folder / f"{inner}_{outer}_{state}.fmu"
        mapping = folder / "mapping.toml"
        mapping.write_text('[units]\nleft = "mm"\nright = "mm"\n')
        return wrap(solver(inner, state), corrector, out, fmi=outer, platforms=["linux64"], mapping=mapping)

    return one


def walked(stepper: FmuStepper | CorrectedStepper) -> Record:
    result = run(stepper, Condition("x", speed=300.0, amplitude=0.03, frequency=2.0), grid(SECONDS, STEP_NS))
    stepper.close()
    assert result is not None
    return result


@each_way
def test_a_parameter_that_training_did_not_have_is_told(
    inner: int, outer: int, solver: Solver, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    model = bundles.make(tmp_path / "toy.onnx", CHANNELS, rows=12, parameters={"gain": 1.5})
    mapping = tmp_path / "mapping.toml"
    mapping.write_text('[units]\nleft = "mm"\nright = "mm"\n')
    made = wrap(solver(inner), model, tmp_path / "x.fmu", fmi=outer, platforms=["linux64"], mapping=mapping)
    path = made.path
    assert not any("correct nothing" in note for note in made.notes)
    mapping.write_text(mapping.read_text() + "[parameters]\ngain = 3.0\n")
    other = wrap(solver(inner), model, tmp_path / "y.fmu", fmi=outer, platforms=["linux64"], mapping=mapping)
    assert any("correct nothing" in note and "gain is 3, trained with 1.5" in note for note in other.notes)
    as_trained = walked(FmuStepper(path, OUTPUTS, units=UNITS))  # the wrapper sets 1.5
    assert as_trained["corrector_status"][-1] == 0.0
    other = walked(FmuStepper(path, OUTPUTS, parameters={"gain": 3.0}, units=UNITS))
    assert "gain is 3, the corrector was trained with 1.5" in caplog.text
    assert set(other["corrector_status"]) == {1.0, 2.0}
    assert np.array_equal(other["left_corrected"], other["left"])
    assert np.allclose(other["left"], 2.0 * as_trained["left"])


@each_way
def test_it_says_what_the_stepper_says(inner: int, outer: int, solver: Solver, foreign: Wrap, corrector: Path) -> None:
    plant = FmuStepper(solver(inner), CHANNELS, parameters={"gain": 1.5}, units=UNITS)
    theirs = walked(CorrectedStepper(plant, bundle.load(corrector)))
    mine = walked(FmuStepper(foreign(inner, outer).path, OUTPUTS, parameters={"gain": 1.5}, units=UNITS))
    assert mine.names == theirs.names
    assert largest(mine.values, theirs.values) < 1e-5
    for name in ("left", "right", "corrector_status"):
        assert np.array_equal(mine[name], theirs[name])
    assert largest(mine["left_corrected"], mine["left"]) > 0.5


@each_way
def test_every_type_goes_through(inner: int, outer: int, foreign: Wrap) -> None:
    with Host(foreign(inner, outer).path) as host:
        fmu, at = host.fmu, host.references
        integers = fmu.getInt32 if outer == 3 else fmu.getInteger
        fmu.setBoolean([at["mirrored"]], [True])
        fmu.setString([at["note"]], ["Größe"])
        for _ in range(20):
            assert host.step(1e-3)[0] == "ok"
        assert list(integers([at["steps"]])) == [20]
        assert host.get("right")[0] == pytest.approx(-2.0 * np.cos(9.0 * 0.02), abs=1e-12)
        assert [bool(value) for value in fmu.getBoolean([at["mirrored"]])] == [True]
        text = fmu.getString([at["note"]])[0]
        assert (text if isinstance(text, str) else text.decode()) == "Größe"


@each_way
def test_it_claims_no_more_than_the_solver(inner: int, outer: int, solver: Solver, foreign: Wrap) -> None:
    before, after = (open_fmu(path) for path in (solver(inner), foreign(inner, outer).path))
    assert {"needs its tool installed"} <= set(after.capabilities)
    assert set(after.capabilities) - {"own memory management", "may return early from a step"} <= set(
        before.capabilities
    )


@each_way
def test_it_is_as_valid_as_the_solver(inner: int, outer: int, solver: Solver, foreign: Wrap) -> None:
    before, after = (validate_fmu(str(path)) for path in (solver(inner), foreign(inner, outer).path))
    if inner == 2:  # pythonfmu leaves these out
        before, after = ([line for line in lines if "InitialUnknowns" not in line] for lines in (before, after))
    assert before == after == []


@pytest.mark.parametrize("fmi", [2, 3])
def test_state_is_offered_where_it_works(fmi: int, foreign: Wrap) -> None:
    made = foreign(fmi, fmi, True)
    assert made.state.serialise
    assert {"get and set state", "serialise state"} <= set(open_fmu(made.path).capabilities)


@pytest.mark.parametrize("fmi", [2, 3])
def test_state_is_not_offered_where_it_does_not(fmi: int, solver: Solver, foreign: Wrap) -> None:
    made = foreign(fmi, fmi, False)
    assert "get and set state" in open_fmu(solver(fmi, False)).capabilities
    assert not {"get and set state", "serialise state"} & set(open_fmu(made.path).capabilities)
    assert any("state" in note for note in made.notes)
