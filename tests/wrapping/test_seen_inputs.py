"""A wrapped corrector that sees an input and an output of the solver beside its channels says what CorrectedStepper says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

import bundles
import fmpy
from fmpy.fmi2 import FMU2Slave
from models import COMBINATIONS
from odd import CHANNELS, MS, ROWS, folder, plain, solver, walk

from fmucorrect import bundle
from fmucorrect.errors import SignalError, WrapError
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, ReplayStepper
from fmucorrect.wrapping import network, proof
from fmucorrect.wrapping.package import wrap

X, Y, Z = CHANNELS
U = Channel("u", unit="", simulation="u")
WEIGHTS = np.random.default_rng(4).normal(size=(4, 2))
COUNT = 60
NAMES = ("x_corrected", "y_corrected")
ANSWERS = tuple(Channel(name, unit, simulation=name) for name, unit in ((NAMES[0], "mm"), (NAMES[1], "mm")))


def seeing(unit: str, rows: int = ROWS, held: tuple[str, ...] = ()) -> Path:
    """Of x and y, with u and z. unit: of u, as the solver says it."""
    path = folder() / f"seeing{rows}{'held' * len(held)}.onnx"
    return bundles.make_seeing(path, WEIGHTS, (X, Y), (replace(U, unit=unit), Z), rows, MS, held)


def live(fmi: int, u: np.ndarray, rows: int = ROWS, held: tuple[str, ...] = ()) -> tuple[Path, np.ndarray]:
    """The bundle, and what the stepper says of the bare solver: (T, 2)."""
    plant = FmuStepper(solver(fmi), (X, Y, U, Z), inputs=("u",))
    path = seeing(plant.channels[2].unit, rows, held)
    corrected = CorrectedStepper(plant, bundle.load(path))
    corrected.reset(Condition("odd", speed=300.0))
    try:
        steps = [corrected.step(k * MS, u[k : k + 1]) for k in range(len(u))]
    finally:
        corrected.close()
    return path, np.array([step.corrected for step in steps])


@pytest.mark.parametrize("held", [(), ("u",)])
@pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)
def test_it_says_what_corrected_stepper_says(inner: int, outer: int, held: tuple[str, ...], tmp_path: Path) -> None:
    """The input of a sample's own time is read again when the host has set it."""
    u = np.random.default_rng(2).normal(size=COUNT)
    path, expected = live(inner, u, held=held)
    out = wrap(solver(inner), path, tmp_path / "wrapped.fmu", fmi=outer, platforms=["linux64"]).path
    with plain(out, ANSWERS, inputs=["u"]) as stepper:
        got = walk(stepper, range(0, COUNT * MS, MS), u[:, None].tolist())
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-5)
    without = live(inner, 0.5 * u, held=held)[1]
    assert np.abs(without - expected)[ROWS:].max() > 0.1  # what it sees of the input matters


def by_fmpy(path: Path, names: list[str], inputs: dict[str, np.ndarray], output: str) -> np.ndarray:
    """What a host reads that reads at a step's end and sets then: (T,)."""
    columns = np.array([*zip(np.arange(COUNT) * 1e-3, *inputs.values(), strict=True)])
    given = np.array([tuple(row) for row in columns], dtype=[(name, float) for name in ("time", *inputs)])
    stop = (COUNT - 1) * 1e-3
    return fmpy.simulate_fmu(
        str(path), stop_time=stop, step_size=1e-3, output_interval=1e-3, input=given, output=names
    )[output]


def test_a_host_that_reads_before_it_sets_has_the_correction_of_the_sample_before(tmp_path: Path) -> None:
    """And wrap says so. A window of one sample looks at the newest alone."""
    u = np.random.default_rng(2).normal(size=COUNT)
    path, at_once = live(2, u, rows=1)
    made = wrap(solver(2), path, tmp_path / "wrapped.fmu", platforms=["linux64"])
    (said,) = (note for note in made.notes if "sees" in note)
    assert "sees what the host sets: u." in said
    with plain(made.path, (*ANSWERS, X), inputs=["u"]) as stepper:
        told = np.array(walk(stepper, range(0, COUNT * MS, MS), u[:, None].tolist()))
    np.testing.assert_allclose(told[:, :2], at_once, atol=1e-5)
    added = told[:, 0] - told[:, 2]
    got = by_fmpy(made.path, [NAMES[0]], {"u": u}, NAMES[0])
    np.testing.assert_allclose(got[1:], told[1:, 2] + added[:-1], rtol=0.0, atol=1e-5)
    assert np.abs(np.diff(added)).max() > 0.1
    outputs_alone = bundles.make_seeing(tmp_path / "z.onnx", WEIGHTS[1:], (X, Y), (Z,), 1, MS)
    assert not any("sees" in note for note in wrap(solver(2), outputs_alone, tmp_path / "z.fmu").notes)


def test_a_host_that_reads_before_it_sets_has_what_inputs_held(tmp_path: Path) -> None:
    """As it is in training, and wrap has nothing to say of it. Whole steps of several samples likewise."""
    u = np.random.default_rng(2).normal(size=COUNT)
    u[0] = 0.0  # which it is as initialisation ends
    path, wanted = live(2, u, rows=2, held=("u",))
    made = wrap(solver(2), path, tmp_path / "wrapped.fmu", platforms=["linux64"])
    assert not any("sees" in note for note in made.notes)
    got = by_fmpy(made.path, [NAMES[0]], {"u": u}, NAMES[0])
    np.testing.assert_allclose(got, wanted[:, 0], rtol=0.0, atol=1e-5)
    stairs = np.repeat(u[::5], 5)
    wanted = live(2, stairs, rows=2, held=("u",))[1]
    with plain(made.path, ANSWERS, inputs=["u"]) as stepper:
        coarse = walk(stepper, range(0, COUNT * MS, 5 * MS), stairs[::5, None].tolist())
    np.testing.assert_allclose(coarse, wanted[::5], rtol=0.0, atol=1e-5)


def test_a_state_that_is_set_brings_what_inputs_held(tmp_path: Path) -> None:
    path, _ = live(2, np.zeros(COUNT), held=("u",), rows=1)
    out = wrap(solver(2), path, tmp_path / "wrapped.fmu", platforms=["linux64"]).path
    directory = fmpy.extract(str(out), str(tmp_path / "unpacked"))
    description = fmpy.read_model_description(directory)
    number = {variable.name: variable.valueReference for variable in description.modelVariables}
    host = FMU2Slave(
        guid=description.guid,
        unzipDirectory=directory,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="a",
    )
    host.instantiate()
    host.setupExperiment(startTime=0.0)
    host.enterInitializationMode()
    host.exitInitializationMode()

    def added() -> float:
        corrected, bare = host.getReal([number[NAMES[0]], number["x"]])
        return corrected - bare

    def step(k: int, u: float) -> None:
        host.setReal([number["u"]], [u])
        host.doStep(k * 1e-3, 1e-3)

    step(0, 3.0)
    step(1, -2.0)
    kept, before = host.getFMUState(), added()
    step(2, 9.0)
    after = added()
    assert abs(after - before) > 0.1
    host.setFMUState(kept)
    assert added() == before
    step(2, 9.0)
    assert added() == after
    host.terminate()
    host.freeInstance()


def test_inputs_that_nobody_sets_are_known_at_once(tmp_path: Path) -> None:
    path, at_once = live(2, np.zeros(COUNT), rows=1)
    out = wrap(solver(2), path, tmp_path / "wrapped.fmu", platforms=["linux64"]).path
    stop = (COUNT - 1) * 1e-3
    got = fmpy.simulate_fmu(str(out), stop_time=stop, step_size=1e-3, output_interval=1e-3, output=NAMES[:1])
    np.testing.assert_allclose(got[NAMES[0]], at_once[:, 0], rtol=0.0, atol=1e-5)


def test_a_network_alone_is_a_sample_late_there_and_no_more(tmp_path: Path) -> None:
    model = bundle.load(bundles.make_seeing(tmp_path / "net.onnx", WEIGHTS[1:], (X, Y), (Z,), ROWS, MS))
    made = wrap(None, model.path, tmp_path / "net.fmu", platforms=["linux64"])
    assert any("a sample late" in note for note in made.notes)
    channels = (X, Y, Z)
    log = Record(np.arange(COUNT, dtype=np.int64) * MS, np.random.default_rng(6).normal(size=(COUNT, 3)), channels)
    stepper = CorrectedStepper(ReplayStepper(channels), model)
    stepper.reset(Condition("log", speed=300.0))
    wanted = stepper.process(log).select([NAMES[0]]).values[:, 0]
    inputs = {channel.name: column for channel, column in zip(channels, log.values.T, strict=True)}
    got = by_fmpy(made.path, [NAMES[0]], inputs, NAMES[0])
    np.testing.assert_allclose(got[1:], wanted[:-1], rtol=0.0, atol=1e-5)


def test_as_c_it_is_the_same(tmp_path: Path) -> None:
    model = bundle.load(seeing("m"))
    assert proof.prove(model, network.sources(model.path), tmp_path).inside > 100


@pytest.mark.parametrize("held", [(), ("u",)])
def test_a_replay_is_the_live_run_and_needs_all_that_is_seen(held: tuple[str, ...]) -> None:
    rng = np.random.default_rng(3)
    model = bundle.load(seeing("m", held=held))
    channels = (X, Y, replace(U, unit="m"), Z)
    log = Record(np.arange(COUNT, dtype=np.int64) * MS, rng.normal(size=(COUNT, 4)), channels)
    stepper = CorrectedStepper(ReplayStepper(channels), model)
    stepper.reset(Condition("log", speed=300.0))
    said = stepper.process(log)
    seen = log.values.copy()
    if held:
        seen[1:, 2] = log.values[:-1, 2]
    wanted = log.values[ROWS - 1 :, :2] + seen[: COUNT + 1 - ROWS] @ WEIGHTS
    got = said.select([*NAMES]).values
    np.testing.assert_allclose(got[ROWS - 1 :], wanted, atol=1e-5)
    stepper.reset(Condition("log", speed=300.0))
    rows = np.array([stepper.step(int(t), row).corrected for t, row in zip(log.t_ns, log.values, strict=True)])
    np.testing.assert_array_equal(rows.astype(np.float32), got.astype(np.float32))
    stepper.reset(Condition("log", speed=300.0))
    parts = [
        stepper.process(part).select([*NAMES]).values for part in (log.rows(0, 1), log.rows(1, 30), log.rows(30, COUNT))
    ]
    np.testing.assert_array_equal(np.concatenate(parts), got)
    with pytest.raises(SignalError, match="lacks u, z"):
        CorrectedStepper(ReplayStepper((X, Y)), model)
    broken = replace(log, values=np.where(np.arange(4) == 2, np.nan, log.values))
    stepper.reset(Condition("log", speed=300.0))
    with pytest.raises(SignalError, match="channel 'u' is nan"):
        stepper.process(broken)


def test_a_solver_that_lacks_it_is_told(tmp_path: Path) -> None:
    strange = bundles.make_seeing(
        tmp_path / "strange.onnx", WEIGHTS, (X, Y), (Channel("road", unit="", simulation="road"), Z), ROWS, MS
    )
    with pytest.raises(WrapError, match="road"):
        wrap(solver(2), strange, tmp_path / "wrapped.fmu", platforms=["linux64"])
