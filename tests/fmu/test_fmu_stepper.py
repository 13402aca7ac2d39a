"""FmuStepper on the oscillator: the numbers."""

from __future__ import annotations

import threading
from pathlib import Path

import fmpy
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from trouble_fmu import OSCILLATOR

from fmucorrect.errors import FmuError, SignalError
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition, Record, join
from fmucorrect.stepper import Status, grid, run

MS = 1_000_000
CHANNELS = (
    Channel("x", "mm", simulation="mass1.x"),
    Channel("v", "m/s", simulation="mass2.v"),
    Channel("F", "kN", simulation="joint1.F"),
)
PLUCKED = Condition("plucked", parameters={"x1": 0.01, "masses": 2.0})


def forces(rows: int, seed: int = 0, step_ns: int = MS) -> Record:
    values = np.random.default_rng(seed).normal(size=(rows, 2))
    return Record(np.arange(rows, dtype=np.int64) * step_ns, values, (Channel("mass2.f", "N"), Channel("base.d", "m")))


def empty(t_ns: np.ndarray) -> Record:
    return Record(t_ns, np.zeros((len(t_ns), 0)), ())


def stepped(stepper: FmuStepper, record: Record) -> np.ndarray:
    return np.array([stepper.step(int(t), u).simulated for t, u in zip(record.t_ns, record.values, strict=True)])


def test_closed_form(oscillator: Path):
    m, k, c, x0 = 2.0, 1800.0, 3.0, 0.01
    with FmuStepper(oscillator, (Channel("x", "mm", simulation="mass1.x"),)) as stepper:
        condition = Condition("free", parameters={"m1": m, "k1": k, "c1": c, "x1": x0})
        out = run(stepper, condition, grid(2.0, MS))
    assert out is not None
    decay = c / (2 * m)
    w = np.sqrt(k / m - decay**2)
    t = out.seconds()
    expected = 1e3 * x0 * np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    np.testing.assert_allclose(out["x"], expected, atol=1e-6 * 1e3 * x0)


def test_same_as_fmpy(oscillator: Path):
    record = forces(500)
    table = np.zeros(len(record), [("time", "f8"), ("mass2.f", "f8"), ("base.d", "f8")])
    table["time"], table["mass2.f"], table["base.d"] = record.seconds(), *record.values.T
    expected = fmpy.simulate_fmu(
        oscillator, stop_time=0.499, step_size=0.001, output_interval=0.001, input=table, output=["mass1.x", "mass2.v"],
        start_values={"x1": 0.01, "masses": 2.0}, fmi_type="CoSimulation",
    )  # fmt: skip
    with FmuStepper(oscillator, CHANNELS, inputs=("base.d", "mass2.f")) as stepper:
        stepper.reset(PLUCKED)
        out = stepper.process(record)
    # fmpy sums its time and reads the outputs before it sets the next inputs, which none of these two feels at once
    np.testing.assert_allclose(out["x"], 1e3 * expected["mass1.x"], rtol=0, atol=1e-10)
    np.testing.assert_allclose(out["v"], expected["mass2.v"], rtol=0, atol=1e-12)


def test_both_versions_give_the_same_numbers():
    results = []
    for name in ("oscillator.fmu", "oscillator_fmi3.fmu"):
        with FmuStepper(OSCILLATOR / name, CHANNELS, inputs=("base.d", "mass2.f")) as stepper:
            stepper.reset(PLUCKED)
            results.append(stepper.process(forces(1000)).values)
    np.testing.assert_array_equal(*results)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    pieces=st.lists(st.tuples(st.integers(1, 30), st.booleans()), min_size=1, max_size=6),
    start=st.sampled_from([0, 1, 5 * MS, -3 * MS, 10**15, 1_700_000_000 * 10**9 + 7]),
    seed=st.integers(0, 99),
    jitter=st.booleans(),
)
def test_process_is_step_to_the_bit(oscillator: Path, pieces, start: int, seed: int, jitter: bool):
    rows = sum(count for count, _ in pieces)
    record = forces(rows, seed)
    noise = np.random.default_rng(seed).integers(0, 300_000, rows) if jitter else 0
    record = Record(record.t_ns + start + noise, record.values, record.channels)
    with FmuStepper(oscillator, CHANNELS, inputs=("mass2.f", "base.d")) as stepper:
        stepper.reset(PLUCKED)
        expected = stepped(stepper, record)
        stepper.reset(PLUCKED)
        row, parts = 0, []
        for count, batch in pieces:
            part = record.rows(row, row + count)
            parts.append(stepper.process(part).values if batch else stepped(stepper, part))
            row += count
    np.testing.assert_array_equal(np.concatenate(parts), expected)


def test_first_row_is_the_initial_state_under_its_inputs(oscillator: Path):
    channels = (Channel("d", "m", simulation="joint1.d"), Channel("t", "s", simulation="time"))
    with FmuStepper(oscillator, channels, inputs=("base.d",)) as stepper:
        stepper.reset(Condition("a"))
        step = stepper.step(7 * MS, np.array([0.25]))
        assert step.simulated.tolist() == [-0.25, 0.007]
        assert (step.status, step.sigma.tolist()) == (Status.OK, [0.0, 0.0])
        later = stepper.step(9 * MS, np.array([0.5]))
    assert later.simulated[1] == pytest.approx(0.009, rel=1e-15)
    assert later.simulated[0] == pytest.approx(-0.5, abs=1e-3)


def test_inputs_hold_over_the_step_that_follows(oscillator: Path):
    channels = (Channel("v", "m/s", simulation="mass1.v"),)
    with FmuStepper(oscillator, channels, inputs=("mass1.f",), parameters={"k1": 0.0, "c1": 0.0}) as stepper:
        stepper.reset(Condition("a"))
        velocities = [
            float(stepper.step(i * 1000 * MS, np.array([f])).simulated[0]) for i, f in enumerate([1.0, 3.0, 0.0])
        ]
    assert velocities == pytest.approx([0.0, 1.0, 4.0], abs=1e-12)


def test_time_does_not_drift(oscillator: Path):
    with FmuStepper(oscillator, (Channel("t", "s", simulation="time"),)) as stepper:
        stepper.reset(Condition("a"))
        start, steps = 10**15, np.arange(20_000, dtype=np.int64)  # 10^6 s on
        out = stepper.process(empty(start + steps * 333_333))
    assert np.abs(out["t"] - (start + steps * 333_333) / 1e9).max() <= 2 * np.spacing(1e6)


def test_units(oscillator: Path):
    unit = (Channel("x", "m", simulation="mass1.x"), Channel("raw", "", simulation="mass1.x"))
    inch = (Channel("x", "in", simulation="mass1.x"), Channel("y", "mm", simulation="mass1.x"))
    with FmuStepper(oscillator, (*unit, inch[1]), inputs=("base.d",)) as stepper:
        stepper.reset(PLUCKED)
        out = stepper.process(Record(np.array([0, MS]), np.array([[30.0], [40.0]]), (Channel("base.d", "mm"),)))
        assert stepper.channels[1].unit == "m"
        assert stepper.step(2 * MS, np.array([0.03])).simulated.shape == (3,)
        stepper.reset(PLUCKED)
        same = stepper.process(Record(np.array([0, MS]), np.array([[0.03], [0.04]]), (Channel("base.d"),)))
    np.testing.assert_array_equal(out.values, same.values)
    np.testing.assert_allclose(out["y"], 1e3 * out["x"])
    assert [c.unit for c in out.channels] == ["m", "m", "mm"]
    with pytest.raises(SignalError, match=r"channel 'x': units do not fit, expected a unit like 'N', got 'm'"):
        FmuStepper(oscillator, (Channel("x", "N", simulation="mass1.x"),))


def test_reset_forgets_everything(oscillator: Path):
    record = forces(300)
    with FmuStepper(oscillator, CHANNELS, inputs=("mass2.f", "base.d"), parameters={"k1": 2e3}) as stepper:
        stepper.reset(PLUCKED)
        first = stepper.process(record).values
        stepper.reset(Condition("other", parameters={"k1": 9e3, "c1": 7.0, "masses": 4.0, "v3": 1.0}))
        other = stepper.process(record).values
        stepper.reset(PLUCKED)
        again = stepper.process(record).values
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3


def test_record_without_columns_leaves_inputs(oscillator: Path):
    with FmuStepper(oscillator, (Channel("d", "m", simulation="joint1.d"),), inputs=("base.d",)) as stepper:
        stepper.reset(Condition("a"))
        stepper.step(0, np.array([0.25]))
        held = stepper.process(empty(np.array([1, 2], np.int64)))
        nothing = stepper.process(empty(np.array([], np.int64)))
    assert held.values[:, 0] == pytest.approx([-0.25, -0.25])
    assert nothing.values.shape == (0, 1)


def test_state_goes_back_to_the_bit(oscillator: Path):
    record = forces(60)
    with FmuStepper(oscillator, CHANNELS, inputs=("mass2.f", "base.d")) as stepper:
        stepper.reset(PLUCKED)
        with pytest.raises(FmuError, match=r"only after the first step"):
            stepper.get_state()
        stepper.process(record.rows(0, 20))
        state = stepper.get_state()
        first = stepper.process(record.rows(20, 60)).values
        stepper.set_state(state)
        np.testing.assert_array_equal(stepper.process(record.rows(20, 60)).values, first)
        stepper.free_state(state)


def test_several_at_once_and_in_threads(oscillator: Path):
    record = forces(2000)

    def result(stepper: FmuStepper, stiffness: float) -> np.ndarray:
        stepper.reset(Condition("a", parameters={"k1": stiffness}))
        return stepper.process(record).values

    def make() -> FmuStepper:
        return FmuStepper(oscillator, CHANNELS, inputs=("mass2.f", "base.d"))

    stiffnesses = [1e3, 2e3, 3e3, 4e3]
    with make() as one:
        expected = [result(one, stiffness) for stiffness in stiffnesses]
    steppers, found = [make() for _ in stiffnesses], {}
    threads = [
        threading.Thread(target=lambda i=i: found.update({i: result(steppers[i], stiffnesses[i])})) for i in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for stepper in steppers:
        stepper.close()
    for i in range(4):
        np.testing.assert_array_equal(found[i], expected[i])


def test_chunks_through_run(oscillator: Path):
    with FmuStepper(oscillator, CHANNELS) as stepper:
        whole = run(stepper, PLUCKED, grid(1.0, MS, rows=5000))
        parts: list[Record] = []
        run(stepper, PLUCKED, grid(1.0, MS, rows=7), parts.append)
    assert whole is not None
    np.testing.assert_array_equal(whole.values, join(parts).values)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"channels": (Channel("x", simulation="mass1.y"), Channel("q"))},
            "no variable 'mass1.y' .did you mean 'mass1.[xav]'",
        ),
        ({"inputs": ("base.x",)}, "no input 'base.x' .did you mean 'base.[dv]'"),
        ({"inputs": ("mass1.x",)}, "no input 'mass1.x'"),
        ({"inputs": ("base.d", "base.d")}, "'base.d' is given twice"),
        ({"parameters": {"kk1": 1.0}}, "no parameter 'kk1' .did you mean 'k1'"),
    ],
)
def test_wrong_names(oscillator: Path, arguments, message: str):
    with pytest.raises(FmuError, match=message):
        FmuStepper(oscillator, **({"channels": CHANNELS} | arguments))


def test_wrong_start_values_are_named_all_at_once(oscillator: Path):
    wrong = {"masses": 5.0, "mass1.x": 1.0, "m1": -1.0, "k": 1.0, "c1": float("nan"), "time": 0.0, "k1": 900.0}
    with FmuStepper(oscillator, CHANNELS) as stepper:
        with pytest.raises(FmuError) as caught:
            stepper.reset(Condition("a", parameters=wrong))
        text = str(caught.value)
        assert "'masses' = 5 is outside [1, 4] 1" in text
        assert "'mass1.x' is a continuous output, whose value the model computes" in text
        assert "'m1' = -1 is outside [1e-09, inf] kg" in text
        assert "there is no parameter 'k'" in text
        assert "'c1' is nan" in text
        assert "'time' is a continuous independent" in text
        assert "'k1'" not in text.replace("did you mean 'k1'", "")
        with pytest.raises(FmuError, match=r"Call reset"):
            stepper.step(0, np.zeros(0))


def test_wrong_rows(oscillator: Path):
    with FmuStepper(oscillator, CHANNELS, inputs=("mass2.f", "base.d")) as stepper:
        stepper.reset(PLUCKED)
        stepper.step(5, np.zeros(2))
        with pytest.raises(SignalError, match=r"time does not increase, expected > 5 ns, got 5 ns"):
            stepper.step(5, np.zeros(2))
        with pytest.raises(SignalError, match=r"time does not increase"):
            stepper.process(forces(3))
        with pytest.raises(SignalError, match=r"wrong length, expected 2: .'mass2.f', 'base.d'., got 3"):
            stepper.step(6, np.zeros(3))
        with pytest.raises(SignalError, match=r"input 'base.d' is inf at t = 0.001 s"):
            stepper.step(MS, np.array([0.0, np.inf]))
        record = forces(3)
        record.values[1, 0] = np.nan
        with pytest.raises(SignalError, match=r"input 'mass2.f' is nan at t = 0.002 s"):
            stepper.process(Record(record.t_ns + MS, record.values, record.channels))
        with pytest.raises(
            SignalError, match=r"columns are not the inputs.*expected .'mass2.f', 'base.d'., got .'base.d'."
        ):
            stepper.process(record.select(["base.d"]))
        with pytest.raises(SignalError, match=r"base.d: units do not fit"):
            stepper.process(Record(record.t_ns, record.values, (Channel("mass2.f"), Channel("base.d", "kg"))))
        stepper.step(10, np.zeros(2))  # none of these reached the solver
