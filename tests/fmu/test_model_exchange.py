"""FMUs of model exchange with CVODE in them, against closed forms, against scipy, and against fmpy's own simulation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
from exchange_fmu import STATES, TROUBLE, description, exchange
from exported import by_pythonfmu
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from trouble_fmu import packed

from fmucorrect.errors import FmuError
from fmucorrect.fmu import FmuStepper, IsolatedStepper, model_exchange, open_fmu
from fmucorrect.fmu.simulation import Simulation
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import grid, run

MS = 1_000_000
Make = Callable[[str], Path]


@pytest.fixture
def made(tmp_path: Path, exchange_library: Path, version: str) -> Make:
    """The FMU of a model."""
    return lambda model: exchange(tmp_path / f"{model}.fmu", model, exchange_library, version)


def channels(*names: str) -> tuple[Channel, ...]:
    return tuple(Channel(name, unit="") for name in names)


def free(
    path: Path,
    names: tuple[str, ...],
    duration: float,
    step_ns: int = 10 * MS,
    tolerance: float | None = None,
    **parameters: float,
) -> Record:
    """Simulated without inputs."""
    with FmuStepper(path, channels(*names), tolerance=tolerance) as stepper:
        out = run(stepper, Condition("free", parameters=parameters), grid(duration, step_ns))
    assert out is not None
    return out


def driven(rows: int, step_ns: int = MS, gear: np.ndarray | None = None, seed: int = 0) -> Record:
    force = np.random.default_rng(seed).normal(size=rows) * 0.3
    gears = np.zeros(rows) if gear is None else gear
    t_ns = np.arange(rows, dtype=np.int64) * step_ns
    return Record(t_ns, np.stack([force, gears], axis=1), (Channel("f", "N"), Channel("gear")))


def held(record: Record, k: float = 1800.0, c: float = 3.0, m: float = 2.0) -> np.ndarray:
    """x of the mass under inputs that are held from each row to the next, exactly."""
    h = float(record.t_ns[1] - record.t_ns[0]) / 1e9
    whole = np.zeros((3, 3))
    whole[:2] = [[0, 1, 0], [-k / m, -c / m, 1 / m]]
    step = expm(whole * h)
    state, found = np.zeros(2), [0.0]
    for force, gear in record.values[:-1]:
        state = step[:2, :2] @ state + step[:2, 2] * (force + 10 * gear)
        found.append(state[0])
    return np.array(found)


def impacts(until: float, g: float = 9.81, e: float = 0.7) -> list[float]:
    times, flight = [np.sqrt(2 / g)], 2 * np.sqrt(2 / g)
    while times[-1] < until:
        flight *= e
        times.append(times[-1] + flight)
    return times[:-1]


def test_the_ball_is_where_the_closed_form_says(made: Make):
    out = free(made("ball"), ("h", "discrete"), 2.0, MS)
    times, t = impacts(2.0), out.seconds()
    np.testing.assert_array_equal(out["discrete"], np.searchsorted(times, t))
    expected = 1 - 0.5 * 9.81 * t**2
    speed = np.sqrt(2 * 9.81)
    for begin in times:
        speed *= 0.7
        later = t >= begin
        expected[later] = speed * (t[later] - begin) - 0.5 * 9.81 * (t[later] - begin) ** 2
    np.testing.assert_allclose(out["h"], expected, rtol=0, atol=2e-5)


def test_the_ball_bounces_on_time_whatever_the_step(made: Make):
    fine = free(made("ball"), ("h", "v"), 2.0, 5 * MS)
    coarse = free(made("ball"), ("h", "v"), 2.0, 50 * MS)
    np.testing.assert_allclose(coarse.values, fine.values[::10], rtol=0, atol=5e-5)


def test_the_ball_comes_to_rest(made: Make):
    out = free(made("ball"), ("h", "v"), 4.0)
    assert out.values[-1].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("mu", [1.0, 100.0])
def test_van_der_pol(made: Make, mu: float):
    """mu = 100 is stiff."""
    out = free(made("pol"), ("x0", "x1", "steps"), 20.0, 100 * MS, mu=mu)
    true = solve_ivp(
        lambda t, x: [x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]], (0, 20), [2, 0], "Radau", out.seconds(), rtol=1e-10, atol=1e-12
    )  # fmt: skip
    np.testing.assert_allclose(out["x0"], true.y[0], rtol=0, atol=1e-5)
    assert out["steps"][-1] < 4000
    loose = free(made("pol"), ("x0", "steps"), 20.0, 100 * MS, 1e-4, mu=mu)
    assert loose["steps"][-1] < out["steps"][-1]


def test_the_stair_goes_up_exactly_on_time(made: Make):
    """Also where the intervals, added up in floating point, lie a rounding before or after a sample."""
    out = free(made("stair"), ("discrete",), 5.0)
    np.testing.assert_array_equal(out["discrete"], 1 + np.arange(501) // 100)
    fine = free(made("stair"), ("discrete",), 3.0, 100 * MS, interval=0.1)
    np.testing.assert_array_equal(fine["discrete"], 1 + np.arange(31))
    between = free(made("stair"), ("discrete", "events"), 3.0, 1000 * MS, interval=0.3)
    np.testing.assert_array_equal(between["discrete"], [1, 4, 7, 11])
    np.testing.assert_array_equal(between["events"], [1, 4, 7, 11])  # none is made twice


def test_decay(made: Make):
    out = free(made("dahlquist"), ("x",), 5.0, k=3.0)
    np.testing.assert_allclose(out["x"], np.exp(-3 * out.seconds()), rtol=0, atol=2e-5)


@pytest.mark.parametrize("model", STATES)
def test_same_as_fmpy(made: Make, model: str):
    names = (*STATES[model], "discrete")
    path = made(model)
    expected = fmpy.simulate_fmu(
        str(path), fmi_type="ModelExchange", stop_time=2.0, output_interval=0.01, relative_tolerance=1e-8, output=list(names),
        start_values={"x": 0.01} if model == "mass" else {}, record_events=False,
    )  # fmt: skip
    out = free(path, names, 2.0, tolerance=1e-8, **({"x": 0.01} if model == "mass" else {}))
    assert np.ptp(out.values, axis=0).any()
    np.testing.assert_allclose(out.values, np.stack([expected[name] for name in names], axis=1), rtol=0, atol=2e-5)


def test_inputs_are_held_as_in_co_simulation(made: Make):
    record = driven(3000)
    with FmuStepper(made("mass"), channels("x", "steps", "events"), inputs=("f", "gear"), tolerance=1e-6) as stepper:
        stepper.reset(Condition("driven"))
        out = stepper.process(record)
    expected = held(record)
    assert np.abs(out["x"] - expected).max() < 3e-6 < 0.02 * np.abs(expected).max()
    assert out["events"][-1] < 20  # those of the switch alone: a sample is no event
    assert out["steps"][-1] < 2 * len(record)


def test_a_smooth_input_is_followed_without_delay(made: Make):
    record = driven(3000)
    record.values[:, 0] = 0.9 * np.sin(2 * np.pi * 3 * record.seconds())
    with FmuStepper(made("mass"), channels("x"), inputs=("f", "gear")) as stepper:
        stepper.reset(Condition("driven"))
        out = stepper.process(record)
    expected = held(record)
    assert np.abs(out["x"] - expected).max() < 3e-4 * np.abs(expected).max()


def test_a_gear_is_shifted_at_an_event_and_only_where_it_changes(made: Make):
    gear = np.zeros(400)
    gear[100:250] = 2
    record = driven(400, gear=gear)
    record.values[:, 0] = 0.0
    with FmuStepper(made("mass"), channels("x", "events"), inputs=("f", "gear"), tolerance=1e-8) as stepper:
        stepper.reset(Condition("driven"))
        out = stepper.process(record)
        stepper.reset(Condition("again"))
        np.testing.assert_array_equal(stepper.process(record).values, out.values)
    assert out["events"][-1] == 3
    np.testing.assert_allclose(out["x"], held(record), rtol=0, atol=2e-6)


def test_an_input_that_jumps_over_an_indicator_is_an_event_at_its_sample(made: Make):
    record = driven(30)
    record.values[:, 0] = np.where(np.arange(30) < 10, 0.5, np.where(np.arange(30) < 20, 1.5, 0.5))
    with FmuStepper(made("mass"), channels("discrete"), inputs=("f", "gear")) as stepper:
        stepper.reset(Condition("driven"))
        out = stepper.process(record)
    np.testing.assert_array_equal(out["discrete"], record.values[:, 0] > 1)


def test_a_stiff_mass_under_noise(made: Make):
    record = driven(300)
    with FmuStepper(made("mass"), channels("x"), inputs=("f", "gear"), tolerance=1e-8) as stepper:
        stepper.reset(Condition("stiff", parameters={"k": 1e9, "c": 1e6}))
        out = stepper.process(record)
    np.testing.assert_allclose(out["x"], held(record, 1e9, 1e6), rtol=0, atol=1e-8)


def test_back_to_a_state_is_the_same_to_the_bit(made: Make, version: str):
    record = driven(200, gear=np.repeat([0.0, 1.0, 0.0, 2.0], 50))
    with FmuStepper(made("mass"), channels("x", "events"), inputs=("f", "gear")) as stepper:
        stepper.reset(Condition("driven"))
        stepper.process(record.rows(0, 80))
        state = stepper.get_state()
        first = stepper.process(record.rows(80, 200))
        stepper.set_state(state)
        np.testing.assert_array_equal(stepper.process(record.rows(80, 200)).values, first.values)
        content = stepper.save_state(state)
        stepper.free_state(state)
        stepper.reset(Condition("elsewhere"))
        stepper.process(record.rows(0, 1))
        state = stepper.load_state(content, int(record.t_ns[79]))
        stepper.set_state(state)
        np.testing.assert_array_equal(stepper.process(record.rows(80, 200)).values, first.values)
        stepper.free_state(state)


def test_a_time_event_comes_again_after_going_back(made: Make):
    with Simulation(made("stair"), channels("discrete"), step_size=0.1) as simulation:
        simulation.start({"interval": 0.25})
        simulation.run(2)
        state = simulation.save()
        first = simulation.run(20)
        simulation.restore(state)
        np.testing.assert_array_equal(simulation.run(20), first)
        assert first[-1, 0] == 9


def test_in_a_process_of_its_own(made: Make):
    record = driven(500)
    results = []
    for kind in (FmuStepper, IsolatedStepper):
        with kind(made("mass"), channels("x", "discrete"), inputs=("f", "gear")) as stepper:
            stepper.reset(Condition("driven"))
            results.append(stepper.process(record).values)
            stepper.reset(Condition("row by row"))
            rows = zip(record.t_ns.tolist(), record.values, strict=True)
            results.append(np.array([stepper.step(t_ns, u).simulated for t_ns, u in rows]))
    for other in results[1:]:
        np.testing.assert_array_equal(other, results[0])


@pytest.mark.parametrize(
    ("trouble", "message"),
    [
        ("REFUSE_LATE", r"CVODE, the integrator, gave up at t = 0\.(5|49)"),
        ("NOT_A_NUMBER", r"CVODE, the integrator, gave up at t = 0\.(5|49)"),
        ("FAIL", r"Derivatives returned 'error' at t = 0\.5"),
        ("END", r"the model asked to end the simulation at t = 0\.5 s"),
        ("ENDLESS_EVENT", r"does not settle at its event at t = 0\.5 s"),
    ],
)
@pytest.mark.parametrize("kind", [FmuStepper, IsolatedStepper])
def test_trouble_is_one_error_with_its_time(made: Make, trouble: str, message: str, kind: type[FmuStepper]):
    with kind(made("dahlquist"), channels("x")) as stepper:
        stepper.reset(Condition("trouble", parameters={"trouble": TROUBLE[trouble], "at": 0.5}))
        record = Record(np.arange(101, dtype=np.int64) * 10 * MS, np.zeros((101, 0)), ())
        with pytest.raises(FmuError, match=message) as caught:
            stepper.process(record)
        assert len(caught.value.finished) in (49, 50, 51)
        np.testing.assert_allclose(
            caught.value.finished["x"], np.exp(-caught.value.finished.seconds()), rtol=0, atol=1e-4
        )
        stepper.reset(Condition("again"))
        assert stepper.process(record)["x"][-1] == pytest.approx(np.exp(-1), abs=1e-5)


def test_a_point_that_the_model_refuses_is_reached_in_shorter_steps(made: Make):
    out = free(made("dahlquist"), ("x",), 1.0, trouble=TROUBLE["DISCARD_LONG"], at=0.3)
    np.testing.assert_allclose(out["x"], np.exp(-out.seconds()), rtol=0, atol=1e-4)


def test_an_end_that_was_agreed_on_is_an_error_all_the_same(made: Make):
    with pytest.raises(FmuError, match="asked to end the simulation at t = 3 s"):
        free(made("stair"), ("discrete",), 5.0, last=3.0)


def test_a_ball_that_bounces_ever_faster_is_refused(made: Make, monkeypatch: pytest.MonkeyPatch):
    """Without v_min it bounces infinitely often before t = 2.6 s; to give up the sooner takes less time."""
    monkeypatch.setattr(model_exchange, "_STEPS", 5000)
    with pytest.raises(FmuError, match=r"CVODE, the integrator, (gave up at|is at) t? ?=? ?2\.5"):
        free(made("ball"), ("h",), 4.0, v_min=0.0)


def test_co_simulation_stays_the_choice_where_there_is_one(tmp_path: Path, library: Path, version: str):
    from trouble_fmu import description as of_trouble

    both = of_trouble(version).replace(
        '<CoSimulation modelIdentifier="trouble"/>',
        '<ModelExchange modelIdentifier="other"/><CoSimulation modelIdentifier="trouble"/>',
    )
    fmu = open_fmu(packed(tmp_path / "a.fmu", both, library, version))
    assert (fmu.identifier, fmu.exchange) == ("trouble", None)


def test_what_is_opened_says_so(made: Make, version: str):
    fmu = open_fmu(made("ball"))
    assert fmu.exchange is not None
    assert fmu.exchange.completed_steps
    assert fmu.capabilities == ("get and set state", "serialise state")


_SLAVE = """
from pythonfmu3 import Fmi3Causality, Fmi3Initial, Fmi3SlaveBase, Fmi3Variability, Float64, ModelExchange

class Decay(Fmi3SlaveBase, ModelExchange):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.k, self.x, self.derx = 0.0, 1.0, 1.0, 0.0
        free = {"variability": Fmi3Variability.continuous}
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, **free))
        self.register_variable(Float64("x", causality=Fmi3Causality.output, start=1, initial=Fmi3Initial.exact, **free))
        self.register_variable(Float64("derx", causality=Fmi3Causality.local, derivative=1, **free))
        self.register_variable(Float64("k", causality=Fmi3Causality.parameter, variability=Fmi3Variability.fixed))

    def get_continuous_state_derivatives(self):
        self.derx = -self.k * self.x
        return [self.derx]
"""


def test_one_that_pythonfmu3_exported(tmp_path: Path):
    pytest.importorskip("pythonfmu3")
    path = by_pythonfmu(tmp_path, "Decay", _SLAVE, package="pythonfmu3")
    with IsolatedStepper(path, channels("x")) as stepper:
        out = run(stepper, Condition("decay", parameters={"k": 2.0}), grid(2.0, 10 * MS))
    assert out is not None
    np.testing.assert_allclose(out["x"], np.exp(-2 * out.seconds()), rtol=0, atol=1e-6)


def test_steps_are_told_only_where_that_is_wanted(tmp_path: Path, exchange_library: Path, version: str):
    attributes = (
        'completedIntegratorStepNotNeeded="true"' if version == "2.0" else 'needsCompletedIntegratorStep="false"'
    )
    xml = description("pol", version, attributes=attributes)
    out = free(packed(tmp_path / "a.fmu", xml, exchange_library, version), ("x0", "steps"), 1.0)
    assert out["steps"][-1] == 0
    np.testing.assert_array_equal(
        out["x0"], free(exchange(tmp_path / "b.fmu", "pol", exchange_library, version), ("x0",), 1.0)["x0"]
    )
